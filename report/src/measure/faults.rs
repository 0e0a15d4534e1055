//! Who took part, who died, and what the machine made of it.
//!
//! What follows a death is judged by what the master says afterwards, never by what should have followed:
//!
//! | process | reaction |
//! |---|---|
//! | planner | `braked to rest on the path` |
//! | servo that drove, with a standby | `standby took over`, in the scan in which the other's command was taken |
//! | servo that drove, without, in motion | `master brought it to rest on the path` |
//! | servo that drove, without, in a jog or at rest | `all axes quick-stopped together`, with braking distance and deviation from the path |
//! | servo that stood by | `none: …`; its axis has no standby until another one is there |
//! | master | `drives braked, disabled; positions kept`, once another one speaks; `the cell ended` until then |
//! | recorder | `none` |

use std::collections::BTreeMap;

use bus::sample::{AxisFeedback, Cause, Feedback, Job, MAX_AXES, Mode, Participant, Roster};
use machine::{Machine, Process};
use path::geometry::AxisVector;
use serde::{Serialize, Serializer};

use super::outcome::{Loss, Reaction, mode_word};
use crate::rounded::{write_r3, write_um};
use monitor::deaths::death_of;
use monitor::words::StopCause;

/// Faults followed at most; more are counted by the processes' deaths only.
const FAULTS_MAX: usize = 1000;
/// Scans after the reaction that the contour error is still followed for: five time constants of a position loop of 50 1/s
/// with scans of 1 ms.
const AFTER_SCANS: u64 = 100;
/// In real time the launcher learns of a death some scans late: so many before it, a takeover may have come.
const NOTICED_LATE_SCANS: u64 = 1000;
/// Changes of an axis's controller kept.
const CHANGES_MAX: usize = 1000;
/// Step of the tool in one scan below which it stands, in mm: 0.1 mm/s with scans of 1 ms.
const STANDS_MM: f64 = 1e-4;
/// Scans that it must have stood.
const STANDS_SCANS: u32 = 20;

/// A process of the run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ProcessResult {
    /// Its name.
    pub process: String,
    /// How many processes had its place.
    pub starts: u32,
    /// Processes that had had its place before the run began.
    #[serde(skip)]
    started_before: u32,
    /// Deaths other than an orderly exit: scan and signal (0: it exited by itself, with a failure).
    #[serde(serialize_with = "write_deaths")]
    pub deaths: Vec<(u64, i32)>,
}

fn write_deaths<S: Serializer>(deaths: &[(u64, i32)], to: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Death {
        scan: u64,
        signal: i32,
    }
    to.collect_seq(deaths.iter().map(|&(scan, signal)| Death { scan, signal }))
}

/// A death and what followed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FaultResult {
    /// Scan of the death.
    pub scan: u64,
    /// Process that died.
    pub process: String,
    /// How it died.
    pub kind: Loss,
    /// Scans until the roster showed it; none if the roster that showed it first is not in the log.
    pub noticed_after_scans: Option<u64>,
    /// What the machine did.
    pub reaction: Reaction,
    /// Largest contour error from the death until the reaction was over and 100 scans more, deviation in a quick stop
    /// included, in mm.
    #[serde(rename = "contour_error_um_max", serialize_with = "write_um")]
    pub contour_error_mm: f64,
    /// Way of the tool from the trip to its rest, in mm: along it where the log has it, else straight; none if nothing braked off
    /// the path.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "write_r3")]
    pub brake_distance_mm: Option<f64>,
    /// Largest distance from the path while it braked, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(rename = "deviation_um", serialize_with = "write_um")]
    pub deviation_mm: Option<f64>,
    /// Scan in which motion on the path went on; none if it never stopped, or never went on.
    pub resumed_at_scan: Option<u64>,
}

