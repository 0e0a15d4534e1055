//! Why a machine stopped, for people.

use std::fmt;

use bus::sample::{Cause, Feedback};
use machine::Machine;

/// Why a machine tripped or stopped, as its feedback names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StopCause {
    /// The axis; none if it is no single one's.
    pub axis: Option<String>,
    /// The cause; none if it is not known here.
    pub cause: Option<Cause>,
}

impl StopCause {
    /// What a feedback names.
    pub fn of(machine: &Machine, feedback: &Feedback) -> StopCause {
        let axis = machine.axes.get(feedback.cause_axis as usize);
        StopCause {
            axis: axis.map(|axis| axis.name.clone()),
            cause: Cause::from_wire(feedback.cause),
        }
    }

    /// What a feedback names; none if nothing stopped the machine.
    pub fn if_any(machine: &Machine, feedback: &Feedback) -> Option<StopCause> {
        let any = feedback.cause != Cause::None as u32;
        any.then(|| StopCause::of(machine, feedback))
    }

    fn words(&self) -> &'static str {
        self.cause.map_or("unknown cause", Cause::words)
    }

    /// The letter of the axis, and why.
    pub fn short(&self) -> String {
        match &self.axis {
            Some(axis) => format!("{axis}: {}", self.words()),
            None => self.words().into(),
        }
    }
}

impl fmt::Display for StopCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.axis {
            Some(axis) => write!(f, "axis {axis}: {}", self.words()),
            None => f.write_str(self.words()),
        }
    }
}
