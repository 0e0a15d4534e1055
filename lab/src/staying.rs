//! A cell that stays up, scan by scan: master, servos and simulated drives, with a planner that plans where programs are laid. It can be
//! copied where a run is to be interrupted.

use std::sync::Arc;

use bus::sample::{
    AxisCommand, Cause, Feedback, Job, Mode, OperatorRequest, OperatorResponse, Order,
    PlannerStatus, ProgramState, Reference, Refused, Roster,
};
use bytemuck::Zeroable;
use machine::{Machine, Process};
use master::saved::SavedState;
use master::{Answers, Drives, Master, RunEnd};
use planner::Planner;
use plant_sim::plant_file::PlantFile;
use servo::Servo;

mod drives;
mod planning;

pub use drives::TroubledDrives;
pub use planning::Planning;

/// A servo that died is back so many scans later.
const RESTARTS_SCANS: u64 = 30;

/// One servo process.
#[derive(Clone)]
pub struct Member {
    /// Its place in the roster.
    pub place: usize,
    /// Its axis.
    pub axis: usize,
    /// 0 for the first of the axis, 1 for the second.
    pub role: usize,
    /// The controller itself.
    pub servo: Servo,
    /// What it commanded in the scan before.
    pub said: Option<AxisCommand>,
}

/// Master, servos, simulated drives and perhaps a planner.
#[derive(Clone)]
pub struct Cell {
    /// As its file has it.
    pub machine: Arc<Machine>,
    /// What is simulated.
    pub plant: Arc<PlantFile>,
    /// The one that lives.
    pub master: Master<TroubledDrives>,
    /// What outlives it.
    pub saved: SavedState,
    /// Which master it is.
    pub incarnation: u32,
    /// The servos.
    pub members: Vec<Member>,
    /// None where nothing is planned: then the planner's place says in every scan that it has what is loaded.
    pub planning: Option<Planning>,
    /// Who takes part.
    pub roster: Roster,
    /// Places of processes that come back, and when.
    pub joining: Vec<(usize, u64)>,
    /// The servo of this axis breaks off in the next scan.
    pub trips: Option<usize>,
    /// What everybody obeys in the scan that was done last.
    pub now: Feedback,
    /// The servos of this axis say nothing in the next scan.
    pub misses: Option<usize>,
    /// The last feedback has been published.
    pub ended: bool,
}

impl Cell {
    /// With its drives off.
    pub fn new(machine: Machine, plant: PlantFile) -> Cell {
        let drives = TroubledDrives::new(plant.drives(&machine).expect("drives"));
        let saved = SavedState::of(&drives);
        let mut roster = Roster::zeroed();
        let servos: Vec<Process> = Process::servos(&machine).collect();
        let everybody = [Process::from(Job::Planner)];
        let all = everybody.into_iter().chain(servos.iter().copied());
        for (place, process) in roster.participants.iter_mut().zip(all) {
            *place = process.first();
        }
        let member = |(place, process): (usize, &Process)| Member {
            place: place + 1,
            axis: process.axis as usize,
            role: process.role as usize,
            servo: Servo::new(&machine, process.axis as usize, process.role, 1).expect("a servo"),
            said: None,
        };
        Cell {
            members: servos.iter().enumerate().map(member).collect(),
            master: Master::new(&machine, drives, 1, 0, false, RunEnd::WhenOrdered),
            machine: Arc::new(machine),
            plant: Arc::new(plant),
            saved,
            incarnation: 1,
            planning: None,
            roster,
            joining: Vec::new(),
            trips: None,
            misses: None,
            now: Feedback::zeroed(),
            ended: false,
        }
    }

    /// One scan of everybody.
    pub fn scan(&mut self) {
        self.now = self.master.feedback();
        if self.master.is_last() {
            self.ended = true;
            return;
        }
        self.admit();
        self.master.exchange();
        let latches = self.master.latches();
        self.saved.save(&latches, self.master.drives());
        let asks_planner = self.master.is_period_boundary();
        self.see_windows();
        let answers = self.answers(asks_planner);
        self.master.close_scan(&answers, &self.roster);
        if self.master.take_latched() {
            self.saved.latch(&self.master.latches());
        }
    }

    /// Processes that are due come back.
    pub fn admit(&mut self) {
        let scan = self.now.scan;
        let due = |(_, at): &(usize, u64)| *at <= scan;
        for (place, _) in self.joining.extract_if(.., |of| due(of)) {
            let participant = &mut self.roster.participants[place];
            participant.live = 1;
            participant.incarnation += 1;
            for member in self.members.iter_mut().filter(|of| of.place == place) {
                member.servo = member.servo.replacement(participant.incarnation);
            }
            if let Some(planning) = self.planning.as_mut().filter(|_| place == 0) {
                planning.planner = Planner::idle(&self.machine, participant.incarnation);
            }
        }
    }

