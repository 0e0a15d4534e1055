//! What is answered to a feedback.

use bus::sample::{AxisCommand, MAX_AXES, PlannerStatus};
use bus::service::ROLES;

/// What was answered in one scan.
#[derive(Debug, Clone, Copy)]
pub struct Answers {
    /// The command of each axis (outer) and role (inner).
    pub commands: [[Option<AxisCommand>; ROLES.len()]; MAX_AXES],
    /// The planner's word, at a period boundary.
    pub planner: Option<PlannerStatus>,
}

impl Answers {
    /// Nothing answered yet.
    pub const NONE: Answers = Answers {
        commands: [[None; ROLES.len()]; MAX_AXES],
        planner: None,
    };

    /// Nothing is answered any more.
    pub fn clear(&mut self) {
        for command in self.commands.iter_mut().flatten() {
            *command = None;
        }
        self.planner = None;
    }
}
