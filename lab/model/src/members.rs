//! The processes of the cell, and what waits for each of them.

use std::sync::Arc;

use bus::sample::{AxisCommand, Feedback, PlannerStatus, Setpoint, WindowHeader};
use planner::{Planner, PlannerPorts, ProgramText};
use servo::{Servo, ServoPorts};
use xxhash_rust::xxh3::xxh3_64;

use crate::bench::PERIOD_SCANS;

/// A window that was published.
#[derive(Debug)]
pub struct Window {
    /// Its header.
    pub header: WindowHeader,
    /// Its setpoints.
    pub setpoints: Vec<Setpoint>,
    /// A hash of its setpoints.
    pub content: u64,
}

/// How far a process is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Life {
    /// It lives and is in the roster.
    TakesPart,
    /// It lives and waits to be admitted.
    Joins,
    /// It has died, and the launcher does not know yet.
    Dead,
    /// It is gone; another one is to be started.
    Due,
    /// It is gone for good.
    Gone,
}

impl Life {
    /// Whether there is a process.
    pub fn lives(self) -> bool {
        matches!(self, Life::TakesPart | Life::Joins)
    }
}

/// A place of the roster and who is in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Place {
    /// How far its process is.
    pub life: Life,
    /// Which one it is, counted from 1.
    pub incarnation: u32,
}

impl Place {
    /// The first process, which takes part.
    pub const FIRST: Place = Place {
        life: Life::TakesPart,
        incarnation: 1,
    };
}

/// The servo of an axis in a role.
#[derive(Debug, Clone)]
pub struct ServoPlace {
    /// Its axis.
    pub axis: usize,
    /// Its role.
    pub role: usize,
    /// Its process.
    pub place: Place,
    /// What the process remembers; that of a dead one is not used.
    pub servo: Arc<Servo>,
    /// Windows that it has not read.
    pub windows: Vec<Arc<Window>>,
    /// The newest command of the axis's other servo that it has not read.
    pub peer: Option<AxisCommand>,
    /// What it has commanded last.
    pub last: Option<AxisCommand>,
}

/// The ports of a servo for one scan.
pub struct ServoScan<'a> {
    /// The feedback it answers.
    pub feedback: Option<Feedback>,
    /// Windows that wait.
    pub windows: &'a mut Vec<Arc<Window>>,
    /// The other servo's command.
    pub peer: &'a mut Option<AxisCommand>,
    /// Its answer.
    pub command: Option<AxisCommand>,
}

impl ServoPorts for ServoScan<'_> {
    type Feedback = Box<Feedback>;

    fn next_feedback(&mut self) -> Option<Box<Feedback>> {
        self.feedback.take().map(Box::new)
    }

    fn for_each_window(&mut self, scan: u64, mut offer: impl FnMut(&WindowHeader, &[Setpoint])) {
        self.windows.retain(|window| {
            let visible = window.header.visible_from <= scan;
            if visible {
                offer(&window.header, &window.setpoints);
            }
            !visible
        });
    }

    fn peer_command(&mut self, scan: u64) -> Option<AxisCommand> {
        let visible = self.peer.filter(|peer| peer.visible_from <= scan);
        if visible.is_some() {
            *self.peer = None;
        }
        visible
    }

    fn publish(&mut self, command: &AxisCommand) {
        self.command = Some(*command);
    }

    fn answered(&mut self, _scan: u64) {}
}

/// The planner.
#[derive(Debug, Clone)]
pub struct PlannerPlace {
    /// Its process.
    pub place: Place,
    /// What the process remembers.
    pub planner: Arc<Planner>,
    /// The period boundary that it has answered last.
    pub answered: Option<u64>,
}

impl PlannerPlace {
    /// Whether this feedback is the first that it sees of its period.
    pub fn asks(&mut self, scan: u64) -> bool {
        let boundary = scan - scan % PERIOD_SCANS;
        if self.answered.is_some_and(|answered| answered >= boundary) {
            return false;
        }
        self.answered = Some(boundary);
        true
    }
}

/// The ports of a planner for one scan.
#[derive(Default)]
pub struct PlannerScan {
    /// The feedback it answers.
    pub feedback: Option<Feedback>,
    /// The window that it has sent.
    pub window: Option<Arc<Window>>,
    /// Its answer.
    pub status: Option<PlannerStatus>,
}

impl PlannerPorts for PlannerScan {
    fn next_feedback(&mut self) -> Option<Feedback> {
        self.feedback.take()
    }

    fn program(&mut self, _load: u32) -> Option<ProgramText> {
        None
    }

    fn publish_window(&mut self, header: &WindowHeader, setpoints: &[Setpoint]) {
        self.window = Some(Arc::new(Window {
            header: *header,
            content: xxh3_64(bytemuck::cast_slice(setpoints)),
            setpoints: setpoints.to_vec(),
        }));
    }

    fn publish_status(&mut self, status: &PlannerStatus) {
        self.status = Some(*status);
    }

    fn answered(&mut self, _scan: u64) {}
}
