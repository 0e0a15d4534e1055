//! Velocity loop of torque mode.
use bytemuck::{Pod, Zeroable};

/// Proportional-integral velocity loop with a torque limit and anti-windup.
///
/// `T = Kv·(v_c − v) + I`, `I += Kv·(v_c − v)·Tp/Ti`, |T| ≤ limit. While the limit acts, the integrator takes in only what
/// leads out of it (conditional integration: nothing to tune, and no jump when the limit lets go). Source: the drive loop
/// of docs/methods/physics.md §3–4. Units: mm/s in, N·m at the motor out. First call: integrator 0. An input that is not a number gives a
/// torque that is not a number and leaves the integrator alone: the caller stops the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityLoop {
    /// Kv at the motor, in N·m per mm/s.
    pub gain_nm_s_per_mm: f64,
    /// Tp/Ti.
    pub scans_per_integral_time_inverse: f64,
    /// Torque limit, in N·m.
    pub limit_nm: f64,
}

/// What [`VelocityLoop`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct VelocityLoopState {
    /// The integrator, in N·m.
    pub integrator_nm: f64,
}

/// Torque and whether the limit acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torque {
    /// In N·m at the motor.
    pub torque_nm: f64,
    /// Whether it is at its limit.
    pub limited: bool,
}

impl VelocityLoop {
    /// From the gain at the table in N·s/m, the integral time, the scan and the travel per motor turn.
    pub fn new(
        gain_n_s_per_m: f64,
        integral_time_s: f64,
        scan_s: f64,
        lead_mm: f64,
        limit_nm: f64,
    ) -> VelocityLoop {
        // N at the table · lead/2π (in m) = N·m; speeds come in mm/s.
        let metres_per_radian = lead_mm * 1e-3 / (2.0 * core::f64::consts::PI);
        VelocityLoop {
            gain_nm_s_per_mm: gain_n_s_per_m * metres_per_radian * 1e-3,
            scans_per_integral_time_inverse: scan_s / integral_time_s,
            limit_nm,
        }
    }

    /// One scan.
    pub fn update(
        &self,
        state: &mut VelocityLoopState,
        command_mm_s: f64,
        velocity_mm_s: f64,
    ) -> Torque {
        let proportional = self.gain_nm_s_per_mm * (command_mm_s - velocity_mm_s);
        let step = proportional * self.scans_per_integral_time_inverse;
        let wanted = proportional + state.integrator_nm + step;
        if !wanted.is_finite() {
            return Torque {
                torque_nm: f64::NAN,
                limited: false,
            };
        }
        let limited = wanted.abs() > self.limit_nm;
        if !limited || wanted * step < 0.0 {
            state.integrator_nm += step;
        }
        Torque {
            torque_nm: wanted.clamp(-self.limit_nm.abs(), self.limit_nm.abs()),
            limited,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOP: VelocityLoop = VelocityLoop {
        gain_nm_s_per_mm: 0.4,
        scans_per_integral_time_inverse: 0.025,
        limit_nm: 32.0,
    };

    #[test]
    fn the_reference_gain_is_as_computed_by_hand() {
        // 257400 N·s/m · 1.5915e-3 m/rad = 409.66 N·m per m/s.
        let found = VelocityLoop::new(257_400.0, 0.010, 250e-6, 10.0, 32.0);
        assert!(
            (found.gain_nm_s_per_mm - 0.409_66).abs() < 1e-4,
            "{found:?}"
        );
        assert_eq!(found.scans_per_integral_time_inverse, 0.025);
    }

    #[test]
    fn the_integrator_reaches_proportional_after_one_integral_time() {
        let mut state = VelocityLoopState::default();
        for _ in 0..40 {
            LOOP.update(&mut state, 1.0, 0.0);
        }
        assert!((state.integrator_nm - 0.4).abs() < 1e-12);
    }

    #[test]
    fn at_the_limit_the_integrator_does_not_wind_up() {
        let mut state = VelocityLoopState::default();
        for _ in 0..10_000 {
            let out = LOOP.update(&mut state, 200.0, 0.0);
            assert_eq!(
                out,
                Torque {
                    torque_nm: 32.0,
                    limited: true
                }
            );
        }
        assert_eq!(state.integrator_nm, 0.0);
        let out = LOOP.update(&mut state, 1.0, 0.0);
        assert!(!out.limited);
    }

    #[test]
    fn it_leaves_the_limit_by_itself() {
        let mut state = VelocityLoopState {
            integrator_nm: 40.0,
        };
        for _ in 0..2_000 {
            LOOP.update(&mut state, 0.0, 1.0);
        }
        assert!(state.integrator_nm < 32.0, "{state:?}");
    }

    #[test]
    fn a_speed_that_is_not_a_number_shows_and_does_not_stay() {
        let mut state = VelocityLoopState { integrator_nm: 1.0 };
        assert!(LOOP.update(&mut state, f64::NAN, 0.0).torque_nm.is_nan());
        assert!(
            LOOP.update(&mut state, f64::MAX, -f64::MAX)
                .torque_nm
                .is_nan()
        );
        assert_eq!(state.integrator_nm, 1.0);
    }
}
