//! The servo as a process. Each scan: wake, read feedback and windows, compute, command.

use std::rc::Rc;
use std::sync::Arc;

use bus::member::{Member, MemberError, Slot};
use bus::realtime::Priority;
use loops::learned_table::LearnedTable;
use loops::path_correction::{Knot, PathCorrection};
use machine::Machine;
use machine::learned::Learned;
use machine::learned_path::{LEARNED_PATH_FILE, LearnedPath};
use machine::settings_file::SettingsFileError;

use crate::controller::Servo;
use crate::ports::{BusPorts, ServoPorts};
use crate::settings::ServoSettingsError;

/// How a servo is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// Letter of its axis.
    pub axis: String,
    /// Role: 0 = a, 1 = b.
    pub role: u32,
}

/// Why a servo cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum ServoError {
    /// The cell refuses it.
    #[error(transparent)]
    Member(#[from] MemberError),
    /// The axis's settings make no servo.
    #[error(transparent)]
    Settings(#[from] ServoSettingsError),
    /// The machine file, what was learned, or a script cannot be read.
    #[error(transparent)]
    File(#[from] SettingsFileError),
    /// The machine has no such axis.
    #[error("axis {0:?}: the machine has none of that name")]
    NoAxis(String),
}

/// Runs one servo until the run or the cell ends.
///
/// # Errors
/// [`ServoError`].
pub fn run(options: &Options) -> Result<(), ServoError> {
    run_over(options, |ports, _, _| Ok(ports))
}

/// The same over ports that `decorate` makes of the process's own.
///
/// # Errors
/// [`ServoError`].
pub fn run_over<P: ServoPorts>(
    options: &Options,
    decorate: impl FnOnce(BusPorts, &Rc<Member>, &Machine) -> Result<P, ServoError>,
) -> Result<(), ServoError> {
    let machine = Machine::load(&options.slot.machine)?;
    let name = format!("servo-{}", options.axis);
    let member = Rc::new(Member::enter(
        options.slot.clone(),
        &name,
        &machine.shape(),
    )?);
    let (axis, settings) = machine
        .axes
        .iter()
        .enumerate()
        .find(|(_, axis)| axis.name == options.axis)
        .ok_or_else(|| ServoError::NoAxis(options.axis.clone()))?;
    let mut servo = Servo::new(&machine, axis, options.role, options.slot.incarnation)?;
    let learned = Learned::beside(&options.slot.machine, &machine)?;
    if let Some(learned) = learned.as_ref().and_then(|l| l.of(&machine, settings)) {
        let learned = &learned.table;
        servo.load_trained(LearnedTable::from_columns(
            learned.friction_scale,
            [&learned.negative_torque_nm, &learned.positive_torque_nm],
            [
                &learned.negative_lost_motion_um,
                &learned.positive_lost_motion_um,
            ],
        ));
    }
    let path_file = machine::machine_file(&options.slot.machine).with_file_name(LEARNED_PATH_FILE);
    if let Some(path) = LearnedPath::load(&path_file, &machine)? {
        servo.load_path(Arc::new(correction_of(&path, axis)));
    }
    let ports = BusPorts::open(
        Rc::clone(&member),
        axis,
        options.role as usize,
        settings.standby,
    )
    .map_err(MemberError::Cell)?;
    let mut ports = decorate(ports, &member, &machine)?;
    member.ready(Priority::Servo);
    while cycle(&mut servo, &mut ports) {}
    Ok(())
}

/// What a program has taught of one axis.
fn correction_of(path: &LearnedPath, axis: usize) -> PathCorrection {
    // A hash that is none is no program's.
    let program_hash = u64::from_str_radix(&path.head.program_hash, 16).unwrap_or(0);
    let knots = path.knots.iter().map(|knot| Knot {
        place_mm: knot.place_mm,
        speed_mm_s: knot.speed_mm_s,
        correction_mm: knot.correction_mm.get(axis).copied().unwrap_or(0.0),
    });
    PathCorrection::new(program_hash, path.elements.clone(), knots.collect())
}

/// One scan of a servo; false when it is time to leave.
pub fn cycle(servo: &mut Servo, ports: &mut impl ServoPorts) -> bool {
    let Some(feedback) = ports.next_feedback().filter(|feedback| feedback.last == 0) else {
        return false;
    };
    ports.for_each_window(feedback.scan, |header, setpoints| {
        // A refusal is reported in the command.
        let _ = servo.offer(header, setpoints, &feedback);
    });
    if let Some(peer) = ports.peer_command(feedback.scan) {
        servo.follow(&peer, &feedback);
    }
    let command = servo.scan(&feedback);
    ports.publish(&command);
    ports.answered(feedback.scan);
    true
}
