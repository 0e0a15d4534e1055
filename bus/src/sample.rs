//! The samples on the wire: fixed size, zero-copy, plain old data.
//!
//! Every sample is `#[repr(C)]` without padding (checked by `bytemuck::Pod`), so any bytes are a value and a reader
//! decides by checking, never by trusting. Enumerations travel as `u32` and are decoded with a refusal for the unknown.
//! Positions are increments (`increment_nm` in the machine file; 1 nm or 1 µdeg by default); speeds and torques are
//! `f64` with the unit in the name. Rotary axes use the same fields with degrees in place of millimetres.
//!
//! A change of layout is a change of the contract: bump the number in `type_name`.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::table;

mod auxiliary;
mod bus_cycle;
pub(crate) mod checksum;
mod ended;
mod inputs;
mod logic;
mod order;
mod signals;

/// The most axes one cell can have.
pub const MAX_AXES: usize = 32;
/// The most of them that a program can move: the first ones, each with a letter. Arrays of so many are by place on the path, which is
/// the index of such an axis; `path::geometry::PATH_AXES` is the same number.
pub const PATH_AXES: usize = 9;
/// The most processes a roster can name: two servos for each axis, and the others.
pub const MAX_PARTICIPANTS: usize = 2 * MAX_AXES + 8;
/// The most instrument samples within one scan (one every 250 µs, scans of at most 2 ms).
pub const MAX_SUBSAMPLES: usize = 8;
/// The most setpoints one window can carry.
pub const MAX_WINDOW_SETPOINTS: usize = 2048;
/// A servo without a standby says its state in one of so many scans: only the log reads it.
pub const STATE_EVERY_SCANS: u64 = 8;
/// Words of eight bytes that a servo's state may take in a command: a servo asserts that its own fits.
pub const SERVO_STATE_WORDS: usize = 192;

/// Names one window for good: who made it, its number and what it says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/WindowId/1")]
#[repr(C)]
pub struct WindowId {
    /// XXH3 over header and setpoints, so that two windows of one name cannot differ unnoticed.
    pub checksum: u64,
    /// Counted by the planner from 1.
    pub sequence: u32,
    /// The planner's incarnation, from the roster.
    pub incarnation: u32,
}
table!(WindowId: checksum, sequence, incarnation);

impl WindowId {
    /// No window.
    pub const NONE: WindowId = WindowId {
        checksum: 0,
        sequence: 0,
        incarnation: 0,
    };

    /// Whether this names no window.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }
}

/// Where on the program's path a setpoint stands; a restarted planner goes on from here.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/PathTag/1")]
#[repr(C)]
pub struct PathTag {
    /// Distance along the element, in mm.
    pub distance_mm: f64,
    /// Index of the element in the expanded path.
    pub element: u32,
    /// Scans of dwell still to wait at this setpoint.
    pub dwell_remaining_scans: u32,
}
table!(PathTag: distance_mm, element, dwell_remaining_scans);

impl PathTag {
    /// Not on the program's path: jogging, drives off, or on the return to where the path was left. No path has that
    /// many elements, so whoever looks the element up finds none.
    pub const OFF_PATH: PathTag = PathTag {
        distance_mm: 0.0,
        element: u32::MAX,
        dwell_remaining_scans: 0,
    };

    /// Whether this names no place on the path.
    pub fn is_off_path(&self) -> bool {
        self.element == Self::OFF_PATH.element
    }
}

/// One scan of a window.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Setpoint/2")]
#[repr(C)]
pub struct Setpoint {
    /// Position of every axis of the path, in increments; second motors of gantries go by the position of their axis.
    pub position: [i64; PATH_AXES],
    /// Where on the path this is.
    pub tag: PathTag,
}
table!(Setpoint: position @ PathAxes, tag);

/// What stands before the setpoints of a window.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/WindowHeader/1")]
#[repr(C)]
pub struct WindowHeader {
    /// Its identity.
    pub id: WindowId,
    /// The window it continues; none after a *no window* state.
    pub predecessor: WindowId,
    /// Scan in which setpoint 0 is executed.
    pub first_scan: u64,
    /// First scan in which a reader may act on it.
    pub visible_from: u64,
    /// Hash of program, machine file and start offsets that the tags refer to.
    pub program_hash: u64,
    /// The master's epoch that a window without predecessor belongs to.
    pub epoch: u32,
    /// Setpoints of intended motion; the others brake to rest.
    pub intended_setpoints: u32,
    /// Setpoints in all.
    pub setpoint_count: u32,
    /// 1 if the last intended setpoint is the end of the program.
    pub ends_program: u32,
}
table!(
    WindowHeader: id, predecessor, first_scan, visible_from, program_hash, epoch, intended_setpoints, setpoint_count,
    ends_program,
);

