//! What a planner sees of its cell, and the same over the bus.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::path::Path;
use std::rc::Rc;

use bus::cell::{CellError, CellPaths};
use bus::member::{Member, Pace};
use bus::port::{Reader, WindowWriter, Writer};
use bus::sample::{Feedback, PlannerStatus, Setpoint, WindowHeader};
use bus::service::SCAN_DEPTH;

/// What a planner sees of its cell. Shared memory, queues and faulty decorators implement it.
pub trait PlannerPorts {
    /// Waits for the newest feedback that asks the planner; none when it is time to leave.
    fn next_feedback(&mut self) -> Option<Feedback>;

    /// Name and text of the program that was loaded into the cell under this number; none if it cannot be read.
    fn program(&mut self, load: u32) -> Option<(String, String)>;

    /// Publishes a window, before the status of the same scan.
    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]);

    /// Publishes what the planner has to report of a scan; every scan that asks gets one.
    fn publish_status(&mut self, status: &PlannerStatus);

    /// Reports that the planner is done with the scan.
    fn answered(&mut self, scan: u64);
}

/// Which feedbacks ask the planner: the first one seen of each interpolation period.
#[derive(Debug)]
struct Boundaries {
    period_scans: u64,
    lockstep: bool,
    answered: Option<u64>,
}

impl Boundaries {
    /// Whether the feedback of this scan asks. Between two boundaries somebody has signalled for all, and nothing is asked; in
    /// lockstep, where everybody is waited for, whoever comes then has just joined.
    fn asks(&mut self, scan: u64) -> bool {
        let boundary = scan - scan % self.period_scans;
        let unasked = self.lockstep && scan != boundary;
        if unasked || self.answered.is_some_and(|answered| answered >= boundary) {
            return false;
        }
        self.answered = Some(boundary);
        true
    }
}

/// The ports of a planner process: shared memory, and the cell's folder of programs.
#[derive(Debug)]
pub struct BusPorts {
    member: Rc<Member>,
    feedback: Reader<Feedback>,
    windows: WindowWriter,
    status: Writer<PlannerStatus>,
    boundaries: Boundaries,
    last: Option<u64>,
}

impl BusPorts {
    /// Opens the ports of the planner, which is asked once in so many scans.
    ///
    /// # Errors
    /// [`CellError::Transport`], also if the cell has a planner already.
    pub fn open(member: Rc<Member>, period_scans: u32) -> Result<BusPorts, CellError> {
        let bus = &member.bus;
        Ok(BusPorts {
            feedback: bus.feedback_reader(SCAN_DEPTH)?,
            windows: bus.window_writer()?,
            status: bus.planner_writer()?,
            boundaries: Boundaries {
                period_scans: u64::from(period_scans.max(1)),
                lockstep: member.slot().pace == Pace::Lockstep,
                answered: None,
            },
            last: member.slot().after_scan,
            member,
        })
    }
}

impl PlannerPorts for BusPorts {
    fn next_feedback(&mut self) -> Option<Feedback> {
        loop {
            let signal = self.member.page.planner_signal();
            let feedback = self
                .member
                .next_feedback(signal, &mut self.feedback, self.last)?;
            self.last = Some(feedback.scan);
            if feedback.last == 1 || self.boundaries.asks(feedback.scan) {
                return Some(feedback);
            }
        }
    }

    fn program(&mut self, load: u32) -> Option<(String, String)> {
        let paths = CellPaths::new(&self.member.slot().cell).ok();
        let Some(path) = paths.and_then(|paths| paths.program(load)) else {
            tracing::error!("the cell has no program of number {load}");
            return None;
        };
        read(&path)
            .map_err(|error| tracing::error!("{}: {error}", path.display()))
            .ok()
    }

    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        if !self.windows.send(header, setpoints) {
            tracing::warn!(sequence = header.id.sequence, "a window could not be sent");
        }
    }

    fn publish_status(&mut self, status: &PlannerStatus) {
        self.status.send(status);
    }

    fn answered(&mut self, scan: u64) {
        self.member.answered(scan);
    }
}

/// Name and text of a program.
pub(crate) fn read(path: &Path) -> std::io::Result<(String, String)> {
    Ok((path.display().to_string(), std::fs::read_to_string(path)?))
}

#[cfg(test)]
mod tests {
    use super::Boundaries;

    fn asked(lockstep: bool, scans: &[u64]) -> Vec<u64> {
        let mut boundaries = Boundaries {
            period_scans: 4,
            lockstep,
            answered: None,
        };
        let asks = scans.iter().filter(|scan| boundaries.asks(**scan));
        asks.copied().collect()
    }

    #[test]
    fn each_period_asks_once_also_a_planner_that_woke_late() {
        assert_eq!(asked(false, &[0, 1, 4, 5, 9, 10, 12]), [0, 4, 9, 12]);
    }

    #[test]
    fn in_lockstep_a_planner_that_joined_within_a_period_waits_for_the_next() {
        assert_eq!(asked(true, &[6, 7, 8, 9, 12]), [8, 12]);
    }
}