/// What the instruments saw in one scan.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    /// Largest contour error, in mm; 0 where it is not measured.
    pub contour_mm: f64,
    /// The tool at the end of the scan, in mm; none without instruments.
    pub tool_mm: Option<AxisVector>,
    /// Its distance from the path near the place the master names, or where the path was left, in mm.
    pub from_path_mm: Option<f64>,
}

/// Controller of an axis: role and incarnation.
type Controller = (u32, u32);

/// Another controller's command was taken.
#[derive(Debug, Clone, Copy)]
struct Change {
    scan: u64,
    axis: usize,
    from: Controller,
    to: Controller,
}

/// How far the reaction to a death has come.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// Its scan has not come, or nothing has happened yet.
    Watching,
    /// The machine brakes or has braked on the path, or stood there.
    AtRest,
    /// All axes brake off the path.
    Braking { standing_scans: u32 },
    /// They stand off the path.
    OffPath,
    /// Nothing more follows from it; the contour error is followed up to this scan.
    Settling { until: u64 },
}

#[derive(Debug)]
struct Watched {
    result: FaultResult,
    job: u32,
    /// Axis and controller of a servo.
    servo: Option<(usize, Controller)>,
    /// Incarnation that died.
    incarnation: u32,
    phase: Phase,
    looked: bool,
}

/// Follows the roster and the faults in it.
#[derive(Debug)]
pub struct Faults {
    machine: Machine,
    /// Starts and deaths.
    processes: BTreeMap<Process, ProcessResult>,
    watched: Vec<Watched>,
    roster_version: Option<u64>,
    begins_at: u64,
    changes: Vec<Change>,
    last: Option<(Feedback, Option<AxisVector>)>,
}

/// What is known when a scan is judged.
struct Moment<'a> {
    feedback: &'a Feedback,
    seen: &'a Seen,
    before: Option<&'a (Feedback, Option<AxisVector>)>,
    machine: &'a Machine,
    changes: &'a [Change],
}

impl Faults {
    /// For one machine.
    pub fn new(machine: &Machine) -> Self {
        Faults {
            machine: machine.clone(),
            processes: BTreeMap::new(),
            watched: Vec::new(),
            roster_version: None,
            begins_at: 0,
            changes: Vec::new(),
            last: None,
        }
    }

    /// Deaths in earlier scans are those of an earlier run.
    pub fn begins_at(&mut self, scan: u64) {
        self.begins_at = scan;
    }

    /// Takes a roster; one that is taken twice changes nothing.
    pub fn roster(&mut self, roster: &Roster) {
        let before = self.roster_version.replace(roster.version);
        // Between two rosters that do not follow each other another one may have named it earlier.
        let first_named = before.is_none_or(|before| roster.version <= before + 1);
        for participant in &roster.participants {
            let Some(process) = Process::of(participant) else {
                continue;
            };
            let machine = &self.machine;
            let result = self
                .processes
                .entry(process)
                .or_insert_with(|| ProcessResult {
                    process: process.name(machine),
                    starts: 0,
                    started_before: 0,
                    deaths: Vec::new(),
                });
            if result.starts == 0 && self.begins_at > 0 {
                result.started_before = participant.incarnation.saturating_sub(1);
            }
            let starts = participant
                .incarnation
                .saturating_sub(result.started_before);
            result.starts = result.starts.max(starts);
            let death = death_of(participant).filter(|(scan, ..)| *scan >= self.begins_at);
            let Some((scan, signal, _)) = death else {
                continue;
            };
            if result.deaths.contains(&(scan, signal)) {
                continue;
            }
            result.deaths.push((scan, signal));
            if self.watched.len() < FAULTS_MAX {
                let noticed = roster.visible_from.saturating_sub(scan);
                let noticed = first_named.then_some(noticed);
                let watched = Watched::of(participant, result.process.clone(), noticed);
                self.watched.push(watched);
            }
        }
    }

