//! Modes of operation.

use schemars::JsonSchema;
use serde::Deserialize;

use super::{
    CONTROLWORD, CONVERTER_TARGET_VELOCITY, CONVERTER_VELOCITY, ERROR_CODE, MODE, MODE_DISPLAY,
    POSITION, STATUSWORD, TARGET_POSITION, TARGET_TORQUE, TARGET_VELOCITY, TORQUE, TORQUE_OFFSET,
    VELOCITY, VELOCITY_OFFSET,
};

/// A mode of operation that a drive may support (object 6502).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DriveMode {
    /// Profile position.
    ProfilePosition,
    /// Velocity, as frequency converters have it.
    Velocity,
    /// Profile velocity.
    ProfileVelocity,
    /// Profile torque.
    ProfileTorque,
    /// Homing.
    Homing,
    /// Interpolated position.
    InterpolatedPosition,
    /// Cyclic synchronous position.
    Csp,
    /// Cyclic synchronous velocity.
    Csv,
    /// Cyclic synchronous torque.
    Cst,
    /// Cyclic synchronous torque with commutation angle.
    Cstca,
}

impl DriveMode {
    /// All, each with its bit in object 6502 and its word in a drive file.
    pub const ALL: [(DriveMode, u32, &'static str); 10] = [
        (DriveMode::ProfilePosition, 0, "profile-position"),
        (DriveMode::Velocity, 1, "velocity"),
        (DriveMode::ProfileVelocity, 2, "profile-velocity"),
        (DriveMode::ProfileTorque, 3, "profile-torque"),
        (DriveMode::Homing, 5, "homing"),
        (DriveMode::InterpolatedPosition, 6, "interpolated-position"),
        (DriveMode::Csp, 7, "csp"),
        (DriveMode::Csv, 8, "csv"),
        (DriveMode::Cst, 9, "cst"),
        (DriveMode::Cstca, 10, "cstca"),
    ];

    /// Those that a value of object 6502 names.
    pub fn of(supported: i64) -> Vec<DriveMode> {
        let named = DriveMode::ALL.iter();
        let named = named.filter(|(_, bit, _)| (supported >> bit) & 1 == 1);
        named.map(|(mode, _, _)| *mode).collect()
    }

    /// Its word in a drive file.
    pub fn word(self) -> &'static str {
        let mut all = DriveMode::ALL.iter();
        all.find(|(mode, _, _)| *mode == self)
            .map_or("", |(_, _, word)| word)
    }

    /// Words of several, with commas between.
    pub fn words(modes: &[DriveMode]) -> String {
        let words: Vec<&str> = modes.iter().map(|mode| mode.word()).collect();
        words.join(", ")
    }
}

/// A mode in which the controller can drive an axis, or a spindle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OperatingMode {
    /// Cyclic synchronous velocity: the controller closes the position loop and adds torque (60B2) where the drive takes it.
    Csv = 9,
    /// Cyclic synchronous torque: the controller closes all loops but that of the current.
    Cst = 10,
    /// Cyclic synchronous position: the drive closes the position loop; the controller adds velocity (60B1) and torque (60B2) where it
    /// takes them.
    Csp = 8,
    /// Profile velocity, of spindles alone: the drive itself ramps to the speed that it is told.
    ProfileVelocity = 3,
    /// Velocity of frequency converters (6042 and 6044, in rev/min), of spindles alone.
    Velocity = 2,
}

impl OperatingMode {
    /// All, the one to prefer first.
    pub const ALL: [OperatingMode; 5] = [
        OperatingMode::Csv,
        OperatingMode::Cst,
        OperatingMode::Csp,
        OperatingMode::ProfileVelocity,
        OperatingMode::Velocity,
    ];

    /// Whether an axis can be driven in it; a spindle can in those that are told a speed.
    pub fn drives_axes(self) -> bool {
        !matches!(
            self,
            OperatingMode::ProfileVelocity | OperatingMode::Velocity
        )
    }

