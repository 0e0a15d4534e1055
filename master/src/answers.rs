//! What is answered to a feedback.

use bus::sample::{AxisCommand, LogicAnswer, PlannerStatus};
use bus::service::ROLES;

/// What was answered in one scan.
#[derive(Debug, Clone)]
pub struct Answers {
    /// The command of each axis (outer) and role (inner).
    pub commands: Vec<[Option<AxisCommand>; ROLES.len()]>,
    /// The planner's word, at a period boundary.
    pub planner: Option<PlannerStatus>,
    /// What the logic has said last.
    pub logic: Option<LogicAnswer>,
}

impl Answers {
    /// Nothing answered, and no room for any command.
    pub const NONE: Answers = Answers {
        commands: Vec::new(),
        planner: None,
        logic: None,
    };

    /// Nothing answered yet, with room for the commands of so many axes.
    pub fn of_axes(axes: usize) -> Answers {
        Answers {
            commands: vec![[None; ROLES.len()]; axes],
            planner: None,
            logic: None,
        }
    }

    /// Nothing is answered any more.
    pub fn clear(&mut self) {
        for command in self.commands.iter_mut().flatten() {
            *command = None;
        }
        self.planner = None;
        self.logic = None;
    }
}
