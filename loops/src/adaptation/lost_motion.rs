//! Where a scale shows the table: how wide the gap is.

use bytemuck::{Pod, Zeroable};

/// Part of the error of the gap that a stroke makes up for.
const GAIN: f64 = 0.3;
/// Most that the gap is off the tuned one: a part of that, and in mm.
const PART_MAX: f64 = 0.5;
const MAX_MM: f64 = 3e-3;
/// Distance from the reversal beyond which friction has turned round, in mm.
const FAR_MM: f64 = 0.3;
/// What the gap may seem to be off, in mm: the model's springs and mass are no better.
const DEAD_ZONE_MM: f64 = 0.25e-3;
/// Scans beyond that distance that a stroke needs.
const SCANS_MIN: f64 = 20.0;

/// Compares what motor and table are apart with what the model says.
///
/// ```text
/// off      r = (x1 − x2) − compensation            the table's own error, whatever the motor does
/// gap      g ← g + 0.3·(r₊ − r₋)                   r±: mean farther than 0.3 mm from reversals, in the last stroke of each direction,
///                                                 where that is above 0.25 µm
/// ```
///
/// The zeros of encoder and scale may be apart: only the difference of the directions counts. What is found is lost motion as a
/// whole, a screw that gives more than in the model included. Bounded: at most half of the tuned gap, or 3 µm where that is more, and never
/// below no gap. Without a scale x1 − x2 is 0, and nothing changes. Units: mm. Source: docs/methods/adaptation.md.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LostMotion {
    /// Tuned gap, in mm.
    pub gap_mm: f64,
}

/// What [`LostMotion`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LostMotionState {
    /// Sum, in mm, and count of what was off far from the reversal in this stroke.
    far: [f64; 2],
    /// Its mean in the last stroke in negative and in positive direction, in mm.
    off_mm: [f64; 2],
    /// 1 where there was one.
    known: [f64; 2],
    /// Believed gap beyond the tuned one, in mm, and what of it is in force.
    gap_mm: f64,
    /// Gap beyond the tuned one that is in force, in mm.
    pub in_force_mm: f64,
}

impl LostMotion {
    /// A scan of steady motion; `wind_mm` is motor less scale, `distance_mm` the way since the reversal.
    pub fn update(
        &self,
        state: &mut LostMotionState,
        wind_mm: f64,
        compensation_mm: f64,
        distance_mm: f64,
    ) {
        if wind_mm != 0.0 && self.gap_mm > 0.0 && distance_mm > FAR_MM {
            let [sum_mm, count] = &mut state.far;
            *sum_mm += wind_mm - compensation_mm;
            *count += 1.0;
        }
    }

    /// The command reverses, after a stroke in this direction.
    pub fn end_stroke(&self, state: &mut LostMotionState, direction: f64) {
        let [sum_mm, count] = core::mem::take(&mut state.far);
        if count < SCANS_MIN {
            return;
        }
        let mut places = state.off_mm.iter_mut().zip(&mut state.known);
        if let Some((off_mm, known)) = places.nth(usize::from(direction > 0.0)) {
            *off_mm = sum_mm / count;
            *known = 1.0;
        }
        if state.known != [1.0; 2] {
            return;
        }
        let [back_mm, forth_mm] = state.off_mm;
        if (forth_mm - back_mm).abs() < DEAD_ZONE_MM {
            return;
        }
        let most_mm = (PART_MAX * self.gap_mm).max(MAX_MM);
        let wanted_mm = state.gap_mm + GAIN * (forth_mm - back_mm);
        state.gap_mm = wanted_mm.max(-most_mm.min(self.gap_mm)).min(most_mm);
    }

    /// What is believed comes into force by a part.
    pub fn come_into_force(&self, state: &mut LostMotionState, part: f64) {
        state.in_force_mm += part * (state.gap_mm - state.in_force_mm);
    }
}

impl LostMotionState {
    /// The axis is moved by others: what is known stays, what was being looked at does not.
    pub fn leave(&mut self) {
        self.far = [0.0; 2];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TUNED: LostMotion = LostMotion { gap_mm: 5e-3 };

    /// Strokes to and fro with this gap; zeros 20 µm apart.
    fn strokes(count: u32, gap_mm: f64, state: &mut LostMotionState) {
        for stroke in 0..count {
            let side = if stroke % 2 == 0 { 1.0 } else { -1.0 };
            for step in 0..100 {
                let compensation_mm = 0.5 * side * (TUNED.gap_mm + state.in_force_mm);
                let wind_mm = 0.5 * side * gap_mm + 0.02;
                TUNED.update(state, wind_mm, compensation_mm, f64::from(step) * 0.05);
                TUNED.come_into_force(state, 0.1);
            }
            TUNED.end_stroke(state, side);
        }
    }

    #[test]
    fn a_gap_that_grew_or_shrank_is_found_wherever_the_zeros_are() {
        for gap_mm in [4e-3, 5e-3, 7e-3] {
            let mut state = LostMotionState::default();
            strokes(30, gap_mm, &mut state);
            let found_mm = TUNED.gap_mm + state.in_force_mm;
            assert!((found_mm - gap_mm).abs() < 3e-4, "{found_mm}");
        }
    }

    #[test]
    fn an_axis_without_a_scale_keeps_its_gap_and_one_that_fell_apart_its_bounds() {
        let mut state = LostMotionState::default();
        for _ in 0..10 {
            for step in 0..100 {
                TUNED.update(&mut state, 0.0, 2.5e-3, f64::from(step));
            }
            TUNED.end_stroke(&mut state, 1.0);
        }
        assert_eq!(state, LostMotionState::default());
        strokes(60, 0.1, &mut state);
        assert!((state.in_force_mm - MAX_MM).abs() < 1e-5);
        strokes(200, -0.1, &mut state);
        assert!((-5e-3..-2e-3).contains(&state.in_force_mm));
    }
}
