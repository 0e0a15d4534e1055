//! What is known of a running cell: fed with samples, shown by others. No clock, no port, no screen.

use std::collections::VecDeque;

use bus::member::Pace;
use bus::messages::{ProgramMessage, TROUBLE};
use bus::sample::{
    AxisCommand, Cause, Feedback, Instruments, Job, Mode, Participant, PlannerStatus, ProgramState,
    Roster, STANDBY_ALARM_S,
};
use machine::{Machine, Process};
use path::geometry::{AxisVector, Element, Feed, Shape};
use path::kinematics::Kinematics;
use program::{Modal, Program};
use remote::state::{AlarmState, BusState, RunsState, SignalState};
use report::contour;

use super::axis::AxisView;
use super::circle::CircleView;
use super::dro::ProgramTimes;
use super::events::{Events, Weight};
use super::reversal::Reversals;
use super::state::Shown;
use super::timing::Timing;
use super::track::Track;
use super::trail::Trail;
use super::words::{self, Says, Tone};
use launcher::children::Child;

/// Messages of the program that are shown.
const SAID_KEPT: usize = 5;

/// A running cell as an observer knows it.
#[derive(Debug)]
pub struct Model {
    /// Its name.
    pub cell: String,
    /// Its machine file.
    pub machine: Machine,
    /// Its pace, if `/proc` tells.
    pub pace: Option<Pace>,
    /// The newest feedback.
    pub feedback: Option<Feedback>,
    /// For how long it has been the newest, in s.
    pub feedback_age_s: f64,
    /// Why less is recorded than was asked for.
    pub scarce: Option<String>,
    /// The newest word of the planner.
    pub planner: Option<PlannerStatus>,
    /// The program, if it could be read.
    pub program: Option<Program>,
    /// What is known of it for the readout.
    pub course: Option<ProgramTimes>,
    /// The state that the next program begins with, if it is known.
    pub next_start: Option<Modal>,
    /// File name of the program that was loaded into a cell that stays up.
    pub loaded: Option<String>,
    /// Per axis.
    pub axes: Vec<AxisView>,
    /// The fieldbus, where the cell has one and its page can be read.
    pub bus: Option<BusState>,
    /// What named inputs and outputs show.
    pub signals: Vec<SignalState>,
    /// Alarms of the machine.
    pub alarms: Vec<AlarmState>,
    /// What run directories take, where the launcher says so.
    pub runs: Option<RunsState>,
    /// The circle that is travelled.
    pub circle: CircleView,
    /// Where the tool was; only of an observer who wants to draw it.
    pub trail: Option<Trail>,
    /// Reversals since the observer came.
    pub reversals: Reversals,
    /// What happened since.
    pub events: Events,
    /// What the program has said to its operator, newest last.
    pub said: VecDeque<ProgramMessage>,
    /// How evenly scans follow each other.
    pub timing: Timing,
    /// The run is over.
    pub ended: bool,
    /// Scans seen, and scans that were lost to this observer because it was not quick enough.
    pub seen_scans: (u64, u64),
    /// What is shown of all this: since the last look, or as an observer on the spot has reported it.
    pub shown: Shown,
    kinematics: Kinematics,
    roster: Option<Roster>,
    children: Vec<Child>,
    answered: Vec<Option<u64>>,
    recorded: Option<u64>,
    /// The newest scan when `answered` was read.
    heard_scan: Option<u64>,
    track: Track,
}

