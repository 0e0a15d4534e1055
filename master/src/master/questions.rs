//! What a program asks while it runs: where the probe trips, what an input shows. The answer is latched here, before the feedback shows
//! it, and stays until the program asks again; so whoever is killed meanwhile, the program learns it once and the same
//! (docs/developers/architecture.md, "Questions").

use bus::sample::{
    Answer, AnswerOutcome, AskedInput, Cause, EventCode, Feedback, InputWait, Inputs, Mode,
    PATH_AXES, PROBE_AWAY, PROBE_MUST, ProgramEvent,
};
use machine::PositionFeedback;

use super::Master;
use super::axis_unit::AxisUnit;
use crate::drives::{Drives, InputFeedback};
use crate::saved::QuestionLatches;

/// The contact changed in the scan: which way, and where the axes were.
#[derive(Debug, Clone, Copy)]
struct Touch {
    made: bool,
    share: f64,
    position: [i64; PATH_AXES],
}

/// Questions of the program, and the inputs that answer them.
#[derive(Debug, Clone, Default)]
pub(super) struct Questions {
    latches: QuestionLatches,
    shown: InputFeedback,
    /// Inputs have been shown: what they show next may be a change.
    seen: bool,
    /// Digital inputs in the scan before.
    before: u64,
    /// The probe made contact in the scan that ends.
    touched: bool,
    /// Changes of the contact in the scan that ends, the earlier one first.
    touches: [Option<Touch>; 2],
    /// Where drives have latched the contact that is watched, and no trip has taken it yet.
    latched: [Option<i64>; PATH_AXES],
    scan_s: f64,
}

/// Share of a scan in which a contact changed of which nobody knows when: at most half a scan off.
const MIDDLE: f64 = 0.5;

/// A latch that is shown so many scans after the trip is one of the same contact.
const LATCH_SCANS: u64 = 8;

/// The place that the drive of an axis latched, as the program counts it.
pub(super) fn latched_position(axis: &AxisUnit) -> Option<i64> {
    let drive = axis.drive();
    let from_mm = drive.motor_position_mm;
    let behind = axis.increments(drive.probe_mm? - from_mm);
    Some(program_position(axis).saturating_add(behind))
}

/// Where an axis is as its command position counts: by its scale, or by its motor, the lost motion that its servo compensates taken off.
pub(super) fn program_position(axis: &AxisUnit) -> i64 {
    let compensated = match axis.settings.feedback {
        PositionFeedback::Motor => axis.increments(axis.servos.command().compensation_mm),
        PositionFeedback::Scale => 0,
    };
    axis.feedback_position().saturating_sub(compensated)
}

impl Questions {
    pub fn new(scan_s: f64) -> Questions {
        Questions {
            scan_s,
            ..Questions::default()
        }
    }

    /// Another program, or the same from its start, is to begin.
    pub fn forget_program(&mut self) {
        self.latches = QuestionLatches::default();
    }

    /// Goes on where a master before this one left.
    pub fn resume(&mut self, latches: &QuestionLatches) {
        if latches.answer.value.is_finite() {
            self.latches = *latches;
        }
    }

    /// What must outlive this master.
    pub fn latches(&self) -> QuestionLatches {
        self.latches
    }

    /// The probe made contact in the scan that ends.
    pub fn is_touched(&self) -> bool {
        self.touched
    }

    /// The answer, and what the inputs show.
    pub fn tell(&self, feedback: &mut Feedback) {
        feedback.answer = self.latches.answer;
        feedback.inputs = Inputs {
            analog: self.shown.analog,
            digital: self.shown.digital,
            contact: u32::from(self.shown.contact),
            panel: 0,
        };
    }

    /// Digital inputs as they are shown, a bit each.
    pub fn digital(&self) -> u64 {
        self.shown.digital
    }

