//! What happened since the observer came, told from how samples differ from those before: deaths, restarts, takeovers, trips, orders.

use std::collections::VecDeque;

use bus::sample::{AxisFeedback, Feedback, Mode, Redundancy, Roster};
use bus::service::ROLES;
use machine::{Machine, Process};
use monitor::words::StopCause;

/// Events that are kept.
const KEPT: usize = 200;
/// Small things of the same kind within so many scans of the first are one event.
const TOGETHER_SCANS: u64 = 30_000;

/// How much an event matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// Ordinary.
    Note,
    /// Somebody should look at it.
    Warning,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// Counted from 1; of a view from another machine, by its server.
    pub number: u64,
    /// Scan in which it was seen, or is reported to have happened.
    pub scan: u64,
    /// In words.
    pub text: String,
    /// How much it matters.
    pub weight: Weight,
    /// Of small things that come often: which, and how many scans in all.
    often: Option<(Often, u32)>,
}

/// What comes often where a PC is not made for real time, and would flood the list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Often {
    Overrun,
    Missed { axis: u32 },
}

/// The events so far.
#[derive(Debug, Default)]
pub struct Events {
    /// The last ones, newest last.
    pub last: VecDeque<Event>,
    /// All that were noted.
    pub count: u64,
    feedback: Option<Feedback>,
    roster: Option<Roster>,
}

impl Events {
    /// Notes an event.
    pub fn note(&mut self, scan: u64, weight: Weight, text: String) {
        self.note_as(self.count + 1, scan, weight, text);
    }

    /// Notes what somebody should look at.
    fn warn(&mut self, scan: u64, text: String) {
        self.note(scan, Weight::Warning, text);
    }

    /// Notes an event that has a number of its own.
    pub fn note_as(&mut self, number: u64, scan: u64, weight: Weight, text: String) {
        if self.last.len() == KEPT {
            self.last.pop_front();
        }
        self.last.push_back(Event {
            number,
            scan,
            text,
            weight,
            often: None,
        });
        self.count += 1;
    }

    /// Gives the event of this number another text.
    #[cfg(feature = "remote")]
    pub fn amend(&mut self, number: u64, text: String) {
        let mut last = self.last.iter_mut().rev();
        if let Some(event) = last.find(|event| event.number == number) {
            event.text = text;
        }
    }

    /// Notes something small: added to the last event of its kind, if that is not long ago.
    fn note_often(&mut self, scan: u64, kind: Often, scans: u32, machine: &Machine) {
        let text = |scans: u32| match kind {
            Often::Overrun => format!("master: {} late", counted(scans)),
            Often::Missed { axis } => {
                let name = machine.axis_name(axis as usize);
                format!("{name}: no command in {}", counted(scans))
            }
        };
        for event in self.last.iter_mut().rev() {
            if event.scan.saturating_add(TOGETHER_SCANS) < scan {
                break;
            }
            if let Some((known, before)) = event.often
                && known == kind
            {
                let scans = before.saturating_add(scans);
                event.text = text(scans);
                event.often = Some((kind, scans));
                return;
            }
        }
        self.note(scan, Weight::Warning, text(scans));
        if let Some(event) = self.last.back_mut() {
            event.often = Some((kind, scans));
        }
    }

    /// Compares a feedback with the one before it.
    pub fn feedback(&mut self, now: &Feedback, machine: &Machine) {
        let Some(before) = self.feedback.replace(*now) else {
            return;
        };
        if now.incarnation != before.incarnation {
            self.warn(now.scan, "the master was restarted".into());
        }
        if now.mode != before.mode {
            self.mode(now, machine);
        }
        if now.hold != before.hold {
            let text = if now.hold == 1 {
                "hold"
            } else {
                "resume: hold is off"
            };
            self.note(now.scan, Weight::Note, text.into());
        }
        if now.override_percent != before.override_percent {
            let (from, to) = (before.override_percent, now.override_percent);
            self.note(
                now.scan,
                Weight::Note,
                format!("override {from} % → {to} %"),
            );
        }
        let switched = report::auxiliary::switched(&before.inputs, &now.inputs);
        let changes = report::auxiliary::changes(&before.auxiliary, &now.auxiliary);
        for change in switched.into_iter().chain(changes) {
            self.note(now.scan, Weight::Note, change);
        }
        if now.overrun_scans > before.overrun_scans {
            let count = now.overrun_scans - before.overrun_scans;
            self.note_often(now.scan, Often::Overrun, count, machine);
        }
        for (index, (axis, earlier)) in now.axes().iter().zip(before.axes()).enumerate() {
            let name = machine.axis_name(index);
            if axis.taken_role != earlier.taken_role {
                let role = |role: u32| ROLES.get(role as usize).copied().unwrap_or("?");
                let (to, from) = (role(axis.taken_role), role(earlier.taken_role));
                self.warn(
                    now.scan,
                    format!("{name}: servo {to} took over from {from}"),
                );
            }
            self.standby(now.scan, name, axis, earlier);
            // Reported when it is over, so that one loss is one event.
            if axis.missed_in_a_row == 0 && earlier.missed_in_a_row > 0 {
                let kind = Often::Missed { axis: index as u32 };
                self.note_often(now.scan, kind, earlier.missed_in_a_row, machine);
            }
        }
    }

    /// Compares what there is of an axis's standby.
    fn standby(&mut self, scan: u64, name: &str, axis: &AxisFeedback, earlier: &AxisFeedback) {
        let state = Redundancy::from_wire(axis.redundancy).unwrap_or_default();
        if axis.redundancy != earlier.redundancy && state != Redundancy::CatchingUp {
            let weight = match state {
                Redundancy::Lost => Weight::Warning,
                _ => Weight::Note,
            };
            self.note(scan, weight, format!("{name}: standby {}", state.words()));
        }
        if axis.differences > earlier.differences {
            self.warn(
                scan,
                format!("{name}: its two servos command different things"),
            );
        }
    }