impl Model {
    /// Of a cell of which nothing has been heard yet.
    pub fn new(cell: &str, machine: Machine) -> Self {
        let mut model = Model {
            cell: cell.into(),
            pace: None,
            feedback: None,
            feedback_age_s: 0.0,
            scarce: None,
            planner: None,
            program: None,
            course: None,
            next_start: None,
            loaded: None,
            axes: machine.axes.iter().map(AxisView::of).collect(),
            bus: None,
            runs: None,
            signals: Vec::new(),
            alarms: Vec::new(),
            circle: CircleView::default(),
            trail: None,
            reversals: Reversals::default(),
            events: Events::default(),
            said: VecDeque::new(),
            timing: Timing::new(f64::from(machine.scan.period_us)),
            ended: false,
            seen_scans: (0, 0),
            shown: Shown::default(),
            kinematics: program::kinematics_of(&machine),
            roster: None,
            children: Vec::new(),
            answered: Vec::new(),
            recorded: None,
            heard_scan: None,
            track: Track::default(),
            machine,
        };
        model.shown = Shown::of(&model);
        model
    }

    /// Whether everything has been heard of once.
    pub fn is_whole(&self) -> bool {
        let errors = self.axes.iter().all(|axis| axis.error_um.is_some());
        self.feedback.is_some() && self.roster.is_some() && self.planner.is_some() && errors
    }

    /// Takes what the program says; as an event if it has just said it.
    pub fn said(&mut self, scan: u64, message: ProgramMessage, just_now: bool) {
        if just_now {
            let who = match message.number {
                TROUBLE => "the planner",
                _ => "the program",
            };
            let text = format!("{who} says, {message}");
            self.events.note(scan, Weight::Note, text);
        }
        if self.said.len() == SAID_KEPT {
            self.said.pop_front();
        }
        self.said.push_back(message);
    }

    /// Takes a feedback; they come in order.
    pub fn feedback(&mut self, now: &Feedback) {
        if let Some(before) = &self.feedback {
            if now.scan <= before.scan {
                return;
            }
            self.seen_scans.1 += now.scan - before.scan - 1;
        }
        self.seen_scans.0 += 1;
        self.track.begin(now.scan, now.tag);
        self.events.feedback(now, &self.machine);
        // Else the command position follows the axes.
        let driven = matches!(
            Mode::from_wire(now.mode),
            Some(Mode::Enabled | Mode::Stopping | Mode::Jogging)
        );
        let angular_rad_s = self.angular_rad_s(now);
        let period_s = self.machine.scan_period_s();
        let axes = self.axes.iter_mut().zip(now.axes());
        for (index, (axis, sample)) in axes.enumerate() {
            if let Some(turn) = axis.feedback(now.scan, sample, driven) {
                self.reversals.begin(index, turn, angular_rad_s, period_s);
            }
        }
        self.ended |= now.last == 1;
        self.feedback = Some(*now);
    }

    /// Angular speed on the arc of this feedback; none elsewhere.
    fn angular_rad_s(&self, feedback: &Feedback) -> Option<f64> {
        let element = self.element(feedback)?;
        match (&element.shape, element.feed) {
            (Shape::Arc { radius_mm, .. }, Feed::PathMmS(feed_mm_s)) => {
                Some(feed_mm_s * f64::from(feedback.override_percent) / 100.0 / radius_mm)
            }
            _ => None,
        }
    }

    fn element(&self, feedback: &Feedback) -> Option<&Element> {
        let executing = !feedback.window.is_none();
        let elements = &self.program.as_ref().filter(|_| executing)?.path.elements;
        elements.get(feedback.tag.element as usize)
    }

    /// Takes a command of any servo.
    pub fn command(&mut self, command: &AxisCommand) {
        let index = command.axis as usize;
        let Some(axis) = self.axes.get_mut(index) else {
            return;
        };
        if command.role != axis.now.taken_role {
            return;
        }
        let error_um = axis.command(command);
        if let (Some(error_um), Some(note)) = (error_um, self.track.of_mut(command.scan))
            && let Some(slot) = note.error_um.get_mut(index)
        {
            *slot = error_um;
        }
    }