wire_enum! {
    /// What the machine is doing: latched by the master, obeyed by everybody.
    pub enum Mode {
        /// Drives have no torque.
        Disabled = 0 => "disabled",
        /// Drives are on and windows are executed.
        Enabled = 1 => "enabled",
        /// No further window is admitted; the one in force brings the tool to rest on the path.
        Stopping = 2 => "stopping",
        /// At rest after a stop, drives on.
        Stopped = 3 => "stopped",
        /// A fault: the drives brake or have braked; held until somebody resets it.
        Tripped = 4 => "tripped",
        /// The program is done and the machine is in position.
        Finished = 5 => "finished",
        /// A second controller moves an axis by hand; no window is executed.
        Jogging = 6 => "jogging",
        /// Drives on, at rest, and no program is running: of a cell that stays up.
        Ready = 7 => "ready",
    }
    /// The word for it on screens and in reports.
    pub fn word
}

impl Mode {
    /// Whether the drives follow commands: they are on, and nothing has tripped.
    pub fn is_driven(self) -> bool {
        !matches!(self, Mode::Disabled | Mode::Tripped)
    }
}

wire_enum! {
    /// Why a machine is in feed hold.
    #[derive(Default)]
    pub enum HoldReason {
        /// It is not.
        #[default]
        None = 0 => "none",
        /// Somebody has ordered it, or drives are on again after a stop.
        Order = 1 => "order",
        /// The program waits for its operator.
        Program = 2 => "program",
        /// A door or guard is open.
        Door = 3 => "door",
        /// A signal that a program needs is off.
        Signal = 4 => "signal",
        /// An alarm holds programs.
        Alarm = 5 => "alarm",
        /// The machine's own logic asks for it.
        Logic = 6 => "logic",
        /// The machine's own logic was lost, or does not answer.
        LogicLost = 7 => "logic-lost",
        /// The planner is silent.
        PlannerLost = 8 => "planner-lost",
        /// An axis is without its standby.
        StandbyLost = 9 => "standby-lost",
        /// Axes are not homed, or outside their travel.
        Start = 10 => "start",
    }
    /// Its word.
    pub fn word
}

impl HoldReason {
    /// Why, for people; none where nothing is to be said of it.
    pub fn words(self) -> Option<&'static str> {
        Some(match self {
            HoldReason::None | HoldReason::Order | HoldReason::Program => return None,
            HoldReason::Door => "a door was opened",
            HoldReason::Signal => "a signal that a program needs went off",
            HoldReason::Alarm => "an alarm holds programs",
            HoldReason::Logic => "the machine's own logic asked for it",
            HoldReason::LogicLost => "the machine's own logic did not answer",
            HoldReason::PlannerLost => "the planner was lost",
            HoldReason::StandbyLost => "an axis is without its standby",
            HoldReason::Start => "axes are not homed or outside their travel",
        })
    }
}

wire_enum! {
    /// Progress of a cell with its program, latched by the master.
    pub enum ProgramState {
        /// None is loaded, or the planner has refused it.
        None = 0 => "none",
        /// The planner is reading it.
        Loading = 1 => "loading",
        /// It can be started.
        Loaded = 2 => "loaded",
        /// It was started and is not done: moving, held, stopped, tripped or with the drives off.
        Running = 3 => "running",
        /// It is done and can be started again.
        Done = 4 => "done",
    }
    /// The word for it on screens and in reports.
    pub fn word
}

