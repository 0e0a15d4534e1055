//! Friction as a function of distance: Maxwell slip elements.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

/// Elements of one curve.
pub const ELEMENTS: usize = 6;

/// One spring that slips.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlipElement {
    /// Force at which it slips in steady sliding, in N.
    pub slip_n: f64,
    /// Distance over which it is wound up to that from rest, in mm.
    pub break_distance_mm: f64,
}

/// Springs side by side, each of which slips at its own force: after a reversal friction turns round over a distance, and a
/// short way back is remembered.
///
/// `F = Σ F_i`, `F_i ← clamp(F_i + (S_i/Δ_i)·Δx, ±S_i·s(v))`, `s(v) = 1 + r·exp(−(v/v_s)²)`. Rate-independent but for the Stribeck
/// factor s. Source: Maxwell slip (Iwan 1966), with the Stribeck curve of docs/physics.md §2. Units: mm, mm/s, N. First call:
/// no spring is wound. A change of position that is not a number changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MaxwellSlip {
    /// The springs; those with `slip_n` = 0 do nothing.
    pub elements: [SlipElement; ELEMENTS],
    /// r: break-away over Coulomb friction, less 1.
    pub static_excess: f64,
    /// v_s, in mm/s.
    pub stribeck_velocity_mm_s: f64,
}

impl MaxwellSlip {
    /// Friction in steady sliding, beyond the Stribeck velocity, in N.
    pub fn coulomb_n(&self) -> f64 {
        self.elements.iter().map(|element| element.slip_n).sum()
    }

    /// Moves on by `travel_mm` at `velocity_mm_s`, with `scale` times the friction of the curve; the friction, in N, positive in the direction of positive motion.
    pub fn update(
        &self,
        state: &mut [f64; ELEMENTS],
        travel_mm: f64,
        velocity_mm_s: f64,
        scale: f64,
    ) -> f64 {
        let ratio = velocity_mm_s / self.stribeck_velocity_mm_s;
        let factor = if self.static_excess > 0.0 {
            1.0 + self.static_excess * libm::exp(-ratio * ratio)
        } else {
            1.0
        };
        let mut sum_n = 0.0;
        for (force_n, element) in state.iter_mut().zip(&self.elements) {
            if travel_mm.is_finite() && element.break_distance_mm > 0.0 {
                let most_n = scale * element.slip_n * factor;
                let stiffness = scale * element.slip_n / element.break_distance_mm;
                *force_n = (*force_n + stiffness * travel_mm).max(-most_n).min(most_n);
            }
            sum_n += *force_n;
        }
        sum_n
    }
}
