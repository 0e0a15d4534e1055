//! A small cell in motion, and samples that somebody has tampered with: what every reader of one does with it.

use std::cell::RefCell;

use bus::port::Visibility;
use bus::sample::{
    AxisCommand, Feedback, Job, MAX_AXES, OperatorRequest, PlannerStatus, Roster, Setpoint,
    WindowHeader,
};
use bus::window::checksum;
use bytemuck::{Pod, Zeroable, bytes_of, bytes_of_mut};
use machine::{Machine, Process};
use master::saved::SavedState;
use master::{Answers, Master, RunEnd};
use planner::{Planner, ProgramText};
use plant_sim::SimulatedDrives;
use plant_sim::plant_file::PlantFile;
use servo::Servo;

use super::targets::shipped;

/// Scans before anything is wrong: the axes move then.
const SCANS: usize = 60;
/// Things that are done with one input.
const STEPS_MAX: usize = 16;
const PROGRAM: &str = "G21 G17 G90 G94\nG0 X5 Y0\nG3 X5 Y0 I-5 J0 F3000\nM2\n";

fn program() -> ProgramText {
    ProgramText::Here("fuzz".into(), PROGRAM.into())
}

/// A cell, between two scans.
#[derive(Clone)]
struct Cell {
    machine: std::rc::Rc<Machine>,
    plant: std::rc::Rc<PlantFile>,
    master: Master<SimulatedDrives>,
    /// X, its standby, Y.
    servos: Vec<Servo>,
    planner: Planner,
    roster: Roster,
    commands: Vec<AxisCommand>,
    status: PlannerStatus,
    window: (WindowHeader, Vec<Setpoint>),
    sent: bool,
    saved: SavedState,
}

impl Cell {
    fn new() -> Cell {
        let mut machine = shipped("xy");
        machine.axes[0].standby = true;
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let beside = [folder.join("machines/xy"), folder.join("../machines/xy")];
        let plant = beside
            .iter()
            .find_map(|folder| PlantFile::load(folder).ok());
        let plant = plant.expect("the plant");
        let drives = plant.drives(&machine).expect("drives");
        let saved = SavedState::of(&drives);
        let master = Master::new(&machine, drives, 1, 0, true, RunEnd::WhenOrdered);
        let places = [(0, 0), (0, 1), (1, 0)];
        let servos = places.map(|(axis, role)| Servo::new(&machine, axis, role, 1));
        let mut roster = Roster::zeroed();
        roster.version = 1;
        let of_servos = places.map(|(axis, role)| Process::servo(axis, role as usize));
        let all = of_servos.into_iter().chain([Job::Planner.into()]);
        for (place, process) in roster.participants.iter_mut().zip(all) {
            *place = process.first();
        }
        let mut cell = Cell {
            planner: Planner::of(&machine, program(), 1),
            master: Master::new(
                &machine,
                plant.drives(&machine).expect("drives"),
                1,
                0,
                true,
                RunEnd::AfterProgram,
            ),
            servos: servos.map(|servo| servo.expect("a servo")).to_vec(),
            roster,
            commands: vec![AxisCommand::zeroed(); 3],
            status: PlannerStatus::zeroed(),
            window: (WindowHeader::zeroed(), Vec::new()),
            sent: false,
            saved,
            machine: machine.into(),
            plant: plant.into(),
        };
        drop(master);
        for _ in 0..SCANS {
            let feedback = cell.master.feedback();
            cell.scan(&feedback);
        }
        cell
    }

    /// One scan whose answers are given to this feedback.
    fn scan(&mut self, feedback: &Feedback) {
        let now = self.master.feedback().scan;
        self.master.exchange();
        self.ask_servos(feedback);
        if self.master.is_period_boundary() {
            self.ask_planner(feedback);
        }
        if self.sent && self.window.0.visible_from <= now {
            let (header, setpoints) = &self.window;
            self.master.offer(header, setpoints, &self.roster);
        }
        self.saved
            .save(&self.master.latches(), self.master.drives());
        self.close();
    }

    fn ask_servos(&mut self, feedback: &Feedback) {
        let peers = [1, 0].map(|peer: usize| self.commands[peer]);
        for (index, servo) in self.servos.iter_mut().enumerate() {
            if self.sent {
                let _ = servo.offer(&self.window.0, &self.window.1, feedback);
            }
            if let Some(peer) = peers.get(index) {
                servo.follow(peer, feedback);
            }
            self.commands[index] = servo.scan(feedback);
        }
    }

    fn ask_planner(&mut self, feedback: &Feedback) {
        let decision = self.planner.scan(feedback);
        self.status = decision.status;
        self.sent = decision.window.is_some();
        if let Some((header, setpoints)) = decision.window {
            self.window = (header, setpoints.to_vec());
        }
    }

