//! What a machine has beside its axes, as it travels: events of the program from the planner to the master, and the levels of
//! spindle, coolant, outputs and tool from the master to everybody.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::PATH_AXES;

use crate::table;

/// Digital outputs that a program can switch, M62 to M65 P0 to P63.
pub const DIGITAL_OUTPUTS: usize = 64;
/// Analogue outputs that a program can set, M67 and M68 E0 to E7.
pub const ANALOG_OUTPUTS: usize = 8;
/// Outputs to be set in motion that a planner names ahead of time.
pub const OUTPUTS_AHEAD: usize = 8;

wire_enum! {
    /// What an event of the program asks for. Numbers stay what they are.
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
        /// G38.2 to G38.5: from here on contact ends the motion; `index` holds [`PROBE_AWAY`](super::PROBE_AWAY) and
        /// [`PROBE_MUST`](super::PROBE_MUST).
        Probe = 21,
        /// The end of a probing motion: asked for only where it came to its end without contact.
        ProbeEnd = 22,
        /// M66: an input is read, after a wait of at most `value` s; `index` is an [`AskedInput`](super::AskedInput).
        AwaitInput = 23,
        /// M61: tool number `index` is in the spindle.
        ToolIs = 25,
        /// The end of a program on a machine whose programs keep parameters: they are kept before it is asked for.
        KeepParameters = 26,
        /// M100 to M199: a program of the machine builder, code `index`, which has run to its end before it is asked for.
        UserCode = 27,
        /// Rigid tapping begins: the spindle comes to rest, and from then on follows axis `index`: a turn in the direction that the program
        /// gave it for each `value` mm (below 0 where the axis goes in against its sense).
        SpindleCouple = 17,
        /// It ends: the spindle turns by itself again, as the program has it.
        SpindleUncouple = 18,
        /// G96: the spindle's axis is at this place of axis `index`, in mm.
        SurfaceCentre = 28,
        /// D of G96: the spindle turns no faster, in rev/min; 0 for no limit.
        SurfaceLimit = 29,
        /// S in G96, behind both: cutting speed at axis `index`, in m/min.
        SurfaceSpeed = 30,
        /// Single block: the path rests behind a block, `element` elements of it are done. Its number is 0: no program asks for it.
        BlockDone = 31,
        /// Start at a line: what stands before it is set, which is `value` events; its first motion is `element`.
        StartAt = 32,
        /// G43 and G49, with the motion behind them: the offset of the tool along axis `index` is `value`, in mm or degrees.
        ToolOffset = 33,
        /// Before it: that is the offset of tool `index`; 0 where it is none's.
        ToolOffsetOf = 34,
        /// (ABORT, …): the program is given up.
        Abort = 35,
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
table!(ProgramEvent: value, number, code, index, line, element, reserved);

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
    /// Turn at [`Levels::spindle_rpm`], another speed in each scan, in step with an axis; left alone, brake with that axis so that
    /// both come to rest together ([`Levels::followed_axis`]).
    Follow = 3,
}

impl SpindleCommand {
    /// Decodes what came over the wire; anything unknown stops.
    pub fn from_wire(value: u32) -> SpindleCommand {
        match value {
            1 => SpindleCommand::Turn,
            2 => SpindleCommand::Orient,
            3 => SpindleCommand::Follow,
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
#[type_name("quadrant/Levels/3")]
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
    /// Index of the axis that a [following](SpindleCommand::Follow) spindle is in step with.
    pub followed_axis: u32,
    /// For no drive: elements of the path up to the end of the block that single block has stopped behind last, in this run.
    pub blocks_done: u32,
}
table!(
    Levels: spindle_rpm, orientation_deg, analog, digital, spindle, coolant, tool, tool_prepared, followed_axis,
    blocks_done,
);

wire_enum! {
    /// What the program, or the machine, waits for at rest.
    #[derive(Default)]
    pub enum Waiting {
        /// Nothing.
        #[default]
        None = 0 => "nothing",
        /// The spindle comes to its speed.
        SpindleSpeed = 1 => "the spindle to reach its speed",
        /// The spindle comes to rest.
        SpindleStandstill = 2 => "the spindle to stand",
        /// The spindle comes to its angle.
        SpindleOrientation = 3 => "the spindle to reach its angle",
        /// The changer puts a tool into the spindle.
        ToolChange = 4 => "the tool changer",
        /// The operator puts a tool into the spindle and resumes.
        ToolByOperator = 5 => "the operator to put in a tool",
        /// M0: the operator resumes.
        ProgramStop = 6 => "the operator (program stop, M0)",
        /// M1: the operator resumes.
        OptionalStop = 7 => "the operator (optional stop, M1)",
        /// M60: the operator changes the pallet and resumes.
        PalletStop = 8 => "the operator (pallet change, M60)",
        /// An input shows what M66 waits for, or the wait has lasted too long.
        Input = 9 => "an input (M66)",
        /// Single block: the block is done, the operator resumes.
        SingleBlock = 10 => "the operator (single block)",
        /// The machine does an M-code.
        MachineCode = 11 => "the machine to do an M-code",
    }
    /// In words.
    pub fn words
}

impl Waiting {
    /// Whether the operator ends it, by `resume`.
    pub fn is_for_operator(self) -> bool {
        matches!(
            self,
            Waiting::ToolByOperator
                | Waiting::ProgramStop
                | Waiting::OptionalStop
                | Waiting::PalletStop
                | Waiting::SingleBlock
        )
    }
}

/// What the master says of spindle, coolant, outputs, tool and stops.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Auxiliaries/7")]
#[repr(C)]
pub struct Auxiliaries {
    /// Commanded in this scan.
    pub levels: Levels,
    /// Speed that the spindle shows, in rev/min, clockwise positive.
    pub spindle_rpm: f64,
    /// Angle that the spindle's encoder shows, in turns, clockwise positive; whole at the index. 0 without an encoder.
    pub spindle_turns: f64,
    /// What the spindle lags behind the axis that it is in step with, in turns; 0 where it is not.
    pub spindle_lag_turns: f64,
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
    /// Of the axis that the spindle is in step with, its index and 1; 0 for none.
    pub coupled: u32,
    /// Line that the program is to be started at, until the tool is on its path there; 0 for none.
    pub start_line: u32,
    /// Number of the tool whose offset is applied (G43); 0 for none, or one of the program's own (G43.1).
    pub tool_offset_of: u32,
    /// The run whose modes are in force between two runs: the last one that came to its end. 0 before the first;
    /// [`MODES_RESET`] where a run was given up, or `reset` was ordered.
    pub modes_of_run: u32,
    /// Offset of the tool that is applied, by axis, in mm and degrees; all 0 after G49.
    pub tool_offset: [f64; PATH_AXES],
}
table!(
    Auxiliaries: levels, spindle_rpm, spindle_turns, spindle_lag_turns, events_done, line, waiting, blocked, at_speed,
    optional_stop, override_disabled, tool, coupled, start_line,
    tool_offset_of, modes_of_run, tool_offset,
);

/// No run's modes are in force, but those that M2 leaves.
pub const MODES_RESET: u32 = u32::MAX;

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
        assert_eq!(EventCode::from_wire(19), None);
        assert_eq!(Waiting::from_wire(12), None);
        assert_eq!(SpindleCommand::from_wire(9), SpindleCommand::Stop);
    }
}