    /// What drives and terminals show at the end of a scan in which the axes went from one place to another.
    pub fn take(&mut self, shown: InputFeedback, from: &[i64; PATH_AXES], to: &[i64; PATH_AXES]) {
        self.before = self.shown.digital;
        let is_known = self.seen && !self.shown.contact_lost && !shown.contact_lost;
        let changed = is_known && self.shown.contact != shown.contact;
        self.touched = !self.shown.contact && (shown.contact || shown.made_at.is_some());
        (self.shown, self.seen) = (shown, true);
        let touch = |made: bool, share: Option<f64>| {
            let share = share?.clamp(0.0, 1.0);
            let mut position = *from;
            for (position, to) in position.iter_mut().zip(to) {
                let way = to.saturating_sub(*position) as f64;
                *position = position.saturating_add(libm::round(way * share) as i64);
            }
            Some(Touch {
                made,
                share,
                position,
            })
        };
        let level = |made: bool| (changed && shown.contact == made).then_some(MIDDLE);
        let touches = [
            touch(true, shown.made_at.or(level(true))),
            touch(false, shown.lost_at.or(level(false))),
        ];
        self.touches = match touches {
            [Some(made), Some(lost)] if lost.share < made.share => [Some(lost), Some(made)],
            touches => touches,
        };
    }

    /// What drives have latched in the same scan; called while contact is watched.
    pub fn take_latched(&mut self, latched: [Option<i64>; PATH_AXES]) {
        // Told once; the contact itself may be shown some scans later.
        for (kept, latched) in self.latched.iter_mut().zip(latched) {
            *kept = kept.or(latched);
        }
    }

    /// The change of the contact that a motion is made for, until it has come to rest.
    pub fn watched(&self) -> Option<bool> {
        self.probes().then(|| self.wanted())
    }

    /// Places that drives latched are those of the trip.
    fn refine(&mut self) -> bool {
        let tripped = self.latches.answer.tripped.iter_mut();
        let mut refined = false;
        for (tripped, latched) in tripped.zip(&mut self.latched) {
            if let Some(latched) = latched.take() {
                *tripped = latched;
                refined = true;
            }
        }
        refined
    }

    /// Whether the probe has tripped and the axes have not come to rest since.
    pub fn brakes(&self) -> bool {
        self.probes() && self.latches.answer.scan != 0
    }

    /// Whether a probing motion is in progress.
    fn probes(&self) -> bool {
        self.latches.answer.outcome == AnswerOutcome::Awaited as u32
    }

    /// Whether an answer waits for the planner to take it: until then no motion is planned.
    pub fn waits_for_planner(&self) -> bool {
        let answer = &self.latches.answer;
        let given = matches!(
            AnswerOutcome::from_wire(answer.outcome),
            Some(AnswerOutcome::Given | AnswerOutcome::Missed)
        );
        given && self.latches.taken < answer.number
    }

    /// The planner has taken the answer to the event of this number.
    pub fn taken(&mut self, number: u32) {
        if number <= self.latches.answer.number {
            self.latches.taken = self.latches.taken.max(number);
        }
    }

    fn wanted(&self) -> bool {
        self.latches.probe & PROBE_AWAY == 0
    }

    /// Begins a probing motion; the cause of a stop where it cannot.
    pub fn begin_probe(&mut self, event: &ProgramEvent) -> Cause {
        self.latches.probe = event.index;
        self.latched = [None; PATH_AXES];
        let early = self.shown.contact == self.wanted();
        self.latches.answer = Answer {
            number: event.number,
            outcome: if early {
                AnswerOutcome::Early as u32
            } else {
                AnswerOutcome::Awaited as u32
            },
            ..Answer::default()
        };
        if early {
            Cause::ProbeEarly
        } else {
            Cause::None
        }
    }

    /// The probing motion has come to its end: the cause of a stop where contact was necessary.
    pub fn end_probe(&mut self, rests: [i64; PATH_AXES]) -> Cause {
        if !self.probes() {
            return Cause::None;
        }
        self.latches.answer.outcome = AnswerOutcome::Missed as u32;
        self.latches.answer.tripped = rests;
        self.latches.answer.rests = rests;
        if self.latches.probe & PROBE_MUST != 0 {
            Cause::ProbeMissed
        } else {
            Cause::None
        }
    }

