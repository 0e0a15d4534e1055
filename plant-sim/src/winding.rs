//! Heat of the motor winding.

use bytemuck::{Pod, Zeroable};

/// The constants of [`WindingSettings::update`] for one period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindingSettings {
    rise_k_per_nm2: f64,
    decay: f64,
    period_s: f64,
}

/// Heat of one winding.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct WindingState {
    /// Rise over the ambient, in K.
    pub rise_k: f64,
    /// Integral of the squared torque since the start, in N²·m²·s; the root of its mean over time is the rms torque.
    pub torque_square_nm2_s: f64,
}

impl WindingSettings {
    /// Prepares a winding for periods of `period_s`: its rise over the ambient at this continuous torque, and its thermal time constant.
    pub fn new(rated_nm: f64, rise_at_rated_k: f64, time_constant_s: f64, period_s: f64) -> Self {
        WindingSettings {
            rise_k_per_nm2: rise_at_rated_k / (rated_nm * rated_nm),
            decay: libm::exp(-period_s / time_constant_s),
            period_s,
        }
    }

    /// One period at this mean square of the torque, in N²·m².
    ///
    /// `θ' = (100 K·(T/T_rated)² − θ)/τ_th`, solved exactly for a constant square (docs/methods/physics.md §3). First call: cold.
    pub fn update(&self, state: &mut WindingState, torque_square_nm2: f64) {
        let end_k = self.rise_k_per_nm2 * torque_square_nm2;
        state.rise_k = end_k + (state.rise_k - end_k) * self.decay;
        state.torque_square_nm2_s += torque_square_nm2 * self.period_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_winding_warms_by_the_first_order_law() {
        let settings = WindingSettings::new(8.0, 100.0, 2400.0, 1e-3);
        let mut state = WindingState::default();
        for _ in 0..2_400_000 {
            settings.update(&mut state, 36.0);
        }
        let expected_k = 56.25 * (1.0 - libm::exp(-1.0));
        let rise_k = state.rise_k;
        assert!(
            (rise_k - expected_k).abs() < 1e-6,
            "{rise_k} K, theory {expected_k} K"
        );
        let rms_nm = (state.torque_square_nm2_s / 2400.0).sqrt();
        assert!((rms_nm - 6.0).abs() < 1e-9, "{rms_nm} N·m");
    }
}
