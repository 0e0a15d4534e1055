//! The planner as a process. At each period boundary: wake, read feedback, plan, publish a window or nothing new.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::path::PathBuf;

use bus::member::{Member, MemberError, Seat};
use bus::realtime::Priority;
use bus::service::SCAN_DEPTH;

use crate::planner::Planner;

/// How a planner is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its seat in the cell.
    pub seat: Seat,
    /// Part program.
    pub program: PathBuf,
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
    member.ready(Priority::Planner);

    let mut last = None;
    let mut answered_boundary = None;
    while let Some(feedback) =
        member.next_feedback(member.page.planner_bell(), &mut feedback_in, last)
    {
        if feedback.last == 1 {
            break;
        }
        last = Some(feedback.scan);
        let boundary = feedback.scan - feedback.scan % period_scans;
        if answered_boundary.is_some_and(|answered| answered >= boundary) {
            // Woken between two boundaries, by somebody who rang for all: nothing is asked.
            continue;
        }
        answered_boundary = Some(boundary);
        let decision = planner.scan(&feedback);
        if let Some((header, rows)) = &decision.window
            && !windows_out.send(header, rows)
        {
            tracing::warn!(sequence = header.id.sequence, "a window could not be sent");
        }
        status_out.send(&decision.status);
        member.page.answered();
    }
    Ok(())
}