    /// One scan of a probing motion that somebody watches; the cause of a stop, and whether something was latched.
    fn watch(&mut self, scan: u64) -> (Cause, bool) {
        if !self.probes() {
            return (Cause::None, false);
        }
        if self.latches.answer.scan != 0 {
            // A drive shows what it latched a few scans later at most; what comes then is a bounce.
            let recent = scan.saturating_sub(self.latches.answer.scan) <= LATCH_SCANS;
            return (Cause::None, recent && self.refine());
        }
        let wanted = self.wanted();
        let mut touches = self.touches.iter().flatten();
        if let Some(touch) = touches.find(|touch| touch.made == wanted) {
            let answer = &mut self.latches.answer;
            answer.scan = scan;
            answer.value = touch.share;
            answer.tripped = touch.position;
            self.refine();
            return (Cause::None, true);
        }
        if self.shown.contact == wanted {
            self.latches.answer.outcome = AnswerOutcome::Lost as u32;
            return (Cause::ProbeLost, true);
        }
        (Cause::None, false)
    }

    /// One scan of a wait for an input: true once it is answered.
    pub fn input_is_answered(
        &mut self,
        event: &ProgramEvent,
        scan: u64,
        waited_scans: u64,
    ) -> bool {
        let Some(asked) = AskedInput::from_wire(event.index) else {
            return true;
        };
        let bit = |inputs: u64| inputs >> asked.number.min(63) & 1 == 1;
        let (was, is) = (bit(self.before), bit(self.shown.digital));
        let there = match asked.wait {
            InputWait::Immediate => true,
            InputWait::Rise => !was && is && waited_scans > 0,
            InputWait::Fall => was && !is && waited_scans > 0,
            InputWait::High => is,
            InputWait::Low => !is,
        };
        let overdue = waited_scans as f64 * self.scan_s >= event.value;
        if !there && !overdue {
            return false;
        }
        let analog = self.shown.analog.get(asked.number as usize).copied();
        self.latches.answer = Answer {
            value: match analog.filter(|_| asked.analog) {
                Some(value) => value,
                None if there => f64::from(u8::from(is)),
                None => -1.0,
            },
            scan,
            number: event.number,
            outcome: if there {
                AnswerOutcome::Given as u32
            } else {
                AnswerOutcome::Missed as u32
            },
            ..Answer::default()
        };
        true
    }
}

impl<D: Drives> Master<D> {
    /// One scan of a probing motion: the trip, then the rest. Nobody watches while the machine is not enabled.
    pub(super) fn step_probe(&mut self) {
        if self.mode() != Mode::Enabled {
            return;
        }
        let scan = self.scan;
        let brakes = self.auxiliary.questions.brakes();
        if brakes && self.windows.at_rest(scan) && self.axes.stand() {
            let rests = self.axes.command_positions();
            let answer = &mut self.auxiliary.questions.latches.answer;
            answer.rests = rests;
            answer.outcome = AnswerOutcome::Given as u32;
            let number = answer.number.saturating_add(1);
            self.auxiliary.count(&ProgramEvent {
                number,
                ..ProgramEvent::default()
            });
            return;
        }
        let (cause, latched) = self.auxiliary.questions.watch(scan);
        if latched {
            self.auxiliary.latched();
        }
        self.stop_for(cause);
    }

    /// Comes to rest on the path for this cause.
    pub(super) fn stop_for(&mut self, cause: Cause) {
        // Drives that are being switched on come on all the same: it is said again once they are.
        let is_new = self.modes.cause() == Cause::None && !self.switching_on.is_under_way();
        if cause != Cause::None && is_new {
            self.modes.blame(cause, u32::MAX, self.scan);
            self.stop();
        }
    }

    /// Does an event that asks something; none for another one, true once it is answered.
    pub(super) fn ask(&mut self, event: &ProgramEvent, waited_scans: u64) -> Option<bool> {
        let rests = self.axes.command_positions();
        let scan = self.scan;
        let questions = &mut self.auxiliary.questions;
        let cause = match EventCode::from_wire(event.code)? {
            EventCode::Probe => questions.begin_probe(event),
            EventCode::ProbeEnd => questions.end_probe(rests),
            EventCode::AwaitInput => {
                return Some(questions.input_is_answered(event, scan, waited_scans));
            }
            _ => return None,
        };
        self.stop_for(cause);
        Some(cause != Cause::ProbeEarly)
    }
}

#[cfg(test)]
mod tests;