wire_enum! {
    /// Why an axis, and with it the machine, stopped. A number is never given to another cause: logs keep them.
    pub enum Cause {
        /// No stop.
        None = 0 => "no fault",
        /// The following error went beyond its limit.
        FollowingError = 1 => "following error beyond its limit",
        /// The command or the axis left the travel.
        SoftLimit = 2 => "soft limit",
        /// A command beyond the speed limit.
        SpeedLimit = 3 => "speed limit",
        /// A value that is not a number, or out of all reason.
        BadValue = 4 => "a value that is not finite or out of range",
        /// The feedback does not make sense (scan, mode or window).
        BadFeedback = 5 => "feedback that does not make sense",
        /// The servo does not hold the window that is being executed.
        WindowMissing = 6 => "servo does not hold the window being executed",
        /// Too many scans in a row without a command: the drive's watchdog.
        Watchdog = 7 => "commands missing for too many scans",
        /// The servo process of the axis died.
        ServoLost = 8 => "servo process lost",
        /// The torque stayed at its limit.
        TorqueLimit = 10 => "torque at its limit for too long",
        /// The planner cannot go on (its program is unreadable, changed or out of limits).
        Planner = 11 => "planner cannot go on",
        /// The axis is at the programmed end and never came into its in-position window.
        NotInPosition = 12 => "not in position at the programmed end",
        /// The master died and was restarted: the drives have braked by themselves and are off.
        MasterLost = 13 => "master lost and restarted, drives off",
        /// The drive of the axis reports a fault of its own.
        DriveFault = 14 => "drive fault",
        /// The drive of the axis does not answer any more.
        DriveLost = 15 => "drive does not answer",
        /// The drive of the axis is off, though it was not ordered so, or did not come on in time.
        DriveOff = 16 => "drive is off, or did not come on in time",
        /// The axis has no reference: nobody knows where it is.
        NotReferenced = 17 => "axis has no reference: home it first",
        /// The master itself did not run for longer than the watchdog: the drives have braked by themselves and are off.
        Stalled = 18 => "master stalled for longer than the watchdog, drives off",
        /// The spindle has a fault, or did not reach its speed, angle or standstill in time.
        Spindle = 19 => "spindle fault, or not where it was ordered in time",
        /// The tool changer did not confirm the tool in time.
        ToolChange = 20 => "tool change not confirmed in time",
        /// A probing motion (G38.2, G38.4) came to its end and the contact did not change.
        ProbeMissed = 24 => "the probe made no contact (G38.2) or kept it (G38.4) to the end of its motion",
        /// A probing motion was to begin and the contact was already as it is to be at its end.
        ProbeEarly = 25 => "the probe was in contact (G38.2, G38.3) or free (G38.4, G38.5) before its motion began",
        /// The contact changed in a probing motion while nobody watched it.
        ProbeLost = 26 => "the probe's contact changed while nobody watched it: probe again",
        /// Homing has not found the edge of the home switch within the longest way of a search.
        HomeSwitch = 27 => "no edge of the home switch within the search distance: is the direction right, and the input?",
        /// Homing has not found the index of the motor encoder.
        HomeIndex = 28 => "no index of the motor encoder where one should be",
        /// A drive that homes by itself did not end in time.
        HomeDrive = 29 => "the drive did not home in time",
        /// The operator has ordered an emergency stop.
        EmergencyStop = 30 => "emergency stop by the operator",
        /// The two motors of a gantry are further apart than they may be; the axis is the second of them.
        Skew = 31 => "the two motors of the gantry are too far apart (skew)",
        /// The program has given itself up by (ABORT, …): its text is the last message.
        Abort = 32 => "given up by the program itself (ABORT)",
        /// The two motors of a gantry pull against each other for too long; the axis is the second of them.
        GantryTorque = 33 => "the two motors of the gantry pull against each other",
        /// The probe made contact in a motion by hand, which has come to rest where it could.
        ProbeJogged = 34 => "the probe made contact in a jog: jog it off",
        /// The emergency-stop chain is open.
        EmergencyStopChain = 35 => "the emergency-stop chain is open",
        /// An input says that the drives may not be on.
        DrivesNotAllowed = 36 => "an input keeps the drives off",
        /// The axis is on its limit switch.
        LimitSwitch = 37 => "limit switch: jog the axis off it",
        /// The process that does the machine's own logic is lost.
        LogicLost = 38 => "the machine's own logic is lost",
        /// The logic of the machine has asked for it.
        LogicTrip = 39 => "stopped by the machine's own logic",
        /// An alarm of the machine stops it.
        MachineAlarm = 40 => "an alarm of the machine (quadrant alarms)",
        /// The machine has not done an M-code in time.
        MachineCode = 41 => "the machine did not do an M-code in time",
        /// The drive of the axis was lost and came back elsewhere.
        Displaced = 42 => "axis came back elsewhere than its drive was lost: see where it is, then `quadrant alarms acknowledge`",
    }
    /// A sentence fragment for people.
    pub fn words
}

impl Cause {
    /// Whether a servo can know it: of its own axis, and of what it was told.
    pub fn is_of_servo(self) -> bool {
        matches!(
            self,
            Cause::FollowingError
                | Cause::SoftLimit
                | Cause::SpeedLimit
                | Cause::BadValue
                | Cause::BadFeedback
                | Cause::WindowMissing
                | Cause::TorqueLimit
        )
    }
}

