//! The manual controller in one scan: command generation, compensation of lost motion, model, position loop, changeover.

use bus::sample::AxisFeedback;
use loops::feed_forward::PeriodState;
use loops::follow_up::FollowUpState;
use loops::hand_course::HandCommands;
use loops::learned_table::LearnedTable;
use machine::{ErrorTable, PositionFeedback};

use crate::closed_loop::Wanted;
use crate::compensation::{Added, Beside};
use crate::manual::{ManualState, course};
use crate::settings::ServoSettings;
use crate::state::ServoState;

/// One scan of the manual controller.
///
/// Its command is a place of the table, as a program's setpoint is, and it is the program's command position too. The model and the
/// compensation of lost motion are those of the program's controller, with the same state: what a jog does to friction and gap is
/// known when the program goes on.
#[derive(Debug)]
pub(crate) struct ManualLoop<'a> {
    pub settings: &'a ServoSettings,
    pub state: &'a mut ServoState,
    pub learned: Option<&'a LearnedTable>,
    /// Lost motion by place, beside the position backlash.
    pub lost_motion: Option<&'a ErrorTable>,
    pub axis: &'a AxisFeedback,
    /// Feedback position, in increments.
    pub position: i64,
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
        let commands = manual.commands(self.axis);
        let model = self.model(&commands);
        let motor_command = commands.at(0).saturating_add(self.compensation());
        let error = motor_command.saturating_sub(self.position);
        let feed_forward_mm_s = self.feed_forward(&commands);
        let own_mm_s = manual.position_loop(error) + feed_forward_mm_s + model.velocity_mm_s;

        let state = &mut self.state.manual;
        if takes_over {
            let before_mm_s = self.axis.velocity_command_mm_s;
            manual.takes_over(state, error, before_mm_s, own_mm_s);
        }
        let (added_mm_s, hand) = manual.changes_over(state, &course(self.axis), moved, error);
        self.remember(commands.at(0), moved);
        Wanted {
            velocity_mm_s: own_mm_s + added_mm_s,
            torque_nm: model.torque_nm,
            feed_forward_mm_s,
            following_error_mm: error as f64 * self.settings.increment_mm,
            hand,
        }
    }

    /// It begins with the error that the program's controller leaves, and makes it good.
    fn begin(&mut self) {
        self.state
            .rest_at(&self.settings.model, self.learned, self.axis.torque_nm);
        self.state.manual = ManualState::of_hand();
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

    /// What lost motion and the identified model add to the commands.
    fn model(&mut self, commands: &HandCommands) -> Added {
        let ServoState {
            backlash,
            model,
            held_torque_nm,
            ..
        } = &mut *self.state;
        let before_mm = backlash.compensation_mm;
        let ahead = (1..=commands.ahead_scans()).map(|ahead| commands.at(ahead));
        self.settings
            .backlash
            .update(backlash, commands.at(-1), commands.at(0), ahead);
        if let Some(lost_motion) = self.lost_motion {
            let place_mm = commands.at(0) as f64 * self.settings.increment_mm;
            let more_mm = lost_motion.at_mm(place_mm);
            self.settings.backlash.vary(backlash, more_mm);
        }
        let beside = Beside {
            before_mm,
            step_mm: backlash.compensation_mm,
            torque_nm: *held_torque_nm,
        };
        let added = self
            .settings
            .model
            .update(model, self.axis, self.learned, &beside, |ahead| {
                commands.at(ahead)
            });
        backlash.compensation_mm = added.compensation_mm;
        added
    }

    /// Speed of the jog fed forward, in mm/s.
    fn feed_forward(&self, commands: &HandCommands) -> f64 {
        if !self.settings.feed_forward_enabled {
            return 0.0;
        }
        let model = &self.settings.model;
        let speed_mm_s = model.setpoint_mm_s(|ahead| commands.at(ahead));
        self.settings.feed_forward.coefficient * speed_mm_s
    }

    fn remember(&mut self, command: i64, moved: i64) {
        let state = &mut *self.state;
        state.command_position_before = state.program.command_position;
        state.program = FollowUpState::closed(command, self.position);
        state.period = PeriodState::at_rest(command);
        state.velocity_mm_s = moved as f64 * (self.settings.increment_mm / self.settings.scan_s);
        state.reversal.cancel();
    }
}