    /// Lays a program where a planner finds it; its number.
    pub fn lay(&mut self, text: &str) -> u32 {
        let planning = self.planning.get_or_insert_with(|| {
            let incarnation = self.roster.participants[0].incarnation;
            Planning::new(Planner::idle(&self.machine, incarnation))
        });
        planning.ports.programs.push(text.into());
        planning.ports.programs.len() as u32
    }

    /// The order to load a program, which is laid.
    pub fn load_of(&mut self, text: &str) -> OperatorRequest {
        OperatorRequest {
            order: Order::Load as u32,
            value: f64::from(self.lay(text)),
            ..OperatorRequest::default()
        }
    }

    /// Loads a program and starts it.
    ///
    /// # Panics
    /// The machine refuses it.
    pub fn load_and_start(&mut self, text: &str) {
        let load = self.load_of(text);
        assert_eq!(self.ask(&load).reason, Refused::Not as u32);
        assert!(self.until(500, |of| of.now.program == ProgramState::Loaded as u32));
        let start = OperatorRequest {
            order: Order::Start as u32,
            session: self.now.load,
            ..OperatorRequest::default()
        };
        let reason = self.ask(&start).reason;
        assert_eq!(
            reason,
            Refused::Not as u32,
            "{:?}",
            Refused::from_wire(reason)
        );
    }

    /// The order to run typed-in blocks, which are laid, as is the program that is loaded before them.
    pub fn typed_of(&mut self, text: &str) -> OperatorRequest {
        let mut request = self.load_of(text);
        let load = self.now.load;
        request.session = load + 1;
        let programs = self.planning.as_ref().map(|of| &of.ports.programs);
        let before = programs.and_then(|of| of.get((load as usize).checked_sub(1)?));
        if let Some(before) = before.cloned() {
            request.deadline_scans = self.lay(&before);
        }
        request
    }

    /// Windows of the scan before.
    fn see_windows(&mut self) {
        let planning = self.planning.as_mut();
        let windows = planning.map_or_else(Vec::new, Planning::take_windows);
        for (header, setpoints) in windows {
            for member in &mut self.members {
                // A window that a servo refuses is not pending with it, and so not admitted.
                let _ = member.servo.offer(&header, &setpoints, &self.now);
            }
            self.master.offer(&header, &setpoints, &self.roster);
        }
    }

    fn planner_says(&mut self, asked: bool) -> Option<PlannerStatus> {
        let place = self.roster.participants[0];
        if place.live == 0 {
            return None;
        }
        let Some(planning) = &mut self.planning else {
            return Some(PlannerStatus {
                scan: self.now.scan,
                load: self.now.load,
                incarnation: place.incarnation,
                ..PlannerStatus::zeroed()
            });
        };
        if !asked {
            return None;
        }
        planning.asked(&self.now)
    }

    /// What servos and planner say to the feedback.
    pub fn answers(&mut self, asks_planner: bool) -> Answers {
        let mut answers = Answers::of_axes(bus::sample::MAX_AXES);
        let before: Vec<_> = self.members.iter().map(|of| of.said).collect();
        for (index, member) in self.members.iter_mut().enumerate() {
            member.said = None;
            if self.roster.participants[member.place].live == 0 || self.misses == Some(member.axis)
            {
                continue;
            }
            for peer in before.iter().enumerate().filter(|(of, _)| *of != index) {
                if let Some(command) = peer.1.filter(|c| c.axis as usize == member.axis) {
                    member.servo.follow(&command, &self.now);
                }
            }
            let mut command = member.servo.scan(&self.now);
            if self.trips == Some(member.axis) {
                command.cause = Cause::FollowingError as u32;
            }
            member.said = Some(command);
            answers.commands[member.axis][member.role] = Some(command);
        }
        (self.trips, self.misses) = (None, None);
        answers.planner = self.planner_says(asks_planner);
        answers
    }

    /// Goes on for a number of scans.
    pub fn scans(&mut self, count: u64) {
        for _ in 0..count {
            self.scan();
        }
    }

    /// Goes on until it is so, for so many scans at most; whether it is.
    pub fn until(&mut self, scans: u64, is: impl Fn(&Cell) -> bool) -> bool {
        (0..scans).any(|_| {
            self.scan();
            is(self)
        })
    }

