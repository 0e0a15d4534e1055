//! The cell: who is asked in which order, and what a fault does to whom.

use std::sync::Arc;

use bus::fault_file::FaultScript;
use bus::machine::Machine;
use bus::order_file::ScriptedOrder;
use bus::page::FaultStep;
use bus::sample::{
    AxisCommand, Feedback, Instruments, Job, OperatorRequest, OperatorResponse, Participant, Roster,
};
use bus::service::ROLES;
use bytemuck::Zeroable;
use planner::Planner;
use plant_sim::axis::StateRefused;
use plant_sim::fault_desk::FaultDesk;
use plant_sim::machine_side::{Answers, MachineSide, RunEnd};
use plant_sim::plant_file::PlantFile;
use plant_sim::setup::SetupError;
use servo::{Servo, ServoSettingsError};

use crate::processes::{PlannerPlace, ServoPlace};
use crate::queues::{Queue, Window};
use crate::saved::Saved;

/// Incarnation of the first process in a place.
const FIRST: u32 = 1;

/// A cell that cannot be rehearsed.
#[derive(Debug, thiserror::Error)]
pub enum RehearsalError {
    /// Machine file and plant file do not fit each other.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// An axis cannot be served.
    #[error(transparent)]
    Servo(#[from] ServoSettingsError),
}

/// Why a machine side could not take the place of one that was killed.
#[derive(Debug, thiserror::Error)]
enum NoReplacement {
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Saved(#[from] StateRefused),
}

/// What a run hangs on beside machine and program.
#[derive(Debug, Clone, Default)]
pub struct Script {
    /// What goes wrong; its blocks are resolved.
    pub faults: Option<FaultScript>,
    /// What the operator asks, in the order of the scans.
    pub orders: Vec<ScriptedOrder>,
}

/// What was said in one scan.
#[derive(Debug)]
pub struct Said<'a> {
    /// By the machine side, at its start.
    pub feedback: &'a Feedback,
    /// By the instruments.
    pub instruments: &'a Instruments,
    /// By the servos that were asked: those that drive in the order of the axes, then the standbys. What a fault makes of
    /// a command on its way to the others does not show here.
    pub commands: &'a [AxisCommand],
    /// Windows that were sent in this scan.
    pub windows: &'a [Arc<Window>],
    /// Who takes part.
    pub roster: &'a Roster,
}

/// A cell and its program.
#[derive(Debug)]
pub struct Rehearsal {
    machine: Machine,
    plant: PlantFile,
    program_name: String,
    program_text: String,
    script: Script,
    orders_done: usize,
    desk: Option<FaultDesk>,
    side: MachineSide,
    side_incarnation: u32,
    side_windows: Queue<Arc<Window>>,
    saved: Saved,
    planner: PlannerPlace,
    places: Vec<ServoPlace>,
    servos: Vec<Servo>,
    roster: Roster,
    answers: Answers,
    feedback: Feedback,
    instruments: Instruments,
    commands: Vec<AxisCommand>,
    sent: Vec<AxisCommand>,
    windows: Vec<Arc<Window>>,
    ended: bool,
}

/// Drives on from the first scan, and the run ends with its program.
fn machine_side(
    machine: &Machine,
    plant: &PlantFile,
    incarnation: u32,
    saved: &Saved,
) -> Result<MachineSide, NoReplacement> {
    let mut simulations = plant.simulations(machine)?;
    let latches = saved.restore(&mut simulations)?;
    let first_scan = latches.map_or(0, |latches| latches.scan + 1);
    let end = RunEnd::AfterProgram;
    let mut side = MachineSide::new(machine, simulations, incarnation, first_scan, true, end);
    if let Some(latches) = &latches {
        side.resume(latches);
    }
    Ok(side)
}

impl Rehearsal {
    /// A cell about to run a program, drives on, that ends with it.
    ///
    /// # Errors
    /// The plant does not fit the machine, or an axis cannot be served.
    pub fn new(
        machine: &Machine,
        plant: &PlantFile,
        program_name: &str,
        program_text: &str,
    ) -> Result<Rehearsal, RehearsalError> {
        Self::with_script(
            machine,
            plant,
            program_name,
            program_text,
            Script::default(),
        )
    }