    /// Takes one scan.
    pub fn scan(&mut self, feedback: &Feedback, seen: &Seen) {
        self.note_changes(feedback);
        let moment = Moment {
            feedback,
            seen,
            before: self.last.as_ref(),
            machine: &self.machine,
            changes: &self.changes,
        };
        for watched in &mut self.watched {
            watched.take(&moment);
        }
        self.last = Some((*feedback, seen.tool_mm));
    }

    fn note_changes(&mut self, feedback: &Feedback) {
        let Some((last, _)) = &self.last else { return };
        for (axis, (now, before)) in feedback.axes().iter().zip(last.axes()).enumerate() {
            let (from, to) = (controller(before), controller(now));
            if from != to && axis < MAX_AXES && self.changes.len() < CHANGES_MAX {
                self.changes.push(Change {
                    scan: feedback.scan,
                    axis,
                    from,
                    to,
                });
            }
        }
    }

    /// Ends the watch.
    pub fn finish(self) -> (Vec<ProcessResult>, Vec<FaultResult>) {
        let processes = self.processes.into_values().collect();
        let mut faults: Vec<FaultResult> = self
            .watched
            .into_iter()
            .map(|watched| watched.result)
            .collect();
        faults.sort_by(|a, b| (a.scan, &a.process).cmp(&(b.scan, &b.process)));
        (processes, faults)
    }
}

fn controller(axis: &AxisFeedback) -> Controller {
    (axis.taken_role, axis.taken_incarnation)
}

/// Whether windows are executed and the setpoints move on the path.
fn moves_on_path(feedback: &Feedback) -> bool {
    Mode::from_wire(feedback.mode) == Some(Mode::Enabled)
        && !feedback.window.is_none()
        && feedback.at_rest == 0
        && !feedback.tag.is_off_path()
}

impl Watched {
    /// Of a participant that died.
    fn of(participant: &Participant, process: String, noticed_after_scans: Option<u64>) -> Watched {
        // A roster that names the successor too counts one more.
        let successor = u32::from(participant.live == 1);
        let incarnation = participant.incarnation.saturating_sub(successor);
        Watched {
            result: FaultResult {
                scan: participant.death_scan,
                process,
                kind: match participant.death_signal {
                    0 => Loss::Exited,
                    _ => Loss::Killed,
                },
                noticed_after_scans,
                reaction: match participant.job {
                    job if job == Job::Master as u32 => Reaction::Other("the cell ended".into()),
                    job if job == Job::Monitor as u32 => Reaction::None,
                    _ => Reaction::not_needed("motion went on undisturbed"),
                },
                contour_error_mm: 0.0,
                brake_distance_mm: None,
                deviation_mm: None,
                resumed_at_scan: None,
            },
            job: participant.job,
            servo: (participant.job == Job::Servo as u32)
                .then_some((participant.axis as usize, (participant.role, incarnation))),
            incarnation,
            phase: Phase::Watching,
            looked: false,
        }
    }

    fn take(&mut self, moment: &Moment<'_>) {
        let feedback = moment.feedback;
        if feedback.scan < self.result.scan {
            return;
        }
        if let Phase::Settling { until } = self.phase {
            if feedback.scan <= until {
                self.widen(moment.seen.contour_mm);
            }
            return;
        }
        self.widen(moment.seen.contour_mm);
        let first_look = !std::mem::replace(&mut self.looked, true);
        match self.phase {
            Phase::Watching if self.job == Job::Monitor as u32 => self.settle(self.result.scan),
            Phase::Watching if self.job == Job::Master as u32 => self.await_master(moment),
            Phase::Watching => self.watch(moment, first_look),
            Phase::AtRest => self.rest(moment),
            Phase::Braking { standing_scans } => self.brake(moment, standing_scans),
            Phase::OffPath => self.off_path(moment),
            Phase::Settling { .. } => {}
        }
    }

    fn widen(&mut self, contour_mm: f64) {
        self.result.contour_error_mm = self.result.contour_error_mm.max(contour_mm);
    }

