//! Everything that a master of a cell within one process sees: servos, planner, roster, script.

use std::sync::Arc;

use bus::port::Visibility;
use bus::sample::{
    AxisCommand, Feedback, Instruments, Job, OperatorRequest, OperatorResponse, Order, Participant,
    PlannerStatus, Roster, Setpoint, WindowHeader,
};
use bus::signal_page::FaultStep;
use bytemuck::Zeroable;
use machine::{KeptParameters, Machine, Process};
use master::saved::{Latches, SavedState};
use master::{Answered, Answers, Drives, Flow, MasterPorts};
use plant_sim::script::injector::FaultInjector;
use servo::Servo;

use super::launcher::Launcher;
use super::members::{Fired, Life, PlannerMember, ServoMember};
use super::queues::{Queue, Window};
use super::script::{CellError, Script};
use crate::tampering::Kind;

/// The master has been killed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MasterKilled {
    /// Another one takes its place.
    pub replaced: bool,
}

/// Who answers a master, and what lies between them.
pub(crate) struct Peers {
    machine: Machine,
    program: (String, String),
    script: Script,
    orders_done: usize,
    injector: Option<FaultInjector>,
    fired: Fired,
    launcher: Launcher,
    planner: PlannerMember,
    members: Vec<ServoMember>,
    pub servos: Vec<Servo>,
    pub roster: Roster,
    windows_to_master: Queue<Arc<Window>>,
    pub saved: Option<SavedState>,
    pub master_killed: Option<MasterKilled>,
    master_may_die: bool,
    pub feedback: Feedback,
    /// As its readers take it, if they do.
    received: Option<Feedback>,
    /// As the master has taken it last, where somebody tampers with it.
    taken_roster: Option<Roster>,
    pub instruments: Instruments,
    answers: Answers,
    pub commands: Vec<AxisCommand>,
    pub status: Option<PlannerStatus>,
    pub windows: Vec<Arc<Window>>,
    /// Orders that were obeyed in this scan.
    pub obeyed: Vec<Order>,
    recorder: Life,
}

impl Peers {
    /// Everybody of this machine, about to run a program (name and text).
    pub fn new(
        machine: Machine,
        program: (&str, &str),
        script: Script,
    ) -> Result<Peers, CellError> {
        let faults = script.faults.as_ref();
        let fired = Fired::none_of(faults.map_or(0, |faults| faults.faults.len()));
        let drives = |axis: &machine::Axis, role: usize| role == 0 || axis.standby;
        let mut members = Vec::new();
        for role in 0..bus::service::ROLES.len() {
            let axes = machine.axes.iter().enumerate();
            members.extend(
                axes.filter(|(_, axis)| drives(axis, role))
                    .map(|(index, axis)| {
                        ServoMember::new((index, role, axis.standby), Life::FIRST, faults, &fired)
                    }),
            );
        }
        let servos = members.iter().map(|member| member.servo(&machine));
        let is_masters =
            |fault: &plant_sim::script::faults::Fault| fault.process.job == Job::Master;
        Ok(Peers {
            servos: servos.collect::<Result<_, _>>()?,
            planner: PlannerMember::new(&machine, program, Life::FIRST, faults, &fired),
            injector: faults.map(|faults| FaultInjector::new(faults.clone(), |_| None, 0)),
            master_may_die: faults.is_some_and(|s| s.faults.iter().any(is_masters)),
            roster: roster(&members),
            answers: Answers::of_axes(machine.axes.len()),
            commands: Vec::with_capacity(members.len()),
            members,
            program: (program.0.into(), program.1.into()),
            orders_done: 0,
            fired,
            windows_to_master: Queue::new(),
            saved: None,
            master_killed: None,
            launcher: Launcher::new(&machine),
            status: None,
            feedback: Feedback::zeroed(),
            received: None,
            taken_roster: None,
            instruments: Instruments::zeroed(),
            windows: Vec::new(),
            obeyed: Vec::new(),
            recorder: Life::FIRST,
            machine,
            script,
        })
    }

    /// The parameters that the program has kept at its end; none before.
    pub fn kept_parameters(&mut self) -> Option<&KeptParameters> {
        self.planner.ports.inner().kept.parameters.as_ref()
    }

    /// Scan in which a fault of the script fired.
    pub fn fired(&self, index: usize) -> Option<u64> {
        self.fired.get(index)
    }

    /// Who was lost and is not replaced.
    pub fn lost_for_good(&self) -> &[Process] {
        self.launcher.lost()
    }