    /// The same with faults and orders, each at its scan.
    ///
    /// # Errors
    /// As [`Rehearsal::new`].
    pub fn with_script(
        machine: &Machine,
        plant: &PlantFile,
        program_name: &str,
        program_text: &str,
        script: Script,
    ) -> Result<Rehearsal, RehearsalError> {
        let mut machine = machine.clone();
        let faults = script.faults.as_ref();
        if let Some(faults) = faults {
            faults.restart.apply(&mut machine.restart);
        }
        let simulations = plant.simulations(&machine)?;
        let end = RunEnd::AfterProgram;
        let side = MachineSide::new(&machine, simulations, FIRST, 0, true, end);
        let axes = || machine.axes.iter().enumerate();
        let mut places = Vec::new();
        for role in 0..ROLES.len() {
            places.extend(
                axes()
                    .filter(|(_, axis)| role == 0 || axis.standby)
                    .map(|(index, axis)| ServoPlace::new(index, role, axis.standby, faults)),
            );
        }
        let servos = places
            .iter()
            .map(|place| Servo::new(&machine, place.axis, place.role as u32, FIRST))
            .collect::<Result<Vec<_>, _>>()?;
        let planner = Planner::new(&machine, program_name, program_text.into(), FIRST);
        Ok(Rehearsal {
            roster: roster(&places),
            planner: PlannerPlace::new(planner, FIRST, faults),
            desk: faults.map(|faults| FaultDesk::new(faults.clone(), |_| None, 0)),
            commands: Vec::with_capacity(places.len()),
            places,
            servos,
            side,
            side_incarnation: FIRST,
            side_windows: Queue::new(),
            saved: Saved::nothing(),
            plant: plant.clone(),
            program_name: program_name.into(),
            program_text: program_text.into(),
            script,
            orders_done: 0,
            machine,
            answers: Answers::NONE,
            feedback: Feedback::zeroed(),
            instruments: Instruments::zeroed(),
            sent: Vec::new(),
            windows: Vec::new(),
            ended: false,
        })
    }

    /// One scan; `None` once the run has ended.
    pub fn scan(&mut self) -> Option<Said<'_>> {
        if self.ended {
            return None;
        }
        self.feedback = self.side.feedback();
        while self.commit_faults() {
            // Another machine side says the feedback of this scan.
            self.feedback = self.side.feedback();
        }
        if self.ended {
            return None;
        }
        let scan = self.feedback.scan;
        while let Some((index, step)) = self.desk.as_mut().and_then(|d| d.next(scan, true)) {
            self.act(index, step, scan);
        }
        if self.side.is_last() {
            self.ended = true;
            return None;
        }
        let boundary = self.side.is_period_boundary();
        self.instruments = self.side.simulate();
        if self.machine_side_may_die() {
            self.saved.save(&self.side);
        }
        self.answers = Answers::NONE;
        self.ask_servos();
        self.windows.clear();
        if boundary && self.planner.lives && !self.planner.stopped {
            self.ask_planner();
        }
        while let Some(order) = self.script.orders.get(self.orders_done)
            && order.scan <= scan
        {
            self.orders_done += 1;
            self.side.order(&order.request);
        }
        while let Some(window) = self.side_windows.next(scan) {
            self.side.offer(&window.header, &window.rows, &self.roster);
        }
        self.side.close_scan(&self.answers, &self.roster);
        Some(Said {
            feedback: &self.feedback,
            instruments: &self.instruments,
            commands: &self.commands,
            windows: &self.windows,
            roster: &self.roster,
        })
    }

    /// The servos, before the first scan: those that drive in the order of the axes, then the standbys.
    pub fn servos(&mut self) -> &mut [Servo] {
        &mut self.servos
    }

    /// An order of the operator, between two scans.
    pub fn order(&mut self, request: &OperatorRequest) -> OperatorResponse {
        self.side.order(request)
    }