    fn settle(&mut self, since: u64) {
        let until = since.saturating_add(AFTER_SCANS);
        self.phase = Phase::Settling { until };
    }

    fn resume(&mut self, scan: u64) {
        self.result.resumed_at_scan = Some(scan);
        self.settle(scan);
    }

    /// Motion goes on as planned so far.
    fn watch(&mut self, moment: &Moment<'_>, first_look: bool) {
        let feedback = moment.feedback;
        if self.judge_takeover(moment) {
            return;
        }
        match Mode::from_wire(feedback.mode) {
            Some(Mode::Tripped) => self.trip(moment),
            Some(Mode::Disabled) if first_look => {
                self.result.reaction = Reaction::not_needed("the drives were off");
                self.settle(feedback.scan);
            }
            Some(Mode::Finished | Mode::Disabled | Mode::Jogging | Mode::Ready) | None => {
                self.settle(feedback.scan);
            }
            Some(Mode::Enabled | Mode::Stopping | Mode::Stopped) => {
                let rests = feedback.at_rest == 1 || feedback.window.is_none();
                let stopped = Mode::from_wire(feedback.mode) == Some(Mode::Stopped);
                if rests || stopped {
                    self.result.reaction = match first_look {
                        true => Reaction::not_needed("the machine was at rest"),
                        false => Reaction::BrakedOnPath,
                    };
                    self.phase = Phase::AtRest;
                } else if self.job == Job::Planner as u32
                    && feedback.window.incarnation > self.incarnation
                {
                    // The successor's windows are executed, and nothing has stopped in between.
                    self.settle(feedback.scan);
                }
            }
        }
    }

    /// Whether the loss of a servo is dealt with by its standby, or concerns one.
    fn judge_takeover(&mut self, moment: &Moment<'_>) -> bool {
        let Some((axis, died)) = self.servo else {
            return false;
        };
        let earliest = self.result.scan.saturating_sub(NOTICED_LATE_SCANS);
        let takeover = moment
            .changes
            .iter()
            .find(|change| change.axis == axis && change.from == died && change.scan >= earliest)
            .filter(|change| change.to.0 != died.0);
        if let Some(takeover) = takeover {
            self.result.reaction = Reaction::Other("standby took over".into());
            self.resume(takeover.scan);
            return true;
        }
        // The feedback of its own scan still names who drove in the scan before.
        let drives = moment.feedback.axes().get(axis).map(controller);
        let stood_by = drives.is_some_and(|(role, _)| role != died.0);
        if stood_by {
            let name = moment.machine.axis_name(axis);
            let why = format!("axis {name} has no standby until another one is there");
            self.result.reaction = Reaction::not_needed(&why);
            self.settle(self.result.scan);
        }
        stood_by
    }

    fn trip(&mut self, moment: &Moment<'_>) {
        let feedback = moment.feedback;
        let cause = StopCause::of(moment.machine, feedback);
        let own_axis = self.servo.map(|(axis, _)| axis as u32);
        let of_this_servo =
            cause.cause == Some(Cause::ServoLost) && own_axis == Some(feedback.cause_axis);
        let how = match self.result.reaction {
            Reaction::BrakedOnPath => "master brought it to rest on the path",
            _ => "all axes quick-stopped together",
        };
        self.result.reaction = Reaction::stopped(how, (!of_this_servo).then_some(cause));
        self.phase = Phase::Braking { standing_scans: 0 };
        self.brake(moment, 0);
    }

