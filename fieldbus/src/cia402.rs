//! CiA 402: numbers, sizes and names of its objects, modes of operation, what its option codes mean.
//!
//! Source: IEC 61800-7-201 (CiA 402-2), ETG.6010.

mod modes;
mod option_codes;

pub use modes::{DriveMode, OperatingMode};
pub use option_codes::{Effect, OptionCode};

/// Number of the device profile.
pub const PROFILE: u32 = 402;

/// Distance between the same objects of two neighbouring axes of a drive (ETG.6010, multi-axis drives).
const OBJECTS_OF_AXIS: u16 = 0x800;
/// The objects of all axes, from the first axis on.
const OBJECTS_OF_AXES: std::ops::Range<u16> = 0x6000..0xA000;

/// Which modules are in the slots of a modular device (ETG.5001): what it exchanges follows from them.
pub const CONFIGURED_MODULES: u16 = 0xF030;

/// Abort connection option code: what the drive does when the bus falls silent.
pub const ABORT_CONNECTION: u16 = 0x6007;
/// Code of the last fault.
pub const ERROR_CODE: u16 = 0x603F;
/// Controlword.
pub const CONTROLWORD: u16 = 0x6040;
/// Statusword.
pub const STATUSWORD: u16 = 0x6041;
/// Quick stop option code.
pub const QUICK_STOP: u16 = 0x605A;
/// Disable operation option code.
pub const DISABLE_OPERATION: u16 = 0x605C;
/// Halt option code.
pub const HALT: u16 = 0x605D;
/// Fault reaction option code.
pub const FAULT_REACTION: u16 = 0x605E;
/// Mode of operation.
pub const MODE: u16 = 0x6060;
/// Mode of operation in force.
pub const MODE_DISPLAY: u16 = 0x6061;
/// Target velocity of frequency converters (mode 2), in rev/min.
pub const CONVERTER_TARGET_VELOCITY: u16 = 0x6042;
/// Actual velocity of frequency converters, in rev/min.
pub const CONVERTER_VELOCITY: u16 = 0x6044;
/// Actual position.
pub const POSITION: u16 = 0x6064;
/// Following error at which the drive trips, in increments.
pub const FOLLOWING_ERROR_WINDOW: u16 = 0x6065;
/// Actual velocity.
pub const VELOCITY: u16 = 0x606C;
/// Target torque.
pub const TARGET_TORQUE: u16 = 0x6071;
/// Highest torque.
pub const MAX_TORQUE: u16 = 0x6072;
/// Actual torque.
pub const TORQUE: u16 = 0x6077;
/// Target position.
pub const TARGET_POSITION: u16 = 0x607A;
/// Highest profile velocity.
pub const MAX_PROFILE_VELOCITY: u16 = 0x607F;
/// Velocity offset.
pub const VELOCITY_OFFSET: u16 = 0x60B1;
/// Highest current.
pub const MAX_CURRENT: u16 = 0x6073;
/// Highest speed of the motor.
pub const MAX_MOTOR_SPEED: u16 = 0x6080;
/// Torque offset.
pub const TORQUE_OFFSET: u16 = 0x60B2;
/// What the touch-probe unit is to latch: a byte for each of its two latches.
pub const TOUCH_PROBE_FUNCTION: u16 = 0x60B8;
/// What it has latched.
pub const TOUCH_PROBE_STATUS: u16 = 0x60B9;
/// Position at the positive edge of its first latch.
pub const TOUCH_PROBE_1_RISING: u16 = 0x60BA;
/// The same at the negative edge.
pub const TOUCH_PROBE_1_FALLING: u16 = 0x60BB;
/// Position at the positive edge of its second latch.
pub const TOUCH_PROBE_2_RISING: u16 = 0x60BC;
/// The same at the negative edge.
pub const TOUCH_PROBE_2_FALLING: u16 = 0x60BD;
/// Interpolation time: sub-index 1 mantissa, 2 exponent of ten in seconds.
pub const INTERPOLATION_TIME: u16 = 0x60C2;
/// Digital inputs: 0 to 3 limit switches, home switch and interlock, 16 to 31 those of the manufacturer.
pub const DIGITAL_INPUTS: u16 = 0x60FD;
/// Digital (physical) outputs: the bits in sub-index 1 (bit 0 the brake, 1 opens it; bits 16 to 31 free to the maker), their mask in 2.
pub const DIGITAL_OUTPUTS: u16 = 0x60FE;
/// Highest torque in the positive direction.
pub const POSITIVE_TORQUE_LIMIT: u16 = 0x60E0;
/// Highest torque in the negative direction.
pub const NEGATIVE_TORQUE_LIMIT: u16 = 0x60E1;
/// Target velocity.
pub const TARGET_VELOCITY: u16 = 0x60FF;
/// Modes that the drive supports.
pub const SUPPORTED_MODES: u16 = 0x6502;
/// How outputs are synchronised (ETG.1020).
pub const SYNC_OF_OUTPUTS: u16 = 0x1C32;
/// What is done about process data that are missing (ETG.1020): sub-index 2 how many are forgiven.
pub const SYNC_ERRORS: u16 = 0x10F1;
/// Which PDOs the drive receives.
pub const RECEIVE_ASSIGN: u16 = 0x1C12;
/// Which PDOs the drive transmits.
pub const TRANSMIT_ASSIGN: u16 = 0x1C13;