    /// How far the second motor of a gantry is ahead of its axis's first, in µm; none of other motors.
    pub fn skew_um(&self, axis: usize) -> Option<f64> {
        let mut gantries = self.machine.gantries();
        let pair = gantries.find(|pair| pair.follower == axis)?;
        let feedback = self.feedback.as_ref()?;
        Some(self.machine.skew_mm(&pair, feedback) * 1e3)
    }

    /// Takes what the instruments saw of a scan.
    pub fn instruments(&mut self, sample: &Instruments) {
        let last = sample.last().unwrap_or(0);
        let table_mm = sample.places_mm(last, |axis| &axis.table_mm);
        let table_mm = AxisVector::from(self.machine.to_program_axes(table_mm));
        self.take_trail(sample.scan, &table_mm);
        let (Some(note), Some(program)) = (self.track.of_mut(sample.scan), &self.program) else {
            return;
        };
        let driven = self.feedback.as_ref().is_some_and(|feedback| {
            !feedback.window.is_none() && feedback.mode != Mode::Disabled as u32
        });
        let element = program.path.elements.get(note.tag.element as usize);
        let Some(element) = element.filter(|_| driven) else {
            self.circle.leave();
            return;
        };
        let tool_mm = self.kinematics.tool(&table_mm);
        let period_s = self.machine.scan_period_s();
        if let Some(radial_um) = self.circle.take(sample.scan, element, &tool_mm, period_s) {
            note.radial_um = radial_um;
        }
    }

    fn take_trail(&mut self, scan: u64, table_mm: &AxisVector) {
        let Some(trail) = &mut self.trail else {
            return;
        };
        let tool_mm = self.kinematics.tool(table_mm);
        let error_um = self.track.of(scan).and_then(|note| {
            let path = &self.program.as_ref()?.path;
            contour::error_mm(path, &note.tag, &tool_mm).map(|mm| mm * 1e3)
        });
        trail.take(&tool_mm, error_um);
    }

    /// Takes a roster.
    pub fn roster(&mut self, roster: &Roster) {
        let scan = self.feedback.as_ref().map_or(0, |feedback| feedback.scan);
        self.events.roster(roster, scan, &self.machine);
        self.roster = Some(*roster);
    }

    /// Whether a second process could take the fieldbus over.
    pub fn has_bus_standby(&self) -> bool {
        let living = self.participants().iter();
        let living = living.filter(|one| one.job == Job::Fieldbus as u32 && one.live == 1);
        living.count() > 1
    }

    /// Takes what `/proc` says, the last scan that each place was done with, and the last that was recorded.
    pub fn processes_seen(
        &mut self,
        children: Vec<Child>,
        answered: Vec<Option<u64>>,
        recorded: Option<u64>,
    ) {
        self.heard_scan = self.feedback.as_ref().map(|feedback| feedback.scan);
        self.recorded = recorded;
        self.pace = children.iter().find_map(|child| child.pace).or(self.pace);
        self.children = children;
        self.answered = answered;
    }

    /// Ends one look: whatever is to be measured over several scans is, and histories go on.
    pub fn end_of_look(&mut self) {
        if let Some(feedback) = &self.feedback {
            self.reversals.measure(feedback.scan, &self.track);
        }
        self.axes.iter_mut().for_each(AxisView::end_of_look);
    }

    /// The places of the roster; none before one was heard.
    pub fn participants(&self) -> &[Participant] {
        let roster = self.roster.as_ref();
        roster.map_or(&[], |roster| &roster.participants)
    }

    /// Process id of the one that has this place now.
    pub fn pid_of(&self, place: usize, participant: &Participant) -> Option<u32> {
        let mut children = self.children.iter();
        let is_it =
            |child: &&Child| child.place == place && child.incarnation == participant.incarnation;
        children.find(is_it).map(|child| child.pid)
    }

    /// Scans since the process in this place was last done with one.
    pub fn age_scans(&self, place: usize, job: Job) -> Option<u64> {
        let now = self.heard_scan?;
        let then = match job {
            Job::Master => Some(now),
            Job::Monitor => self.recorded,
            _ => self.answered.get(place).copied().flatten(),
        };
        Some(now.saturating_sub(then?))
    }

