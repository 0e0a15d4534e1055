//! The ends of a cell's services, for whoever looks on.

use bus::cell::CellError;
use bus::port::Reader;
use bus::sample::{AxisCommand, BusCycle, Feedback, Instruments, PlannerStatus, Roster, Signals};
use bus::service::{Bus, RECORDER_DEPTH_SCANS};
use machine::{Machine, Process};

/// The ends of the cell's services.
pub struct Ports {
    _bus: Bus,
    /// Feedback of the master.
    pub feedback: Reader<Feedback>,
    /// Bench instruments.
    pub instruments: Reader<Instruments>,
    /// What the fieldbus does, of a cell that has one.
    pub bus_cycle: Option<Reader<BusCycle>>,
    /// Named inputs and outputs, of a machine that has any.
    pub signals: Option<Reader<Signals>>,
    /// Status of the planner.
    pub planner: Reader<PlannerStatus>,
    /// Who takes part.
    pub roster: Reader<Roster>,
    /// Commands of the servos, by axis and role.
    pub commands: Vec<Reader<AxisCommand>>,
}

impl Ports {
    /// Opens them; nobody in the cell waits for their queues to be emptied. Of named inputs and outputs so many scans wait here: one
    /// for somebody who shows the newest.
    ///
    /// # Errors
    /// The cell is gone, or refuses.
    pub fn open(bus: Bus, machine: &Machine, signals_depth: usize) -> Result<Ports, CellError> {
        let depth = RECORDER_DEPTH_SCANS;
        let commands = Process::servos(machine)
            .map(|servo| bus.command_reader(servo.axis as usize, servo.role as usize, depth));
        Ok(Ports {
            commands: commands.collect::<Result<_, _>>()?,
            instruments: bus.instruments_reader(depth)?,
            bus_cycle: bus.bus_cycle_reader(depth)?,
            signals: bus.signals_reader(signals_depth)?,
            planner: bus.planner_reader(1)?,
            roster: bus.roster_reader(16)?,
            // The last one: of a scan whose feedback comes, all the others do.
            feedback: bus.feedback_reader(depth)?,
            _bus: bus,
        })
    }
}
