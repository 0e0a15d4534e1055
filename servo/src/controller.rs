//! The pure servo: windows in, feedback in, command out. No port, no clock, no allocation after construction.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{
    AxisCommand, AxisFeedback, Cause, ControllerState, Driver, Feedback, ManualState, Mode,
    WindowHeader, WindowId, WindowRow,
};
use bytemuck::Zeroable;
use control::backlash::BacklashState;
use control::feed_forward::{FeedForward, MovementCommands};
use control::guards::Broken;
use control::inverse_dynamics::InverseDynamicsState;
use control::learned_table::LearnedTable;
use control::reversal::{Announcement, ReversalState};
use control::trigger::Speeds;
use control::velocity_loop::VelocityLoopState;
use machine::{DriveMode, Machine, PositionFeedback, WithinPeriod};

use crate::compensation::Added;
use crate::even_rows::PeriodEnds;
use crate::held::{HeldWindow, Refusal, check_itself, check_seam};
use crate::manual::{self, PROGRAM};
use crate::settings::{ServoSettings, ServoSettingsError};

/// One axis in one role.
///
/// Each scan: offer the windows that became visible, then [`scan`](Servo::scan) the feedback. All that a command depends
/// on is the feedback, the windows held and the [`ControllerState`] of the command before, so that another servo of the
/// axis can go on from there to the bit.
#[derive(Debug, Clone)]
pub struct Servo {
    settings: ServoSettings,
    role: u32,
    incarnation: u32,
    held: HeldWindow,
    pending: HeldWindow,
    refused: WindowId,
    state: ControllerState,
    learned: Option<Box<LearnedTable>>,
}

impl Servo {
    /// A servo that holds nothing yet; all its memory is allocated here.
    ///
    /// # Errors
    /// The machine has no such axis.
    pub fn new(
        machine: &Machine,
        axis: usize,
        role: u32,
        incarnation: u32,
    ) -> Result<Servo, ServoSettingsError> {
        Ok(Servo {
            settings: ServoSettings::new(machine, axis)?,
            role,
            incarnation,
            held: HeldWindow::none(),
            pending: HeldWindow::none(),
            refused: WindowId::NONE,
            state: ControllerState::zeroed(),
            learned: None,
        })
    }

    /// One that takes this one's place: it remembers nothing but what runs before have taught.
    pub fn replacement(&self, incarnation: u32) -> Servo {
        Servo {
            settings: self.settings,
            role: self.role,
            incarnation,
            held: HeldWindow::none(),
            pending: HeldWindow::none(),
            refused: WindowId::NONE,
            state: ControllerState::zeroed(),
            learned: self.learned.clone(),
        }
    }

    /// Its settings.
    pub fn settings(&self) -> &ServoSettings {
        &self.settings
    }

    /// Goes by what runs before this one have taught; before its first scan.
    pub fn recall(&mut self, learned: LearnedTable) {
        self.learned = Some(Box::new(learned));
    }

    /// The state after the last scan.
    pub fn state(&self) -> &ControllerState {
        &self.state
    }

    /// Goes on from the state another controller of the axis left, before the next scan.
    pub fn adopt(&mut self, state: &ControllerState) {
        self.state = *state;
    }

    /// The axis's other servo has commanded: if its command is the one that acts in this scan, goes on from the state it left.
    /// A servo whose own command acts has that state already.
    pub fn follow(&mut self, peer: &AxisCommand, feedback: &Feedback) {
        let taken = feedback.axes.get(self.settings.axis).is_some_and(|axis| {
            axis.taken_role == peer.role
                && axis.taken_incarnation == peer.incarnation
                && axis.command_scan == peer.scan
        });
        if taken && peer.role != self.role && peer.scan.wrapping_add(1) == feedback.scan {
            self.state = peer.state;
        }
    }

