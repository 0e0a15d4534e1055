//! The processes that answer: what each remembers, and what is gone when it is killed.

use std::sync::Arc;

use bus::fault_file::FaultScript;
use bus::sample::{AxisCommand, Feedback, Job, PlannerStatus};
use bus::tamper::Tamper;
use planner::Planner;
use servo::Servo;

use crate::queues::{Queue, Window};

/// The place of one servo. The servo itself is kept beside it.
#[derive(Debug)]
pub(crate) struct ServoPlace {
    pub axis: usize,
    pub role: usize,
    pub incarnation: u32,
    pub lives: bool,
    /// It has been stopped: it lives and does nothing.
    pub stopped: bool,
    pub windows: Queue<Arc<Window>>,
    /// Commands of the axis's other servo; none where there is no other.
    pub peer: Option<Queue<AxisCommand>>,
    tamper: Option<Tamper>,
}

impl ServoPlace {
    pub fn new(axis: usize, role: usize, standby: bool, script: Option<&FaultScript>) -> Self {
        ServoPlace {
            axis,
            role,
            incarnation: 1,
            lives: true,
            stopped: false,
            windows: Queue::new(),
            peer: standby.then(Queue::new),
            tamper: script.map(|script| Tamper::new(script, Job::Servo, axis as u32, role as u32)),
        }
    }

    /// Another process in this place.
    pub fn replace(&mut self, script: Option<&FaultScript>) {
        let incarnation = self.incarnation + 1;
        *self = ServoPlace {
            incarnation,
            ..ServoPlace::new(self.axis, self.role, self.peer.is_some(), script)
        };
    }

    /// One scan, as in servo/src/run.rs; what it sends goes to `send`.
    pub fn scan(
        &mut self,
        servo: &mut Servo,
        feedback: &Feedback,
        fired: impl Fn(usize) -> Option<u64>,
        mut send: impl FnMut(&AxisCommand),
    ) -> AxisCommand {
        while let Some(window) = self.windows.next(feedback.scan) {
            // A refusal is reported in the command.
            let _ = servo.offer(&window.header, &window.rows, feedback);
        }
        if let Some(peer) = self.peer.as_mut().and_then(|p| p.newest(feedback.scan)) {
            servo.follow(&peer, feedback);
        }
        let command = servo.scan(feedback);
        match &mut self.tamper {
            None => send(&command),
            Some(tamper) => tamper.command(&command, fired, send),
        }
        command
    }
}

/// The place of the planner.
#[derive(Debug)]
pub(crate) struct PlannerPlace {
    pub planner: Planner,
    pub incarnation: u32,
    pub lives: bool,
    pub stopped: bool,
    tamper: Option<Tamper>,
}

impl PlannerPlace {
    pub fn new(planner: Planner, incarnation: u32, script: Option<&FaultScript>) -> Self {
        PlannerPlace {
            planner,
            incarnation,
            lives: true,
            stopped: false,
            tamper: script.map(|script| Tamper::new(script, Job::Planner, 0, 0)),
        }
    }

    /// A period boundary, as in planner/src/run.rs; the windows it sends come into `sent`.
    pub fn scan(
        &mut self,
        feedback: &Feedback,
        fired: impl Fn(usize) -> Option<u64>,
        sent: &mut Vec<Arc<Window>>,
    ) -> PlannerStatus {
        let decision = self.planner.scan(feedback);
        let planned = decision
            .window
            .as_ref()
            .map(|(header, rows)| (header, *rows));
        let mut send = |header: &bus::sample::WindowHeader, rows: &[bus::sample::WindowRow]| {
            sent.push(Arc::new(Window {
                header: *header,
                rows: rows.to_vec(),
            }));
        };
        match (&mut self.tamper, planned) {
            (Some(tamper), planned) => tamper.window(feedback.scan, planned, fired, send),
            (None, Some((header, rows))) => send(header, rows),
            (None, None) => {}
        }
        decision.status
    }
}
