//! The simulated spindle: a drive with a speed loop on one inertia, a load that comes and goes, an encoder with an index.

use bus::sample::{Levels, SpindleCommand};
use bytemuck::{Pod, Zeroable};

use crate::plant_file::PlantSpindle;

/// Longest step of the integration, in s: a hundredth of the fastest speed loop's time constant is some µs, a tenth suffices for
/// those of real spindles.
const STEP_S_MAX: f64 = 50e-6;
/// Time constants of the speed loop until a load is made up for by its integrator.
const INTEGRAL_TIME_CONSTANTS: f64 = 4.0;
/// Below this nothing is cut and the load does nothing, in rev/min.
const CUTTING_RPM: f64 = 1.0;

/// What outlives the process.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SpindleState {
    /// Angle, in turns, clockwise positive.
    pub turns: f64,
    /// Speed, in rev/min, clockwise positive.
    pub rpm: f64,
    /// Speed that the drive's ramp has reached, in rev/min.
    pub ramp_rpm: f64,
    /// Torque of the speed loop's integrator, in N·m.
    pub integral_nm: f64,
    /// Time since the load came last, in s.
    pub load_s: f64,
    /// 1 where it stands at the angle that was commanded.
    pub oriented: u32,
    /// Kept zero.
    pub reserved: u32,
}

impl SpindleState {
    /// Whether any machine can be in it.
    pub fn is_sound(&self) -> bool {
        let values = [
            self.turns,
            self.rpm,
            self.ramp_rpm,
            self.integral_nm,
            self.load_s,
        ];
        values.iter().all(|value| value.is_finite())
    }

    /// Angle within a turn, in degrees from 0 to 360.
    #[cfg(test)]
    pub fn deg(&self) -> f64 {
        360.0 * (self.turns - libm::floor(self.turns))
    }
}

impl PlantSpindle {
    /// What its encoder shows, in turns.
    pub fn measured_turns(&self, state: &SpindleState) -> f64 {
        match self.encoder_counts_per_turn {
            0 => 0.0,
            counts => libm::floor(state.turns * f64::from(counts)) / f64::from(counts),
        }
    }

    /// Time in which it brakes to rest, in s.
    pub fn braking_s(&self, state: &SpindleState) -> f64 {
        state.rpm.abs() / self.acceleration_rpm_s
    }

    /// Nobody commands any more: it has braked to rest along its ramp.
    pub fn run_down(&self, state: &mut SpindleState) {
        state.turns += 0.5 * state.rpm / 60.0 * self.braking_s(state);
        state.rpm = 0.0;
        state.ramp_rpm = 0.0;
        state.integral_nm = 0.0;
        state.oriented = 0;
    }

    /// One scan under these levels.
    pub fn scan(&self, state: &mut SpindleState, levels: &Levels, scan_s: f64) {
        let command = SpindleCommand::from_wire(levels.spindle);
        let slow = state.rpm.abs() <= self.orientation_rpm;
        if command == SpindleCommand::Orient && slow {
            return self.orient(state, levels.orientation_deg, scan_s);
        }
        state.oriented = 0;
        let wanted_rpm = match command {
            SpindleCommand::Turn | SpindleCommand::Follow => levels.spindle_rpm,
            SpindleCommand::Stop | SpindleCommand::Orient => 0.0,
        };
        if self.inertia_kg_m2 <= 0.0 {
            let step_rpm = self.acceleration_rpm_s * scan_s;
            state.rpm += (wanted_rpm - state.rpm).clamp(-step_rpm, step_rpm);
            state.ramp_rpm = state.rpm;
            state.turns += state.rpm / 60.0 * scan_s;
            return;
        }
        let steps = libm::ceil(scan_s / STEP_S_MAX).max(1.0);
        let step_s = scan_s / steps;
        for _ in 0..steps as u32 {
            self.step(state, wanted_rpm, step_s);
        }
    }

    /// Slowly in the positive direction to the angle, and there it stands.
    fn orient(&self, state: &mut SpindleState, wanted_deg: f64, scan_s: f64) {
        let step = self.orientation_rpm / 60.0 * scan_s;
        let wanted = wanted_deg / 360.0;
        let left = wanted - state.turns;
        let left = left - libm::floor(left);
        // Rounding leaves it a hair beyond the place where it stands already.
        let there = left <= step || (state.oriented == 1 && left > 1.0 - step);
        if there {
            let whole = libm::round(state.turns + left - wanted);
            state.turns = whole + wanted - if left > 1.0 - step { 1.0 } else { 0.0 };
            state.rpm = 0.0;
        } else {
            state.turns += step;
            state.rpm = self.orientation_rpm;
        }
        state.ramp_rpm = state.rpm;
        state.integral_nm = 0.0;
        state.oriented = u32::from(there);
    }