    /// The master's end of a scan, with what has been answered.
    fn close(&mut self) {
        let mut answers = Answers::of_axes(MAX_AXES);
        let [x, standby, y] = [0, 1, 2].map(|servo: usize| Some(self.commands[servo]));
        answers.commands[0] = [x, standby];
        answers.commands[1] = [y, None];
        answers.planner = Some(self.status);
        self.master.close_scan(&answers, &self.roster);
    }

    /// Another master goes on from what was saved.
    fn replace_master(&mut self) {
        let Ok(mut drives) = self.plant.drives(&self.machine) else {
            return;
        };
        let Ok(latches) = self.saved.restore(&mut drives) else {
            return;
        };
        let scan = latches.scan.saturating_add(1);
        let end = RunEnd::AfterProgram;
        self.master = Master::new(&self.machine, drives, 2, scan, true, end);
        self.master.resume(&latches);
    }
}

thread_local! {
    static CELL: RefCell<Option<Cell>> = const { RefCell::new(None) };
}

/// Takes its bytes one after the other; zeros when there are no more.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }

    fn number(&mut self) -> usize {
        usize::from(self.byte()) << 8 | usize::from(self.byte())
    }

    /// Changes some bytes of a sample, anywhere in it.
    fn tamper<T: Pod>(&mut self, sample: &mut T) {
        self.change(bytes_of_mut(sample));
    }

    fn change(&mut self, bytes: &mut [u8]) {
        if bytes.is_empty() {
            return;
        }
        for _ in 0..=self.byte() % 4 {
            let at = self.number() % bytes.len();
            let by = self.byte();
            let count = usize::from(self.byte() % 9).max(1);
            for byte in bytes.iter_mut().skip(at).take(count) {
                *byte ^= by;
            }
        }
    }
}

/// Samples that were tampered with, to everybody who reads them.
pub fn samples(data: &[u8]) {
    CELL.with(|kept| {
        let mut kept = kept.borrow_mut();
        let mut cell = kept.get_or_insert_with(Cell::new).clone();
        let mut bytes = Bytes(data);
        for _ in 0..STEPS_MAX {
            if bytes.0.is_empty() {
                break;
            }
            step(&mut cell, &mut bytes);
        }
    });
}

fn step(cell: &mut Cell, bytes: &mut Bytes<'_>) {
    let mut feedback = cell.master.feedback();
    match bytes.byte() % 9 {
        0 => cell.scan(&feedback),
        1 => {
            bytes.tamper(&mut feedback);
            let _ = Visibility::of(feedback.visible_from, feedback.scan, 1);
            cell.scan(&feedback);
        }
        2 => {
            let which = usize::from(bytes.byte()) % cell.commands.len();
            bytes.tamper(&mut cell.commands[which]);
            for servo in &mut cell.servos {
                servo.follow(&cell.commands[which], &feedback);
                servo.scan(&feedback);
            }
            cell.master.exchange();
            cell.close();
        }
        3 => tampered_window(cell, bytes, &feedback),
        4 => {
            bytes.tamper(&mut cell.roster);
            cell.scan(&feedback);
        }
        5 => {
            bytes.tamper(&mut cell.status);
            cell.master.exchange();
            cell.close();
        }
        6 => {
            let mut request = OperatorRequest {
                order: u32::from(bytes.byte()),
                axis: u32::from(bytes.byte()),
                value: f64::from(bytes.byte()),
                ..OperatorRequest::default()
            };
            if bytes.byte() > 127 {
                bytes.tamper(&mut request);
            }
            cell.master.order(&request);
            cell.scan(&feedback);
        }
        7 => {
            let mut saved = cell.saved.clone();
            bytes.change(&mut saved.bytes);
            std::mem::swap(&mut saved, &mut cell.saved);
            cell.replace_master();
        }
        _ => {
            // Another planner, that knows nothing and sees this.
            bytes.tamper(&mut feedback);
            cell.planner = Planner::of(&cell.machine, program(), 2);
            for _ in 0..3 {
                cell.ask_planner(&feedback);
            }
        }
    }
    assert_eq!(cell.master.feedback().axes.len(), MAX_AXES);
}

/// A window with something wrong in it; its checksum fits, or not.
fn tampered_window(cell: &mut Cell, bytes: &mut Bytes<'_>, feedback: &Feedback) {
    let (header, setpoints) = &mut cell.window;
    match bytes.byte() % 4 {
        0 => bytes.tamper(header),
        1 => {
            let count = setpoints.len().max(1);
            let which = bytes.number() % count;
            if let Some(setpoint) = setpoints.get_mut(which) {
                bytes.tamper(setpoint);
            }
        }
        2 => setpoints.truncate(bytes.number() % 64),
        _ => {
            header.first_scan = feedback.scan.wrapping_add(u64::from(bytes.byte() % 16));
            header.predecessor = feedback.window;
        }
    }
    if bytes.byte().is_multiple_of(2) {
        header.setpoint_count = setpoints.len() as u32;
        header.id.checksum = checksum(header, setpoints);
    }
    let _ = bytes_of(header).len();
    cell.sent = true;
    let feedback = *feedback;
    cell.scan(&feedback);
}
