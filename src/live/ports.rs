//! The ends of a cell's services, for whoever looks on.

use bus::cell::CellError;
use bus::machine::Machine;
use bus::port::Reader;
use bus::sample::{AxisCommand, Feedback, Instruments, PlannerStatus, Roster};
use bus::service::{Bus, RECORDER_DEPTH_SCANS, ROLES};

/// The ends of the cell's services.
pub struct Ports {
    _bus: Bus,
    pub feedback: Reader<Feedback>,
    pub instruments: Reader<Instruments>,
    pub planner: Reader<PlannerStatus>,
    pub roster: Reader<Roster>,
    pub commands: Vec<Reader<AxisCommand>>,
}

impl Ports {
    /// Opens them; nobody in the cell waits for their queues to be emptied.
    ///
    /// # Errors
    /// The cell is gone, or refuses.
    pub fn open(bus: Bus, machine: &Machine) -> Result<Ports, CellError> {
        let depth = RECORDER_DEPTH_SCANS;
        let mut commands = Vec::new();
        for (axis, settings) in machine.axes.iter().enumerate() {
            for role in 0..ROLES.len() {
                if role == 0 || settings.standby {
                    commands.push(bus.command_reader(axis, role, depth)?);
                }
            }
        }
        Ok(Ports {
            feedback: bus.feedback_reader(depth)?,
            instruments: bus.instruments_reader(depth)?,
            planner: bus.planner_reader(1)?,
            roster: bus.roster_reader(16)?,
            commands,
            _bus: bus,
        })
    }
}
