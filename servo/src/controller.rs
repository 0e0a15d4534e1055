//! The pure servo: windows in, feedback in, command out. No port, no clock, no allocation after construction.
use std::sync::Arc;

use bus::sample::{
    AxisCommand, AxisFeedback, Cause, Driver, Feedback, Mode, Reference, STATE_EVERY_SCANS,
    Setpoint, WindowHeader,
};
use bytemuck::Zeroable;
use loops::feed_forward::PeriodState;
use loops::follow_up::FollowUpState;
use loops::guards::Broken;
use loops::learned_table::LearnedTable;
use loops::path_correction::PathCorrection;
use machine::{DriveMode, ErrorTable, Machine, PositionFeedback};

use crate::closed_loop::{ClosedLoop, Wanted};
use crate::held::Refusal;
use crate::manual::{self, ManualState};
use crate::manual_loop::ManualLoop;
use crate::setpoints::Setpoints;
use crate::settings::{ServoSettings, ServoSettingsError};
use crate::state::ServoState;
use crate::windows::Windows;

/// One axis in one role.
///
/// Each scan: offer the windows that became visible, then [`scan`](Servo::scan) the feedback. All that a command depends
/// on is the feedback, the windows held and the [`ServoState`] that the command before carried, so that another servo of the
/// axis can go on from there to the bit.
#[derive(Debug, Clone)]
pub struct Servo {
    settings: ServoSettings,
    role: u32,
    incarnation: u32,
    windows: Windows,
    /// The state after the last scan; another controller of the axis can go on from it, before the next scan.
    pub state: ServoState,
    learned: Option<Box<LearnedTable>>,
    path: Option<Arc<PathCorrection>>,
    /// Lost motion by place, beside the position backlash.
    lost_motion: Option<Arc<ErrorTable>>,
}

/// A feedback that makes sense, and what it says of this axis.
#[derive(Debug, Clone, Copy)]
struct Judged<'a> {
    feedback: &'a Feedback,
    axis: &'a AxisFeedback,
    mode: Mode,
    /// Feedback position, in increments.
    position: i64,
}

impl<'a> Judged<'a> {
    /// Whether its positions are those of the machine: otherwise nobody knows where its travel is.
    fn is_homed(&self) -> bool {
        self.axis.reference == Reference::Known as u32
    }

