//! The planner as a process. At each period boundary: wake, read feedback, plan, publish a window or nothing new.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::path::PathBuf;
use std::rc::Rc;

use bus::member::{Member, MemberError, Slot};
use bus::realtime::Priority;
use machine::Machine;
use machine::settings_file::SettingsFileError;

use crate::planner::Planner;
use crate::ports::{BusPorts, PlannerPorts, read};

/// How a planner is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// Part program; without one it reads those that are loaded into the cell, one after the other.
    pub program: Option<PathBuf>,
}

/// Why a planner cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum PlannerError {
    /// The cell refuses it.
    #[error(transparent)]
    Member(#[from] MemberError),
    /// The program cannot be read.
    #[error("{path}: {source}")]
    Program {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The machine file, or a script, cannot be read.
    #[error(transparent)]
    File(#[from] SettingsFileError),
}

/// Plans until the run or the cell ends.
///
/// # Errors
/// [`PlannerError`].
pub fn run(options: &Options) -> Result<(), PlannerError> {
    run_over(options, |ports, _, _| Ok(ports))
}

/// The same over ports that `decorate` makes of the process's own.
///
/// # Errors
/// [`PlannerError`].
pub fn run_over<P: PlannerPorts>(
    options: &Options,
    decorate: impl FnOnce(BusPorts, &Rc<Member>, &Machine) -> Result<P, PlannerError>,
) -> Result<(), PlannerError> {
    let machine = Machine::load(&options.slot.machine)?;
    let member = Member::enter(options.slot.clone(), "planner", &machine.shape())?;
    let member = Rc::new(member);
    let period_scans = machine.scan.interpolation_period_scans;
    let ports = BusPorts::open(Rc::clone(&member), period_scans).map_err(MemberError::Cell)?;
    let mut planner = match &options.program {
        Some(path) => {
            let (name, text) = read(path).map_err(|source| PlannerError::Program {
                path: path.display().to_string(),
                source,
            })?;
            Planner::new(&machine, &name, text, options.slot.incarnation)
        }
        None => Planner::idle(&machine, options.slot.incarnation),
    };
    let mut ports = decorate(ports, &member, &machine)?;
    member.ready(Priority::Planner);
    while cycle(&mut planner, &mut ports) {}
    Ok(())
}

/// One period of a planner; false when it is time to leave.
pub fn cycle(planner: &mut Planner, ports: &mut impl PlannerPorts) -> bool {
    let Some(feedback) = ports.next_feedback().filter(|feedback| feedback.last == 0) else {
        return false;
    };
    if feedback.load != planner.loaded() {
        planner.load(ports.program(feedback.load), &feedback);
    }
    let decision = planner.scan(&feedback);
    if let Some((header, setpoints)) = &decision.window {
        ports.publish_window(header, setpoints);
    }
    ports.publish_status(&decision.status);
    ports.answered(feedback.scan);
    true
}