    /// Whether the drive is told a speed in it.
    pub fn is_told_speed(self) -> bool {
        self == OperatingMode::Csv || !self.drives_axes()
    }

    /// The objects of target and actual velocity in it.
    pub fn velocity_objects(self) -> (u16, u16) {
        match self {
            OperatingMode::Velocity => (CONVERTER_TARGET_VELOCITY, CONVERTER_VELOCITY),
            _ => (TARGET_VELOCITY, VELOCITY),
        }
    }

    /// Its value of object 6060.
    pub fn value(self) -> i64 {
        self as i64
    }

    /// The same as a drive reports it.
    pub fn as_drive_mode(self) -> DriveMode {
        match self {
            OperatingMode::Csp => DriveMode::Csp,
            OperatingMode::Csv => DriveMode::Csv,
            OperatingMode::Cst => DriveMode::Cst,
            OperatingMode::ProfileVelocity => DriveMode::ProfileVelocity,
            OperatingMode::Velocity => DriveMode::Velocity,
        }
    }

    /// Its word in a drive file.
    pub fn word(self) -> &'static str {
        self.as_drive_mode().word()
    }

    /// What the drive must receive.
    pub fn receive_needed(self) -> &'static [u16] {
        match self {
            OperatingMode::Csp => &[CONTROLWORD, TARGET_POSITION],
            OperatingMode::Csv | OperatingMode::ProfileVelocity => &[CONTROLWORD, TARGET_VELOCITY],
            OperatingMode::Velocity => &[CONTROLWORD, CONVERTER_TARGET_VELOCITY],
            OperatingMode::Cst => &[CONTROLWORD, TARGET_TORQUE],
        }
    }

    /// What it should receive besides.
    pub fn receive_wanted(self) -> &'static [u16] {
        match self {
            OperatingMode::Csp => &[VELOCITY_OFFSET, TORQUE_OFFSET, MODE],
            OperatingMode::Csv => &[TORQUE_OFFSET, MODE],
            OperatingMode::Cst | OperatingMode::ProfileVelocity | OperatingMode::Velocity => {
                &[MODE]
            }
        }
    }

    /// What the drive must transmit.
    pub fn transmit_needed(self) -> &'static [u16] {
        match self {
            OperatingMode::Csp | OperatingMode::Csv => &[STATUSWORD, POSITION],
            OperatingMode::Cst => &[STATUSWORD, POSITION, TORQUE],
            OperatingMode::ProfileVelocity => &[STATUSWORD, VELOCITY],
            OperatingMode::Velocity => &[STATUSWORD, CONVERTER_VELOCITY],
        }
    }

    /// What it should transmit besides.
    pub fn transmit_wanted(self) -> &'static [u16] {
        match self {
            OperatingMode::Csp | OperatingMode::Csv => {
                &[VELOCITY, TORQUE, ERROR_CODE, MODE_DISPLAY]
            }
            OperatingMode::Cst => &[VELOCITY, ERROR_CODE, MODE_DISPLAY],
            OperatingMode::ProfileVelocity => &[POSITION, TORQUE, ERROR_CODE, MODE_DISPLAY],
            OperatingMode::Velocity => &[TORQUE, ERROR_CODE, MODE_DISPLAY],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bits_of_6502_name_modes() {
        assert_eq!(
            DriveMode::of(0x380),
            [DriveMode::Csp, DriveMode::Csv, DriveMode::Cst]
        );
        assert_eq!(DriveMode::of(0), []);
        assert_eq!(DriveMode::of(-1).len(), DriveMode::ALL.len());
    }

    #[test]
    fn every_word_is_the_one_that_a_file_is_read_by() {
        #[derive(Deserialize)]
        struct Words {
            modes: Vec<DriveMode>,
        }
        let words = DriveMode::ALL.map(|(_, _, word)| format!("{word:?}"));
        let text = format!("modes = [{}]", words.join(", "));
        let read: Words = toml::from_str(&text).expect("words");
        assert_eq!(read.modes, DriveMode::ALL.map(|(mode, _, _)| mode));
    }
}