    /// A window became visible in the scan that `feedback` began; before [`scan`](Servo::scan) of the same feedback.
    ///
    /// Accepted, it is pending (reported in the next command) until feedback names or voids it. The window that is being
    /// executed already is taken as it is by a servo that came late. A window it holds already is no news.
    ///
    /// # Errors
    /// Why it is refused; reported in the commands from then on.
    pub fn offer(
        &mut self,
        header: &WindowHeader,
        rows: &[WindowRow],
        feedback: &Feedback,
    ) -> Result<(), Refusal> {
        self.obey(feedback);
        let id = header.id;
        if !id.is_none() && (id == self.held.id() || id == self.pending.id()) {
            return Ok(());
        }
        let judged = check_itself(&self.settings, header, rows).and_then(|()| {
            if id == feedback.window {
                Ok(&mut self.held)
            } else {
                check_seam(
                    &self.settings,
                    &self.held,
                    &self.pending,
                    header,
                    rows,
                    feedback,
                )
                .map(|()| &mut self.pending)
            }
        });
        match judged {
            Ok(place) => {
                place.set(header, rows);
                Ok(())
            }
            Err(refusal) => {
                self.refused = id;
                Err(refusal)
            }
        }
    }

    /// Windows as the feedback says: the pending one takes over, is void, or waits.
    fn obey(&mut self, feedback: &Feedback) {
        if !self.pending.is_none() {
            let id = self.pending.id();
            if feedback.window == id {
                core::mem::swap(&mut self.held, &mut self.pending);
                self.pending.clear();
            } else {
                let header = self.pending.header();
                let missed = feedback.scan >= header.first_scan;
                let orphaned = header.predecessor != feedback.window;
                if feedback.voided == id || missed || orphaned {
                    self.pending.clear();
                }
            }
        }
        if feedback.window.is_none() {
            self.held.clear();
        }
    }

    /// One scan: the command that answers this feedback.
    ///
    /// 1. judge the feedback;
    /// 2. obey it as to windows;
    /// 3. with the drives off or tripped, follow the axis;
    /// 4. otherwise position command, following error, reversal, feed-forward, velocity command, limits, or the manual
    ///    controller's;
    /// 5. in torque mode, the velocity loop.
    ///
    /// A cause stops the axis and is held until the drives are off or tripped.
    pub fn scan(&mut self, feedback: &Feedback) -> AxisCommand {
        let mut command = self.blank(feedback);
        let (mode, axis) = match self.judge(feedback) {
            Ok(judged) => judged,
            Err(cause) => return self.stop(command, cause),
        };
        self.obey(feedback);
        let late = self.held.is_none() && !feedback.window.is_none();
        if late && feedback.at_rest == 1 && self.state.initialised != 0 {
            self.held.stand(feedback);
        }
        command.held = self.held.id();
        command.pending = self.pending.id();
        let missing = !feedback.window.is_none() && self.held.id() != feedback.window;
        if self.state.initialised == 0 {
            self.initialise(feedback, &axis);
        }
        let scan_before = self.state.scan;
        self.state.scan = feedback.scan;
        if matches!(mode, Mode::Disabled | Mode::Tripped) {
            self.follow_up(mode, &axis);
            return self.finish(command);
        }
        let driver = Driver::from_wire(axis.driver);
        let Some(driver) = driver.filter(|d| *d == Driver::Program || feedback.window.is_none())
        else {
            return self.stop(command, Cause::BadFeedback);
        };
        if missing {
            return self.stop(command, Cause::WindowMissing);
        }
        if !self.held.is_none() && !self.held.has_row(feedback.row) {
            return self.stop(command, Cause::BadFeedback);
        }
        command.tag = if self.held.is_none() {
            feedback.tag
        } else {
            self.held.tag(feedback.row)
        };
        command.stop_deceleration_mm_s2 = self
            .held
            .stop_deceleration_mm_s2(&self.settings, feedback.row);
        if driver == Driver::Program {
            self.closed(feedback, &axis, scan_before, command)
        } else {
            self.by_hand(&axis, driver == Driver::ManualStop, command)
        }
    }

