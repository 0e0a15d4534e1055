//! The machine's own logic, as the master sees it: what it has said last, whether it is there, and what follows when it is not.

use bus::sample::{
    Cause, Feedback, HoldReason, Job, LOGIC_HOLD, LOGIC_INHIBIT, LOGIC_STOP, LOGIC_TRIP,
    LogicAnswer, Mode, Refused, Roster,
};
use bytemuck::Zeroable;
use machine::{Machine, OnLogicLoss};

use super::Master;
use crate::answers::Answers;
use crate::drives::Drives;

/// A logic that has not answered within this time is lost, in s.
const BEGINS_S: f64 = 5.0;

/// What the logic has said, and whether it still counts.
#[derive(Debug, Clone)]
pub(super) struct LogicOfMachine {
    on_loss: OnLogicLoss,
    /// Scans behind a question that was answered after which the answer to the next one has not come in time.
    patience_scans: u64,
    said: Box<LogicAnswer>,
    answers: bool,
    /// It was missed in the scan before; in a master's first feedback nobody has been asked yet.
    was_missed: bool,
    /// Scans in which it may still begin to answer under this master; 0 once it has.
    begins_scans: u64,
    /// Times that it was lost.
    losses: u32,
    /// It has asked for a stop in the scan before.
    stopped: bool,
}

impl LogicOfMachine {
    pub fn new(machine: &Machine) -> Option<LogicOfMachine> {
        let settings = machine.logic.as_ref()?;
        let deadline = libm::ceil(settings.deadline_ms * 1e-3 / machine.scan_period_s());
        Some(LogicOfMachine {
            on_loss: settings.on_loss,
            patience_scans: machine.logic_every_scans()? + deadline as u64,
            said: Box::new(LogicAnswer::zeroed()),
            answers: false,
            was_missed: false,
            begins_scans: libm::ceil(BEGINS_S / machine.scan_period_s()) as u64,
            losses: 0,
            stopped: false,
        })
    }

    /// Takes what it has said in this scan; whether it has been lost since the scan before.
    fn take(&mut self, said: Option<&LogicAnswer>, scan: u64, roster: &Roster) -> bool {
        let process = roster.living(Job::Logic, 0, 0);
        let incarnation = process.map(|process| process.incarnation);
        if let Some(said) = said
            && Some(said.incarnation) == incarnation
            && said.scan <= scan
        {
            *self.said = *said;
        }
        let in_time = scan <= self.said.scan.saturating_add(self.patience_scans);
        let is_its = incarnation == Some(self.said.incarnation);
        let before = std::mem::replace(
            &mut self.answers,
            is_its && in_time && self.said.answers == 1,
        );
        self.begins_scans = match self.answers {
            true => 0,
            false => self.begins_scans.saturating_sub(1),
        };
        // One that never begins to answer is lost too.
        let is_lost = !self.answers && (before || self.begins_scans == 1);
        self.losses += u32::from(is_lost);
        self.was_missed = self.is_missed();
        is_lost
    }

    /// Whether nothing may move without it, and it does not answer.
    fn is_missed(&self) -> bool {
        !self.answers && self.on_loss != OnLogicLoss::GoOn
    }

    /// What the feedback shows of it. A thread is cut to its end without it, as in feed hold.
    pub fn tell(&self, is_in_thread: bool, feedback: &mut Feedback) {
        feedback.logic_losses = self.losses;
        feedback.auxiliary.blocked |= u32::from(self.was_missed && !is_in_thread);
    }

    /// Alarms that it raises, a bit each.
    pub fn alarms(&self) -> u64 {
        if self.answers { self.said.alarms } else { 0 }
    }

    fn asks(&self, request: u32) -> bool {
        self.answers && self.said.requests & request != 0
    }

    /// Value of a signal that it sets, or this one as long as it has not; none while it is lost.
    pub fn value(&self, index: usize, otherwise: f64) -> Option<f64> {
        if !self.answers {
            return None;
        }
        match self.said.sets.has(index) {
            true => self.said.values().get(index).copied(),
            false => Some(otherwise),
        }
    }

    /// Whether it lets a program, or the hand, move the machine.
    pub fn allows(&self, program: bool) -> Result<(), Refused> {
        if self.is_missed() {
            return Err(Refused::LogicLost);
        }
        if program && self.asks(LOGIC_INHIBIT | LOGIC_HOLD) {
            return Err(Refused::LogicInhibits);
        }
        Ok(())
    }

    /// Whether it lets drives be switched on.
    pub fn lets_drives_on(&self) -> Result<(), Refused> {
        if !self.answers && self.on_loss == OnLogicLoss::Trip {
            return Err(Refused::LogicLost);
        }
        match self.asks(LOGIC_TRIP) {
            true => Err(Refused::LogicInhibits),
            false => Ok(()),
        }
    }
}

impl<D: Drives> Master<D> {
    /// What the logic asks for, and what follows when it is lost.
    pub(super) fn heed_logic(&mut self, answers: &Answers, roster: &Roster) {
        let Some(logic) = &mut self.signals.logic else {
            return;
        };
        let is_lost = logic.take(answers.logic.as_ref(), self.scan, roster);
        let on_loss = logic.on_loss;
        let (holds, trips) = (logic.asks(LOGIC_HOLD), logic.asks(LOGIC_TRIP));
        let stops = logic.asks(LOGIC_STOP);
        let stops_now = !std::mem::replace(&mut logic.stopped, stops) && stops;
        let driven = self.mode().is_driven();
        if driven && is_lost && on_loss == OnLogicLoss::Trip {
            self.trip(Cause::LogicLost, u32::MAX);
        } else if driven && trips {
            self.trip(Cause::LogicTrip, u32::MAX);
        }
        let reason = match holds {
            true => HoldReason::Logic,
            false => HoldReason::LogicLost,
        };
        if holds || is_lost && on_loss == OnLogicLoss::Hold {
            match self.mode() {
                Mode::Jogging => self.rest_all_by_hand(),
                _ if self.program.is_running() => self.modes.hold(reason),
                _ => {}
            }
        }
        if stops_now {
            self.stop();
        }
    }
}