/// What the master says of one axis in one scan.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/AxisFeedback/4")]
#[repr(C)]
pub struct AxisFeedback {
    /// Motor encoder, in increments of the axis (already through the position factor of the drive).
    pub motor_position: i64,
    /// Linear scale, in increments; equals the motor encoder where the axis has none.
    pub scale_position: i64,
    /// The command position: where the axis is commanded to be. Follows the encoder while the drive is off.
    pub command_position: i64,
    /// Its course by hand; counts while [`AxisFeedback::driver`] is the manual controller.
    pub hand: HandCourse,
    /// Scan of the command that acts in this scan.
    pub command_scan: u64,
    /// Velocity measured by the drive, in mm/s.
    pub velocity_mm_s: f64,
    /// Velocity command acting in this scan, in mm/s.
    pub velocity_command_mm_s: f64,
    /// Motor torque at the end of the scan before, in N·m.
    pub torque_nm: f64,
    /// Winding temperature above ambient, in K.
    pub winding_k: f64,
    /// Scans without a command in time, in all.
    pub missed_scans: u32,
    /// The same, in a row until now.
    pub missed_in_a_row: u32,
    /// Incarnation of the servo whose command was taken.
    pub taken_incarnation: u32,
    /// Its role (0 = a, 1 = b).
    pub taken_role: u32,
    /// [`Cause`] of a trip of this axis.
    pub cause: u32,
    /// 1 while the torque is at its limit.
    pub torque_limited: u32,
    /// [`Driver`]: which of the axis's two controllers drives.
    pub driver: u32,
    /// The drive's own error code while it reports a fault, else 0 (CiA 402 object 603Fh). With [`Cause::Skew`] the skew that it was,
    /// in µm, as an `i32`, likewise the displacement with [`Cause::Displaced`]; with [`Cause::GantryTorque`] the difference of the torques, in percent of the rated one, likewise.
    pub drive_code: u32,
    /// [`Redundancy`] of the axis.
    pub redundancy: u32,
    /// Scans in a row in which its standby could not have taken over; 0 where it has none.
    pub unsynchronised_scans: u32,
    /// How often its two servos have commanded different things after they had commanded the same.
    pub differences: u32,
    /// [`Reference`]: whether its positions are those of the machine.
    pub reference: u32,
}
table!(
    AxisFeedback: motor_position, scale_position, command_position, hand, command_scan, velocity_mm_s,
    velocity_command_mm_s, torque_nm, winding_k, missed_scans, missed_in_a_row, taken_incarnation, taken_role, cause,
    torque_limited, driver, drive_code, redundancy, unsynchronised_scans, differences, reference,
);

/// The course of an axis that is moved by hand, as it was in the scan before (`loops::hand_course`).
///
/// Places and steps in 1/65536 of an increment. From the same course everybody makes the same steps: a servo looks ahead on it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/HandCourse/1")]
#[repr(C)]
pub struct HandCourse {
    /// Position command.
    pub command: i64,
    /// What leads it.
    pub lead: i64,
    /// What the lead moved.
    pub lead_step: i64,
    /// What the command moved.
    pub step: i64,
    /// Where it is to end.
    pub goal: i64,
    /// Largest step of a scan.
    pub step_max: i64,
    /// Where it is to end once the change has come.
    pub next_goal: i64,
    /// Largest step of a scan from then on.
    pub next_step_max: i64,
    /// Largest change of the lead's step from scan to scan.
    pub step_change_max: i64,
    /// Share of the way to the lead that the command makes in a scan.
    pub follows_by: f64,
    /// Scans until that change, 1 in this one; 0 without one.
    pub changes_in: u32,
    /// Kept zero.
    pub reserved: u32,
}
table!(
    HandCourse: command, lead, lead_step, step, goal, step_max, next_goal, next_step_max, step_change_max, follows_by,
    changes_in, reserved,
);

wire_enum! {
    /// Reference of an axis: what its positions are worth.
    #[derive(Default)]
    pub enum Reference {
        /// They are: its encoder is absolute, or it was homed.
        #[default]
        Known = 0 => "homed",
        /// They begin anywhere: it must be homed.
        Missing = 1 => "not homed",
        /// It is being homed.
        Searching = 2 => "homing",
        /// Its drive was lost and came back elsewhere: somebody has to look before it is driven.
        Displaced = 3 => "came back elsewhere",
        /// Its drive does not answer: they are those that it showed last.
        Unseen = 4 => "as seen last",
    }
    /// In a word or two.
    pub fn words
}

/// So long an axis may be without its standby before it is an alarm, in s: a replacement is there sooner.
pub const STANDBY_ALARM_S: f64 = 1.0;

