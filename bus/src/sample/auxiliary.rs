//! What a machine has beside its axes, as it travels: events of the program from the planner to the master, and the levels of
//! spindle, coolant, outputs and tool from the master to everybody.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Digital outputs that a program can switch, M62 to M65 P0 to P63.
pub const DIGITAL_OUTPUTS: usize = 64;
/// Analogue outputs that a program can set, M67 and M68 E0 to E7.
pub const ANALOG_OUTPUTS: usize = 8;
/// Outputs to be set in motion that a planner names ahead of time.
pub const OUTPUTS_AHEAD: usize = 8;

/// What an event of the program asks for. Numbers stay what they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum EventCode {
    /// S: the spindle's speed, in rev/min.
    SpindleSpeed = 1,
    /// M3.
    SpindleClockwise = 2,
    /// M4.
    SpindleCounterClockwise = 3,
    /// M5.
    SpindleStop = 4,
    /// M19: the spindle stands at this angle, in degrees.
    SpindleOrient = 5,
    /// Before the first feed after a new speed or direction: the spindle turns at its speed.
    AwaitSpindle = 6,
    /// M7, M9: value 1 or 0.
    Mist = 7,
    /// M8, M9: value 1 or 0.
    Flood = 8,
    /// T: tool number `index` is to be ready for a change.
    ToolPrepare = 9,
    /// M6: tool number `index` into the spindle.
    ToolChange = 10,
    /// M1: stops where the operator has switched it on.
    OptionalStop = 11,
    /// M0.
    ProgramStop = 12,
    /// M60.
    PalletStop = 13,
    /// M64, M65 at rest; M62, M63 in motion: output `index`, value 1 or 0.
    DigitalOutput = 14,
    /// M68 at rest; M67 in motion: output `index` to the value.
    AnalogOutput = 15,
    /// M48, M49: value 1 or 0.
    Overrides = 16,
}

impl EventCode {
    /// All of them.
    pub const ALL: [EventCode; 16] = [
        EventCode::SpindleSpeed,
        EventCode::SpindleClockwise,
        EventCode::SpindleCounterClockwise,
        EventCode::SpindleStop,
        EventCode::SpindleOrient,
        EventCode::AwaitSpindle,
        EventCode::Mist,
        EventCode::Flood,
        EventCode::ToolPrepare,
        EventCode::ToolChange,
        EventCode::OptionalStop,
        EventCode::ProgramStop,
        EventCode::PalletStop,
        EventCode::DigitalOutput,
        EventCode::AnalogOutput,
        EventCode::Overrides,
    ];

    /// Decodes what came over the wire.
    pub fn from_wire(value: u32) -> Option<EventCode> {
        Self::ALL.into_iter().find(|code| *code as u32 == value)
    }
}

/// One event of the program, as the planner asks the master for it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/ProgramEvent/1")]
#[repr(C)]
pub struct ProgramEvent {
    /// Speed, angle, level or 1 and 0.
    pub value: f64,
    /// Counted from 1 in the order of the program; 0 for none.
    pub number: u32,
    /// [`EventCode`].
    pub code: u32,
    /// Which output or tool.
    pub index: u32,
    /// Line of the program.
    pub line: u32,
    /// The first element of the path that comes after it.
    pub element: u32,
    /// Kept zero.
    pub reserved: u32,
}

/// What a spindle is commanded to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum SpindleCommand {
    /// Come to rest.
    #[default]
    Stop = 0,
    /// Turn at [`Levels::spindle_rpm`].
    Turn = 1,
    /// Stand at [`Levels::orientation_deg`].
    Orient = 2,
}

impl SpindleCommand {
    /// Decodes what came over the wire; anything unknown stops.
    pub fn from_wire(value: u32) -> SpindleCommand {
        match value {
            1 => SpindleCommand::Turn,
            2 => SpindleCommand::Orient,
            _ => SpindleCommand::Stop,
        }
    }
}

/// Coolant as mist, in [`Levels::coolant`].
pub const MIST: u32 = 1;
/// Coolant as flood, in [`Levels::coolant`].
pub const FLOOD: u32 = 2;