    /// Mode and axis of a feedback that makes sense.
    fn judge(&self, feedback: &Feedback) -> Result<(Mode, AxisFeedback), Cause> {
        let mode = Mode::from_wire(feedback.mode).ok_or(Cause::BadFeedback)?;
        let forward = self.state.initialised == 0 || feedback.scan > self.state.scan;
        let whole = feedback.axis_count as usize == self.settings.axis_count;
        let axis = feedback
            .axes
            .get(self.settings.axis)
            .filter(|_| forward && whole && feedback.visible_from <= feedback.scan)
            .ok_or(Cause::BadFeedback)?;
        let finite = axis.velocity_mm_s.is_finite()
            && axis.velocity_command_mm_s.is_finite()
            && axis.torque_nm.is_finite();
        if finite {
            Ok((mode, *axis))
        } else {
            Err(Cause::BadValue)
        }
    }

    fn position(&self, axis: &AxisFeedback) -> i64 {
        match self.settings.feedback {
            PositionFeedback::Motor => axis.motor_position,
            PositionFeedback::Scale => axis.scale_position,
        }
    }

    /// The position command `ahead` scans from this one.
    fn command_at(&self, feedback: &Feedback, axis: &AxisFeedback, ahead: i64) -> i64 {
        if self.held.is_none() {
            return axis.command_register;
        }
        let row = i64::from(feedback.row) + ahead;
        match self.settings.within_period {
            WithinPeriod::Exact => self.held.position(self.settings.axis, row),
            WithinPeriod::Linear => self.even_row(feedback, row, ahead),
        }
    }

    /// A row of the period's even split: the windows stay exact, only what this servo makes of them is split.
    ///
    /// The period in which the window ends is not split: the machine counts as at rest from its last row on.
    fn even_row(&self, feedback: &Feedback, row: i64, ahead: i64) -> i64 {
        let axis = self.settings.axis;
        let period = self.settings.scans_per_period;
        let scan = i64::try_from(feedback.scan).unwrap_or(i64::MAX);
        let scan_in_period = scan.saturating_add(ahead).rem_euclid(period.into());
        let before = row - scan_in_period - 1;
        let last = before + i64::from(period);
        if self.held.ends_by(last) {
            return self.held.position(axis, row);
        }
        // The window begins with this period: its predecessor's last row is what was commanded.
        let from_predecessor = before < 0 && ahead >= 0 && self.state.initialised != 0;
        let ends = PeriodEnds {
            before: if from_predecessor {
                self.state.period_start
            } else {
                self.held.position(axis, before)
            },
            last: self.held.position(axis, last),
        };
        ends.split(u32::try_from(scan_in_period).unwrap_or(0), period)
    }

    /// First feedback: as if the axis had been commanded along the window until now, or had stood.
    fn initialise(&mut self, feedback: &Feedback, axis: &AxisFeedback) {
        let phase = self.phase(feedback.scan);
        let at = |ahead: i64| self.command_at(feedback, axis, ahead);
        let period = i64::from(self.settings.scans_per_period);
        let start = -1 - i64::from(phase);
        self.state = ControllerState {
            command_position: at(-1),
            command_position_before: at(-2),
            feedback_position: self.position(axis),
            period_start: at(start),
            period_start_before: at(start - period),
            velocity_mm_s: axis.velocity_mm_s,
            motor_position: axis.motor_position,
            // This scan: no period boundary is seen to pass.
            scan: feedback.scan,
            cause: self.state.cause,
            initialised: 1,
            // Whoever comes late takes over what is being commanded; there is no switch.
            manual: ManualState {
                drove: PROGRAM,
                ..ManualState::zeroed()
            },
            ..ControllerState::zeroed()
        };
    }

    /// Place of a scan in its distribution period, from 0.
    fn phase(&self, scan: u64) -> u32 {
        let period = u64::from(self.settings.scans_per_period.max(1));
        u32::try_from(scan % period).unwrap_or(0)
    }