wire_enum! {
    /// Whether the other servo of an axis could take it over.
    #[derive(Default)]
    pub enum Redundancy {
        /// The axis has one servo.
        #[default]
        Alone = 0 => "alone",
        /// The standby has commanded the same in the last scans, and takes over in the scan in which the other is silent.
        Synchronised = 1 => "synchronised",
        /// A standby is there and could not take over yet.
        CatchingUp = 2 => "catching up",
        /// There is no standby.
        Lost = 3 => "lost",
    }
    /// In a word or two.
    pub fn words
}

wire_enum! {
    /// Which of an axis's two controllers drives it: the switch between them, set by the master, obeyed by the servo.
    pub enum Driver {
        /// The program's: it executes windows.
        Program = 0,
        /// The manual one: it follows [`AxisFeedback::hand`].
        Manual = 1,
        /// None of them: the drive holds the axis or homes it, and the servo follows.
        Drive = 2,
    }
}

/// State of the manual controller of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[repr(u32)]
pub enum Hand {
    /// It does not drive, or the motor has not settled since it does.
    #[default]
    Off = 0,
    /// It follows the course.
    Follows = 1,
    /// The course rests, and the motor has settled there.
    Settled = 2,
}

impl Hand {
    /// Decodes what came over the wire; what nobody knows is no hand.
    pub fn from_wire(value: u32) -> Hand {
        match value {
            1 => Hand::Follows,
            2 => Hand::Settled,
            _ => Hand::Off,
        }
    }
}

/// What the master says each scan.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Feedback/14")]
#[repr(C)]
pub struct Feedback {
    /// Number of the scan that begins with this sample.
    pub scan: u64,
    /// First scan in which a reader may act on it (its own: the feedback starts the scan).
    pub visible_from: u64,
    /// Window being executed, or none.
    pub window: WindowId,
    /// Window that every enabled axis holds and that takes over at its first scan, or none.
    pub armed: WindowId,
    /// The last window that was voided, or none.
    pub voided: WindowId,
    /// Hash of the program that `tag` belongs to.
    pub program_hash: u64,
    /// Where the setpoint being executed is on the path.
    pub tag: PathTag,
    /// Where the path was left, and where a resumed program returns to; off the path as long as none was started.
    pub interrupted_at: PathTag,
    /// First scan with the cause below.
    pub cause_scan: u64,
    /// Command positions that the program was started from: its path is expanded from there, by every planner of this run.
    pub program_start: [i64; PATH_AXES],
    /// Setpoint of the window being executed in this scan.
    pub setpoint: u32,
    /// 1 once that setpoint is the window's last: the machine is commanded to rest.
    pub at_rest: u32,
    /// The epoch: counts the *no window* states; a window without predecessor must name it.
    pub epoch: u32,
    /// Incarnation of the master.
    pub incarnation: u32,
    /// [`Mode`].
    pub mode: u32,
    /// [`Cause`] of a trip or stop.
    pub cause: u32,
    /// Axis that caused it (index), or `u32::MAX`.
    pub cause_axis: u32,
    /// Latched override in percent.
    pub override_percent: u32,
    /// 1 while feed hold is latched.
    pub hold: u32,
    /// [`HoldReason`]: what began it.
    pub hold_reason: u32,
    /// Losses of the machine's own logic.
    pub logic_losses: u32,
    /// 1 if this is the last feedback of the run.
    pub last: u32,
    /// Scans that were skipped because the master itself was late.
    pub overrun_scans: u32,
    /// Axes in use.
    pub axis_count: u32,
    /// Number of the program that was loaded last, 0 for the one that the cell was started with.
    pub load: u32,
    /// [`ProgramState`] of it.
    pub program: u32,
    /// Counts the programs that were started.
    pub run: u32,
    /// Messages of the program that the path has come to: each is to be shown once.
    pub messages: u32,
    /// 1 while the machine rests as orders to move or let go an axis want it.
    pub rested: u32,
    /// Axes in use that programs move: the first ones.
    pub path_axes: u32,
    /// The run that ended last, and how.
    pub ended: EndedRun,
    /// Spindle, coolant, outputs, tool and stops.
    pub auxiliary: Auxiliaries,
    /// The answer to what the program asked last.
    pub answer: Answer,
    /// What the inputs show.
    pub inputs: Inputs,
    /// Per axis.
    pub axes: [AxisFeedback; MAX_AXES],
    /// Of all that stands before it and is in use (XXH3-64); written when it is sent, checked by every reader.
    pub checksum: u64,
}
table!(
    Feedback: scan, visible_from, window, armed, voided, program_hash, tag, interrupted_at, cause_scan, program_start @ PathAxes, setpoint, at_rest, epoch, incarnation, mode,
    cause, cause_axis, override_percent, hold, hold_reason, logic_losses, last, overrun_scans, axis_count, load, program, run, messages, rested, path_axes, ended, auxiliary, answer, inputs, axes @ Axes, checksum,
);

