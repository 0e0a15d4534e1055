//! Ports of servos and planner within one process: queues with the scan's rules.

use std::sync::Arc;

use bus::sample::{AxisCommand, Feedback, PlannerStatus, Setpoint, WindowHeader};
use machine::{KeptParameters, Machine};
use path::speed_map::first_mapped;
use planner::questions::{KeptAnswer, kept_in};
use planner::{Left, Place, PlannerPorts, ProgramText};
use servo::ServoPorts;

use super::queues::{Queue, Window};

/// What one servo receives and sends.
#[derive(Debug)]
pub(crate) struct ServoQueues {
    /// The feedback it is to answer.
    pub feedback: Option<Arc<Feedback>>,
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
    type Feedback = Arc<Feedback>;

    fn next_feedback(&mut self) -> Option<Arc<Feedback>> {
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
    /// What it, and those before it, have kept.
    pub kept: PlannersKept,
}

/// What planners keep for those after them.
#[derive(Debug, Default)]
pub(crate) struct PlannersKept {
    /// Places of the program.
    places: Vec<Place>,
    /// Answers of the machine.
    answers: Vec<KeptAnswer>,
    /// Parameters of the program at its end.
    pub parameters: Option<KeptParameters>,
}

impl PlannerPorts for PlannerQueues {
    fn next_feedback(&mut self) -> Option<Feedback> {
        self.windows.clear();
        self.status = None;
        self.feedback.take()
    }

    /// A cell within one process runs the program that it was made with.
    fn program(&mut self, _load: u32) -> Option<ProgramText> {
        None
    }

    fn place_before(&mut self, program_hash: u64, element: u32) -> Option<Place> {
        let fits = |place: &&Place| {
            place.program_hash == program_hash && first_mapped(place.element) <= element
        };
        let bytes = self.kept.places.iter().rfind(fits)?.to_bytes();
        Place::from_bytes(&bytes)
    }

    fn keep_place(&mut self, place: &Place, _tool: u32) {
        self.kept.places.push(place.clone());
    }

    fn answers(&mut self, _load: u32, _run: u32) -> Vec<KeptAnswer> {
        kept_in(bytemuck::cast_slice(&self.kept.answers))
    }

    fn keep_answer(&mut self, _load: u32, _run: u32, answer: &KeptAnswer) -> bool {
        self.kept.answers.truncate(answer.index as usize);
        self.kept.answers.push(*answer);
        true
    }

    fn keep(&mut self, _machine: &Machine, left: &Left) -> Result<(), String> {
        self.kept.parameters = Some(left.parameters.clone());
        Ok(())
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
