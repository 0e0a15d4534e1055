//! Liveness: once nothing more goes wrong, the run ends, or the machine rests and says truly why and what brings it on.

use std::collections::HashSet;
use std::sync::Mutex;

use bus::sample::{Cause, Mode, OperatorRequest};

use crate::bench::Budget;
use crate::cell::{Cell, Frame};
use crate::scan::{Fate, go_on_order};

/// Scans in which it must have come to that: a return to the path dwells 100 scans of 2 ms, and a run has 20.
pub const SCANS_MAX: u32 = 400;

/// States that are known to come to a good end.
#[derive(Debug, Default)]
pub struct Settled(Mutex<HashSet<u64>>);

impl Settled {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.lock().map_or(0, |known| known.len())
    }
}

impl Cell {
    /// Whether the run comes to a good end from here, if nothing more goes wrong and the launcher does its work at once.
    pub fn settles(&self, frame: &Frame, settled: &Settled) -> bool {
        let mut cell = self.clone();
        cell.budget = Budget {
            kills: 0,
            losses: 0,
            stops: 0,
            go_ons: 0,
        };
        let mut way = Vec::new();
        for _ in 0..SCANS_MAX {
            let name = cell.fingerprint();
            let known = |known: &Mutex<HashSet<u64>>| known.lock().is_ok_and(|k| k.contains(&name));
            if known(&settled.0) || cell.is_good_end(frame) {
                if let Ok(mut known) = settled.0.lock() {
                    known.extend(way);
                    known.insert(name);
                }
                return true;
            }
            way.push(name);
            cell.supervise(frame);
            cell.scan(frame, Fate::Good);
        }
        false
    }

    /// Everything has ended as it should, or the machine waits for somebody and what it says is true.
    pub fn is_good_end(&self, frame: &Frame) -> bool {
        if self.launcher.exited {
            // Either the last feedback was published, or the launcher reports what was lost for good.
            return self.ghost.ended || self.launcher.ends;
        }
        self.waits_truly(frame)
    }

    /// The machine rests, its feedback names why, nobody has ordered it to end, and the order that brings it on is accepted.
    fn waits_truly(&self, frame: &Frame) -> bool {
        let (Some(master), Some(feedback)) = (&self.master, &self.feedback) else {
            return false;
        };
        let ending = self.ghost.stopped || self.launcher.interrupted || self.launcher.ends;
        let mut next = self.clone();
        next.supervise(frame);
        let busy = next.everybody().any(|who| !next.place(who).life.lives());
        let cause = Cause::from_wire(feedback.cause).unwrap_or(Cause::None);
        let named = match Mode::from_wire(feedback.mode) {
            Some(Mode::Tripped) => matches!(cause, Cause::ServoLost | Cause::Watchdog),
            Some(Mode::Disabled) => cause == Cause::MasterLost,
            Some(Mode::Enabled) => feedback.hold == 1 && feedback.at_rest == 1,
            _ => false,
        };
        if ending || busy || !named || self.page.stop || self.inbox.stop {
            return false;
        }
        let order = go_on_order(feedback);
        order.is_some_and(|order| {
            let mut master = (**master).clone();
            let answer = master.order(&OperatorRequest::of(order));
            // Where it goes on by itself as soon as it may, it does not wait.
            answer.accepted == 1 && !goes_on_by_itself(frame, feedback.mode)
        })
    }
}

fn goes_on_by_itself(frame: &Frame, mode: u32) -> bool {
    mode == Mode::Tripped as u32 && frame.setting.servo == machine::AfterLoss::Resume
}