    /// An order without a value; `load` takes the first program.
    pub fn order(&mut self, order: Order) -> Refused {
        let value = if order == Order::Load { 1.0 } else { 0.0 };
        let request = OperatorRequest {
            order: order as u32,
            value,
            ..OperatorRequest::default()
        };
        Refused::from_wire(self.ask(&request).reason).expect("a reason")
    }

    /// An order, answered and saved.
    pub fn ask(&mut self, request: &OperatorRequest) -> OperatorResponse {
        let answer = self.master.order(request);
        self.saved.latch(&self.master.latches());
        answer
    }

    /// Of the scan that was done last.
    pub fn mode(&self) -> Mode {
        Mode::from_wire(self.now.mode).expect("a mode")
    }

    /// Of the scan that was done last.
    pub fn cause(&self) -> Cause {
        Cause::from_wire(self.now.cause).expect("a cause")
    }

    /// Whether every axis knows where it is.
    pub fn is_homed(&self) -> bool {
        let mut axes = self.now.axes().iter();
        axes.all(|axis| axis.reference == Reference::Known as u32)
    }

    /// Drives on, ready.
    pub fn ready(&mut self) {
        assert_eq!(self.order(Order::Enable), Refused::Not);
        assert!(
            self.until(1_000, |of| of.mode() == Mode::Ready),
            "not ready"
        );
        self.scans(200);
    }

    /// Drives on, and homed.
    pub fn ready_and_homed(&mut self) {
        self.scans(5);
        self.ready();
        if !self.is_homed() {
            assert_eq!(self.order(Order::Home), Refused::Not);
            self.rests();
            assert_eq!(self.mode(), Mode::Ready);
        }
    }

    /// The same, with the first two axes not far from the middle of their travel.
    pub fn ready_in_the_middle(&mut self) {
        self.ready_and_homed();
        let mut line = OperatorRequest::of(Order::Jog);
        for axis in 0..2 {
            let (left_mm, travel_mm) = self.to_the_middle(axis);
            if left_mm.abs() > travel_mm / 4.0 {
                line.line_mm[axis] = left_mm;
            }
        }
        if line.line_mm.iter().any(|way_mm| *way_mm != 0.0) {
            assert_eq!(self.ask(&line).reason, Refused::Not as u32);
            self.rests();
        }
    }

    /// Way of an axis to the middle of its travel, and how long that is, in mm.
    pub fn to_the_middle(&self, axis: usize) -> (f64, f64) {
        let settings = &self.machine.axes[axis];
        let at_mm = self.now.axes[axis].command_position as f64 * settings.increment_mm();
        let middle_mm = f64::midpoint(settings.travel_min_mm, settings.travel_max_mm);
        (
            middle_mm - at_mm,
            settings.travel_max_mm - settings.travel_min_mm,
        )
    }

    /// What moves comes to rest.
    pub fn rests(&mut self) {
        self.scans(2);
        let moves = |of: &Cell| matches!(of.mode(), Mode::Jogging | Mode::Stopping);
        assert!(self.until(100_000, |of| !moves(of)), "it never rests");
        self.scans(200);
    }

    /// Who drives dies.
    pub fn dies(&mut self, job: Job, axis: usize) {
        let role = self.now.axes[axis].taken_role;
        self.one_dies(job, axis, role);
    }

    /// Who has this role dies.
    pub fn one_dies(&mut self, job: Job, axis: usize, role: u32) {
        let mut participants = self.roster.participants.iter().enumerate();
        let is_it = |p: &bus::sample::Participant| {
            p.job == job as u32 && p.axis == axis as u32 && p.role == role && p.live == 1
        };
        if let Some((place, _)) = participants.find(|(_, p)| is_it(p)) {
            self.roster.participants[place].live = 0;
            self.joining.push((place, self.now.scan + RESTARTS_SCANS));
        }
    }

    /// Another master takes the drives, from what the one before it has saved.
    pub fn replace_master(&mut self) {
        let drives = self.plant.drives(&self.machine).expect("drives");
        let mut drives = TroubledDrives::new(drives);
        let latches = self.saved.restore(&mut drives).expect("what was saved");
        drives.be_troubled_as(self.master.drives());
        self.incarnation += 1;
        let first = latches.scan + 1;
        let end = RunEnd::WhenOrdered;
        self.master = Master::new(&self.machine, drives, self.incarnation, first, false, end);
        self.master.resume(&latches);
    }

    /// True place of a motor less the place that the machine shows, in mm.
    pub fn off_mm(&self, axis: usize) -> f64 {
        let samples = self.master.drives().instruments(axis);
        let true_mm = samples.last().map_or(f64::NAN, |of| of.motor_mm);
        let shown = self.master.feedback().axes[axis].motor_position;
        true_mm - shown as f64 * self.machine.axes[axis].increment_mm()
    }
}
