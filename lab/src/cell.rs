//! A whole cell in one process: master, planner and servos take turns in the order that lockstep gives them.
//!
//! It calls the same `cycle` functions as the real processes do, over queues in memory, and each sample is visible in the scan
//! that the real one is visible in; so the motion digest is the same to the bit (docs/developers/architecture.md). Also with faults: a
//! script kills, stops and restarts processes and makes their samples wrong as it does to real ones, and what a process
//! remembers goes with it. Who is replaced, and when the machine is ordered to stop, is decided by the launcher's rules. It
//! leaves out what lies between processes: shared memory and signals.
//!
//! [`invariants`](crate::invariants) judges what is published, scan by scan.

use std::sync::Arc;

use bus::sample::{
    AxisCommand, Feedback, Instruments, OperatorRequest, OperatorResponse, Order, PlannerStatus,
    Roster,
};
use machine::{KeptParameters, Machine, Process};
use master::{Beginning, Flow, Master, RunEnd, cycle::cycle};
use plant_sim::SimulatedDrives;
use plant_sim::plant_file::PlantFile;
use servo::Servo;

mod launcher;
mod members;
mod peers;
mod ports;
mod queues;
mod script;

use members::Life;
use peers::Peers;
pub(crate) use ports::ServoQueues;
pub(crate) use queues::Queue;
pub use queues::Window;
pub use script::{CellError, Script};

/// What was published in one scan.
#[derive(Debug)]
pub struct Published<'a> {
    /// By the master, at its start.
    pub feedback: &'a Feedback,
    /// By the instruments.
    pub instruments: &'a Instruments,
    /// By the servos that were asked: those that drive in the order of the axes, then the standbys. What a fault makes of
    /// a command on its way to the others does not show here.
    pub commands: &'a [AxisCommand],
    /// What the planner has last reported.
    pub status: Option<&'a PlannerStatus>,
    /// Windows that were sent in this scan.
    pub windows: &'a [Arc<Window>],
    /// Who takes part.
    pub roster: &'a Roster,
    /// Orders of the script that were obeyed in this scan.
    pub obeyed: &'a [Order],
}

/// A cell and its program.
pub struct InProcessCell {
    machine: Machine,
    plant: PlantFile,
    master: Master<SimulatedDrives>,
    incarnation: u32,
    peers: Peers,
    ended: bool,
}

/// A master over these drives, which are on from the first scan; the run ends with its program.
fn new_master(
    machine: &Machine,
    drives: SimulatedDrives,
    incarnation: u32,
    first_scan: u64,
) -> Master<SimulatedDrives> {
    let end = RunEnd::AfterProgram;
    Master::new(machine, drives, incarnation, first_scan, true, end)
}

impl InProcessCell {
    /// A cell about to run a program, drives on, that ends with it.
    ///
    /// # Errors
    /// The plant does not fit the machine, or an axis cannot be served.
    pub fn new(
        machine: &Machine,
        plant: &PlantFile,
        program_name: &str,
        program_text: &str,
    ) -> Result<InProcessCell, CellError> {
        let program = (program_name, program_text);
        Self::with_script(machine, plant, program, Script::default())
    }

    /// The same with faults and orders, each at its scan.
    ///
    /// # Errors
    /// As [`InProcessCell::new`].
    pub fn with_script(
        machine: &Machine,
        plant: &PlantFile,
        program: (&str, &str),
        script: Script,
    ) -> Result<InProcessCell, CellError> {
        let mut machine = machine.clone();
        if let Some(faults) = &script.faults {
            faults.restart.apply(&mut machine.restart);
        }
        let drives = plant.drives(&machine)?;
        let incarnation = Life::FIRST.incarnation;
        Ok(InProcessCell {
            master: new_master(&machine, drives, incarnation, 0),
            peers: Peers::new(machine.clone(), program, script)?,
            plant: plant.clone(),
            incarnation,
            machine,
            ended: false,
        })
    }

    /// Before the first scan: the program begins at a line.
    pub fn begin_at_line(&mut self, line: u32) {
        self.master.begin_with(&Beginning {
            start_line: line,
            ..Beginning::default()
        });
    }

    /// One scan; `None` once the run has ended.
    pub fn scan(&mut self) -> Option<Published<'_>> {
        while !self.ended {
            let Ok(flow) = cycle(&mut self.master, &mut self.peers);
            if flow == Flow::GoOn {
                let peers = &self.peers;
                return Some(Published {
                    feedback: &peers.feedback,
                    instruments: &peers.instruments,
                    commands: &peers.commands,
                    status: peers.status.as_ref(),
                    windows: &peers.windows,
                    roster: &peers.roster,
                    obeyed: &peers.obeyed,
                });
            }
            let killed = self.peers.master_killed.take();
            let replaced = killed.is_some_and(|killed| killed.replaced);
            self.ended = !replaced || self.replace_master().is_err();
        }
        None
    }

    /// The servos, before the first scan: those that drive in the order of the axes, then the standbys.
    pub fn servos(&mut self) -> &mut [Servo] {
        &mut self.peers.servos
    }

    /// The simulated drives, with the truth that no controller sees.
    pub fn drives(&self) -> &SimulatedDrives {
        self.master.drives()
    }

    /// An order of the operator, between two scans.
    pub fn order(&mut self, request: &OperatorRequest) -> OperatorResponse {
        self.master.order(request)
    }

    /// The parameters that the program has kept at its end; none before.
    pub fn kept_parameters(&mut self) -> Option<&KeptParameters> {
        self.peers.kept_parameters()
    }

    /// Scan in which a fault of the script fired.
    pub fn fired(&self, index: usize) -> Option<u64> {
        self.peers.fired(index)
    }

    /// Who was lost and is not replaced.
    pub fn lost_for_good(&self) -> &[Process] {
        self.peers.lost_for_good()
    }

    /// The master that takes the place of a killed one goes on from what that one has saved.
    fn replace_master(&mut self) -> Result<(), CellError> {
        let mut drives = self.plant.drives(&self.machine)?;
        let saved = self.peers.saved.as_ref();
        let latches = saved.map(|saved| saved.restore(&mut drives)).transpose()?;
        self.incarnation += 1;
        let first_scan = latches.map_or(0, |latches| latches.scan + 1);
        self.master = new_master(&self.machine, drives, self.incarnation, first_scan);
        if let Some(latches) = &latches {
            self.master.resume(latches);
        }
        self.peers.master_replaced(self.incarnation, first_scan);
        Ok(())
    }
}
