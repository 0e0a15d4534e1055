//! The program's controller in one scan: position loop, feed-forward, reversal compensation, model.

use bus::sample::{AxisFeedback, Hand};
use loops::feed_forward::{FeedForward, MovementCommands, PeriodState};
use loops::follow_up::FollowUpState;
use loops::learned_table::LearnedTable;
use loops::path_correction::PathCorrection;
use loops::trigger::Speeds;
use machine::{ErrorTable, PositionFeedback};

use crate::compensation::{Added, Beside};
use crate::path_correction;
use crate::setpoints::Setpoints;
use crate::settings::ServoSettings;
use crate::state::ServoState;

/// Way within the look-ahead from which on an axis that has rested starts, in mm.
const STARTING_MM: f64 = 1e-3;

/// What is wanted of an axis in one scan, before the guards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wanted {
    /// Velocity command, in mm/s.
    pub velocity_mm_s: f64,
    /// Torque fed forward, in N·m.
    pub torque_nm: f64,
    /// Feed-forward part of the velocity command, in mm/s.
    pub feed_forward_mm_s: f64,
    /// Command minus feedback, compensation not counted, in mm.
    pub following_error_mm: f64,
    /// State of the manual controller.
    pub hand: Hand,
}

/// One scan of the program's controller.
#[derive(Debug)]
pub(crate) struct ClosedLoop<'a> {
    pub settings: &'a ServoSettings,
    pub state: &'a mut ServoState,
    pub learned: Option<&'a LearnedTable>,
    pub path: Option<&'a PathCorrection>,
    /// Lost motion by place, beside the position backlash.
    pub lost_motion: Option<&'a ErrorTable>,
    pub setpoints: Setpoints<'a>,
    pub axis: &'a AxisFeedback,
    /// Feedback position, in increments.
    pub position: i64,
    /// Scans since the one that the state was left in, at least 1 but in the first.
    pub scans_passed: u64,
}