    /// Another master begins in this scan.
    pub fn master_replaced(&mut self, incarnation: u32, first_scan: u64) {
        self.windows_to_master = Queue::new();
        let orders = &self.script.orders;
        self.orders_done = orders.partition_point(|order| order.scan < first_scan);
        let fired = |index| self.fired.get(index);
        let script = self.script.faults.as_ref();
        self.injector = script.map(|s| FaultInjector::new(s.clone(), fired, first_scan));
        let mut participants = self.roster.participants.iter_mut();
        if let Some(master) = participants.find(|p| p.job == Job::Master as u32) {
            master.incarnation = incarnation;
            master.death_scan = first_scan;
        }
    }

    fn ask_servos(&mut self) {
        self.commands.clear();
        let Some(feedback) = self.received else {
            return;
        };
        let tampering = self.script.tampering;
        let shared = Arc::new(feedback);
        for index in 0..self.members.len() {
            let (Some(member), Some(servo)) =
                (self.members.get_mut(index), self.servos.get_mut(index))
            else {
                continue;
            };
            if !member.life.answers() {
                continue;
            }
            let (axis, role) = (member.axis, member.role);
            member.ports.inner().feedback = Some(Arc::clone(&shared));
            servo::cycle(servo, &mut member.ports);
            self.commands.extend(member.ports.made());
            let mut sent = std::mem::take(&mut member.ports.inner().sent);
            if let Some(tampering) = tampering {
                let scan = self.feedback.scan;
                let taken = |c: &AxisCommand| tampering.received(Kind::Command, scan, c);
                sent = sent.iter().filter_map(taken).collect();
            }
            let answer = self
                .answers
                .commands
                .get_mut(axis)
                .and_then(|a| a.get_mut(role));
            if let Some(answer) = answer {
                let next = self.feedback.scan + 1;
                let is_seen =
                    |c: &&AxisCommand| Visibility::of(c.visible_from, next, 1) == Visibility::Now;
                *answer = sent.iter().rev().find(is_seen).copied();
            }
            let mut others = self.members.iter_mut();
            let peer = others.find(|other| other.axis == axis && other.role != role);
            if let Some(queue) = peer.and_then(|p| p.ports.inner().peer.as_mut()) {
                for command in &sent {
                    queue.push(*command);
                }
            }
            if let Some(member) = self.members.get_mut(index) {
                member.ports.inner().sent = sent;
            }
        }
    }

    fn ask_planner(&mut self) {
        let member = &mut self.planner;
        if !member.life.answers() {
            return;
        }
        let Some(feedback) = self.received else {
            return;
        };
        member.ports.inner().feedback = Some(feedback);
        planner::cycle(&mut member.planner, &mut member.ports);
        let mut status = member.ports.inner().status;
        if let Some(tampering) = self.script.tampering {
            let scan = self.feedback.scan;
            status = status.and_then(|s| tampering.received(Kind::Status, scan, &s));
        }
        self.status = status.or(self.status);
        let next = self.feedback.scan + 1;
        self.answers.planner =
            status.filter(|status| Visibility::of(status.visible_from, next, 1) == Visibility::Now);
        self.windows.append(&mut member.ports.inner().windows);
        for window in &self.windows {
            self.windows_to_master.push(Arc::clone(window));
            for member in self.members.iter_mut().filter(|member| member.life.lives) {
                member.ports.inner().windows.push(Arc::clone(window));
            }
        }
    }

    /// What is due in this scan, before its feedback is published or after.
    fn inject(&mut self, scan: u64, published: bool) -> Flow {
        while let Some((index, step)) = self
            .injector
            .as_mut()
            .and_then(|injector| injector.next(scan, published))
        {
            if self.act(index, step, scan) == Flow::Leave {
                return Flow::Leave;
            }
        }
        Flow::GoOn
    }

    /// What the launcher does for a fault; the master leaves where it is killed.
    fn act(&mut self, index: usize, step: FaultStep, scan: u64) -> Flow {
        let script = self.script.faults.as_ref();
        let Some(fault) = script.and_then(|s| s.faults.get(index)).copied() else {
            return Flow::GoOn;
        };
        let process = fault.process;
        let axis = process.axis as usize;
        let standby = self.machine.axes.get(axis).is_some_and(|a| a.standby);
        let mut replaced = self.machine.restart.replaces(process.job, standby);
        if self.script.supervised {
            match step {
                FaultStep::Kill => replaced = self.dies(process, scan),
                // The rules say when.
                FaultStep::Restart => return Flow::GoOn,
                FaultStep::Stop | FaultStep::Readmit | FaultStep::Continue => {}
            }
        } else if step == FaultStep::Kill && process.job == Job::Planner && !replaced {
            self.launcher.lose(process);
        }
        self.suffer(process, step, replaced, scan)
    }