    /// What there is to say of an axis that has been without its standby for too long.
    pub fn standby_alarm(&self, axis: &AxisView) -> Option<String> {
        let since_s = f64::from(axis.now.unsynchronised_scans) * self.machine.scan_period_s();
        (since_s > STANDBY_ALARM_S).then(|| {
            let (name, state) = (&axis.name, axis.redundancy().words());
            format!("axis {name} without its standby for {since_s:.0} s ({state})")
        })
    }

    /// Place of a process in the roster, once one was heard.
    pub fn place_of(&self, process: Process) -> Option<usize> {
        let mut places = self.participants().iter();
        places.position(|participant| Process::of(participant) == Some(process))
    }

    /// Name of the program's file; none where none is loaded.
    pub fn program_name(&self) -> Option<&str> {
        if self.program_state() == Some(ProgramState::None) {
            return None;
        }
        if let Some(loaded) = &self.loaded {
            return Some(loaded);
        }
        let path = std::path::Path::new(&self.program.as_ref()?.name);
        path.file_name()?.to_str()
    }

    /// How far the program is.
    pub fn program_state(&self) -> Option<ProgramState> {
        ProgramState::from_wire(self.feedback.as_ref()?.program)
    }

    /// Share of the program's path that is done, if the planner has reported.
    pub fn share_done(&self) -> Option<f64> {
        if self.program_state() == Some(ProgramState::Done) {
            return Some(1.0);
        }
        let status = self.planner.as_ref()?;
        let share = status.path_done_mm / status.path_length_mm;
        share.is_finite().then(|| share.clamp(0.0, 1.0))
    }

    /// Line and text of the block being executed, or of the one where the path was left.
    pub fn block(&self) -> Option<(u32, &str)> {
        let feedback = self.feedback.as_ref()?;
        let Some(program) = &self.program else {
            let line = self.planner.as_ref()?.line;
            return (line > 0).then_some((line, ""));
        };
        let tag = if feedback.tag.is_off_path() {
            &feedback.interrupted_at
        } else {
            &feedback.tag
        };
        let line = program.path.line_of(tag.element as usize)?;
        Some((line, program.block_text(line).unwrap_or_default().trim()))
    }

    /// What the program said where it has given itself up, or its planner where that cannot go on.
    pub fn given_up(&self) -> Option<String> {
        let said = self.said.back()?;
        let by_planner = said.number == TROUBLE;
        match Cause::from_wire(self.feedback.as_ref()?.cause)? {
            Cause::Abort if !by_planner => Some(said.to_string()),
            Cause::Planner if by_planner => Some(said.to_string()),
            _ => None,
        }
    }

    /// The state in words.
    pub fn says(&self) -> Says {
        let Some(feedback) = &self.feedback else {
            let detail = "nothing has been heard of the master yet";
            let next = "it is being started, or lost";
            return Says::new("…", "SILENT", Tone::Waits, detail, next);
        };
        let mut says = words::says(feedback, &self.machine);
        if let Some(text) = self.given_up() {
            says.words.detail = format!("{}; {text}", says.words.detail);
        }
        if self.ended {
            let Says { words, .. } = &says;
            let detail = format!(
                "last seen: {}, {}",
                words.state.to_lowercase(),
                words.detail
            );
            let next = "the run has ended; this view waits for the next one (q quits)";
            says = Says::new("—", "ENDED", Tone::Waits, &detail, next);
        } else if self.feedback_age_s > 0.5 {
            let age_s = self.feedback_age_s;
            let detail = format!("no feedback for {age_s:.1} s: the master is lost or stopped");
            let next = "what is shown is old; the drives brake by themselves";
            says = Says::new("✖", "SILENT", Tone::Bad, &detail, next);
        }
        says
    }
}
