//! A procedure that runs, scan by scan, and its steps.

use std::path::Path;

use bus::sample::{MAX_AXES, Mode, Order, ProgramState, Refused, Waiting};
use master::Drives;

use super::interruptions::{Interruption, asked, order};
use super::table::{Act, Procedure};
use crate::staying::Cell;

/// A procedure that takes longer does not end.
const SCANS_MAX: u64 = 40_000;
/// A machine that does not take an order of the procedure after so many scans never does.
const PATIENCE_SCANS: u64 = 4_000;
/// An operator answers what a program asks after so many.
const ANSWERS_SCANS: u64 = 40;
/// A step shorter than this has no middle.
const SHORT_SCANS: u64 = 20;
/// From the power of the PC to the first order, and between two turns.
const BEFORE_SCANS: u64 = 300;

/// A cell in which a procedure is under way.
#[derive(Clone)]
pub struct Run {
    pub cell: Cell,
    pub procedure: &'static Procedure,
    /// The act that comes next.
    next: usize,
    /// Scans that it has waited for.
    waited: u64,
    /// Scans that the program has asked for something of the operator.
    asked: u64,
}

/// What makes a step of a procedure another one than the step before.
type Step = (
    (Mode, u32, u32, u32, u32),
    (u32, u32, bool, bool, u32),
    (u64, u32),
    Vec<(u32, u32, bool, bool)>,
);

/// A step, from its first scan on.
#[derive(Clone)]
pub struct Stage {
    /// As it begins.
    pub run: Run,
    /// Of the first turn or the second.
    pub turn: usize,
    /// Its number in the turn.
    pub number: usize,
    /// How many it lasts.
    pub scans: u64,
}

impl Stage {
    /// Whether it is interrupted in its middle too.
    pub fn has_middle(&self) -> bool {
        self.scans > SHORT_SCANS
    }
}

/// A procedure with all its steps.
pub struct Prepared {
    pub procedure: &'static Procedure,
    pub stages: Vec<Stage>,
    pub interruptions: Vec<Interruption>,
    /// Command positions at its end.
    pub ends: [i64; MAX_AXES],
}

impl Run {
    /// The machine is ready, and the procedure about to begin.
    fn new(procedure: &'static Procedure, mill: &Path) -> anyhow::Result<Run> {
        let (machine, plant) = procedure.stand.machine(mill)?;
        let mut cell = Cell::new(machine, plant);
        // So that a planner plans.
        cell.lay("M2\n");
        cell.scans(5);
        cell.ready();
        cell.scans(BEFORE_SCANS);
        Ok(Run {
            cell,
            procedure,
            next: 0,
            waited: 0,
            asked: 0,
        })
    }

    /// The procedure is to be done once more.
    pub fn begin(&mut self) {
        (self.next, self.waited, self.asked) = (0, 0, 0);
    }

    /// One scan of it; false once all acts are done, without a scan.
    ///
    /// # Errors
    /// An order is refused that is none of "wait a moment", or what is waited for never comes.
    pub fn advance(&mut self) -> Result<bool, String> {
        let cell = &mut self.cell;
        let done = match self.procedure.acts.get(self.next) {
            None => return Ok(false),
            Some(Act::Until(is) | Act::Tended(is)) if is(cell) => {
                (self.next, self.waited) = (self.next + 1, 0);
                return self.advance();
            }
            Some(Act::Until(_)) => false,
            Some(Act::Tended(_)) => {
                let waiting = Waiting::from_wire(cell.now.auxiliary.waiting);
                let is_asked = waiting.is_some_and(Waiting::is_for_operator);
                self.asked = if is_asked { self.asked + 1 } else { 0 };
                if self.asked == ANSWERS_SCANS {
                    self.asked = 0;
                    asked(cell, &order(Order::Resume))?;
                }
                false
            }
            Some(Act::Fate(what)) => {
                what.happens(cell)?;
                true
            }
            Some(Act::Ask(request)) => {
                let request = request(cell);
                match asked(cell, &request)? {
                    Refused::Not => true,
                    Refused::NotAtRest | Refused::Loading | Refused::NotReady
                        if self.waited < PATIENCE_SCANS =>
                    {
                        false
                    }
                    reason => {
                        let act = self.next;
                        return Err(format!("act {act} is refused: {}", reason.words()));
                    }
                }
            }
        };
        cell.scan();
        self.waited += 1;
        if done {
            (self.next, self.waited) = (self.next + 1, 0);
        }
        if self.waited > SCANS_MAX {
            let (act, state) = (self.next, super::operator::state(cell));
            return Err(format!("act {act} never comes to its end: {state}"));
        }
        Ok(true)
    }

    fn step(&self) -> Step {
        let Cell { now, master, .. } = &self.cell;
        let auxiliary = &now.auxiliary;
        let off_path = now.window.is_none() || now.tag.is_off_path();
        let drives = master.drives();
        let of_axis = |axis: usize| {
            let (of, shown) = (&now.axes[axis], drives.feedback(axis));
            let moves = of.velocity_command_mm_s.abs() > 0.05;
            (of.driver, of.reference, shown.index_mm.is_some(), moves)
        };
        let element = if off_path { u32::MAX } else { now.tag.element };
        (
            (
                self.cell.mode(),
                now.hold,
                now.program,
                auxiliary.waiting,
                auxiliary.events_done,
            ),
            (
                auxiliary.start_line,
                auxiliary.at_speed,
                now.rested == 1,
                drives.inputs().contact,
                now.answer.outcome,
            ),
            (drives.inputs().digital, element),
            (0..self.cell.machine.axes.len()).map(of_axis).collect(),
        )
    }
}

impl Prepared {
    /// Runs a procedure twice, undisturbed.
    ///
    /// # Errors
    /// It does not come to its end.
    pub fn new(procedure: &'static Procedure, mill: &Path) -> anyhow::Result<Prepared> {
        let mut run = Run::new(procedure, mill)?;
        let mut stages: Vec<Stage> = Vec::new();
        for turn in 0..2 {
            let (mut number, mut at) = (0, None);
            loop {
                let step = run.step();
                let is_new = at.as_ref() != Some(&step);
                if is_new {
                    at = Some(step);
                    stages.push(Stage {
                        run: run.clone(),
                        turn,
                        number,
                        scans: 0,
                    });
                    number += 1;
                }
                let goes_on = run.advance().map_err(|why| {
                    let name = procedure.name;
                    anyhow::anyhow!("{name}, turn {turn}, undisturbed: {why}")
                })?;
                if !goes_on {
                    break;
                }
                if let Some(stage) = stages.last_mut() {
                    stage.scans += 1;
                }
            }
            run.cell.scans(BEFORE_SCANS);
            run.begin();
        }
        let is_ready =
            run.cell.mode() == Mode::Ready && run.cell.now.program != ProgramState::Running as u32;
        anyhow::ensure!(
            is_ready,
            "{}: it ends in {:?}",
            procedure.name,
            run.cell.mode()
        );
        stages.retain(|stage| stage.scans > 0);
        Ok(Prepared {
            procedure,
            interruptions: Interruption::all(&run.cell.machine),
            ends: run.cell.now.axes.map(|axis| axis.command_position),
            stages,
        })
    }
}
