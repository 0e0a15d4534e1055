//! Ports of servos and planner within one process: queues with the scan's rules.

use std::sync::Arc;

use bus::sample::{AxisCommand, Feedback, PlannerStatus, Setpoint, WindowHeader};
use planner::PlannerPorts;
use servo::ServoPorts;

use super::queues::{Queue, Window};

/// What one servo receives and sends.
#[derive(Debug)]
pub(crate) struct ServoQueues {
    /// The feedback it is to answer.
    pub feedback: Option<Feedback>,
    /// Windows that were published.
    pub windows: Queue<Arc<Window>>,
    /// Commands of the axis's other servo; none where there is no other.
    pub peer: Option<Queue<AxisCommand>>,
    /// What it has sent in this scan.
    pub sent: Vec<AxisCommand>,
}

impl ServoQueues {
    pub fn new(standby: bool) -> ServoQueues {
        ServoQueues {
            feedback: None,
            windows: Queue::new(),
            peer: standby.then(Queue::new),
            sent: Vec::with_capacity(2),
        }
    }
}

impl ServoPorts for ServoQueues {
    fn next_feedback(&mut self) -> Option<Feedback> {
        self.sent.clear();
        self.feedback.take()
    }

    fn for_each_window(&mut self, scan: u64, mut offer: impl FnMut(&WindowHeader, &[Setpoint])) {
        while let Some(window) = self.windows.next(scan) {
            offer(&window.header, &window.setpoints);
        }
    }

    fn peer_command(&mut self, scan: u64) -> Option<AxisCommand> {
        self.peer.as_mut()?.newest(scan)
    }

    fn publish(&mut self, command: &AxisCommand) {
        self.sent.push(*command);
    }

    fn answered(&mut self, _scan: u64) {}
}

/// What the planner receives and sends.
#[derive(Debug, Default)]
pub(crate) struct PlannerQueues {
    /// The feedback it is to answer.
    pub feedback: Option<Feedback>,
    /// Windows that it has sent in this scan.
    pub windows: Vec<Arc<Window>>,
    /// What it has reported of this scan.
    pub status: Option<PlannerStatus>,
}

impl PlannerPorts for PlannerQueues {
    fn next_feedback(&mut self) -> Option<Feedback> {
        self.windows.clear();
        self.status = None;
        self.feedback.take()
    }

    /// A cell within one process runs the program that it was made with.
    fn program(&mut self, _load: u32) -> Option<(String, String)> {
        None
    }

    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        self.windows.push(Arc::new(Window {
            header: *header,
            setpoints: setpoints.to_vec(),
        }));
    }

    fn publish_status(&mut self, status: &PlannerStatus) {
        self.status = Some(*status);
    }

    fn answered(&mut self, _scan: u64) {}
}
