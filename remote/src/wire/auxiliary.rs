//! Spindle, coolant, outputs, tool and stops, as the feedback has them.

use serde::{Deserialize, Serialize};

use super::{Refusal, check_count, check_number, number};

/// Analogue outputs of a cell.
pub const ANALOG_OUTPUTS: usize = 8;

/// What is commanded beside the axes, what the spindle shows and what is waited for.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AuxiliaryState {
    /// Speed commanded to the spindle, in rev/min, clockwise positive.
    #[serde(with = "number")]
    pub spindle_command_rpm: f64,
    /// Angle of an oriented spindle, in degrees.
    #[serde(with = "number")]
    pub orientation_deg: f64,
    /// Speed that the spindle shows, in rev/min, clockwise positive.
    #[serde(with = "number")]
    pub spindle_rpm: f64,
    /// What the spindle is commanded to do, as in the samples.
    pub spindle: u32,
    /// Coolant, a bit each, as in the samples.
    pub coolant: u32,
    /// Digital outputs, a bit each.
    pub digital: u64,
    /// Analogue outputs; none for a value out of all reason.
    pub analog: Vec<Option<f64>>,
    /// Number of the tool that is to be in the spindle.
    pub tool_wanted: u32,
    /// Number of the tool that is to be ready for the next change.
    pub tool_prepared: u32,
    /// Number of the tool in the spindle.
    pub tool: u32,
    /// Events of the program that are done.
    pub events_done: u32,
    /// What is waited for, as in the samples.
    pub waiting: u32,
    /// Line of what is waited for; 0 for none.
    pub line: u32,
    /// Of the axis that the spindle is in step with, its index and 1; 0 for none.
    pub coupled: u32,
    /// The spindle turns at its speed.
    pub at_speed: bool,
    /// The operator has optional stops switched on.
    pub optional_stop: bool,
    /// The program has switched the override off.
    pub override_disabled: bool,
}

impl AuxiliaryState {
    pub(super) fn check(&self) -> Result<(), Refusal> {
        check_count("analogue outputs", self.analog.len(), ANALOG_OUTPUTS)?;
        let speeds = [
            self.spindle_command_rpm,
            self.spindle_rpm,
            self.orientation_deg,
        ];
        let mut values = speeds
            .into_iter()
            .chain(self.analog.iter().flatten().copied());
        values.try_for_each(|value| check_number("auxiliary", value))
    }
}
