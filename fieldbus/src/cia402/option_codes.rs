//! What a drive does when it is told to stop, to switch off, or is left alone.

use super::{ABORT_CONNECTION, DISABLE_OPERATION, FAULT_REACTION, HALT, QUICK_STOP};

/// An object that says how the drive reacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum OptionCode {
    /// 605A: the order quick stop.
    QuickStop = QUICK_STOP,
    /// 605C: the order disable operation.
    DisableOperation = DISABLE_OPERATION,
    /// 605D: the halt bit.
    Halt = HALT,
    /// 605E: a fault.
    FaultReaction = FAULT_REACTION,
    /// 6007: the bus falls silent.
    AbortConnection = ABORT_CONNECTION,
}

/// What becomes of an axis that moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// It is braked, and held at rest.
    Held,
    /// It is braked; at rest the drive switches off.
    Braked,
    /// The drive reports a fault, and does what it does then (605E).
    Fault,
    /// The drive switches off: the axis coasts.
    Coasts,
    /// Nothing happens: it goes on moving.
    GoesOn,
    /// The vendor's own meaning, or none at all: it may coast.
    Unknown,
}

impl Effect {
    /// Whether an axis may go on by itself, without torque or with the last command.
    pub fn may_coast(self) -> bool {
        matches!(self, Effect::Coasts | Effect::GoesOn | Effect::Unknown)
    }

    /// It in words.
    pub fn words(self) -> &'static str {
        match self {
            Effect::Held => "brakes and holds the axis",
            Effect::Braked => "brakes the axis, then switches off",
            Effect::Fault => "a fault, with the reaction to it (605E)",
            Effect::Coasts => "switches off: the axis coasts",
            Effect::GoesOn => "nothing: the axis goes on",
            Effect::Unknown => "the vendor's own meaning: the axis may coast",
        }
    }
}

impl OptionCode {
    /// All of them.
    pub const ALL: [OptionCode; 5] = [
        OptionCode::QuickStop,
        OptionCode::DisableOperation,
        OptionCode::Halt,
        OptionCode::FaultReaction,
        OptionCode::AbortConnection,
    ];

    /// Its object.
    pub fn index(self) -> u16 {
        self as u16
    }

    /// Its key in a drive file.
    pub fn key(self) -> &'static str {
        match self {
            OptionCode::QuickStop => "quick_stop",
            OptionCode::DisableOperation => "disable_operation",
            OptionCode::Halt => "halt",
            OptionCode::FaultReaction => "fault_reaction",
            OptionCode::AbortConnection => "abort_connection",
        }
    }

    /// The value to set it to: the axis is braked.
    pub fn braking(self) -> i64 {
        match self {
            OptionCode::QuickStop => 6,
            OptionCode::DisableOperation | OptionCode::Halt => 1,
            OptionCode::FaultReaction => 2,
            OptionCode::AbortConnection => 3,
        }
    }

    /// What a value means (CiA 402-2).
    pub fn effect(self, value: i64) -> Effect {
        match (self, value) {
            (OptionCode::QuickStop, 1..=4) => Effect::Braked,
            (OptionCode::QuickStop, 5..=8) => Effect::Held,
            (OptionCode::DisableOperation, 1) => Effect::Braked,
            (OptionCode::Halt, 1..=4) => Effect::Held,
            (OptionCode::FaultReaction, 1..=4) => Effect::Braked,
            (OptionCode::AbortConnection, 0) => Effect::GoesOn,
            (OptionCode::AbortConnection, 1) => Effect::Fault,
            (OptionCode::AbortConnection, 2) => Effect::Coasts,
            (OptionCode::AbortConnection, 3) => Effect::Braked,
            (OptionCode::Halt, 0) => Effect::Unknown,
            (_, 0) => Effect::Coasts,
            _ => Effect::Unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_to_set_brakes_the_axis() {
        for code in OptionCode::ALL {
            assert!(!code.effect(code.braking()).may_coast(), "{code:?}");
        }
    }

    #[test]
    fn zero_and_negative_values_may_coast() {
        for code in OptionCode::ALL {
            assert!(code.effect(0).may_coast(), "{code:?}");
            assert!(code.effect(-1).may_coast(), "{code:?}");
        }
    }
}
