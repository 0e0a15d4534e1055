//! The servo as a process. Each scan: wake, read feedback and windows, compute, command.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::path::PathBuf;

use bus::fault_file;
use bus::machine::learned::Learned;
use bus::member::{Member, MemberError, Seat};
use bus::realtime::Priority;
use bus::sample::Job;
use bus::service::{ROLES, SCAN_DEPTH};
use bus::settings_file::SettingsFileError;
use bus::tamper::Tamper;
use control::learned_table::LearnedTable;

use crate::controller::Servo;
use crate::settings::ServoSettingsError;

/// How a servo is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its seat in the cell.
    pub seat: Seat,
    /// Letter of its axis.
    pub axis: String,
    /// Role: 0 = a, 1 = b.
    pub role: u32,
    /// A fault script, for the faults that this servo is to commit.
    pub faults: Option<PathBuf>,
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
    /// What was learned, or the fault script, cannot be read.
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
    let member = Member::enter(options.seat.clone(), &format!("servo-{}", options.axis))?;
    let axis = member
        .machine
        .axes
        .iter()
        .position(|axis| axis.name == options.axis)
        .ok_or_else(|| ServoError::NoAxis(options.axis.clone()))?;
    let cell = |error| ServoError::Member(MemberError::Cell(error));
    let mut feedback_in = member.bus.feedback_reader(SCAN_DEPTH).map_err(cell)?;
    let mut windows_in = member.bus.window_reader(SCAN_DEPTH).map_err(cell)?;
    let mut command_out = member
        .bus
        .command_writer(axis, options.role as usize)
        .map_err(cell)?;
    let mut servo = Servo::new(
        &member.machine,
        axis,
        options.role,
        options.seat.incarnation,
    )?;
    let learned = Learned::beside(&options.seat.machine, &member.machine)?;
    let of_axis = learned.as_ref().zip(member.machine.axes.get(axis));
    if let Some(taught) = of_axis.and_then(|(l, a)| l.of(&member.machine, a)) {
        servo.recall(LearnedTable::from_columns(
            taught.friction_scale,
            [&taught.negative_torque_nm, &taught.positive_torque_nm],
            [
                &taught.negative_lost_motion_um,
                &taught.positive_lost_motion_um,
            ],
        ));
    }
    let mut tamper = match &options.faults {
        Some(path) => {
            let script = fault_file::load(path, &member.machine)?;
            Some(Tamper::new(&script, Job::Servo, axis as u32, options.role))
        }
        None => None,
    };
    let standby = member.machine.axes.get(axis).is_some_and(|a| a.standby);
    let mut peer_in = standby
        .then(|| {
            let peer = ROLES.len().saturating_sub(1 + options.role as usize);
            member.bus.command_reader(axis, peer, SCAN_DEPTH)
        })
        .transpose()
        .map_err(cell)?;
    member.ready(Priority::Servo);

    let mut last = options.seat.after_scan;
    while let Some(feedback) = member.next_feedback(member.page.scan_bell(), &mut feedback_in, last)
    {
        if feedback.last == 1 {
            break;
        }
        last = Some(feedback.scan);
        windows_in.each(feedback.scan, |header, rows| {
            // A refusal is reported in the command.
            let _ = servo.offer(header, rows, &feedback);
        });
        if let Some(peer) = peer_in.as_mut().and_then(|r| r.newest(feedback.scan)) {
            servo.follow(&peer, &feedback);
        }
        let command = servo.scan(&feedback);
        match &mut tamper {
            None => command_out.send(&command),
            Some(tamper) => {
                let fired = |index| member.page.fault_fired(index);
                tamper.command(&command, fired, |sent| command_out.send(sent));
            }
        }
        member.page.set_answered(member.seat().place, feedback.scan);
        member.page.answered();
    }
    Ok(())
}