    /// A process dies by itself: whether it is replaced.
    fn dies(&mut self, process: Process, scan: u64) -> bool {
        let participants = &self.roster.participants;
        let is_it = |p: &Participant| Process::of(p) == Some(process);
        let Some(place) = participants.iter().position(is_it) else {
            return false;
        };
        // It is dead already, or another one is on its way.
        if participants.get(place).is_some_and(|p| p.live == 0) {
            return false;
        }
        let (axis, role) = (process.axis as usize, 1 - process.role.min(1));
        let covered =
            process.job == Job::Servo && self.roster.living(Job::Servo, axis, role).is_some();
        let replaced = self.launcher.judge(place, process, covered, scan);
        if process.job == Job::Master {
            self.launcher.take_master(place, scan);
        }
        replaced
    }

    /// Who was being started takes part from this scan on.
    fn admit(&mut self, scan: u64) {
        while let Some(place) = self.launcher.take_joined(scan) {
            let process = self.roster.participants.get(place).and_then(Process::of);
            if let Some(process) = process {
                let _ = self.suffer(process, FaultStep::Restart, true, scan);
            }
        }
    }

    /// What a step does to a process; the master leaves where it is killed.
    fn suffer(&mut self, process: Process, step: FaultStep, replaced: bool, scan: u64) -> Flow {
        let script = self.script.faults.as_ref();
        let (axis, role) = (process.axis as usize, process.role as usize);
        match process.job {
            Job::Monitor => {
                if is_replaced(step, self.recorder, replaced) {
                    self.recorder = self.recorder.next();
                } else {
                    suffer(&mut self.recorder, step);
                }
                self.publish_roster(process, step, self.recorder, scan);
            }
            Job::Master if step == FaultStep::Kill => {
                self.master_killed = Some(MasterKilled { replaced });
                return Flow::Leave;
            }
            // The drives of this cell are simulated, and it has no logic of its own.
            Job::Master | Job::Fieldbus | Job::Logic => {}
            Job::Planner => {
                if is_replaced(step, self.planner.life, replaced) {
                    let (name, text) = &self.program;
                    let life = self.planner.life.next();
                    let (machine, fired) = (&self.machine, &self.fired);
                    let kept = std::mem::take(&mut self.planner.ports.inner().kept);
                    self.planner = PlannerMember::new(machine, (name, text), life, script, fired);
                    self.planner.ports.inner().kept = kept;
                } else {
                    suffer(&mut self.planner.life, step);
                }
                let life = self.planner.life;
                self.publish_roster(process, step, life, scan);
            }
            Job::Servo => {
                let mut members = self.members.iter().enumerate();
                let found = members.find(|(_, m)| m.axis == axis && m.role == role);
                let Some(at) = found.map(|(at, _)| at) else {
                    return Flow::GoOn;
                };
                let (Some(member), Some(servo)) =
                    (self.members.get_mut(at), self.servos.get_mut(at))
                else {
                    return Flow::GoOn;
                };
                if is_replaced(step, member.life, replaced) {
                    *member = member.replacement(script, &self.fired);
                    *servo = servo.replacement(member.life.incarnation);
                } else {
                    suffer(&mut member.life, step);
                }
                let life = member.life;
                self.publish_roster(process, step, life, scan);
            }
        }
        Flow::GoOn
    }

    /// What the launcher then publishes in the roster.
    fn publish_roster(&mut self, process: Process, step: FaultStep, life: Life, scan: u64) {
        let is_it = |p: &&mut Participant| Process::of(p) == Some(process);
        let Some(slot) = self.roster.participants.iter_mut().find(is_it) else {
            return;
        };
        match step {
            FaultStep::Kill if slot.live == 1 => {
                slot.live = 0;
                slot.stalled = 0;
                slot.death_scan = scan;
            }
            FaultStep::Restart if life.lives && slot.live == 0 => {
                slot.live = 1;
                slot.stalled = 0;
                slot.incarnation = life.incarnation;
            }
            FaultStep::Stop => slot.stalled = 1,
            FaultStep::Readmit => slot.stalled = 0,
            FaultStep::Kill | FaultStep::Restart | FaultStep::Continue => {}
        }
        self.roster.version += 1;
        self.roster.visible_from = scan;
    }
}