    /// Open loop: the register follows the axis (docs/methods/follow-up.md).
    ///
    /// With the drives switched off at rest, direction and backlash compensation stay true with it. After a trip, or
    /// where the master's register says otherwise, closing it starts from a clean state where that register is.
    fn follow_up(&mut self, mode: Mode, axis: &AxisFeedback) {
        let position = self.position(axis);
        let register = manual::follow_up(&mut self.state, position);
        let kept = if mode == Mode::Disabled && register == axis.command_register {
            ControllerState {
                direction: self.state.direction,
                backlash_mm: self.state.backlash_mm,
                inverse_dynamics: {
                    let mut values = self.state.inverse_dynamics;
                    InverseDynamicsState::leave(&mut values);
                    values
                },
                manual: self.state.manual,
                ..ControllerState::zeroed()
            }
        } else {
            let mut manual = ManualState::zeroed();
            manual.steady_deviation = axis.command_register.saturating_sub(position);
            ControllerState {
                manual,
                ..ControllerState::zeroed()
            }
        };
        self.state = ControllerState {
            command_position: axis.command_register,
            command_position_before: axis.command_register,
            feedback_position: position,
            period_start: axis.command_register,
            period_start_before: axis.command_register,
            velocity_mm_s: axis.velocity_mm_s,
            motor_position: axis.motor_position,
            scan: self.state.scan,
            kicks: self.state.kicks,
            initialised: 1,
            ..kept
        };
    }

    /// The second controller drives the axis (docs/methods/two-controllers.md).
    fn by_hand(
        &mut self,
        axis: &AxisFeedback,
        stop: bool,
        mut command: AxisCommand,
    ) -> AxisCommand {
        let settings = self.settings;
        let position = self.position(axis);
        let speed_per_increment = settings.increment_mm / settings.scan_s;
        let measured_mm_s =
            position.saturating_sub(self.state.feedback_position) as f64 * speed_per_increment;
        let output = settings
            .manual
            .update(&mut self.state, axis, position, stop);
        let register = self.state.command_position;
        self.state.command_position_before = register;
        self.state.period_start = register;
        self.state.period_start_before = register;
        self.state.velocity_mm_s = measured_mm_s;
        self.state.armed = 0;
        self.state.kick_mm_s = 0.0;
        self.state.kick_remaining_scans = 0;
        command.jog_done = u32::from(output.done);
        command.following_error_mm = output.error as f64 * settings.increment_mm;
        // The model does not know where this motion goes: its torque stays, and goes on from there.
        InverseDynamicsState::leave(&mut self.state.inverse_dynamics);
        self.state.motor_position = axis.motor_position;
        let [torque_nm, _] = self.state.torque_feed_forward_nm;
        self.state.torque_feed_forward_nm = [torque_nm; 2];
        self.drive(
            axis,
            register,
            position,
            output.velocity_mm_s,
            torque_nm,
            command,
        )
    }