    /// Scan in which a fault of the script fired.
    pub fn fired(&self, index: usize) -> Option<u64> {
        self.desk.as_ref().and_then(|desk| desk.fired(index))
    }

    fn ask_servos(&mut self) {
        self.commands.clear();
        let desk = self.desk.as_ref();
        for index in 0..self.places.len() {
            let (Some(place), Some(servo)) =
                (self.places.get_mut(index), self.servos.get_mut(index))
            else {
                continue;
            };
            if !place.lives || place.stopped {
                continue;
            }
            let (axis, role, standby) = (place.axis, place.role, place.peer.is_some());
            let fired = |fault| desk.and_then(|desk| desk.fired(fault));
            let sent = &mut self.sent;
            sent.clear();
            let command = place.scan(servo, &self.feedback, fired, |command| sent.push(*command));
            self.commands.push(command);
            let answers = self.answers.commands.get_mut(axis);
            if let Some(answer) = answers.and_then(|roles| roles.get_mut(role)) {
                *answer = self.sent.last().copied();
            }
            if standby {
                let is_peer = |p: &&mut ServoPlace| p.axis == axis && p.role != role;
                let peer = self.places.iter_mut().find(is_peer);
                if let Some(queue) = peer.and_then(|p| p.peer.as_mut()) {
                    for command in &self.sent {
                        queue.push(*command);
                    }
                }
            }
        }
    }

    fn ask_planner(&mut self) {
        let desk = self.desk.as_ref();
        let fired = |fault| desk.and_then(|desk| desk.fired(fault));
        let status = self.planner.scan(&self.feedback, fired, &mut self.windows);
        self.answers.planner = Some(status);
        for window in &self.windows {
            self.side_windows.push(Arc::clone(window));
            for place in self.places.iter_mut().filter(|place| place.lives) {
                place.windows.push(Arc::clone(window));
            }
        }
    }

    fn machine_side_may_die(&self) -> bool {
        let faults = self.script.faults.as_ref();
        faults.is_some_and(|script| script.faults.iter().any(|f| f.job == Job::Machine))
    }

    /// What is due before the feedback is said; true if another machine side has begun.
    fn commit_faults(&mut self) -> bool {
        let scan = self.feedback.scan;
        let Some(desk) = &mut self.desk else {
            return false;
        };
        desk.look(&self.feedback, |_| {});
        while let Some((index, step)) = self.desk.as_mut().and_then(|d| d.next(scan, false)) {
            self.act(index, step, scan);
            let is_machine = self.job_of(index) == Some(Job::Machine);
            if is_machine && step == FaultStep::Kill {
                return !self.ended;
            }
        }
        false
    }

    fn job_of(&self, fault: usize) -> Option<Job> {
        let faults = self.script.faults.as_ref()?;
        Some(faults.faults.get(fault)?.job)
    }

    /// What the launcher does for a fault.
    fn act(&mut self, index: usize, step: FaultStep, scan: u64) {
        let script = self.script.faults.as_ref();
        let Some(fault) = script.and_then(|s| s.faults.get(index)).copied() else {
            return;
        };
        let (axis, role) = (fault.axis as usize, fault.role as usize);
        let standby = self.machine.axes.get(axis).is_some_and(|a| a.standby);
        let replaces = self.machine.restart.replaces(fault.job, standby);
        match fault.job {
            Job::Monitor => {}
            Job::Machine => {
                if step == FaultStep::Kill {
                    self.kill_machine_side(replaces);
                }
            }
            Job::Planner => {
                let place = &mut self.planner;
                match step {
                    FaultStep::Kill => place.lives = false,
                    FaultStep::Restart if replaces && !place.lives => {
                        let incarnation = place.incarnation + 1;
                        let (name, text) = (&self.program_name, self.program_text.clone());
                        let planner = Planner::new(&self.machine, name, text, incarnation);
                        *place = PlannerPlace::new(planner, incarnation, script);
                    }
                    FaultStep::Restart => {}
                    FaultStep::Stop => place.stopped = true,
                    FaultStep::Readmit => {}
                    FaultStep::Continue => place.stopped = false,
                }
                let (lives, incarnation) = (place.lives, place.incarnation);
                self.tell_roster(Job::Planner, 0, 0, step, (lives, incarnation), scan);
            }
            Job::Servo => {
                let is_it = |p: &ServoPlace| p.axis == axis && p.role == role;
                let Some(at) = self.places.iter().position(is_it) else {
                    return;
                };
                let (Some(place), Some(servo)) = (self.places.get_mut(at), self.servos.get_mut(at))
                else {
                    return;
                };
                match step {
                    FaultStep::Kill => place.lives = false,
                    FaultStep::Restart if replaces && !place.lives => {
                        place.replace(script);
                        *servo = servo.replacement(place.incarnation);
                    }
                    FaultStep::Restart => {}
                    FaultStep::Stop => place.stopped = true,
                    FaultStep::Readmit => {}
                    FaultStep::Continue => place.stopped = false,
                }
                let (lives, incarnation) = (place.lives, place.incarnation);
                self.tell_roster(Job::Servo, axis, role, step, (lives, incarnation), scan);
            }
        }
    }