    /// The position commands around this scan.
    fn setpoints(&self, settings: &'a ServoSettings, windows: &'a Windows) -> Setpoints<'a> {
        let command_position = self.axis.command_position;
        Setpoints::new(settings, windows, self.feedback, command_position)
    }
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
            windows: Windows::none(),
            state: ServoState::zeroed(),
            learned: None,
            path: None,
            lost_motion: machine.lost_motion_by_place(axis).map(Arc::new),
        })
    }

    /// One that takes this one's slot: it remembers nothing but what was learned in runs before.
    pub fn replacement(&self, incarnation: u32) -> Servo {
        Servo {
            settings: self.settings,
            role: self.role,
            incarnation,
            windows: Windows::none(),
            state: ServoState::zeroed(),
            learned: self.learned.clone(),
            path: self.path.clone(),
            lost_motion: self.lost_motion.clone(),
        }
    }

    /// Headers of the windows it holds: the one being executed and the one that waits.
    pub fn windows(&self) -> [&WindowHeader; 2] {
        [&self.windows.held.header, &self.windows.pending.header]
    }

    /// Goes by what was learned in runs before this one; before its first scan.
    pub fn load_trained(&mut self, learned: LearnedTable) {
        self.learned = Some(Box::new(learned));
    }

    /// Goes by what runs of one program have learned along its path; before its first scan.
    pub fn load_path(&mut self, path: Arc<PathCorrection>) {
        self.path = Some(path);
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
            self.state = ServoState::of(peer);
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
        setpoints: &[Setpoint],
        feedback: &Feedback,
    ) -> Result<(), Refusal> {
        self.windows
            .offer(&self.settings, header, setpoints, feedback)
    }

    /// One scan: the command that answers this feedback.
    ///
    /// 1. judge the feedback;
    /// 2. follow it as to windows;
    /// 3. with the drives off or tripped, follow the axis;
    /// 4. otherwise the axis's active controller: the program's (`ClosedLoop`) or the manual one;
    /// 5. guards; in torque mode, the velocity loop.
    ///
    /// A cause stops the axis and is held until the drives are off or tripped.
    pub fn scan(&mut self, feedback: &Feedback) -> AxisCommand {
        let mut command = self.blank(feedback);
        let scan = match self.judge(feedback) {
            Ok(judged) => judged,
            Err(cause) => return self.stop(command, cause),
        };
        self.windows.follow(feedback);
        let scans_passed = self.begin(&scan);
        command.held = self.windows.held.id();
        command.pending = self.windows.pending.id();
        if matches!(scan.mode, Mode::Disabled | Mode::Tripped) {
            self.open_loop(&scan);
            return self.finish(command);
        }
        let driver = match self.driver(&scan) {
            Ok(driver) => driver,
            Err(cause) => return self.stop(command, cause),
        };
        let held = &self.windows.held;
        command.tag = if held.is_none() {
            feedback.tag
        } else {
            held.tag(feedback.setpoint)
        };
        command.stop_deceleration_mm_s2 =
            held.stop_deceleration_mm_s2(&self.settings, feedback.setpoint);
        let before = self.state.program.command_position;
        let takes_over = !self.state.manual.program_drove();
        let wanted = match driver {
            Driver::Program => self.closed_loop(&scan, scans_passed),
            Driver::Manual => self.manual(&scan),
            Driver::Drive => {
                self.open_loop(&scan);
                return self.finish(command);
            }
        };
        let broken = self.broken_travel(&scan, (driver, takes_over), before);
        self.drive(&scan, broken, &wanted, command)
    }

    /// A feedback that makes sense, or what is wrong with it.
    fn judge<'a>(&self, feedback: &'a Feedback) -> Result<Judged<'a>, Cause> {
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
        if !finite {
            return Err(Cause::BadValue);
        }
        Ok(Judged {
            feedback,
            axis,
            mode,
            position: match self.settings.feedback {
                PositionFeedback::Motor => axis.motor_position,
                PositionFeedback::Scale => axis.scale_position,
            },
        })
    }

    /// The state is of this scan from now on; scans since the one it was left in.
    fn begin(&mut self, scan: &Judged) -> u64 {
        if self.state.initialised == 0 {
            self.initialise(scan);
        } else {
            self.windows.take_what_is_left(scan.feedback);
        }
        let scan_before = self.state.scan;
        self.state.scan = scan.feedback.scan;
        scan.feedback.scan.saturating_sub(scan_before)
    }

    /// First feedback: as if the axis had been commanded along the window until now, or had been at rest.
    fn initialise(&mut self, scan: &Judged) {
        let setpoints = scan.setpoints(&self.settings, &self.windows);
        let period_start = -1 - i64::from(setpoints.scan_in_period());
        let period = i64::from(self.settings.scans_per_period);
        let mut state = ServoState {
            program: FollowUpState::closed(setpoints.at(-1), scan.position),
            command_position_before: setpoints.at(-2),
            period: PeriodState {
                start: setpoints.at(period_start),
                start_before: setpoints.at(period_start - period),
            },
            velocity_mm_s: scan.axis.velocity_mm_s,
            // This scan: no period boundary is seen to pass.
            scan: scan.feedback.scan,
            cause: self.state.cause,
            initialised: 1,
            // Whoever comes late takes over what is being commanded; there is no switch.
            manual: ManualState::of_program(),
            ..ServoState::zeroed()
        };
        state.model.motor_position = scan.axis.motor_position;
        self.state = state;
    }

    /// Open loop: the command position follows the axis (docs/methods/follow-up.md).
    ///
    /// With the drives switched off at rest, direction and backlash compensation stay true with it. After a trip, or
    /// where the master's command position says otherwise, closing it starts from a clean state where that command position is.
    fn open_loop(&mut self, scan: &Judged) {
        let before = &mut self.state;
        manual::follow_up(&mut before.manual, &mut before.program, scan.position);
        let command_position = scan.axis.command_position;
        let mut state = ServoState {
            program: FollowUpState::closed(command_position, scan.position),
            command_position_before: command_position,
            period: PeriodState::at_rest(command_position),
            velocity_mm_s: scan.axis.velocity_mm_s,
            scan: before.scan,
            initialised: 1,
            model: before.model.kept(),
            ..ServoState::zeroed()
        };
        state.model.motor_position = scan.axis.motor_position;
        state.reversal.pulses = before.reversal.pulses;
        if scan.mode == Mode::Disabled && before.program.command_position == command_position {
            state.program.steady_deviation = before.program.steady_deviation;
            state.backlash = before.backlash;
            state.model.inverse_dynamics = before.model.inverse_dynamics;
            state.model.inverse_dynamics.leave();
            state.manual = before.manual;
        } else {
            state.program.steady_deviation = command_position.saturating_sub(scan.position);
        }
        self.state = state;
    }

    /// Which of the axis's controllers drives it in this scan.
    fn driver(&self, scan: &Judged) -> Result<Driver, Cause> {
        let feedback = scan.feedback;
        let driver = Driver::from_wire(scan.axis.driver)
            .filter(|driver| *driver == Driver::Program || feedback.window.is_none())
            .ok_or(Cause::BadFeedback)?;
        if self.windows.misses(feedback) {
            return Err(Cause::WindowMissing);
        }
        if !self.windows.held.is_none() && !self.windows.held.has_setpoint(feedback.setpoint) {
            return Err(Cause::BadFeedback);
        }
        Ok(driver)
    }

    /// The program's controller drives the axis.
    fn closed_loop(&mut self, scan: &Judged, scans_passed: u64) -> Wanted {
        let setpoints = scan
            .setpoints(&self.settings, &self.windows)
            .after(self.state.period.start);
        ClosedLoop {
            settings: &self.settings,
            state: &mut self.state,
            learned: self.learned.as_deref(),
            path: self.path.as_deref(),
            lost_motion: self.lost_motion.as_deref().filter(|_| scan.is_homed()),
            setpoints,
            axis: scan.axis,
            position: scan.position,
            scans_passed,
        }
        .scan()
    }

    /// The second controller drives the axis (docs/methods/two-controllers.md).
    fn manual(&mut self, scan: &Judged) -> Wanted {
        ManualLoop {
            settings: &self.settings,
            state: &mut self.state,
            learned: self.learned.as_deref(),
            lost_motion: self.lost_motion.as_deref().filter(|_| scan.is_homed()),
            axis: scan.axis,
            position: scan.position,
        }
        .scan()
    }

    /// Whether the axis leaves its travel, as far as anybody knows where that is; it was commanded to be at `before` in the scan
    /// before.
    fn broken_travel(
        &self,
        scan: &Judged,
        (driver, takes_over): (Driver, bool),
        before: i64,
    ) -> Option<Broken> {
        let guards = &self.settings.guards;
        let command = self.state.program.command_position;
        let broken = if driver == Driver::Program && !takes_over {
            let reach = self.settings.reach(scan.feedback).from_place(before);
            guards.positions(reach, command, scan.position)
        } else {
            guards.by_hand(before, command, scan.position)
        };
        broken.filter(|_| scan.is_homed())
    }

    /// Guards, then the velocity command for the drive or, in torque mode, through the velocity loop the torque.
    fn drive(
        &mut self,
        scan: &Judged,
        travel: Option<Broken>,
        wanted: &Wanted,
        mut command: AxisCommand,
    ) -> AxisCommand {
        command.following_error_mm = wanted.following_error_mm;
        command.feed_forward_mm_s = wanted.feed_forward_mm_s;
        command.hand = wanted.hand as u32;
        let guards = &self.settings.guards;
        let broken = guards
            .following_error(wanted.following_error_mm)
            .or(travel)
            .or(guards.speed(wanted.velocity_mm_s));
        if let Some(broken) = broken {
            return self.stop(command, cause(broken));
        }
        if self.state.cause != Cause::None as u32 {
            // Held until the master has taken notice.
            return self.silence(command);
        }
        command.velocity_mm_s = wanted.velocity_mm_s;
        command.torque_nm = wanted.torque_nm;
        let limited = match self.settings.drive_mode {
            DriveMode::Velocity | DriveMode::Position => scan.axis.torque_limited != 0,
            DriveMode::Torque => {
                let torque = self.settings.velocity_loop.update(
                    &mut self.state.velocity_loop,
                    wanted.velocity_mm_s,
                    self.state.velocity_mm_s,
                );
                if !torque.torque_nm.is_finite() {
                    return self.stop(command, Cause::BadValue);
                }
                command.torque_nm = torque.torque_nm + wanted.torque_nm;
                torque.limited
            }
        };
        self.state.torque_limited_scans = if limited {
            self.state.torque_limited_scans.saturating_add(1)
        } else {
            0
        };
        if self.state.torque_limited_scans > self.settings.torque_limited_scans_max {
            return self.stop(command, Cause::TorqueLimit);
        }
        self.finish(command)
    }

    /// A command that asks for nothing yet.
    fn blank(&self, feedback: &Feedback) -> AxisCommand {
        AxisCommand {
            scan: feedback.scan,
            visible_from: feedback.scan.saturating_add(1),
            stop_deceleration_mm_s2: self.settings.quick_stop_mm_s2,
            held: self.windows.held.id(),
            pending: self.windows.pending.id(),
            axis: self.settings.axis as u32,
            role: self.role,
            incarnation: self.incarnation,
            ahead_scans: self.settings.manual.ahead_scans,
            // What holds a weight is there before a loop is closed.
            torque_nm: self.settings.model.weight_nm,
            drive_mode: match self.settings.drive_mode {
                DriveMode::Velocity => 0,
                DriveMode::Torque => 1,
                DriveMode::Position => 2,
            },
            ..AxisCommand::zeroed()
        }
    }

    /// Drives nothing and reports why; the first cause is held.
    fn stop(&mut self, command: AxisCommand, cause: Cause) -> AxisCommand {
        if self.state.cause == Cause::None as u32 {
            self.state.cause = cause as u32;
        }
        self.silence(command)
    }

    fn silence(&mut self, mut command: AxisCommand) -> AxisCommand {
        command.velocity_mm_s = 0.0;
        command.torque_nm = self.settings.model.weight_nm;
        self.state.velocity_loop.integrator_nm = 0.0;
        if !command.following_error_mm.is_finite() {
            command.following_error_mm = 0.0;
        }
        if !command.feed_forward_mm_s.is_finite() {
            command.feed_forward_mm_s = 0.0;
        }
        self.finish(command)
    }

    /// Completes the command by the state after this scan, and what others read of it.
    fn finish(&self, mut command: AxisCommand) -> AxisCommand {
        command.position = self.state.program.command_position;
        command.refused = self.windows.refused;
        command.cause = self.state.cause;
        command.compensation_mm = self.state.backlash.compensation_mm;
        command.friction_pulse_mm_s = self.state.reversal.pulse_mm_s;
        command.torque_feed_forward_nm = self.state.model.torque_nm();
        command.torque_cut_nm = self.state.model.torque_cut_nm;
        let (model, learned) = (&self.settings.model, self.learned.as_deref());
        command.friction_level = model.friction_level(&self.state.model, learned);
        command.friction_unexplained = self.state.model.adaptation.unexplained;
        if self.settings.has_standby || command.scan.is_multiple_of(STATE_EVERY_SCANS) {
            self.state.put_into(&mut command);
        }
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
