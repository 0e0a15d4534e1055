//! Nothing hangs and nothing lies: after the last disturbance the machine goes on along its program, or has ended, or rests and
//! says truly why and what to do (docs/developers/invariants.md). Pure: fed with what was published, scan by scan.
//!
//! - Within [`patience_scans`] of the last disturbance the program comes further than it ever was, or the machine says which
//!   orders bring it on, and takes them ([`Liveness::rests`]).
//! - By then the standby of an axis is in step: its command is that of the other servo to the bit.
//! - A cause that the feedback names has really happened ([`Liveness::take`]).

use bus::sample::{AnswerOutcome, Cause, Feedback, Job, MAX_AXES, Mode, Roster};
use machine::Machine;

use crate::cell::Published;
use crate::invariants::{Violation, Violations};

/// Of a return to the path: the machine is still so long before the program goes on, in s.
const RETURN_SETTLES_S: f64 = 0.2;
/// To plan a window, hold it and take it over, and for a servo to be ready or a standby again, in interpolation periods.
const PLANNING_PERIODS: u32 = 8;
/// Axes that have come to rest still creep so long before they count as standing, in s.
const CREEPS_S: f64 = 0.1;

/// So many scans may pass without progress once nothing disturbs: the window in force comes to rest, the next one is planned
/// and taken over, and on a return to the path the machine settles. Restarts count as disturbances until they are over.
pub fn patience_scans(machine: &Machine) -> u64 {
    let braking_s = machine
        .axes
        .iter()
        .map(|axis| axis.rapid_mm_s / axis.acceleration_mm_s2)
        .fold(0.0, f64::max);
    let longest_s = braking_s + RETURN_SETTLES_S + CREEPS_S;
    let planning = PLANNING_PERIODS * machine.scan.interpolation_period_scans;
    libm::ceil(longest_s / machine.scan_period_s()) as u64
        + u64::from(planning + machine.intended_setpoints() + machine.scan.settle_scans)
}

/// How far a program is: compared in this order.
type Place = (u32, f64, std::cmp::Reverse<u32>);

/// Judges one run.
#[derive(Debug)]
pub struct Liveness<'a> {
    machine: &'a Machine,
    patience_scans: u64,
    /// The farthest place on the path so far.
    farthest: Option<Place>,
    before: Option<Feedback>,
    /// The last scan that came further.
    progressed: u64,
    /// Per axis, the last scan in which its standby was in step, or none was to be.
    in_step: [u64; MAX_AXES],
    /// Per axis, what its servos asked for in the scan before, a bit for each cause.
    asked: [u64; MAX_AXES],
    /// The planner's cause in its last status.
    planner: u32,
    /// Axes that have lost a servo so far, a bit for each.
    lost: u32,
    violations: Violations,
}

