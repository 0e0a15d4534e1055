//! A whole cell in one process: machine side, planner and servos take turns in the order that lockstep gives them.
//!
//! It calls the same `scan` functions as the real processes do and hands the same samples over, each visible in the scan
//! that the real one is visible in; so the machine side's digest is the same to the bit (docs/architecture.md). What it leaves
//! out is what lies between processes: shared memory, wake-ups, deaths.

use bus::machine::Machine;
use bus::sample::{
    AxisCommand, Feedback, Instruments, Job, OperatorRequest, OperatorResponse, Participant,
    Roster, WindowHeader, WindowRow,
};
use bytemuck::Zeroable;
use planner::Planner;
use plant_sim::machine_side::{Answers, MachineSide, RunEnd};
use plant_sim::plant_file::PlantFile;
use plant_sim::setup::SetupError;
use servo::{Servo, ServoSettingsError};

/// Every process is the first of its place.
const INCARNATION: u32 = 1;

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

/// What was said in one scan.
#[derive(Debug)]
pub struct Said<'a> {
    /// By the machine side, at its start.
    pub feedback: &'a Feedback,
    /// By the instruments.
    pub instruments: &'a Instruments,
    /// By the servos, in the order of the axes.
    pub commands: &'a [AxisCommand],
}

/// A cell and its program.
#[derive(Debug)]
pub struct Rehearsal {
    side: MachineSide,
    planner: Planner,
    servos: Vec<Servo>,
    roster: Roster,
    answers: Answers,
    feedback: Feedback,
    instruments: Instruments,
    commands: Vec<AxisCommand>,
    window: Option<WindowHeader>,
    rows: Vec<WindowRow>,
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
        let simulations = plant.simulations(machine)?;
        let servos = (0..machine.axes.len())
            .map(|axis| Servo::new(machine, axis, 0, INCARNATION))
            .collect::<Result<Vec<_>, _>>()?;
        let end = RunEnd::AfterProgram;
        Ok(Rehearsal {
            side: MachineSide::new(machine, simulations, INCARNATION, 0, true, end),
            planner: Planner::new(machine, program_name, program_text.into(), INCARNATION),
            servos,
            roster: roster(machine.axes.len()),
            answers: Answers::NONE,
            feedback: Feedback::zeroed(),
            instruments: Instruments::zeroed(),
            commands: Vec::with_capacity(machine.axes.len()),
            window: None,
            rows: Vec::new(),
        })
    }

    /// One scan; `None` once the run has ended.
    pub fn scan(&mut self) -> Option<Said<'_>> {
        let boundary = self.side.is_period_boundary();
        self.feedback = self.side.feedback();
        if self.side.is_last() {
            return None;
        }
        self.instruments = self.side.simulate();
        let feedback = &self.feedback;
        let visible = self.window.filter(|w| w.visible_from <= feedback.scan);
        self.commands.clear();
        for (servo, answer) in self.servos.iter_mut().zip(&mut self.answers.commands) {
            if let Some(header) = &visible {
                // A refusal is reported in the command.
                let _ = servo.offer(header, &self.rows, feedback);
            }
            let command = servo.scan(feedback);
            self.commands.push(command);
            *answer = [Some(command), None];
        }
        if let Some(header) = &visible {
            self.side.offer(header, &self.rows, &self.roster);
            self.window = None;
        }
        self.answers.planner = None;
        if boundary {
            let decision = self.planner.scan(feedback);
            if let Some((header, rows)) = decision.window {
                self.window = Some(header);
                self.rows.clear();
                self.rows.extend_from_slice(rows);
            }
            self.answers.planner = Some(decision.status);
        }
        self.side.close_scan(&self.answers, &self.roster);
        Some(Said {
            feedback: &self.feedback,
            instruments: &self.instruments,
            commands: &self.commands,
        })
    }

    /// The servos, before the first scan.
    pub fn servos(&mut self) -> &mut [Servo] {
        &mut self.servos
    }

    /// An order of the operator, between two scans.
    pub fn order(&mut self, request: &OperatorRequest) -> OperatorResponse {
        self.side.order(request)
    }
}

/// Everybody lives.
fn roster(axes: usize) -> Roster {
    let place = |job: Job, axis: usize| Participant {
        death_scan: u64::MAX,
        job: job as u32,
        axis: axis as u32,
        incarnation: INCARNATION,
        live: 1,
        ..Participant::zeroed()
    };
    let mut roster = Roster {
        version: 1,
        ..Roster::zeroed()
    };
    let everybody = [place(Job::Machine, 0), place(Job::Planner, 0)];
    let servos = (0..axes).map(|axis| place(Job::Servo, axis));
    for (slot, participant) in roster
        .participants
        .iter_mut()
        .zip(everybody.into_iter().chain(servos))
    {
        *slot = participant;
    }
    roster
}