/// What only an instrument could see: the bench's ball-bar and grid encoder, not for any controller.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Instruments/2")]
#[repr(C)]
pub struct Instruments {
    /// The scan these were taken in.
    pub scan: u64,
    /// First scan in which a reader may act on it.
    pub visible_from: u64,
    /// The master's running digest (see `motion_digest` in the report), first half.
    pub motion_digest_high: u64,
    /// Second half.
    pub motion_digest_low: u64,
    /// Samples per axis within the scan, evenly spaced; the last is at the end of the scan.
    pub subsamples: u32,
    /// Axes in use.
    pub axis_count: u32,
    /// Per axis.
    pub axes: [AxisInstruments; MAX_AXES],
}
table!(
    Instruments: scan, visible_from, motion_digest_high, motion_digest_low, subsamples, axis_count, axes @ Axes,
);

/// What instruments see of one axis in a scan.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/AxisInstruments/1")]
#[repr(C)]
pub struct AxisInstruments {
    /// Table position in mm, per subsample.
    pub table_mm: [f64; MAX_SUBSAMPLES],
    /// Motor position in mm at the table side of the lead, per subsample.
    pub motor_mm: [f64; MAX_SUBSAMPLES],
}
table!(AxisInstruments: table_mm @ Subsamples, motor_mm @ Subsamples);

impl Instruments {
    /// The master's running digest.
    pub fn motion_digest(&self) -> u128 {
        u128::from(self.motion_digest_high) << 64 | u128::from(self.motion_digest_low)
    }
}

/// What one servo asks of its drive for one scan.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/AxisCommand/8")]
#[repr(C)]
pub struct AxisCommand {
    /// Scan whose feedback this answers; takes effect one scan later.
    pub scan: u64,
    /// First scan in which a reader may act on it.
    pub visible_from: u64,
    /// Position command of this scan, in increments.
    pub position: i64,
    /// Velocity command to the drive, in mm/s (velocity mode).
    pub velocity_mm_s: f64,
    /// Torque added to the drive's own (velocity mode), or the whole torque (torque mode), in N·m at the motor.
    pub torque_nm: f64,
    /// Feed-forward part of the velocity command, in mm/s.
    pub feed_forward_mm_s: f64,
    /// Following error: command minus feedback, compensation not counted, in mm.
    pub following_error_mm: f64,
    /// Deceleration the drive is to use if this axis has to brake from now on, in mm/s².
    pub stop_deceleration_mm_s2: f64,
    /// Compensation of lost motion in force, in mm.
    pub compensation_mm: f64,
    /// Friction pulse being output at a reversal, in mm/s, signed.
    pub friction_pulse_mm_s: f64,
    /// Torque that the axis's model feeds forward, in N·m at the motor.
    pub torque_feed_forward_nm: f64,
    /// What the model asked for beyond that, in N·m: more than the drive has.
    pub torque_cut_nm: f64,
    /// Level of friction that the servo goes by, as a part of that of its model; 0 without one.
    pub friction_level: f64,
    /// Part of Coulomb friction that the last way between two reversals left unexplained; 0 where friction is not followed.
    pub friction_unexplained: f64,
    /// Window this servo executes or would execute, none if it holds none.
    pub held: WindowId,
    /// Window it holds for later.
    pub pending: WindowId,
    /// Last window it refused, none if it never did.
    pub refused: WindowId,
    /// Tag of the setpoint this command was made from.
    pub tag: PathTag,
    /// Axis index.
    pub axis: u32,
    /// Role: 0 = a, 1 = b.
    pub role: u32,
    /// Incarnation of this servo, from the roster.
    pub incarnation: u32,
    /// Drive mode asked for: 0 velocity, 1 torque, 2 position.
    pub drive_mode: u32,
    /// [`Cause`] of a stop this servo asks for.
    pub cause: u32,
    /// [`Hand`]: state of the manual controller.
    pub hand: u32,
    /// Scans that it looks ahead on a course by hand: a change of the course is known so early.
    pub ahead_scans: u32,
    /// Words of the state that are in use.
    pub state_words: u32,
    /// The servo's state after this scan, as the servo lays it out: for the axis's other servo, which goes on from it to the bit. Nobody
    /// else can read it; what others need has a field of its own. Without a standby it is there in one scan of
    /// [`STATE_EVERY_SCANS`].
    pub state: [u64; SERVO_STATE_WORDS],
    /// Of all that stands before it and is in use (XXH3-64); written when it is sent, checked by every reader.
    pub checksum: u64,
}
table!(
    AxisCommand: scan, visible_from, position, velocity_mm_s, torque_nm, feed_forward_mm_s, following_error_mm,
    stop_deceleration_mm_s2, compensation_mm, friction_pulse_mm_s, torque_feed_forward_nm, torque_cut_nm,
    friction_level, friction_unexplained, held, pending, refused, tag, axis, role, incarnation, drive_mode, cause,
    hand, ahead_scans, state_words, state, checksum,
);