    /// What the launcher then says in the roster.
    fn tell_roster(
        &mut self,
        job: Job,
        axis: usize,
        role: usize,
        step: FaultStep,
        (lives, incarnation): (bool, u32),
        scan: u64,
    ) {
        let is_it = |p: &&mut Participant| {
            p.job == job as u32 && p.axis == axis as u32 && p.role == role as u32
        };
        let Some(place) = self.roster.participants.iter_mut().find(is_it) else {
            return;
        };
        match step {
            FaultStep::Kill if place.live == 1 => {
                place.live = 0;
                place.stalled = 0;
                place.death_scan = scan;
            }
            FaultStep::Restart if lives && place.live == 0 => {
                place.live = 1;
                place.stalled = 0;
                place.incarnation = incarnation;
            }
            FaultStep::Stop => place.stalled = 1,
            FaultStep::Readmit => place.stalled = 0,
            FaultStep::Kill | FaultStep::Restart | FaultStep::Continue => {}
        }
        self.roster.version += 1;
        self.roster.visible_from = scan;
    }

    /// The machine side is killed; the one that takes its place goes on from what it has saved.
    fn kill_machine_side(&mut self, replaces: bool) {
        let incarnation = self.side_incarnation + 1;
        let next = machine_side(&self.machine, &self.plant, incarnation, &self.saved);
        let (true, Ok(side)) = (replaces, next) else {
            self.ended = true;
            return;
        };
        self.side = side;
        self.side_incarnation = incarnation;
        self.side_windows = Queue::new();
        let first_scan = self.side.scan();
        let orders = &self.script.orders;
        self.orders_done = orders.partition_point(|order| order.scan < first_scan);
        let before = self.desk.take();
        let script = self.script.faults.as_ref();
        self.desk = script.map(|script| {
            let fired = |index| before.as_ref().and_then(|desk| desk.fired(index));
            FaultDesk::new(script.clone(), fired, first_scan)
        });
        if let Some(place) = self
            .roster
            .participants
            .iter_mut()
            .find(|p| p.job == Job::Machine as u32)
        {
            place.incarnation = incarnation;
            place.death_scan = first_scan;
        }
    }
}

/// Everybody lives.
fn roster(places: &[ServoPlace]) -> Roster {
    let place = |job: Job, axis: usize, role: usize| Participant {
        death_scan: u64::MAX,
        job: job as u32,
        axis: axis as u32,
        role: role as u32,
        incarnation: FIRST,
        live: 1,
        ..Participant::zeroed()
    };
    let mut roster = Roster {
        version: 1,
        ..Roster::zeroed()
    };
    let everybody = [place(Job::Machine, 0, 0), place(Job::Planner, 0, 0)];
    let servos = places.iter().map(|p| place(Job::Servo, p.axis, p.role));
    for (slot, participant) in roster
        .participants
        .iter_mut()
        .zip(everybody.into_iter().chain(servos))
    {
        *slot = participant;
    }
    roster
}