    /// Closed loop: the block diagram of the servo.
    fn closed(
        &mut self,
        feedback: &Feedback,
        axis: &AxisFeedback,
        scan_before: u64,
        mut command: AxisCommand,
    ) -> AxisCommand {
        let settings = self.settings;
        let phase = self.phase(feedback.scan);
        if self.state.manual.drove != PROGRAM {
            // The register came from elsewhere: where it is, is no motion.
            let register = self.command_at(feedback, axis, 0);
            self.state.command_position = register;
            self.state.command_position_before = register;
        }
        let boundary = self.step_period(feedback, axis, scan_before);
        let position_command = self.command_at(feedback, axis, 0);
        let position = self.position(axis);
        if self.held.is_none() {
            // No window, no future: nothing is fed forward and no kick waits for a reversal that will not come.
            self.state.armed = 0;
            self.state.period_start = axis.command_register;
            self.state.period_start_before = axis.command_register;
        }
        let movement = MovementCommands::gather(
            self.state.period_start_before,
            self.state.period_start,
            phase,
            settings.scans_per_period,
            settings.look_ahead_periods,
            |ahead| self.command_at(feedback, axis, ahead),
        );
        let speed_per_increment = settings.increment_mm / settings.scan_s;

        let before_mm = self.state.backlash_mm;
        let (compensation_mm, reversed) = self.backlash(feedback, axis, position_command);
        let model = self.model(feedback, axis, before_mm, compensation_mm);
        let error = position_command.saturating_sub(position) as f64 * settings.increment_mm;
        let ahead_mm = self.error_ahead_mm(feedback, axis, scan_before, position);
        let proportional_mm_s = settings.position_gain_per_s
            * (self.position_error_mm(axis, position_command, model.compensation_mm) + ahead_mm);
        let period_speed_mm_s =
            settings.feed_forward.increments_per_scan(&movement, phase) * speed_per_increment;
        let feed_forward_mm_s = model
            .row_speed_mm_s
            .filter(|_| settings.feed_forward_enabled)
            .map_or(period_speed_mm_s, |speed_mm_s| {
                settings.feed_forward.coefficient * speed_mm_s
            });
        // What the reversal is judged by: the speed of the rows themselves (their smoothed speed is centred one scan back),
        // or of the position loop where nothing is fed forward and the axis lags by 1/Kp.
        let speed_mm_s = if settings.feed_forward_enabled {
            let rows = FeedForward {
                coefficient: 1.0,
                advance_scans: 1.0,
                ..settings.feed_forward
            };
            rows.increments_per_scan(&movement, phase) * speed_per_increment
        } else {
            proportional_mm_s
        };
        let speeds = Speeds {
            command_mm_s: speed_mm_s,
            fed_command_mm_s: settings.feed_forward.coefficient * speed_mm_s,
            feed_forward_mm_s,
            proportional_mm_s,
        };
        let kick_mm_s = self.kick(&movement, boundary, reversed, &speeds);
        let own_mm_s = proportional_mm_s + feed_forward_mm_s + kick_mm_s + model.velocity_mm_s;
        let velocity_mm_s =
            settings
                .manual
                .program_drives(&mut self.state, axis.velocity_command_mm_s, own_mm_s);

        let measured_mm_s =
            position.saturating_sub(self.state.feedback_position) as f64 * speed_per_increment;
        self.state.command_position_before = self.state.command_position;
        self.state.command_position = position_command;
        self.state.feedback_position = position;
        self.state.velocity_mm_s = measured_mm_s;
        command.following_error_mm = error;
        command.feed_forward_mm_s = feed_forward_mm_s;
        self.drive(
            axis,
            position_command,
            position,
            velocity_mm_s,
            model.torque_nm,
            command,
        )
    }

    /// Guards, then the velocity command for the drive or, in torque mode, through the velocity loop the torque.
    fn drive(
        &mut self,
        axis: &AxisFeedback,
        position_command: i64,
        position: i64,
        velocity_mm_s: f64,
        torque_nm: f64,
        mut command: AxisCommand,
    ) -> AxisCommand {
        let settings = self.settings;
        let measured_mm_s = self.state.velocity_mm_s;
        let guards = &settings.guards;
        let broken = guards
            .following_error(command.following_error_mm)
            .or(guards.positions(position_command, position))
            .or(guards.speed(velocity_mm_s));
        if let Some(broken) = broken {
            return self.stop(command, cause(broken));
        }
        if self.state.cause != Cause::None as u32 {
            // Held until the master has taken notice.
            return self.silence(command);
        }
        let limited = match settings.drive_mode {
            DriveMode::Velocity => {
                command.velocity_mm_s = velocity_mm_s;
                command.torque_nm = torque_nm;
                axis.torque_limited != 0
            }
            DriveMode::Torque => {
                let mut inner = VelocityLoopState {
                    integrator_nm: self.state.integrator_nm,
                };
                let torque =
                    settings
                        .velocity_loop
                        .update(&mut inner, velocity_mm_s, measured_mm_s);
                if !torque.torque_nm.is_finite() {
                    return self.stop(command, Cause::BadValue);
                }
                self.state.integrator_nm = inner.integrator_nm;
                command.velocity_mm_s = velocity_mm_s;
                command.torque_nm = torque.torque_nm + torque_nm;
                torque.limited
            }
        };
        self.state.torque_limited_scans = if limited {
            self.state.torque_limited_scans.saturating_add(1)
        } else {
            0
        };
        if self.state.torque_limited_scans > settings.torque_limited_scans_max {
            return self.stop(command, Cause::TorqueLimit);
        }
        self.finish(command)
    }

