//! A mass that swings: on the table (a fixture, a column, a tall workpiece), or under it (the frame that carries an axis).

use bytemuck::{Pod, Zeroable};

/// The mass and what holds it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swinging {
    step_s: f64,
    step_s_per_kg: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
}

/// Where it is.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SwingingState {
    /// From its place on the table or the ground, in m.
    pub off_m: f64,
    /// Its speed, in m/s.
    pub velocity_m_s: f64,
}

impl Swinging {
    /// Of this mass, that rings at this frequency and damping on a table that is held, or on the ground where nothing moves on it.
    pub fn new(mass_kg: f64, frequency_hz: f64, damping_ratio: f64, step_s: f64) -> Self {
        let rate_rad_s = 2.0 * std::f64::consts::PI * frequency_hz;
        Swinging {
            step_s,
            step_s_per_kg: step_s / mass_kg,
            stiffness_n_per_m: mass_kg * rate_rad_s * rate_rad_s,
            damping_n_s_per_m: 2.0 * damping_ratio * mass_kg * rate_rad_s,
        }
    }

    /// One microstep on a table with this speed: the force on the table, in N.
    #[inline]
    pub fn on_table(&self, state: &mut SwingingState, table_m_s: f64) -> f64 {
        let force_n = self.stiffness_n_per_m * state.off_m
            + self.damping_n_s_per_m * (state.velocity_m_s - table_m_s);
        state.velocity_m_s -= self.step_s_per_kg * force_n;
        state.off_m += self.step_s * (state.velocity_m_s - table_m_s);
        force_n
    }

    /// One microstep in which the frame drives its table with this force, in N: by how much faster the frame is then, in m/s. Whatever is
    /// measured from the frame is slower by as much.
    #[inline]
    pub fn under_table(&self, state: &mut SwingingState, drives_n: f64) -> f64 {
        let held_n =
            self.stiffness_n_per_m * state.off_m + self.damping_n_s_per_m * state.velocity_m_s;
        let faster_m_s = -self.step_s_per_kg * (drives_n + held_n);
        state.velocity_m_s += faster_m_s;
        state.off_m += self.step_s * state.velocity_m_s;
        faster_m_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_rings_at_its_frequency_and_dies_away() {
        let mass = Swinging::new(40.0, 90.0, 0.02, 25e-6);
        let mut state = SwingingState {
            off_m: 1e-5,
            ..SwingingState::default()
        };
        let mut crossings = 0;
        let mut before_m = state.off_m;
        for _ in 0..40_000 {
            mass.on_table(&mut state, 0.0);
            crossings += u32::from(before_m * state.off_m < 0.0);
            before_m = state.off_m;
        }
        assert!((179..=181).contains(&crossings), "{crossings}");
        assert!(state.off_m.abs() < 1e-9);
    }

    #[test]
    fn it_rings_at_its_frequency_and_gives_way_by_the_force_over_its_stiffness() {
        let frame = Swinging::new(2000.0, 30.0, 0.05, 25e-6);
        let mut state = SwingingState::default();
        let still_m = -800.0 / (2000.0 * (2.0 * std::f64::consts::PI * 30.0_f64).powi(2));
        let mut crossings = 0;
        for _ in 0..40_000 {
            let before_m = state.off_m - still_m;
            frame.under_table(&mut state, 800.0);
            crossings += u32::from(before_m * (state.off_m - still_m) < 0.0);
            if state.velocity_m_s == 0.0 {
                break;
            }
        }
        assert!((59..=61).contains(&crossings), "{crossings}");
        assert!((state.off_m / still_m - 1.0).abs() < 1e-3, "{state:?}");
    }
}
