//! The planner as a process. At each period boundary: wake, read feedback, plan, publish a window or nothing new.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::path::{Path, PathBuf};

use bus::cell::CellPlace;
use bus::fault_file;
use bus::member::{Member, MemberError, Pace, Seat};
use bus::realtime::Priority;
use bus::sample::{Feedback, Job, WindowHeader, WindowRow};
use bus::service::SCAN_DEPTH;
use bus::settings_file::SettingsFileError;
use bus::tamper::Tamper;

use crate::planner::Planner;

/// How a planner is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its seat in the cell.
    pub seat: Seat,
    /// Part program; without one it reads those that are loaded into the cell, one after the other.
    pub program: Option<PathBuf>,
    /// A fault script, for the faults that this planner is to commit.
    pub faults: Option<PathBuf>,
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
    /// Nothing lies where a loaded program should.
    #[error("no program lies in the cell under number {0}")]
    NotThere(u32),
    /// The fault script cannot be read.
    #[error(transparent)]
    Faults(#[from] SettingsFileError),
}

fn read(path: &Path) -> Result<(String, String), PlannerError> {
    let name = path.display().to_string();
    match std::fs::read_to_string(path) {
        Ok(text) => Ok((name, text)),
        Err(source) => Err(PlannerError::Program { path: name, source }),
    }
}

/// Takes the program that the feedback names; one that cannot be read is refused in the planner's status.
fn load(planner: &mut Planner, member: &Member, feedback: &Feedback) {
    let place = CellPlace::new(&member.seat().cell).ok();
    let program = match place.and_then(|place| place.program(feedback.load)) {
        Some(path) => read(&path),
        None => Err(PlannerError::NotThere(feedback.load)),
    };
    let program = program.map_err(|error| tracing::error!("{error}"));
    planner.load(program.ok(), feedback);
}

/// Plans until the run or the cell ends.
///
/// # Errors
/// [`PlannerError`].
pub fn run(options: &Options) -> Result<(), PlannerError> {
    let member = Member::enter(options.seat.clone(), "planner")?;
    let cell = |error| PlannerError::Member(MemberError::Cell(error));
    let mut feedback_in = member.bus.feedback_reader(SCAN_DEPTH).map_err(cell)?;
    let mut windows_out = member.bus.window_writer().map_err(cell)?;
    let mut status_out = member.bus.planner_writer().map_err(cell)?;
    let mut planner = match &options.program {
        Some(path) => {
            let (name, text) = read(path)?;
            Planner::new(&member.machine, &name, text, options.seat.incarnation)
        }
        None => Planner::idle(&member.machine, options.seat.incarnation),
    };
    let period_scans = u64::from(member.machine.scan.distribution_period_scans);
    let mut tamper = match &options.faults {
        Some(path) => {
            let script = fault_file::load(path, &member.machine)?;
            Some(Tamper::new(&script, Job::Planner, 0, 0))
        }
        None => None,
    };
    member.ready(Priority::Planner);

    let lockstep = options.seat.pace == Pace::Lockstep;
    let mut last = options.seat.after_scan;
    let mut answered_boundary = None;
    while let Some(feedback) =
        member.next_feedback(member.page.planner_bell(), &mut feedback_in, last)
    {
        if feedback.last == 1 {
            break;
        }
        last = Some(feedback.scan);
        let boundary = feedback.scan - feedback.scan % period_scans;
        // In lockstep everybody is waited for: who comes between two boundaries has just joined, and was not asked.
        let unasked = lockstep && feedback.scan != boundary;
        if unasked || answered_boundary.is_some_and(|answered| answered >= boundary) {
            // Woken between two boundaries, by somebody who rang for all: nothing is asked.
            continue;
        }
        answered_boundary = Some(boundary);
        if feedback.load != planner.loaded() {
            load(&mut planner, &member, &feedback);
        }
        let decision = planner.scan(&feedback);
        let mut send = |header: &WindowHeader, rows: &[WindowRow]| {
            if !windows_out.send(header, rows) {
                tracing::warn!(sequence = header.id.sequence, "a window could not be sent");
            }
        };
        match &mut tamper {
            None => {
                if let Some((header, rows)) = &decision.window {
                    send(header, rows);
                }
            }
            Some(tamper) => {
                let fired = |index| member.page.fault_fired(index);
                let planned = decision
                    .window
                    .as_ref()
                    .map(|(header, rows)| (header, *rows));
                tamper.window(feedback.scan, planned, fired, send);
            }
        }
        status_out.send(&decision.status);
        member.page.set_answered(member.seat().place, feedback.scan);
        member.page.answered();
    }
    Ok(())
}