/// What the machine beside its axes is commanded to be: levels, the same in each scan until they change, so that commanding them
/// again does no harm.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Levels/1")]
#[repr(C)]
pub struct Levels {
    /// Speed of the spindle, in rev/min, clockwise positive.
    pub spindle_rpm: f64,
    /// Angle that an oriented spindle stands at, in degrees.
    pub orientation_deg: f64,
    /// Analogue outputs.
    pub analog: [f64; ANALOG_OUTPUTS],
    /// Digital outputs, a bit each.
    pub digital: u64,
    /// [`SpindleCommand`].
    pub spindle: u32,
    /// [`MIST`] and [`FLOOD`].
    pub coolant: u32,
    /// Number of the tool that is to be in the spindle.
    pub tool: u32,
    /// Number of the tool that is to be ready for the next change.
    pub tool_prepared: u32,
}

/// What the program, or the machine, waits for at rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Waiting {
    /// Nothing.
    #[default]
    None = 0,
    /// The spindle comes to its speed.
    SpindleSpeed = 1,
    /// The spindle comes to rest.
    SpindleStandstill = 2,
    /// The spindle comes to its angle.
    SpindleOrientation = 3,
    /// The changer puts a tool into the spindle.
    ToolChange = 4,
    /// The operator puts a tool into the spindle and resumes.
    ToolByOperator = 5,
    /// M0: the operator resumes.
    ProgramStop = 6,
    /// M1: the operator resumes.
    OptionalStop = 7,
    /// M60: the operator changes the pallet and resumes.
    PalletStop = 8,
}

impl Waiting {
    /// All of them, each at its number.
    pub const ALL: [Waiting; 9] = [
        Waiting::None,
        Waiting::SpindleSpeed,
        Waiting::SpindleStandstill,
        Waiting::SpindleOrientation,
        Waiting::ToolChange,
        Waiting::ToolByOperator,
        Waiting::ProgramStop,
        Waiting::OptionalStop,
        Waiting::PalletStop,
    ];

    /// Decodes what came over the wire.
    pub fn from_wire(value: u32) -> Option<Waiting> {
        Self::ALL
            .into_iter()
            .find(|waiting| *waiting as u32 == value)
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Waiting::None => "nothing",
            Waiting::SpindleSpeed => "the spindle to reach its speed",
            Waiting::SpindleStandstill => "the spindle to stand",
            Waiting::SpindleOrientation => "the spindle to reach its angle",
            Waiting::ToolChange => "the tool changer",
            Waiting::ToolByOperator => "the operator to put in a tool",
            Waiting::ProgramStop => "the operator (program stop, M0)",
            Waiting::OptionalStop => "the operator (optional stop, M1)",
            Waiting::PalletStop => "the operator (pallet change, M60)",
        }
    }

    /// Whether the operator ends it, by `resume`.
    pub fn is_for_operator(self) -> bool {
        matches!(
            self,
            Waiting::ToolByOperator
                | Waiting::ProgramStop
                | Waiting::OptionalStop
                | Waiting::PalletStop
        )
    }
}

/// What the master says of spindle, coolant, outputs, tool and stops.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Auxiliaries/1")]
#[repr(C)]
pub struct Auxiliaries {
    /// Commanded in this scan.
    pub levels: Levels,
    /// Speed that the spindle shows, in rev/min, clockwise positive.
    pub spindle_rpm: f64,
    /// Events of the program that are done; the next one has the next number.
    pub events_done: u32,
    /// Line of the event that is waited for, or of the stop; 0 for none.
    pub line: u32,
    /// [`Waiting`].
    pub waiting: u32,
    /// 1 while no motion may be planned: the spindle is on its way back to the speed that the path was left with.
    pub blocked: u32,
    /// 1 while the spindle turns at its speed within the tolerance.
    pub at_speed: u32,
    /// 1 while the operator has optional stops (M1) switched on.
    pub optional_stop: u32,
    /// 1 while the program has switched the override off (M49).
    pub override_disabled: u32,
    /// Number of the tool in the spindle.
    pub tool: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_back_and_unknown_ones_are_not() {
        for code in EventCode::ALL {
            assert_eq!(EventCode::from_wire(code as u32), Some(code));
        }
        for (index, waiting) in Waiting::ALL.into_iter().enumerate() {
            assert_eq!(waiting as usize, index);
            assert_eq!(Waiting::from_wire(index as u32), Some(waiting));
        }
        assert_eq!(EventCode::from_wire(0), None);
        assert_eq!(EventCode::from_wire(17), None);
        assert_eq!(Waiting::from_wire(9), None);
        assert_eq!(SpindleCommand::from_wire(9), SpindleCommand::Stop);
    }
}
