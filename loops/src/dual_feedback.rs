//! One position out of two encoders: the motor's for what is fast, the scale's for what stays.
use bytemuck::{Pod, Zeroable};

/// Takes over into the motor's position error what the scale's says beyond it, at once or through a first-order filter.
///
/// `c ← c + share·((scale error − motor error) − c)`; the loop works with `motor error + c`. Source: dual position feedback of
/// docs/methods/full-closed-loop.md. Units: mm. First call: c is 0. Limits: a share of 1 is the scale alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DualFeedback {
    /// Part of the difference that is taken over in one scan, above 0 up to 1.
    pub share: f64,
}

/// What [`DualFeedback`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct DualFeedbackState {
    /// c, in mm.
    pub correction_mm: f64,
}

impl DualFeedback {
    /// Where the scale counts at once, or the time constant is 0.
    pub const SCALE: DualFeedback = DualFeedback { share: 1.0 };

    /// With this time constant, in s.
    pub fn with_time_constant(time_constant_s: f64, scan_s: f64) -> DualFeedback {
        if time_constant_s > 0.0 {
            DualFeedback {
                share: 1.0 - libm::exp(-scan_s / time_constant_s),
            }
        } else {
            Self::SCALE
        }
    }

    /// One scan: the position error that the loop works with, in mm.
    pub fn update(&self, state: &mut DualFeedbackState, motor_mm: f64, scale_mm: f64) -> f64 {
        let missing_mm = scale_mm - motor_mm;
        state.correction_mm += self.share * (missing_mm - state.correction_mm);
        motor_mm + state.correction_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_time_constant_the_scale_alone_counts() {
        let mut state = DualFeedbackState::default();
        let block = DualFeedback::with_time_constant(0.0, 1e-3);
        for (motor_mm, scale_mm) in [(0.5, 0.25), (0.75, -0.5), (0.0, 1.0)] {
            assert_eq!(block.update(&mut state, motor_mm, scale_mm), scale_mm);
        }
    }

    #[test]
    fn a_step_of_the_scale_comes_in_by_63_percent_in_the_time_constant() {
        let mut state = DualFeedbackState::default();
        let block = DualFeedback::with_time_constant(20e-3, 1e-3);
        let mut found_mm = 0.0;
        for _ in 0..20 {
            found_mm = block.update(&mut state, 0.0, 1.0);
        }
        assert!((found_mm - 0.632).abs() < 1e-3, "{found_mm}");
        // What the motor does is seen at once.
        assert!((block.update(&mut state, 0.1, 1.1) - found_mm - 0.1).abs() < 0.02);
    }
}
