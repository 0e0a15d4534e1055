//! The alarm of an axis that is without its standby: said once when it begins, and once when it is over.

use bus::sample::{Feedback, Redundancy, STANDBY_ALARM_S};
use machine::Machine;

/// What has been said of each axis.
#[derive(Debug, Default)]
pub struct StandbyAlarm {
    said: Vec<Said>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Said {
    alarm: bool,
    differences: u32,
}

/// What is to be said now.
#[derive(Debug, PartialEq, Eq)]
pub struct Alarm {
    /// Word of the event.
    pub event: &'static str,
    /// For people.
    pub words: String,
    /// Whether it is over.
    pub over: bool,
}

impl StandbyAlarm {
    /// Looks at the newest feedback.
    pub fn look(&mut self, feedback: &Feedback, machine: &Machine) -> Vec<Alarm> {
        self.said.resize(machine.axes.len(), Said::default());
        let limit_scans = STANDBY_ALARM_S / machine.scan_period_s();
        let axes = feedback.axes().iter().zip(&machine.axes);
        let mut alarms = Vec::new();
        for ((axis, settings), said) in axes.zip(&mut self.said) {
            let name = &settings.name;
            let since_s = f64::from(axis.unsynchronised_scans) * machine.scan_period_s();
            let alarm = f64::from(axis.unsynchronised_scans) > limit_scans;
            let mut raise = |event, words, over| alarms.push(Alarm { event, words, over });
            if alarm && !said.alarm {
                let state = Redundancy::from_wire(axis.redundancy)
                    .unwrap_or_default()
                    .words();
                let words = format!(
                    "axis {name} has been without its standby for {since_s:.1} s ({state}): the loss of its servo would stop the machine"
                );
                raise("standby-alarm", words, false);
            }
            if !alarm && said.alarm {
                let words = format!("axis {name} has its standby again");
                raise("standby-back", words, true);
            }
            let differences = axis.differences;
            if differences > said.differences {
                let words = format!(
                    "the two servos of axis {name} have commanded different things, {differences} times in all: one of them computes wrongly"
                );
                raise("standby-differs", words, false);
            }
            *said = Said { alarm, differences };
        }
        alarms
    }
}

#[cfg(test)]
#[path = "standby_alarm/tests.rs"]
mod tests;