    /// One step of drive and inertia: the ramp with its acceleration fed forward, a PI speed loop, the load.
    fn step(&self, state: &mut SpindleState, wanted_rpm: f64, step_s: f64) {
        let rad_s_per_rpm = std::f64::consts::PI / 30.0;
        let most_rpm = self.acceleration_rpm_s * step_s;
        let ramp_step_rpm = (wanted_rpm - state.ramp_rpm).clamp(-most_rpm, most_rpm);
        state.ramp_rpm += ramp_step_rpm;
        let bandwidth_per_s = 2.0 * std::f64::consts::PI * self.speed_loop_hz;
        let gain_nm_s = self.inertia_kg_m2 * bandwidth_per_s;
        let off_rad_s = (state.ramp_rpm - state.rpm) * rad_s_per_rpm;
        let forward_nm = self.inertia_kg_m2 * ramp_step_rpm * rad_s_per_rpm / step_s;
        let asked_nm = forward_nm + gain_nm_s * off_rad_s + state.integral_nm;
        let torque_nm = asked_nm.clamp(-self.torque_max_nm, self.torque_max_nm);
        if torque_nm == asked_nm {
            let integral_s = INTEGRAL_TIME_CONSTANTS / bandwidth_per_s;
            state.integral_nm += gain_nm_s / integral_s * off_rad_s * step_s;
        }
        state.load_s += step_s;
        if state.load_s >= self.load_period_s {
            state.load_s -= self.load_period_s;
        }
        let cuts = state.rpm.abs() > CUTTING_RPM && state.load_s < 0.5 * self.load_period_s;
        let load_nm = if cuts {
            self.load_torque_nm * state.rpm.signum()
        } else {
            0.0
        };
        let before_rpm = state.rpm;
        state.rpm += (torque_nm - load_nm) / self.inertia_kg_m2 / rad_s_per_rpm * step_s;
        state.turns += 0.5 * (before_rpm + state.rpm) / 60.0 * step_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCAN_S: f64 = 1e-3;

    fn spindle() -> PlantSpindle {
        PlantSpindle {
            acceleration_rpm_s: 3000.0,
            orientation_rpm: 60.0,
            encoder_counts_per_turn: 4096,
            inertia_kg_m2: 0.02,
            torque_max_nm: 40.0,
            speed_loop_hz: 20.0,
            load_torque_nm: 6.0,
            load_period_s: 0.4,
        }
    }

    fn turning(rpm: f64) -> Levels {
        Levels {
            spindle_rpm: rpm,
            spindle: SpindleCommand::Turn as u32,
            ..Levels::default()
        }
    }

    /// Least and highest speed while it turns at 1000 rev/min.
    fn speeds(spindle: &PlantSpindle) -> (f64, f64) {
        let mut state = SpindleState::default();
        for _ in 0..1000 {
            spindle.scan(&mut state, &turning(1000.0), SCAN_S);
        }
        let (mut low, mut high) = (f64::INFINITY, 0.0f64);
        for _ in 0..1000 {
            spindle.scan(&mut state, &turning(1000.0), SCAN_S);
            (low, high) = (low.min(state.rpm), high.max(state.rpm));
        }
        (low, high)
    }

    #[test]
    fn a_step_of_the_load_makes_the_speed_droop_and_recover() {
        let (low, high) = speeds(&spindle());
        // 6 N·m on 0.02 kg·m² is 2865 rev/min/s, held back by a loop of 8 ms: some ten rev/min.
        assert!((975.0..995.0).contains(&low), "{low}");
        assert!((1005.0..1025.0).contains(&high), "{high}");
        let idle = PlantSpindle {
            load_torque_nm: 0.0,
            ..spindle()
        };
        let (low, high) = speeds(&idle);
        assert!(low > 999.9 && high < 1000.1, "{low} {high}");
    }

    #[test]
    fn the_ramp_is_kept_to_within_the_speed_loop_and_torque_bounds_it() {
        let mut idle = PlantSpindle {
            load_torque_nm: 0.0,
            ..spindle()
        };
        let after = |spindle: &PlantSpindle, scans: u32| {
            let mut state = SpindleState::default();
            for _ in 0..scans {
                spindle.scan(&mut state, &turning(3000.0), SCAN_S);
            }
            state
        };
        let half = after(&idle, 500);
        assert!((half.rpm - 1500.0).abs() < 1.0, "{half:?}");
        assert!(
            (half.turns - 0.5 * 3000.0 / 60.0 * 0.25).abs() < 0.01,
            "{half:?}"
        );
        idle.torque_max_nm = 3.0;
        // 3 N·m on 0.02 kg·m² is 1432 rev/min/s.
        let weak = after(&idle, 500);
        assert!((weak.rpm - 716.0).abs() < 2.0, "{weak:?}");
    }

    #[test]
    fn what_the_encoder_shows_is_a_count_below_the_truth_and_whole_at_the_index() {
        let spindle = spindle();
        let mut state = SpindleState {
            turns: 17.0,
            ..SpindleState::default()
        };
        assert_eq!(spindle.measured_turns(&state), 17.0);
        state.turns = -3.4567;
        let shown = spindle.measured_turns(&state);
        assert!(shown <= state.turns && state.turns - shown < 1.0 / 4096.0);
        let blind = PlantSpindle {
            encoder_counts_per_turn: 0,
            ..spindle
        };
        assert_eq!(blind.measured_turns(&state), 0.0);
    }

    #[test]
    fn it_runs_down_along_its_ramp() {
        let spindle = spindle();
        let mut state = SpindleState {
            rpm: -600.0,
            ..SpindleState::default()
        };
        assert_eq!(spindle.braking_s(&state), 0.2);
        spindle.run_down(&mut state);
        assert_eq!((state.rpm, state.turns), (0.0, -1.0));
    }
}