/// What limits the torque of a drive: both ways on their own, or together.
pub const TORQUE_LIMITS: [u16; 3] = [POSITIVE_TORQUE_LIMIT, NEGATIVE_TORQUE_LIMIT, MAX_TORQUE];

/// Name and size in bits of an object that the controller uses.
pub fn standard(index: u16, sub: u8) -> Option<(&'static str, u32)> {
    let known = match (index, sub) {
        (ABORT_CONNECTION, 0) => ("abort connection option code", 16),
        (ERROR_CODE, 0) => ("error code", 16),
        (CONTROLWORD, 0) => ("controlword", 16),
        (STATUSWORD, 0) => ("statusword", 16),
        (QUICK_STOP, 0) => ("quick stop option code", 16),
        (DISABLE_OPERATION, 0) => ("disable operation option code", 16),
        (HALT, 0) => ("halt option code", 16),
        (FAULT_REACTION, 0) => ("fault reaction option code", 16),
        (MODE, 0) => ("mode of operation", 8),
        (MODE_DISPLAY, 0) => ("mode of operation in force", 8),
        (CONVERTER_TARGET_VELOCITY, 0) => ("target velocity of a converter", 16),
        (CONVERTER_VELOCITY, 0) => ("actual velocity of a converter", 16),
        (POSITION, 0) => ("actual position", 32),
        (FOLLOWING_ERROR_WINDOW, 0) => ("following error window", 32),
        (VELOCITY, 0) => ("actual velocity", 32),
        (TARGET_TORQUE, 0) => ("target torque", 16),
        (MAX_TORQUE, 0) => ("highest torque", 16),
        (TORQUE, 0) => ("actual torque", 16),
        (TARGET_POSITION, 0) => ("target position", 32),
        (MAX_PROFILE_VELOCITY, 0) => ("highest profile velocity", 32),
        (VELOCITY_OFFSET, 0) => ("velocity offset", 32),
        (TORQUE_OFFSET, 0) => ("torque offset", 16),
        (TOUCH_PROBE_FUNCTION, 0) => ("touch probe function", 16),
        (TOUCH_PROBE_STATUS, 0) => ("touch probe status", 16),
        (TOUCH_PROBE_1_RISING, 0) => ("touch probe 1, position of its positive edge", 32),
        (TOUCH_PROBE_1_FALLING, 0) => ("touch probe 1, position of its negative edge", 32),
        (TOUCH_PROBE_2_RISING, 0) => ("touch probe 2, position of its positive edge", 32),
        (TOUCH_PROBE_2_FALLING, 0) => ("touch probe 2, position of its negative edge", 32),
        (INTERPOLATION_TIME, 1) => ("interpolation time, mantissa", 8),
        (INTERPOLATION_TIME, 2) => ("interpolation time, exponent", 8),
        (POSITIVE_TORQUE_LIMIT, 0) => ("highest positive torque", 16),
        (NEGATIVE_TORQUE_LIMIT, 0) => ("highest negative torque", 16),
        (TARGET_VELOCITY, 0) => ("target velocity", 32),
        _ => return None,
    };
    Some(known)
}

/// Whether an object in process data holds the drive back while it is 0.
pub fn is_limit(index: u16) -> bool {
    let of_torque = [
        MAX_TORQUE,
        POSITIVE_TORQUE_LIMIT,
        NEGATIVE_TORQUE_LIMIT,
        MAX_CURRENT,
    ];
    of_torque.contains(&index) || [MAX_PROFILE_VELOCITY, MAX_MOTOR_SPEED].contains(&index)
}

/// An object as messages name it: `6040`, `60C2:1`, with its name where that is known.
pub fn named(index: u16, sub: u8) -> String {
    let number = number(index, sub);
    let (axis, of_first) = of_axis(index).unwrap_or((0, index));
    match (standard(of_first, sub), axis) {
        (Some((name, _)), 0) => format!("{number} ({name})"),
        (Some((name, _)), axis) => format!("{number} ({name}, axis {})", axis + 1),
        (None, _) => number,
    }
}

/// Which axis of a drive an object is of, from 0, and the same object of the first one; none of an object of the whole drive.
pub fn of_axis(index: u16) -> Option<(u16, u16)> {
    let above = OBJECTS_OF_AXES
        .contains(&index)
        .then(|| index - OBJECTS_OF_AXES.start)?;
    Some((
        above / OBJECTS_OF_AXIS,
        OBJECTS_OF_AXES.start + above % OBJECTS_OF_AXIS,
    ))
}

/// An object as an axis of a drive sees it, axes from 0: its own objects have the numbers of the first axis; none for an object of another.
pub fn seen_by(index: u16, axis: u16) -> Option<u16> {
    match of_axis(index) {
        None => Some(index),
        Some((of, index)) => (of == axis).then_some(index),
    }
}

/// The object of an axis of a drive, from 0, that an object of the first one is; others are the same for all.
pub fn on_axis(index: u16, axis: u16) -> u16 {
    match of_axis(index) {
        Some((0, index)) => index + axis * OBJECTS_OF_AXIS,
        _ => index,
    }
}

/// An object by its number: `6040`, `60C2:1`.
pub fn number(index: u16, sub: u8) -> String {
    match sub {
        0 => format!("{index:04X}"),
        sub => format!("{index:04X}:{sub}"),
    }
}