    /// Steps the registers of the distribution period; true in the first scan of one. Goes by scan numbers; where some
    /// were skipped, the rows of the window say what was commanded.
    fn step_period(&mut self, feedback: &Feedback, axis: &AxisFeedback, scan_before: u64) -> bool {
        let phase = self.phase(feedback.scan);
        if feedback.scan.saturating_sub(scan_before) <= u64::from(phase) {
            return false;
        }
        if feedback.scan == scan_before.wrapping_add(1) {
            self.state.period_start_before = self.state.period_start;
            self.state.period_start = self.state.command_position;
        } else {
            let start = -1 - i64::from(phase);
            let period = i64::from(self.settings.scans_per_period);
            self.state.period_start = self.command_at(feedback, axis, start);
            self.state.period_start_before = self.command_at(feedback, axis, start - period);
        }
        true
    }

    /// What the prediction of the feedback adds to the position error: the command as far ahead, less the feedback's share.
    fn error_ahead_mm(
        &self,
        feedback: &Feedback,
        axis: &AxisFeedback,
        scan_before: u64,
        position: i64,
    ) -> f64 {
        let settings = &self.settings;
        let scans = feedback.scan.saturating_sub(scan_before).max(1) as f64;
        let difference = position.saturating_sub(self.state.feedback_position) as f64 / scans;
        let command = settings
            .prediction
            .command_ahead(|ahead| self.command_at(feedback, axis, ahead));
        (command - settings.prediction.added(difference)) * settings.increment_mm
    }

    fn backlash(
        &mut self,
        feedback: &Feedback,
        axis: &AxisFeedback,
        position_command: i64,
    ) -> (f64, bool) {
        let settings = &self.settings;
        let mut side = BacklashState {
            direction: self.state.direction,
            compensation_mm: self.state.backlash_mm,
        };
        let rows = settings.scans_per_period as i64 * settings.look_ahead_periods as i64;
        let ahead = (1..=rows).map(|i| self.command_at(feedback, axis, i));
        let reversed = settings.backlash.update(
            &mut side,
            self.state.command_position,
            position_command,
            ahead,
        );
        self.state.direction = side.direction;
        self.state.backlash_mm = side.compensation_mm;
        (side.compensation_mm, reversed)
    }

    fn kick(
        &mut self,
        movement: &MovementCommands,
        boundary: bool,
        reversed: bool,
        speeds: &Speeds,
    ) -> f64 {
        let block = &self.settings.kick;
        let mut reversal = ReversalState {
            announcement: match self.state.armed {
                1 => Announcement::Ahead,
                2 => Announcement::Answered,
                3 => Announcement::Overdue,
                _ => Announcement::None,
            },
            trigger_speed_mm_s: self.state.trigger_speed_mm_s,
            kick_mm_s: self.state.kick_mm_s,
            kick_remaining_scans: self.state.kick_remaining_scans,
            kick_direction: self.state.kick_direction,
            kick_trigger_mm_s: self.state.kick_trigger_mm_s,
            kick_distance_mm: self.state.kick_distance_mm,
            kicks: self.state.kicks,
        };
        if reversed {
            block.reversed(&mut reversal);
        }
        if boundary {
            block.announce(&mut reversal, self.state.direction, movement);
        }
        let kick_mm_s = block.update(&mut reversal, self.state.direction, speeds);
        self.state.armed = match reversal.announcement {
            Announcement::None => 0,
            Announcement::Ahead => 1,
            Announcement::Answered => 2,
            Announcement::Overdue => 3,
        };
        self.state.trigger_speed_mm_s = reversal.trigger_speed_mm_s;
        self.state.kick_mm_s = reversal.kick_mm_s;
        self.state.kick_remaining_scans = reversal.kick_remaining_scans;
        self.state.kick_direction = reversal.kick_direction;
        self.state.kick_trigger_mm_s = reversal.kick_trigger_mm_s;
        self.state.kick_distance_mm = reversal.kick_distance_mm;
        self.state.kicks = reversal.kicks;
        kick_mm_s
    }

