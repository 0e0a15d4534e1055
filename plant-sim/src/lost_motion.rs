//! Lost motion with hysteresis: bearings and nut that give way elastically and slip, beside the clean gap.

use bytemuck::{Pod, Zeroable};

/// Elements of the hysteresis.
pub const JENKINS_ELEMENTS: usize = 3;

/// Springs with slipping contacts between motor and table, beside the screw (Jenkins elements; Iwan 1966): inside the gap they carry
/// the table along until they slip.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LostMotion {
    /// Force at which each slips, in N.
    pub slip_n: [f64; JENKINS_ELEMENTS],
    /// Its stiffness times the microstep, in N·s/m.
    spring_step_n_s_per_m: [f64; JENKINS_ELEMENTS],
}

impl LostMotion {
    /// Elements that slip at these forces after these ways, in m.
    pub fn new(
        slip_n: [f64; JENKINS_ELEMENTS],
        slip_m: [f64; JENKINS_ELEMENTS],
        step_s: f64,
    ) -> Self {
        let mut spring_step_n_s_per_m = slip_n;
        for (spring, way_m) in spring_step_n_s_per_m.iter_mut().zip(slip_m) {
            *spring = if way_m > 0.0 {
                *spring * step_s / way_m
            } else {
                0.0
            };
        }
        LostMotion {
            slip_n,
            spring_step_n_s_per_m,
        }
    }

    /// One microstep with the motor that much faster than the table, in m/s: the force on the table, in N.
    #[inline]
    pub fn update(&self, state: &mut LostMotionState, faster_m_s: f64) -> f64 {
        let mut sum_n = 0.0;
        let elements = self.slip_n.iter().zip(&self.spring_step_n_s_per_m);
        for (force_n, (slip_n, spring)) in state.force_n.iter_mut().zip(elements) {
            *force_n = (*force_n + spring * faster_m_s).max(-slip_n).min(*slip_n);
            sum_n += *force_n;
        }
        sum_n
    }
}

/// What [`LostMotion`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LostMotionState {
    /// Force of each element, in N.
    pub force_n: [f64; JENKINS_ELEMENTS],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cycle_takes_energy_and_never_gives_any() {
        let lost = LostMotion::new([50.0, 80.0, 40.0], [1e-6, 3e-6, 6e-6], 25e-6);
        let mut state = LostMotionState::default();
        for amplitude_m in [0.5e-6, 2e-6, 10e-6] {
            let mut work_j = 0.0;
            for cycle in 0..3 {
                work_j = 0.0;
                for step in 0..4000 {
                    let phase = 2.0 * std::f64::consts::PI * f64::from(step) / 4000.0;
                    let v = amplitude_m * libm::cos(phase) * 20.0 * std::f64::consts::PI;
                    work_j += lost.update(&mut state, v) * v * 25e-6;
                }
                assert!(work_j > -1e-9, "cycle {cycle}: {work_j} J");
            }
            assert!(work_j >= -1e-9);
        }
    }
}