impl MasterPorts for Peers {
    type Error = std::convert::Infallible;

    fn roster(&self) -> &Roster {
        self.taken_roster.as_ref().unwrap_or(&self.roster)
    }

    fn read_roster(&mut self) {}

    fn begin_scan(&mut self, feedback: &Feedback, _ask_planner: bool) -> Flow {
        let scan = feedback.scan;
        self.admit(scan);
        if let Some(injector) = &mut self.injector {
            injector.look(feedback, |index| self.fired.set(index, scan));
        }
        if self.inject(scan, false) == Flow::Leave {
            return Flow::Leave;
        }
        self.feedback = *feedback;
        self.received = Some(*feedback);
        self.windows.clear();
        let flow = self.inject(scan, true);
        if let Some(tampering) = self.script.tampering {
            self.received = tampering.received(Kind::Feedback, scan, feedback);
            let taken = tampering.received(Kind::Roster, scan, &self.roster);
            self.taken_roster = taken.or(self.taken_roster);
        }
        flow
    }

    fn publish_instruments(&mut self, instruments: &Instruments) {
        self.instruments = *instruments;
    }

    fn save(&mut self, latches: &Latches, drives: &impl Drives) {
        if self.master_may_die {
            let saved = self.saved.get_or_insert_with(|| SavedState::of(drives));
            saved.save(latches, drives);
        }
    }

    fn latch(&mut self, latches: &Latches) {
        if let Some(saved) = self.saved.as_mut() {
            saved.latch(latches);
        }
    }

    fn await_answers(&mut self, _scan: u64, ask_planner: bool) -> Result<Answered, Self::Error> {
        self.answers.clear();
        self.ask_servos();
        if ask_planner {
            self.ask_planner();
        }
        Ok(Answered::Scan { overrun_scans: 0 })
    }

    fn answers(&self) -> &Answers {
        &self.answers
    }

    fn serve_orders(
        &mut self,
        scan: u64,
        mut judge: impl FnMut(&OperatorRequest) -> (OperatorResponse, Latches),
    ) {
        self.obeyed.clear();
        let mut due = Vec::new();
        while let Some(order) = self.script.orders.get(self.orders_done)
            && order.scan <= scan
        {
            self.orders_done += 1;
            due.push(order.request);
        }
        if self.launcher.is_stop_due(&self.feedback) {
            due.push(OperatorRequest::of(Order::Down));
        }
        for request in due {
            let (answer, latches) = judge(&request);
            // Whoever has an answer can rely on it, also if this master dies now.
            if let Some(saved) = self.saved.as_mut().filter(|_| answer.accepted == 1) {
                saved.latch(&latches);
            }
            if answer.accepted == 1 {
                self.obeyed.extend(Order::from_wire(request.order));
            }
        }
    }

    fn launcher_lives(&mut self, _scan: u64) -> Option<bool> {
        Some(true)
    }

    fn for_each_window(
        &mut self,
        scan: u64,
        mut offer: impl FnMut(&WindowHeader, &[Setpoint], &Roster),
    ) {
        let roster = *self.roster();
        while let Some(window) = self.windows_to_master.next(scan) {
            offer(&window.header, &window.setpoints, &roster);
        }
    }

    fn finish(&mut self, _scan: u64) {}

    fn leave(&mut self) {}
}

/// Whether this step puts another process into the slot.
fn is_replaced(step: FaultStep, life: Life, replaced: bool) -> bool {
    step == FaultStep::Restart && replaced && !life.lives
}

/// What a step does to a process that stays the same.
fn suffer(life: &mut Life, step: FaultStep) {
    match step {
        FaultStep::Kill => life.lives = false,
        FaultStep::Stop => life.stopped = true,
        FaultStep::Continue => life.stopped = false,
        FaultStep::Restart | FaultStep::Readmit => {}
    }
}

/// Everybody lives.
fn roster(members: &[ServoMember]) -> Roster {
    let mut roster = Roster {
        version: 1,
        ..Roster::zeroed()
    };
    let everybody = [Job::Master, Job::Planner, Job::Monitor].map(Process::from);
    let servos = members.iter().map(|m| Process::servo(m.axis, m.role));
    let all = everybody.into_iter().chain(servos);
    for (to, process) in roster.participants.iter_mut().zip(all) {
        *to = process.first();
    }
    roster
}
