//! A mass that swings on the table: a fixture, a column, a tall workpiece.

use bytemuck::{Pod, Zeroable};

/// The mass and what holds it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttachedMass {
    step_s: f64,
    step_s_per_kg: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
}

/// Where it is.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct AttachedMassState {
    /// From its place on the table, in m.
    pub off_m: f64,
    /// Its speed, in m/s.
    pub velocity_m_s: f64,
}

impl AttachedMass {
    /// Of this mass, that rings at this frequency and damping on a table that is held.
    pub fn new(mass_kg: f64, frequency_hz: f64, damping_ratio: f64, step_s: f64) -> Self {
        let rate_rad_s = 2.0 * std::f64::consts::PI * frequency_hz;
        AttachedMass {
            step_s,
            step_s_per_kg: step_s / mass_kg,
            stiffness_n_per_m: mass_kg * rate_rad_s * rate_rad_s,
            damping_n_s_per_m: 2.0 * damping_ratio * mass_kg * rate_rad_s,
        }
    }

    /// One microstep on a table with this speed: the force on the table, in N.
    #[inline]
    pub fn update(&self, state: &mut AttachedMassState, table_m_s: f64) -> f64 {
        let force_n = self.stiffness_n_per_m * state.off_m
            + self.damping_n_s_per_m * (state.velocity_m_s - table_m_s);
        state.velocity_m_s -= self.step_s_per_kg * force_n;
        state.off_m += self.step_s * (state.velocity_m_s - table_m_s);
        force_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_rings_at_its_frequency_and_dies_away() {
        let mass = AttachedMass::new(40.0, 90.0, 0.02, 25e-6);
        let mut state = AttachedMassState {
            off_m: 1e-5,
            ..AttachedMassState::default()
        };
        let mut crossings = 0;
        let mut before_m = state.off_m;
        for _ in 0..40_000 {
            mass.update(&mut state, 0.0);
            crossings += u32::from(before_m * state.off_m < 0.0);
            before_m = state.off_m;
        }
        assert!((179..=181).contains(&crossings), "{crossings}");
        assert!(state.off_m.abs() < 1e-9);
    }
}
