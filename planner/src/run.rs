//! The planner as a process. At each period boundary: wake, read feedback, plan, publish a window or nothing new.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::path::PathBuf;

use bus::fault_file;
use bus::member::{Member, MemberError, Pace, Seat};
use bus::realtime::Priority;
use bus::sample::{Job, WindowHeader, WindowRow};
use bus::service::SCAN_DEPTH;
use bus::settings_file::SettingsFileError;
use bus::tamper::Tamper;

use crate::planner::Planner;

/// How a planner is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its seat in the cell.
    pub seat: Seat,
    /// Part program.
    pub program: PathBuf,
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
    /// The fault script cannot be read.
    #[error(transparent)]
    Faults(#[from] SettingsFileError),
}

/// Plans until the run or the cell ends.
///
/// # Errors
/// [`PlannerError`].
pub fn run(options: &Options) -> Result<(), PlannerError> {
    let member = Member::enter(options.seat.clone(), "planner")?;
    let name = options.program.display().to_string();
    let text =
        std::fs::read_to_string(&options.program).map_err(|source| PlannerError::Program {
            path: name.clone(),
            source,
        })?;
    let cell = |error| PlannerError::Member(MemberError::Cell(error));
    let mut feedback_in = member.bus.feedback_reader(SCAN_DEPTH).map_err(cell)?;
    let mut windows_out = member.bus.window_writer().map_err(cell)?;
    let mut status_out = member.bus.planner_writer().map_err(cell)?;
    let mut planner = Planner::new(&member.machine, &name, text, options.seat.incarnation);
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