    /// All axes brake off the path: how far, and how far off.
    fn brake(&mut self, moment: &Moment<'_>, standing_scans: u32) {
        let step_mm = self.step_mm(moment);
        if let Some(step_mm) = step_mm {
            *self.result.brake_distance_mm.get_or_insert(0.0) += step_mm;
        }
        if let Some(from_path_mm) = moment.seen.from_path_mm {
            let largest_mm = self.result.deviation_mm.unwrap_or(0.0).max(from_path_mm);
            self.result.deviation_mm = Some(largest_mm);
            self.widen(largest_mm);
        }
        let stands = step_mm.is_none_or(|step_mm| step_mm < STANDS_MM);
        let standing_scans = if stands { standing_scans + 1 } else { 0 };
        let tripped = Mode::from_wire(moment.feedback.mode) == Some(Mode::Tripped);
        self.phase = if tripped && standing_scans < STANDS_SCANS {
            Phase::Braking { standing_scans }
        } else {
            Phase::OffPath
        };
    }

    fn step_mm(&self, moment: &Moment<'_>) -> Option<f64> {
        let (_, before) = moment.before?;
        Some((moment.seen.tool_mm? - (*before)?).norm())
    }

    fn off_path(&mut self, moment: &Moment<'_>) {
        if moves_on_path(moment.feedback) {
            self.resume(moment.feedback.scan);
        }
    }

    fn rest(&mut self, moment: &Moment<'_>) {
        let feedback = moment.feedback;
        if self.judge_takeover(moment) {
            return;
        }
        if moves_on_path(feedback) {
            self.resume(feedback.scan);
            return;
        }
        match Mode::from_wire(feedback.mode) {
            // It did not stop for the death: what had been planned was the end of the program.
            Some(Mode::Finished) => {
                let why = "the program had been planned to its end";
                self.result.reaction = Reaction::not_needed(why);
                self.settle(feedback.scan);
            }
            Some(Mode::Tripped) if self.servo.is_some() => self.trip(moment),
            _ => {}
        }
    }

    /// Nobody speaks until another master does.
    fn await_master(&mut self, moment: &Moment<'_>) {
        let feedback = moment.feedback;
        if feedback.incarnation <= self.incarnation {
            return;
        }
        let before = moment.before.map(|(before, _)| before);
        let positions = before.and_then(|before| self.judge_positions(before, moment));
        let positions = positions.map_or(String::new(), |words| format!("; {words}"));
        let mode = mode_word(Mode::from_wire(feedback.mode));
        self.result.reaction = Reaction::Other(format!("drives braked, {mode}{positions}"));
        if let Some(step_mm) = self.step_mm(moment) {
            self.result.brake_distance_mm = Some(step_mm);
        }
        if let Some(from_path_mm) = moment.seen.from_path_mm {
            self.result.deviation_mm = Some(from_path_mm);
            self.widen(from_path_mm);
        }
        self.phase = Phase::OffPath;
    }

    /// Whether each axis is where it can have come to by its own drive's quick stop; none where the log does not reach close
    /// enough to the death.
    fn judge_positions(&self, before: &Feedback, moment: &Moment<'_>) -> Option<String> {
        // The scan of the death may have been simulated still, and one more is the transport delay.
        let unseen = self.result.scan.saturating_sub(before.scan) + 2;
        if unseen > 12 {
            return None;
        }
        let axes = moment.machine.axes.iter();
        let axes = axes.zip(before.axes()).zip(moment.feedback.axes());
        let period_s = moment.machine.scan_period_s();
        for ((axis, was), is) in axes {
            let moved_mm =
                is.motor_position.saturating_sub(was.motor_position) as f64 * axis.increment_mm();
            let speed_mm_s = was.velocity_mm_s.abs();
            // Twice the way of a quick stop, because friction and torque limits are not in its formula.
            let most_mm = speed_mm_s * unseen as f64 * period_s
                + speed_mm_s * speed_mm_s / axis.quick_stop_mm_s2
                + 0.01;
            if moved_mm.abs() > most_mm {
                let (name, unit) = (&axis.name, axis.kind.unit());
                return Some(format!(
                    "axis {name} came back {moved_mm:.3} {unit} from where it was: at most {most_mm:.3} {unit} would be right"
                ));
            }
        }
        Some("positions kept".into())
    }
}