    fn mode(&mut self, now: &Feedback, machine: &Machine) {
        let Some(mode) = Mode::from_wire(now.mode) else {
            self.note(now.scan, Weight::Warning, "an unknown mode".into());
            return;
        };
        match (mode, StopCause::if_any(machine, now)) {
            (Mode::Tripped, Some(cause)) => {
                self.warn(now.cause_scan, format!("TRIP {}", cause.short()));
            }
            (_, Some(cause)) if mode != Mode::Enabled => {
                self.warn(now.scan, format!("{}: {}", mode.word(), cause.short()));
            }
            _ => self.note(now.scan, Weight::Note, mode.word().into()),
        }
    }

    /// Compares a roster with the one before it.
    pub fn roster(&mut self, now: &Roster, scan: u64, machine: &Machine) {
        let Some(before) = self.roster.replace(*now) else {
            return;
        };
        for (process, earlier) in now.participants.iter().zip(&before.participants) {
            let Some(name) = Process::of(process).map(|of| of.name(machine)) else {
                continue;
            };
            let died = earlier.live == 1
                && (process.live == 0 || process.incarnation != earlier.incarnation);
            if died {
                let how = if process.death_signal != 0 {
                    format!("killed by signal {}", process.death_signal)
                } else {
                    format!("ended with status {}", process.death_status)
                };
                self.note(process.death_scan, Weight::Warning, format!("{name} {how}"));
            }
            if process.live == 1 && process.incarnation != earlier.incarnation {
                let text = format!("{name} restarted (start {})", process.incarnation);
                self.note(scan, Weight::Note, text);
            }
            if process.live == 1 && process.stalled != earlier.stalled && earlier.live == 1 {
                let how = match process.stalled {
                    1 => "stands still",
                    _ => "goes on",
                };
                self.warn(scan, format!("{name} {how}"));
            }
        }
    }
}

fn counted(scans: u32) -> String {
    match scans {
        1 => "1 scan".into(),
        _ => format!("{scans} scans"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::test_support::{machine, running};
    use bus::sample::{Cause, Job, Participant};
    use bytemuck::Zeroable;

    fn texts(events: &Events) -> Vec<(u64, &str)> {
        let each = events.last.iter();
        each.map(|event| (event.scan, event.text.as_str()))
            .collect()
    }

    #[test]
    fn a_death_its_restart_and_the_takeover_are_reported_once_each() {
        let machine = machine();
        let mut events = Events::default();
        let mut roster = Roster::zeroed();
        roster.participants[0] = Participant {
            death_scan: u64::MAX,
            job: Job::Servo as u32,
            axis: 1,
            incarnation: 1,
            live: 1,
            ..Participant::default()
        };
        let mut feedback = running(900);
        events.roster(&roster, 900, &machine);
        events.feedback(&feedback, &machine);
        assert_eq!(texts(&events), []);
        roster.participants[0].live = 0;
        roster.participants[0].death_scan = 905;
        roster.participants[0].death_signal = 9;
        events.roster(&roster, 910, &machine);
        feedback.scan = 911;
        feedback.axes[1].taken_role = 1;
        events.feedback(&feedback, &machine);
        roster.participants[0].live = 1;
        roster.participants[0].incarnation = 2;
        events.roster(&roster, 930, &machine);
        events.roster(&roster, 931, &machine);
        let expected = [
            (905, "servo-Y killed by signal 9"),
            (911, "Y: servo b took over from a"),
            (930, "servo-Y restarted (start 2)"),
        ];
        assert_eq!(texts(&events), expected);
    }

    #[test]
    fn a_death_and_restart_between_two_looks_are_both_reported() {
        let machine = machine();
        let mut events = Events::default();
        let mut roster = Roster::zeroed();
        roster.participants[0].job = Job::Planner as u32;
        roster.participants[0].live = 1;
        roster.participants[0].incarnation = 1;
        events.roster(&roster, 1, &machine);
        roster.participants[0].incarnation = 2;
        roster.participants[0].death_signal = 9;
        roster.participants[0].death_scan = 55;
        events.roster(&roster, 60, &machine);
        let expected = [
            (55, "planner killed by signal 9"),
            (60, "planner restarted (start 2)"),
        ];
        assert_eq!(texts(&events), expected);
    }

    #[test]
    fn scans_that_are_missed_now_and_then_do_not_flood_the_list() {
        let machine = machine();
        let mut events = Events::default();
        for scan in 0..1000u64 {
            let mut feedback = running(scan);
            feedback.axes[0].missed_in_a_row = u32::from(scan % 10 == 5);
            feedback.overrun_scans = (scan / 100) as u32;
            events.feedback(&feedback, &machine);
        }
        let expected = [
            (6, "X: no command in 100 scans"),
            (100, "master: 9 scans late"),
        ];
        assert_eq!(texts(&events), expected);
    }

    #[test]
    fn a_trip_is_reported_with_axis_and_cause_at_its_own_scan() {
        let machine = machine();
        let mut events = Events::default();
        let mut feedback = running(1000);
        events.feedback(&feedback, &machine);
        feedback.scan = 1020;
        feedback.mode = Mode::Tripped as u32;
        feedback.cause = Cause::FollowingError as u32;
        feedback.cause_axis = 0;
        feedback.cause_scan = 1011;
        events.feedback(&feedback, &machine);
        let expected = [(1011, "TRIP X: following error beyond its limit")];
        assert_eq!(texts(&events), expected);
    }
}
