//! The simulated spindle, tool changer and outputs.

use bus::sample::{Levels, SpindleCommand};
use bytemuck::{Pod, Zeroable};
use master::AuxiliaryFeedback;

use crate::plant_file::{PlantSpindle, PlantToolChanger};
use crate::spindle::SpindleState;

/// What outlives the process.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct AuxiliaryState {
    /// The spindle.
    pub spindle: SpindleState,
    /// Time that the change in progress has taken, in s.
    pub changing_s: f64,
    /// Outputs as the terminals show them.
    pub outputs: Levels,
    /// Tool in the spindle.
    pub tool: u32,
    /// Kept zero.
    pub reserved: u32,
}

/// Spindle, tool changer and outputs.
#[derive(Debug, Clone)]
pub struct SimulatedAuxiliaries {
    spindle: Option<PlantSpindle>,
    changer: Option<PlantToolChanger>,
    scan_s: f64,
    state: AuxiliaryState,
}

impl SimulatedAuxiliaries {
    /// At rest, without a tool and with all outputs off.
    pub fn new(
        spindle: Option<PlantSpindle>,
        changer: Option<PlantToolChanger>,
        scan_s: f64,
    ) -> SimulatedAuxiliaries {
        SimulatedAuxiliaries {
            spindle,
            changer,
            scan_s,
            state: AuxiliaryState::default(),
        }
    }

    /// The same with a tool in the spindle.
    pub fn with_tool(mut self, tool: u32) -> SimulatedAuxiliaries {
        self.state.tool = tool;
        self.state.outputs.tool = tool;
        self
    }

    /// One scan under these levels.
    pub fn scan(&mut self, levels: &Levels) {
        let before = self.state.outputs.tool;
        self.state.outputs = *levels;
        if let Some(spindle) = self.spindle {
            spindle.scan(&mut self.state.spindle, levels, self.scan_s);
        }
        if let Some(changer) = self.changer
            && levels.tool != self.state.tool
        {
            // Another tool than the one on its way: the change begins again.
            if levels.tool != before {
                self.state.changing_s = 0.0;
            }
            self.state.changing_s += self.scan_s;
            if self.state.changing_s >= changer.change_s {
                self.state.tool = levels.tool;
                self.state.changing_s = 0.0;
            }
        }
    }

    /// Nobody commands any more: the spindle has braked to rest by itself, and coolant is off. Outputs stay as they are.
    pub fn run_down(&mut self) {
        match self.spindle {
            Some(spindle) => spindle.run_down(&mut self.state.spindle),
            None => self.state.spindle.rpm = 0.0,
        }
        self.state.outputs.spindle = SpindleCommand::Stop as u32;
        self.state.outputs.spindle_rpm = 0.0;
        self.state.outputs.coolant = 0;
    }

    /// What they show.
    pub fn feedback(&self) -> AuxiliaryFeedback {
        AuxiliaryFeedback {
            spindle_rpm: self.state.spindle.rpm,
            spindle_turns: self
                .spindle
                .map_or(0.0, |spindle| spindle.measured_turns(&self.state.spindle)),
            oriented: self.state.spindle.oriented == 1,
            spindle_code: 0,
            tool: self.state.tool,
        }
    }

    /// The state, for saving it.
    pub fn state(&self) -> &AuxiliaryState {
        &self.state
    }

    /// Goes on from a saved state; [`run_down`](Self::run_down) is next. False for a state that none can have.
    pub fn restore(&mut self, state: &AuxiliaryState) -> bool {
        if !state.spindle.is_sound() || !state.changing_s.is_finite() {
            return false;
        }
        self.state = *state;
        true
    }

    /// While the spindle is in step with an axis: the axis, and the time in s over which both brake if nobody commands any more.
    pub fn brakes_together(&self) -> Option<(usize, f64)> {
        let outputs = &self.state.outputs;
        let follows = SpindleCommand::from_wire(outputs.spindle) == SpindleCommand::Follow;
        let spindle = self.spindle.filter(|_| follows)?;
        let braking_s = spindle.braking_s(&self.state.spindle);
        Some((outputs.followed_axis as usize, braking_s))
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;

    fn auxiliaries() -> SimulatedAuxiliaries {
        let spindle = PlantSpindle {
            acceleration_rpm_s: 1000.0,
            orientation_rpm: 60.0,
            ..PlantSpindle::default()
        };
        let changer = PlantToolChanger { change_s: 0.5 };
        SimulatedAuxiliaries::new(Some(spindle), Some(changer), 1e-3)
    }

    fn turning(rpm: f64) -> Levels {
        Levels {
            spindle_rpm: rpm,
            spindle: SpindleCommand::Turn as u32,
            ..Levels::default()
        }
    }

    fn scans_until(
        sim: &mut SimulatedAuxiliaries,
        levels: &Levels,
        is_there: impl Fn(&AuxiliaryFeedback) -> bool,
    ) -> u32 {
        (1..100_000)
            .find(|_| {
                sim.scan(levels);
                is_there(&sim.feedback())
            })
            .expect("it gets there")
    }

    #[test]
    fn the_spindle_ramps_reverses_and_stops() {
        let mut sim = auxiliaries();
        assert_eq!(
            scans_until(&mut sim, &turning(2000.0), |f| f.spindle_rpm >= 2000.0),
            2000
        );
        assert_eq!(
            scans_until(&mut sim, &turning(-500.0), |f| f.spindle_rpm <= -500.0),
            2500
        );
        assert_eq!(
            scans_until(&mut sim, &Levels::default(), |f| f.spindle_rpm == 0.0),
            500
        );
    }

    #[test]
    fn it_stands_at_the_angle_that_was_asked_for() {
        let mut sim = auxiliaries();
        scans_until(&mut sim, &turning(700.0), |f| f.spindle_rpm >= 700.0);
        for angle_deg in [0.0, 90.5, -90.0] {
            let levels = Levels {
                orientation_deg: angle_deg,
                spindle: SpindleCommand::Orient as u32,
                ..Levels::default()
            };
            scans_until(&mut sim, &levels, |f| f.oriented);
            assert!((sim.state().spindle.deg() - (angle_deg + 360.0) % 360.0).abs() < 1e-9);
            assert_eq!(sim.feedback().spindle_rpm, 0.0);
            scans_until(&mut sim, &turning(100.0), |f| f.spindle_rpm >= 100.0);
        }
    }

    #[test]
    fn a_tool_takes_its_time_and_stays_over_a_restart() {
        let mut sim = auxiliaries();
        let levels = Levels {
            tool: 7,
            ..turning(300.0)
        };
        let scans = scans_until(&mut sim, &levels, |f| f.tool == 7);
        assert!((500..=501).contains(&scans), "{scans}");
        let mut other = auxiliaries();
        assert!(other.restore(sim.state()));
        other.run_down();
        assert_eq!(
            (other.feedback().tool, other.feedback().spindle_rpm),
            (7, 0.0)
        );
    }
}
