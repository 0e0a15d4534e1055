//! The manual controller in one scan: command generation, compensation of lost motion, model, position loop, changeover.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::AxisFeedback;
use control::feed_forward::PeriodState;
use control::follow_up::FollowUpState;
use control::jog_course::JogCourse;
use control::learned_table::LearnedTable;
use machine::PositionFeedback;

use crate::closed_loop::Wanted;
use crate::compensation::{Added, Beside};
use crate::manual::{ManualState, Pace};
use crate::settings::ServoSettings;
use crate::state::ServoState;

/// One scan of the manual controller.
///
/// Its command is a place of the table, as a program's setpoint is. The model and the compensation of lost motion are those of the
/// program's controller, with the same state: what a jog does to friction and gap is known when the program goes on.
#[derive(Debug)]
pub(crate) struct ManualLoop<'a> {
    pub settings: &'a ServoSettings,
    pub state: &'a mut ServoState,
    pub learned: Option<&'a LearnedTable>,
    pub axis: &'a AxisFeedback,
    /// Feedback position, in increments.
    pub position: i64,
    /// How fast it may be.
    pub pace: Pace,
    /// It is to come to rest.
    pub stop: bool,
}

impl ManualLoop<'_> {
    /// The block diagram.
    pub fn scan(mut self) -> Wanted {
        let takes_over = !self.state.manual.drove();
        if takes_over {
            self.begin();
        }
        let moved = self.position.saturating_sub(self.state.program.encoder);
        let manual = &self.settings.manual;
        let course = manual.advance(&mut self.state.manual, self.pace, self.stop);
        let model = self.model(&course);
        let motor_command = course.at(0).saturating_add(self.compensation());
        let error = motor_command.saturating_sub(self.position);
        let feed_forward_mm_s = self.feed_forward(&course);
        let own_mm_s = manual.position_loop(error) + feed_forward_mm_s + model.velocity_mm_s;

        let state = &mut *self.state;
        if takes_over {
            manual.takes_over(&mut state.manual, self.axis.velocity_command_mm_s, own_mm_s);
        }
        let (added_mm_s, jog_done) =
            manual.changes_over(&mut state.manual, &mut state.program, self.position, error);
        self.remember(moved);
        Wanted {
            velocity_mm_s: own_mm_s + added_mm_s,
            torque_nm: model.torque_nm,
            feed_forward_mm_s,
            following_error_mm: error as f64 * self.settings.increment_mm,
            jog_done,
        }
    }

    /// It begins without an error, where the motor stands; from there it is as far to its goal as from the command position.
    fn begin(&mut self) {
        let before = self.compensation();
        self.state
            .rest_at(&self.settings.model, self.learned, self.axis.torque_nm);
        let compensation = self.compensation();
        let mut program = FollowUpState::closed(self.axis.command_position, self.position);
        // With the table on another side of its gap than was thought, the axis is not where it was taken to be.
        program.compensate(compensation.saturating_sub(before));
        let way = self
            .axis
            .jog_target
            .saturating_sub(program.command_position);
        let table = self.position.saturating_sub(compensation);
        self.state.manual = ManualState::at_rest(table, table.saturating_add(way));
        self.state.program = program;
        self.state.model.moved_by_others();
    }

    /// What the motor stands from the table's place to make up for lost motion, in increments; a scale shows the table itself.
    fn compensation(&self) -> i64 {
        match self.settings.feedback {
            PositionFeedback::Motor => {
                let compensation_mm = self.state.backlash.compensation_mm;
                libm::round(compensation_mm / self.settings.increment_mm) as i64
            }
            PositionFeedback::Scale => 0,
        }
    }

    /// What lost motion and the identified model add to the commands. The program's command position stays true to the table.
    fn model(&mut self, course: &JogCourse) -> Added {
        let before = self.compensation();
        let ServoState {
            backlash,
            model,
            manual,
            held_torque_nm,
            ..
        } = &mut *self.state;
        let before_mm = backlash.compensation_mm;
        let ahead = (1..=course.ahead_scans()).map(|ahead| course.at(ahead));
        self.settings
            .backlash
            .update(backlash, course.at(-1), course.at(0), ahead);
        let beside = Beside {
            before_mm,
            step_mm: backlash.compensation_mm,
            torque_nm: *held_torque_nm,
        };
        let added = self
            .settings
            .model
            .update(model, self.axis, self.learned, &beside, |ahead| {
                course.at(ahead)
            });
        backlash.compensation_mm = added.compensation_mm;
        if manual.may_move() {
            let change = self.compensation().saturating_sub(before);
            self.state.program.compensate(change);
        }
        added
    }

    /// Speed of the jog fed forward, in mm/s.
    fn feed_forward(&self, course: &JogCourse) -> f64 {
        if !self.settings.feed_forward_enabled {
            return 0.0;
        }
        let speed_mm_s = self.settings.model.setpoint_mm_s(|ahead| course.at(ahead));
        self.settings.feed_forward.coefficient * speed_mm_s
    }

    fn remember(&mut self, moved: i64) {
        let state = &mut *self.state;
        state.command_position_before = state.program.command_position;
        state.period = PeriodState::at_rest(state.program.command_position);
        state.velocity_mm_s = moved as f64 * (self.settings.increment_mm / self.settings.scan_s);
        state.reversal.cancel();
    }
}
