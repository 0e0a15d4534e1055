//! Who took part, who died, and what the machine made of it.

use std::collections::BTreeMap;

use bus::machine::Machine;
use bus::sample::{Cause, Feedback, Job, Mode, Roster};

/// Faults followed at most; more are counted by the processes' deaths only.
const FAULTS_MAX: usize = 1000;

/// A process of the run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProcessResult {
    /// Its name.
    pub process: String,
    /// How many processes had its place.
    pub starts: u32,
    /// Deaths other than an orderly exit: scan and signal (0: it exited by itself, with a failure).
    pub deaths: Vec<(u64, i32)>,
}

/// A death and what followed.
#[derive(Debug, Clone, PartialEq)]
pub struct FaultResult {
    /// Scan of the death.
    pub scan: u64,
    /// Process that died.
    pub process: String,
    /// `killed` or `exited`.
    pub kind: &'static str,
    /// Signal, 0 if none.
    pub signal: i32,
    /// Scans until the roster said so.
    pub noticed_after_scans: u64,
    /// What the machine did.
    pub reaction: String,
    /// Largest contour error until motion resumed, in mm.
    pub contour_error_mm: f64,
    /// Scan in which motion went on; none if it never stopped, or never went on.
    pub resumed_at_scan: Option<u64>,
}

#[derive(Debug)]
struct Watched {
    result: FaultResult,
    servo: Option<usize>,
    role_before: Option<u32>,
    stopped: bool,
    done: bool,
}

/// Follows the roster and the faults in it.
#[derive(Debug)]
pub struct Faults {
    axes: Vec<String>,
    /// By (job, axis, role): starts and deaths.
    places: BTreeMap<(u32, u32, u32), ProcessResult>,
    watched: Vec<Watched>,
}

impl Faults {
    /// For one machine.
    pub fn new(machine: &Machine) -> Self {
        Faults {
            axes: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
            places: BTreeMap::new(),
            watched: Vec::new(),
        }
    }

    /// Takes a roster; one that is taken twice changes nothing.
    pub fn roster(&mut self, roster: &Roster) {
        for participant in roster.participants.iter().filter(|p| p.job != 0) {
            let key = (participant.job, participant.axis, participant.role);
            let name = process_name(&self.axes, key);
            let place = self.places.entry(key).or_insert_with(|| ProcessResult {
                process: name.clone(),
                starts: 0,
                deaths: Vec::new(),
            });
            place.starts = place.starts.max(participant.incarnation);
            let orderly = participant.death_signal == 0 && participant.death_status == 0;
            let death = (participant.death_scan, participant.death_signal);
            if participant.death_scan == u64::MAX || orderly || place.deaths.contains(&death) {
                continue;
            }
            place.deaths.push(death);
            if self.watched.len() >= FAULTS_MAX {
                continue;
            }
            self.watched.push(Watched {
                result: FaultResult {
                    scan: participant.death_scan,
                    process: name,
                    kind: if participant.death_signal != 0 {
                        "killed"
                    } else {
                        "exited"
                    },
                    signal: participant.death_signal,
                    noticed_after_scans: roster.visible_from.saturating_sub(participant.death_scan),
                    reaction: if participant.job == Job::Machine as u32 {
                        "the cell ended".into()
                    } else {
                        "motion went on undisturbed".into()
                    },
                    contour_error_mm: 0.0,
                    resumed_at_scan: None,
                },
                servo: (participant.job == Job::Servo as u32).then_some(participant.axis as usize),
                role_before: None,
                stopped: false,
                done: false,
            });
        }
    }

    /// Takes one scan.
    pub fn scan(&mut self, feedback: &Feedback, contour_mm: f64) {
        for watched in self.watched.iter_mut().filter(|watched| !watched.done) {
            watched.take(feedback, contour_mm, &self.axes);
        }
    }

    /// Ends the watch.
    pub fn finish(self) -> (Vec<ProcessResult>, Vec<FaultResult>) {
        let processes = self.places.into_values().collect();
        let mut faults: Vec<FaultResult> = self
            .watched
            .into_iter()
            .map(|watched| watched.result)
            .collect();
        faults.sort_by(|a, b| (a.scan, &a.process).cmp(&(b.scan, &b.process)));
        (processes, faults)
    }
}

impl Watched {
    fn take(&mut self, feedback: &Feedback, contour_mm: f64, axes: &[String]) {
        let role = self
            .servo
            .and_then(|axis| feedback.axes().get(axis))
            .map(|axis| axis.taken_role);
        if feedback.scan < self.result.scan {
            self.role_before = role;
            return;
        }
        self.result.contour_error_mm = self.result.contour_error_mm.max(contour_mm);
        let mode = Mode::from_wire(feedback.mode);
        let moving =
            mode == Some(Mode::Enabled) && !feedback.window.is_none() && feedback.at_rest == 0;
        if self.stopped {
            if moving {
                self.result.resumed_at_scan = Some(feedback.scan);
                self.done = true;
            }
        } else if self.role_before.is_some() && role != self.role_before {
            self.result.reaction = "standby took over".into();
            self.result.resumed_at_scan = Some(feedback.scan);
            self.done = true;
        } else if mode == Some(Mode::Tripped) {
            let cause = Cause::from_wire(feedback.cause).map_or("unknown cause", Cause::words);
            let axis = axes.get(feedback.cause_axis as usize);
            let whose = axis.map_or(String::new(), |axis| format!("axis {axis}: "));
            self.result.reaction = format!("all axes stopped ({whose}{cause})");
            self.stopped = true;
        } else if matches!(mode, Some(Mode::Stopping | Mode::Stopped)) {
            self.result.reaction = "came to rest on the path".into();
            self.stopped = mode == Some(Mode::Stopped);
        } else if mode == Some(Mode::Enabled) && feedback.at_rest == 1 {
            self.result.reaction = "came to rest on the path".into();
            self.stopped = true;
        } else if mode == Some(Mode::Finished) {
            self.done = true;
        }
    }
}

fn process_name(axes: &[String], (job, axis, role): (u32, u32, u32)) -> String {
    let servo = || {
        let letter = axes.get(axis as usize).map_or("?", String::as_str);
        let standby = if role == 0 { "" } else { "-b" };
        format!("servo-{letter}{standby}")
    };
    match job {
        job if job == Job::Machine as u32 => "plant-sim".into(),
        job if job == Job::Planner as u32 => "planner".into(),
        job if job == Job::Servo as u32 => servo(),
        job if job == Job::Monitor as u32 => "monitor".into(),
        job => format!("job {job}"),
    }
}