impl<'a> Liveness<'a> {
    /// For a run on this machine.
    pub fn new(machine: &'a Machine) -> Liveness<'a> {
        Liveness {
            machine,
            patience_scans: patience_scans(machine),
            farthest: None,
            before: None,
            progressed: 0,
            in_step: [0; MAX_AXES],
            asked: [0; MAX_AXES],
            planner: 0,
            lost: 0,
            violations: Violations::default(),
        }
    }

    /// Takes the next scan. `disturbed_until` is the last scan that a fault or an order disturbs, as far as it is known; `lies`
    /// whether a fault puts words into the mouth of a servo of this axis.
    pub fn take(
        &mut self,
        published: &Published<'_>,
        disturbed_until: u64,
        lies: impl Fn(usize) -> bool,
    ) {
        let feedback = published.feedback;
        for process in &published.roster.participants {
            let replaced = process.live == 0 || process.incarnation > 1;
            if process.job == Job::Servo as u32 && replaced {
                self.lost |= 1 << process.axis.min(31);
            }
        }
        let before = self.before.replace(*feedback);
        self.cause(before.as_ref(), feedback, lies);
        if self.has_progressed(before.as_ref(), feedback) {
            self.progressed = feedback.scan;
        }
        self.standbys(published, disturbed_until);
        self.asked = [0; MAX_AXES];
        for command in published.commands {
            if let Some(asked) = self.asked.get_mut(command.axis as usize) {
                *asked |= 1u64.checked_shl(command.cause).unwrap_or(0);
            }
        }
        if let Some(status) = published.status {
            self.planner = status.cause;
        }
    }

    /// The roster, as the machine read it, may have said so of any servo.
    pub fn believe_that_all_are_lost(&mut self) {
        self.lost = u32::MAX;
    }

    /// Whether the machine has come no further for as long as it may take.
    pub fn rests(&self, disturbed_until: u64) -> bool {
        let since = self.progressed.max(disturbed_until);
        self.before
            .is_some_and(|feedback| feedback.scan > since + self.patience_scans)
    }

    /// Somebody has given it an order: its time begins again.
    pub fn disturb(&mut self) {
        self.progressed = self.before.map_or(0, |feedback| feedback.scan);
        self.in_step = [self.progressed; MAX_AXES];
    }

    /// What must not be.
    pub fn end(self) -> Vec<Violation> {
        self.violations.0
    }

    fn has_progressed(&mut self, before: Option<&Feedback>, feedback: &Feedback) -> bool {
        let Some(before) = before else { return true };
        let latched = |f: &Feedback| {
            (
                f.mode,
                f.hold,
                f.override_percent,
                f.last,
                f.incarnation,
                f.cause,
            )
        };
        if latched(before) != latched(feedback) {
            return true;
        }
        let driven = matches!(
            Mode::from_wire(feedback.mode),
            Some(Mode::Enabled | Mode::Stopping | Mode::Jogging)
        );
        if !driven {
            return false;
        }
        if feedback.tag.is_off_path() {
            let axes = feedback.axes().iter().zip(before.axes());
            return axes
                .into_iter()
                .any(|(is, was)| is.command_position != was.command_position);
        }
        let tag = feedback.tag;
        let dwell = std::cmp::Reverse(tag.dwell_remaining_scans);
        let place = (tag.element, tag.distance_mm, dwell);
        let further = self.farthest.is_none_or(|farthest| place > farthest);
        if further {
            self.farthest = Some(place);
        }
        further
    }

    /// Both servos of an axis say the same, unless one of them is not there.
    fn standbys(&mut self, published: &Published<'_>, disturbed_until: u64) {
        let feedback = published.feedback;
        let driven = feedback.mode == Mode::Enabled as u32;
        for index in 0..self.machine.axes.len() {
            let of = |role: u32| {
                let mut commands = published.commands.iter();
                commands.find(|c| c.axis as usize == index && c.role == role)
            };
            let both = driven
                && is_there(published.roster, index, 0)
                && is_there(published.roster, index, 1);
            let same = match (of(0), of(1)) {
                (Some(a), Some(b)) => a.drives_as(b),
                _ => false,
            };
            if !both || same {
                self.in_step[index] = feedback.scan;
                continue;
            }
            let since = self.in_step[index].max(disturbed_until);
            if feedback.scan == since + self.patience_scans + 1 {
                let axis = self.machine.axis_name(index);
                let words = format!(
                    "the standby of axis {axis} is there and has not come into step since scan {since}"
                );
                self.violations.say(feedback.scan, words);
            }
        }
    }

    /// A cause that is new has really happened.
    fn cause(
        &mut self,
        before: Option<&Feedback>,
        feedback: &Feedback,
        lies: impl Fn(usize) -> bool,
    ) {
        let known = before
            .is_some_and(|b| (b.cause, b.cause_scan) == (feedback.cause, feedback.cause_scan));
        if known || feedback.cause == 0 {
            return;
        }
        let Some(cause) = Cause::from_wire(feedback.cause) else {
            self.violations
                .say(feedback.scan, format!("cause {} is none", feedback.cause));
            return;
        };
        let axis = feedback.cause_axis as usize;
        let shown = feedback.axes().get(axis);
        let asked = self.asked.get(axis).copied().unwrap_or(0);
        let is_asked = asked >> cause as u32 & 1 == 1;
        let true_word = match cause {
            Cause::None | Cause::EmergencyStop => true,
            Cause::ServoLost => self.lost & (1 << axis.min(31)) != 0,
            Cause::Watchdog => shown.is_some_and(|axis| axis.missed_in_a_row > 0),
            Cause::Planner => self.planner == cause as u32,
            Cause::MasterLost => feedback.incarnation > 1,
            Cause::NotInPosition => !feedback.axes().is_empty(),
            Cause::FollowingError
            | Cause::SoftLimit
            | Cause::SpeedLimit
            | Cause::BadValue
            | Cause::BadFeedback
            | Cause::WindowMissing
            | Cause::TorqueLimit => is_asked || lies(axis) || self.is_off(before, axis),
            Cause::DriveFault
            | Cause::DriveLost
            | Cause::DriveOff
            | Cause::NotReferenced
            | Cause::Displaced
            | Cause::Stalled
            | Cause::Spindle
            | Cause::ToolChange
            | Cause::MachineCode
            | Cause::Skew
            | Cause::GantryTorque
            | Cause::EmergencyStopChain
            | Cause::DrivesNotAllowed
            | Cause::LogicLost
            | Cause::LogicTrip
            | Cause::MachineAlarm
            | Cause::LimitSwitch => false,
            Cause::HomeSwitch | Cause::HomeIndex | Cause::HomeDrive => {
                let settings = self.machine.axes.get(axis);
                settings.is_some_and(|settings| settings.homing.is_some())
            }
            Cause::Abort => feedback.messages > 0,
            Cause::ProbeJogged => feedback.inputs.contact == 1,
            Cause::ProbeMissed => feedback.answer.outcome == AnswerOutcome::Missed as u32,
            Cause::ProbeEarly => feedback.answer.outcome == AnswerOutcome::Early as u32,
            Cause::ProbeLost => feedback.answer.outcome == AnswerOutcome::Lost as u32,
        };
        if !true_word {
            let words = format!(
                "the machine says: {}, which has not happened",
                cause.words()
            );
            self.violations.say(feedback.scan, words);
        }
    }

    /// Whether an axis is further from its command than it may be, as the master sees it.
    fn is_off(&self, before: Option<&Feedback>, axis: usize) -> bool {
        let shown = before.and_then(|f| f.axes().get(axis));
        let Some((shown, settings)) = shown.zip(self.machine.axes.get(axis)) else {
            return false;
        };
        let off = shown.command_position.saturating_sub(shown.motor_position) as f64;
        off.abs() * settings.increment_mm() >= settings.following_error_limit_mm
    }
}

fn is_there(roster: &Roster, axis: usize, role: u32) -> bool {
    let servo = roster.living(Job::Servo, axis, role);
    servo.is_some_and(|servo| servo.stalled == 0)
}