impl AxisCommand {
    /// Whether it drives an axis as another one does, to the bit, whoever sent them.
    pub fn drives_as(&self, other: &AxisCommand) -> bool {
        let of_other = AxisCommand {
            role: other.role,
            incarnation: other.incarnation,
            // A window that one of them refused or does not hold yet is no part of what it drives.
            refused: other.refused,
            pending: other.pending,
            // When it may be read, and that it was not damaged, is judged by the reader.
            visible_from: other.visible_from,
            checksum: other.checksum,
            ..*self
        };
        bytemuck::bytes_of(&of_other) == bytemuck::bytes_of(other)
    }
}

impl Default for AxisCommand {
    fn default() -> AxisCommand {
        AxisCommand::zeroed()
    }
}

/// What the planner says at each period boundary, also when it has nothing new.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/PlannerStatus/6")]
#[repr(C)]
pub struct PlannerStatus {
    /// Scan whose feedback this answers.
    pub scan: u64,
    /// First scan in which a reader may act on it.
    pub visible_from: u64,
    /// Program in force.
    pub program_hash: u64,
    /// Last window published, none if none yet.
    pub published: WindowId,
    /// Path length of the program, in mm; 0 while its end is not read.
    pub path_length_mm: f64,
    /// Path travelled up to the window in force, in mm.
    pub path_done_mm: f64,
    /// Incarnation of this planner.
    pub incarnation: u32,
    /// 1 once the window that ends the program is published.
    pub finished: u32,
    /// [`Cause`] of a stop the planner asks for.
    pub cause: u32,
    /// Windows published in all.
    pub windows: u32,
    /// Number of the program that it has read, as in the feedback.
    pub load: u32,
    /// Line of the program that the tool is in, or was when the path was left; 0 if it is not known.
    pub line: u32,
    /// Number of the event whose answer it has taken last.
    pub answered: u32,
    /// Messages of the program that the path has come to, and whose texts are where readers find them.
    pub messages: u32,
    /// The event that the program asks for where the machine rests now; its number is 0 for none.
    pub event: ProgramEvent,
    /// The next outputs to be set in motion, each in the scan in which its element begins; number 0 for none.
    pub outputs_ahead: [ProgramEvent; OUTPUTS_AHEAD],
    /// Of all that stands before it and is in use (XXH3-64); written when it is sent, checked by every reader.
    pub checksum: u64,
}
table!(
    PlannerStatus: scan, visible_from, program_hash, published, path_length_mm, path_done_mm, incarnation, finished,
    cause, windows, load, line, answered, messages, event, outputs_ahead, checksum,
);

wire_enum! {
    /// Job of a participant.
    #[derive(PartialOrd, Ord)]
    pub enum Job {
        /// The master.
        Master = 1 => "master",
        /// The planner.
        Planner = 2 => "planner",
        /// One servo.
        Servo = 3 => "servo",
        /// The recorder.
        Monitor = 4 => "recorder",
        /// The owner of the fieldbus, or its standby.
        Fieldbus = 5 => "fieldbus",
        /// The logic of the machine.
        Logic = 6 => "logic",
    }
    /// In a word.
    pub fn word
}

/// One process in the roster.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Participant/2")]
#[repr(C)]
pub struct Participant {
    /// Scan at which it last died, `u64::MAX` if it never did.
    pub death_scan: u64,
    /// [`Job`]; 0 for an unused entry.
    pub job: u32,
    /// Axis of a servo.
    pub axis: u32,
    /// Role of a servo.
    pub role: u32,
    /// Counts the processes that had this place, from 1.
    pub incarnation: u32,
    /// 1 while it lives.
    pub live: u32,
    /// Signal that ended the last one before, 0 if none.
    pub death_signal: i32,
    /// Exit status of the last one before.
    pub death_status: i32,
    /// 1 while it lives but has been stopped by a fault script: nobody waits for it.
    pub stalled: u32,
}
table!(
    Participant: death_scan, job, axis, role, incarnation, live, death_signal, death_status, stalled,
);

