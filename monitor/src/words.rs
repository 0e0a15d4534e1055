//! What people read: numbers, why a machine stopped, and what a program waits for.

use std::fmt;

use bus::sample::{Auxiliaries, Cause, Feedback, Waiting};
use machine::Machine;

/// A number with so many decimals at most, and without zeros at the end.
pub fn shown(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let text = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => &text,
    };
    if text == "-0" { "0" } else { text }.to_owned()
}

/// A speed of the spindle, whatever its direction.
pub fn rev_min(speed_rpm: f64) -> String {
    format!("{} rev/min", shown(speed_rpm.abs(), 1))
}

/// What is waited for and for which line; none if nothing is.
pub fn waiting(auxiliary: &Auxiliaries) -> Option<String> {
    let waiting = Waiting::from_wire(auxiliary.waiting)?;
    let tool = auxiliary.levels.tool;
    let what = match waiting {
        Waiting::None => return None,
        Waiting::SpindleSpeed => format!(
            "{}: {:.0} of {}",
            waiting.words(),
            auxiliary.spindle_rpm.abs(),
            rev_min(auxiliary.levels.spindle_rpm)
        ),
        Waiting::ToolChange => format!("{}: tool {tool}", waiting.words()),
        Waiting::ToolByOperator => format!("the operator to put in tool {tool}"),
        _ => waiting.words().into(),
    };
    Some(match auxiliary.line {
        0 => what,
        line => format!("{what}, line {line}"),
    })
}

/// Why a machine tripped or stopped, as its feedback names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StopCause {
    /// The axis; none if it is no single one's.
    pub axis: Option<String>,
    /// The cause; none if it is not known here.
    pub cause: Option<Cause>,
    /// What the drive of the axis says of it; 0 for nothing.
    pub code: u32,
    /// Both in words.
    words: String,
}

impl StopCause {
    /// What a feedback names.
    pub fn of(machine: &Machine, feedback: &Feedback) -> StopCause {
        let index = feedback.cause_axis as usize;
        let code = feedback.axes.get(index).map_or(0, |axis| axis.drive_code);
        StopCause::named(machine, Cause::from_wire(feedback.cause), index, code)
    }

    /// A cause, with its axis by index and what the drive says.
    pub fn named(machine: &Machine, cause: Option<Cause>, index: usize, code: u32) -> StopCause {
        let axis = machine.axes.get(index);
        StopCause {
            axis: axis.map(|axis| axis.name.clone()),
            cause,
            code,
            words: cause.map_or_else(
                || "unknown cause".into(),
                |cause| machine.cause_words(cause, index, code),
            ),
        }
    }

    /// What a feedback names; none if nothing stopped the machine.
    pub fn if_any(machine: &Machine, feedback: &Feedback) -> Option<StopCause> {
        let any = feedback.cause != Cause::None as u32;
        any.then(|| StopCause::of(machine, feedback))
    }

    /// The letter of the axis, and why.
    pub fn short(&self) -> String {
        match &self.axis {
            Some(axis) => format!("{axis}: {}", self.words),
            None => self.words.clone(),
        }
    }
}

impl fmt::Display for StopCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.axis {
            Some(axis) => write!(f, "axis {axis}: {}", self.words),
            None => f.write_str(&self.words),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_no_more_decimals_than_it_needs() {
        for (value, decimals, words) in [
            (201.60007995844867, 1, "201.6"),
            (1500.0, 1, "1500"),
            (1500.0, 0, "1500"),
            (-0.00001, 4, "0"),
            (356.00012, 4, "356.0001"),
            (-2.50, 3, "-2.5"),
        ] {
            assert_eq!(shown(value, decimals), words);
        }
    }
}