    /// What the identified model adds to the commands.
    fn model(
        &mut self,
        feedback: &Feedback,
        axis: &AxisFeedback,
        before_mm: f64,
        step_mm: f64,
    ) -> Added {
        let mut state = self.state;
        let added = self.settings.model.update(
            &mut state,
            axis,
            self.learned.as_deref(),
            [before_mm, step_mm],
            |scans| match scans {
                0.. => self.command_at(feedback, axis, scans),
                -1 => self.state.command_position,
                _ => self.state.command_position_before,
            },
        );
        state.backlash_mm = added.compensation_mm;
        self.state = state;
        added
    }

    /// Position error of the loop, in mm: at the motor with its compensation, and with a scale corrected by what the
    /// scale says, at once or smoothly where `dual_feedback_ms` is set.
    fn position_error_mm(
        &mut self,
        axis: &AxisFeedback,
        position_command: i64,
        compensation_mm: f64,
    ) -> f64 {
        let settings = &self.settings;
        let off_mm = |position: i64| {
            position_command.saturating_sub(position) as f64 * settings.increment_mm
        };
        let motor_mm = off_mm(axis.motor_position) + compensation_mm;
        match settings.feedback {
            PositionFeedback::Motor => motor_mm,
            PositionFeedback::Scale => {
                let missing_mm = off_mm(axis.scale_position) - motor_mm;
                let correction_mm = &mut self.state.scale_correction_mm;
                *correction_mm += settings.scale_share * (missing_mm - *correction_mm);
                motor_mm + *correction_mm
            }
        }
    }

    fn blank(&self, feedback: &Feedback) -> AxisCommand {
        AxisCommand {
            scan: feedback.scan,
            visible_from: feedback.scan.saturating_add(1),
            position: self.state.command_position,
            stop_deceleration_mm_s2: self
                .settings
                .quick_stop_mm_s2
                .get(self.settings.axis)
                .copied()
                .unwrap_or(0.0),
            held: self.held.id(),
            pending: self.pending.id(),
            axis: self.settings.axis as u32,
            role: self.role,
            incarnation: self.incarnation,
            drive_mode: match self.settings.drive_mode {
                DriveMode::Velocity => 0,
                DriveMode::Torque => 1,
            },
            ..AxisCommand::zeroed()
        }
    }

    /// Drives nothing and says why; the first cause is held.
    fn stop(&mut self, command: AxisCommand, cause: Cause) -> AxisCommand {
        if self.state.cause == Cause::None as u32 {
            self.state.cause = cause as u32;
        }
        self.silence(command)
    }

    fn silence(&mut self, mut command: AxisCommand) -> AxisCommand {
        command.velocity_mm_s = 0.0;
        command.torque_nm = 0.0;
        self.state.integrator_nm = 0.0;
        if !command.following_error_mm.is_finite() {
            command.following_error_mm = 0.0;
        }
        if !command.feed_forward_mm_s.is_finite() {
            command.feed_forward_mm_s = 0.0;
        }
        self.finish(command)
    }

    fn finish(&self, mut command: AxisCommand) -> AxisCommand {
        command.position = self.state.command_position;
        command.refused = self.refused;
        command.cause = self.state.cause;
        command.state = self.state;
        command
    }
}

fn cause(broken: Broken) -> Cause {
    match broken {
        Broken::Travel => Cause::SoftLimit,
        Broken::FollowingError => Cause::FollowingError,
        Broken::Speed => Cause::SpeedLimit,
        Broken::NotFinite => Cause::BadValue,
    }
}