/// Who takes part: published by the launcher, which learns of deaths from the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Roster/4")]
#[repr(C)]
pub struct Roster {
    /// Counted from 1.
    pub version: u64,
    /// First scan it counts for.
    pub visible_from: u64,
    /// The processes.
    pub participants: [Participant; MAX_PARTICIPANTS],
    /// Of all that stands before it and is in use (XXH3-64); written when it is sent, checked by every reader.
    pub checksum: u64,
}
table!(Roster: version, visible_from, participants, checksum);

impl Default for Roster {
    fn default() -> Roster {
        Roster::zeroed()
    }
}

impl Roster {
    /// The places that somebody has or had: the first ones.
    pub fn places(&self) -> &[Participant] {
        let used = self.participants.iter().position(|place| place.job == 0);
        let used = used.unwrap_or(self.participants.len());
        self.participants.get(..used).unwrap_or(&self.participants)
    }

    /// The participant in this place, if there is one.
    pub fn find(&self, job: Job, axis: usize, role: u32) -> Option<&Participant> {
        self.places()
            .iter()
            .find(|p| p.job == job as u32 && p.axis == axis as u32 && p.role == role)
    }

    /// The participant in this place, if it lives.
    pub fn living(&self, job: Job, axis: usize, role: u32) -> Option<&Participant> {
        self.find(job, axis, role).filter(|p| p.live == 1)
    }
}

pub use auxiliary::{
    ANALOG_OUTPUTS, Auxiliaries, DIGITAL_OUTPUTS, EventCode, FLOOD, Levels, MIST, MODES_RESET,
    OUTPUTS_AHEAD, ProgramEvent, SpindleCommand, Waiting,
};
pub use bus_cycle::BusCycle;
pub use ended::{EndedRun, RunOutcome};
pub use inputs::{
    ANALOG_INPUTS, Answer, AnswerOutcome, AskedInput, DIGITAL_INPUTS, InputWait, Inputs,
    OVERRIDE_MAX_PERCENT, PROBE_AWAY, PROBE_MUST,
};
pub use logic::{LOGIC_HOLD, LOGIC_INHIBIT, LOGIC_STOP, LOGIC_TRIP, LogicAnswer};
pub use order::{DOWN_FOR_LOSS, OperatorRequest, OperatorResponse, Order, Refused};
pub use signals::{ALARMS_MAX, SIGNALS_MAX, SignalSet, Signals, has_bit, with_bit};

impl Feedback {
    /// Whether the positions of an axis are worth this.
    pub fn has_axis(&self, reference: Reference) -> bool {
        let mut axes = self.axes().iter();
        axes.any(|axis| axis.reference == reference as u32)
    }

    /// The axes in use.
    pub fn axes(&self) -> &[AxisFeedback] {
        self.axes
            .get(..self.axis_count as usize)
            .unwrap_or(&self.axes)
    }

    /// Where the axes of the path are commanded to be, in increments; 0 behind the last.
    pub fn path_positions(&self) -> [i64; PATH_AXES] {
        let mut positions = [0; PATH_AXES];
        let axes = self.axes().iter().take(self.path_axes as usize);
        for (position, axis) in positions.iter_mut().zip(axes) {
            *position = axis.command_position;
        }
        positions
    }
}

impl Instruments {
    /// The axes in use.
    pub fn axes(&self) -> &[AxisInstruments] {
        self.axes
            .get(..self.axis_count as usize)
            .unwrap_or(&self.axes)
    }

    /// The last subsample; none where there are none.
    pub fn last(&self) -> Option<usize> {
        let count = (self.subsamples as usize).min(MAX_SUBSAMPLES);
        count.checked_sub(1)
    }

    /// Places of all axes in a subsample, in mm: `of` chooses which; 0 for axes that are not in use.
    pub fn places_mm(
        &self,
        subsample: usize,
        of: impl Fn(&AxisInstruments) -> &[f64; MAX_SUBSAMPLES],
    ) -> [f64; MAX_AXES] {
        let mut places_mm = [0.0; MAX_AXES];
        for (place_mm, axis) in places_mm.iter_mut().zip(self.axes()) {
            *place_mm = of(axis).get(subsample).copied().unwrap_or(0.0);
        }
        places_mm
    }
}