impl ClosedLoop<'_> {
    /// The block diagram.
    pub fn scan(mut self) -> Wanted {
        self.catch_up();
        self.take_over();
        let period_begins = self.step_period();
        let setpoint = self.setpoints.at(0);
        let movement = self.movement();

        self.rest();
        let compensated_before_mm = self.state.backlash.compensation_mm;
        let reversed = self.backlash(setpoint);
        let model = self.model(compensated_before_mm);
        let path = path_correction::added(self.settings, self.path, &self.setpoints);
        let proportional_mm_s =
            self.position_loop(setpoint, model.compensation_mm, path.position_mm);
        let feed_forward_mm_s = self.feed_forward(&movement, &model);
        let speeds = self.speeds(&movement, proportional_mm_s, feed_forward_mm_s);
        let pulse_mm_s = self.friction_pulse(&movement, period_begins, reversed, &speeds);
        let own_mm_s = proportional_mm_s
            + feed_forward_mm_s
            + pulse_mm_s
            + model.velocity_mm_s
            + path.velocity_mm_s;
        let velocity_mm_s = self.settings.manual.program_drives(
            &mut self.state.manual,
            self.axis.velocity_command_mm_s,
            own_mm_s,
        );

        self.remember(setpoint);
        Wanted {
            velocity_mm_s,
            torque_nm: model.torque_nm + path.torque_nm,
            feed_forward_mm_s,
            following_error_mm: self.mm(setpoint.saturating_sub(self.position)),
            hand: Hand::Off,
        }
    }

    fn mm(&self, increments: i64) -> f64 {
        increments as f64 * self.settings.increment_mm
    }

    /// In scans that this servo has not seen the axis was commanded along the windows, and is taken to have moved so.
    fn catch_up(&mut self) {
        if self.scans_passed <= 1 || !self.setpoints.has_window() {
            return;
        }
        let [before, last] = [-2, -1].map(|scans| self.setpoints.at(scans));
        let unseen = last.saturating_sub(self.state.program.command_position);
        let motor_position = &mut self.state.model.motor_position;
        *motor_position = motor_position.saturating_add(unseen);
        self.state.program.command_position = last;
        self.state.command_position_before = before;
    }

    /// Where another controller drove, the command position came from elsewhere: where it is, is no motion.
    fn take_over(&mut self) {
        if !self.state.manual.program_drove() {
            let command_position = self.setpoints.at(0);
            self.state.program.command_position = command_position;
            self.state.command_position_before = command_position;
            self.state.model.moved_by_others();
        }
    }

    /// Steps the interpolation period; true in the first scan of one. Goes by scan numbers; where some were skipped, the
    /// setpoints of the window, and of the one before it, say what was commanded.
    fn step_period(&mut self) -> bool {
        let scan_in_period = self.setpoints.scan_in_period();
        let begins = self.scans_passed > u64::from(scan_in_period);
        if begins {
            let start = -1 - i64::from(scan_in_period);
            let length = self.settings.scans_per_period;
            let passed = self.scans_passed;
            if passed > u64::from(scan_in_period) + u64::from(length) {
                self.state.period.start = self.setpoints.at(start - i64::from(length));
            }
            self.state.period.step(match passed {
                1 => self.state.program.command_position,
                _ => self.setpoints.at(start),
            });
        }
        self.setpoints = self.setpoints.after(self.state.period.start);
        begins
    }

    fn movement(&mut self) -> MovementCommands {
        if !self.setpoints.has_window() {
            // No window, no future: nothing is fed forward and no pulse waits for a reversal that will not come.
            self.state.reversal.disarm();
            self.state.period = PeriodState::at_rest(self.axis.command_position);
        }
        MovementCommands::gather(
            self.state.period.start_before,
            self.state.period.start,
            self.setpoints.scan_in_period(),
            self.settings.scans_per_period,
            self.settings.look_ahead_periods,
            |ahead| self.setpoints.at(ahead),
        )
    }

    /// Whether the command reverses in this scan; lost motion is then compensated on the other side.
    fn backlash(&mut self, setpoint: i64) -> bool {
        let known = self.settings.scans_per_period as i64 * self.settings.look_ahead_periods as i64;
        let ahead = (1..=known).map(|i| self.setpoints.at(i));
        let (backlash, state) = (&self.settings.backlash, &mut self.state.backlash);
        let before = self.state.program.command_position;
        let reversed = backlash.update(state, before, setpoint, ahead);
        if let Some(lost_motion) = self.lost_motion {
            let place_mm = setpoint as f64 * self.settings.increment_mm;
            backlash.vary(state, lost_motion.at_mm(place_mm));
        }
        reversed
    }

    /// Before the program moves an axis that it had left at rest, the model goes by the torque that holds it: after a stop the loop
    /// lets go of springs that the model still has wound up. The torque itself does not change.
    fn rest(&mut self) {
        let Some(resting_scans) = self.settings.model.resting_scans() else {
            return;
        };
        let here = self.setpoints.at(0);
        let ahead = i64::from(self.settings.model.ahead_scans());
        let rested = self.state.resting_scans >= resting_scans;
        // A command that creeps stands still for as long, time and again.
        let starts =
            rested && self.mm(self.setpoints.at(ahead).saturating_sub(here)).abs() > STARTING_MM;
        if starts {
            self.state
                .rest_at(&self.settings.model, self.learned, self.axis.torque_nm);
        }
        let moves = self.state.program.command_position != here;
        let will_move = || (1..=ahead).any(|scans| self.setpoints.at(scans) != here);
        // It counts no further than matters: an axis at rest is in one state.
        if moves || starts {
            self.state.resting_scans = 0;
        } else if !rested && !will_move() {
            self.state.resting_scans += 1;
        }
    }

    /// What the identified model adds to the commands.
    fn model(&mut self, compensated_before_mm: f64) -> Added {
        let ServoState {
            program,
            command_position_before,
            backlash,
            model,
            held_torque_nm,
            ..
        } = &mut *self.state;
        let beside = Beside {
            before_mm: compensated_before_mm,
            step_mm: backlash.compensation_mm,
            torque_nm: *held_torque_nm,
        };
        let added =
            self.settings.model.update(
                model,
                self.axis,
                self.learned,
                &beside,
                |scans| match scans {
                    0.. => self.setpoints.at(scans),
                    -1 => program.command_position,
                    _ => *command_position_before,
                },
            );
        backlash.compensation_mm = added.compensation_mm;
        added
    }

    /// `Kp·ε`, in mm/s; `path_mm`: what the command is corrected by along the path.
    fn position_loop(&mut self, setpoint: i64, compensation_mm: f64, path_mm: f64) -> f64 {
        let motor_mm =
            self.mm(setpoint.saturating_sub(self.axis.motor_position)) + compensation_mm + path_mm;
        let error_mm = match self.settings.feedback {
            PositionFeedback::Motor => motor_mm,
            PositionFeedback::Scale => {
                let scale_mm = self.mm(setpoint.saturating_sub(self.axis.scale_position)) + path_mm;
                self.settings.dual_feedback.update(
                    &mut self.state.dual_feedback,
                    motor_mm,
                    scale_mm,
                )
            }
        };
        self.settings.position_gain_per_s * (error_mm + self.error_ahead_mm())
    }

    /// What the prediction of the feedback adds to the position error: the command as far ahead, less the feedback's share.
    fn error_ahead_mm(&self) -> f64 {
        let prediction = &self.settings.prediction;
        let scans = self.scans_passed.max(1) as f64;
        let moved = self.position.saturating_sub(self.state.program.encoder);
        let command = prediction.command_ahead(|ahead| self.setpoints.at(ahead));
        (command - prediction.added(moved as f64 / scans)) * self.settings.increment_mm
    }

    /// Speed fed forward, in mm/s: of the setpoints where their acceleration is fed forward as torque, else smoothed over a
    /// period.
    fn feed_forward(&self, movement: &MovementCommands, model: &Added) -> f64 {
        let forward = &self.settings.feed_forward;
        let period_mm_s = self.mm_s(forward, movement);
        model
            .setpoint_mm_s
            .filter(|_| self.settings.feed_forward_enabled)
            .map_or(period_mm_s, |speed_mm_s| forward.coefficient * speed_mm_s)
    }

    fn mm_s(&self, forward: &FeedForward, movement: &MovementCommands) -> f64 {
        forward.increments_per_scan(movement, self.setpoints.scan_in_period())
            * self.speed_per_increment_mm_s()
    }

    fn speed_per_increment_mm_s(&self) -> f64 {
        self.settings.increment_mm / self.settings.scan_s
    }

    /// What the reversal is judged by: the speed of the setpoints themselves (their smoothed speed is centred one scan back),
    /// or of the position loop where nothing is fed forward and the axis lags by 1/Kp.
    fn speeds(
        &self,
        movement: &MovementCommands,
        proportional_mm_s: f64,
        feed_forward_mm_s: f64,
    ) -> Speeds {
        let forward = &self.settings.feed_forward;
        let command_mm_s = if self.settings.feed_forward_enabled {
            let setpoints = FeedForward {
                coefficient: 1.0,
                advance_scans: 1.0,
                ..*forward
            };
            self.mm_s(&setpoints, movement)
        } else {
            proportional_mm_s
        };
        Speeds {
            command_mm_s,
            fed_command_mm_s: forward.coefficient * command_mm_s,
            feed_forward_mm_s,
            proportional_mm_s,
        }
    }

    fn friction_pulse(
        &mut self,
        movement: &MovementCommands,
        period_begins: bool,
        reversed: bool,
        speeds: &Speeds,
    ) -> f64 {
        let block = &self.settings.pulse;
        let direction = self.state.backlash.direction;
        let state = &mut self.state.reversal;
        if reversed {
            block.reversed(state);
        }
        if period_begins {
            block.announce(state, direction, movement);
        }
        block.update(state, direction, speeds)
    }

    fn remember(&mut self, setpoint: i64) {
        let moved = self.position.saturating_sub(self.state.program.encoder);
        let scans = self.scans_passed.max(1) as f64;
        self.state.velocity_mm_s = moved as f64 / scans * self.speed_per_increment_mm_s();
        self.state.command_position_before = self.state.program.command_position;
        self.state.program = FollowUpState::closed(setpoint, self.position);
    }
}
