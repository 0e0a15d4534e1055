//! What outlives a master: its latches and the state of its drives, saved each scan, so that a replacement knows where the
//! axes really are and where the path was left.

use bus::sample::{Answer, EndedRun, Levels, MAX_AXES, PATH_AXES};
use bytemuck::{Pod, Zeroable};

use crate::drives::{Drives, StateRefused};
use crate::window_arbiter::Left;

/// What the master had latched.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Latches {
    /// The scan they are of.
    pub scan: u64,
    /// The motion digest up to then, high and low half.
    pub digest: [u64; 2],
    /// Where the path was left.
    pub left: Left,
    /// Command positions the program was started from.
    pub program_start: [i64; PATH_AXES],
    /// The run that ended last.
    pub ended: EndedRun,
    /// Override in percent.
    pub override_percent: u32,
    /// Scans overrun so far.
    pub overrun_scans: u32,
    /// 1 if somebody had asked for a stop: the run may end.
    pub may_end: u32,
    /// 1 if the cell was ordered to end, 2 if for the loss of a process.
    pub ends: u32,
    /// Number of the program that was loaded last.
    pub load: u32,
    /// [`ProgramState`](bus::sample::ProgramState) of it.
    pub program: u32,
    /// Programs started so far.
    pub run: u32,
    /// [`HoldReason`](bus::sample::HoldReason) of the feed hold that is latched.
    pub hold: u32,
    /// Typed-in blocks have the program's place: 1, or 2 where M2 or M30 ends them.
    pub typed: u32,
    /// Number under which the program before them is read again; 0 for none.
    pub typed_before: u32,
    /// Spindle, coolant, outputs, tool and the events that are done.
    pub auxiliary: AuxiliaryLatches,
    /// What the program asked last, and the answer.
    pub questions: QuestionLatches,
    /// Where the axes are that have been homed.
    pub homing: HomingLatches,
    /// Signals that an operator has set or forced.
    pub signals: SignalLatches,
}

/// The most signals that can be set or forced at a time.
pub const HELD_SIGNALS_MAX: usize = 32;

/// Signals that an operator has set or forced, and what he has not acknowledged.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct SignalLatches {
    /// Each of them.
    pub held: [HeldSignal; HELD_SIGNALS_MAX],
    /// Alarms that nobody has acknowledged, a bit each.
    pub unacknowledged: u64,
}

/// A signal that an operator has set or forced.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct HeldSignal {
    /// Its value.
    pub value: f64,
    /// Its index in the machine file and 1; 0 for none.
    pub of: u32,
    /// 1 if it is forced over its source, 2 for what the axis of its pulses has travelled, in mm.
    pub how: u32,
}

/// Spindle, coolant, outputs, tool, the operator's switches and the events that are done.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct AuxiliaryLatches {
    /// As the program has commanded them, whether or not they act now.
    pub levels: Levels,
    /// S, in rev/min.
    pub speed_rpm: f64,
    /// While the spindle follows an axis, the travel for one turn, in mm.
    pub mm_per_turn: f64,
    /// Angle where that began, in turns.
    pub coupled_turns: f64,
    /// Place of the axis where that began, in mm.
    pub coupled_place_mm: f64,
    /// While the speed follows a radius (G96), the cutting speed, in m/min.
    pub surface_m_min: f64,
    /// It turns no faster then, in rev/min; 0 for no limit.
    pub surface_limit_rpm: f64,
    /// Place of the axis that the spindle turns about, in mm.
    pub surface_centre_mm: f64,
    /// Offset of the tool that is applied, by axis, in mm and degrees.
    pub tool_offset: [f64; PATH_AXES],
    /// Events of the program that are done.
    pub events_done: u32,
    /// 1 clockwise, 2 counter-clockwise, 0 at rest.
    pub direction: u32,
    /// [`Waiting`](bus::sample::Waiting): the stop that the operator ends.
    pub stopped_for: u32,
    /// Its line.
    pub line: u32,
    /// 1 while optional stops are obeyed.
    pub optional_stop: u32,
    /// 1 while the override does not count.
    pub override_disabled: u32,
    /// Tool in the spindle, where the operator changes it.
    pub tool: u32,
    /// Messages that the path has come to.
    pub messages: u32,
    /// Of the axis that the spindle follows, its index and 1; 0 for none.
    pub coupled: u32,
    /// Of the axis whose place is the radius, its index and 1; 0 for a speed that follows none.
    pub surface: u32,
    /// 1 while single block is switched on.
    pub single_block: u32,
    /// Override of rapids, in percent.
    pub rapid_override_percent: u32,
    /// Line that the program is to be started at, until the tool is on its path; 0 for none.
    pub start_line: u32,
    /// Number of the tool whose offset is applied; 0 for none.
    pub tool_offset_of: u32,
    /// The run whose modes are in force, 0 or [`bus::sample::MODES_RESET`].
    pub modes_of_run: u32,
    /// Override of jogs, in percent.
    pub jog_override_percent: u32,
}

/// Where the axes are that have been homed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct HomingLatches {
    /// Position of the machine less raw position of the drive, by axis, in increments.
    pub offset: [i64; MAX_AXES],
    /// Axes that are homed, a bit each.
    pub homed: u64,
    /// Axes that are not homed, whose drives are lost or came back elsewhere.
    pub unsure: u64,
}

/// What the program asked last, and the answer.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct QuestionLatches {
    /// What the feedback says.
    pub answer: Answer,
    /// Index of the probing event that was begun last.
    pub probe: u32,
    /// Number of the event whose answer the planner has taken last.
    pub taken: u32,
}

/// One saved state: the latches, then the drives.
#[derive(Debug, Clone)]
pub struct SavedState {
    /// All of it; to be filled with a state that was saved.
    pub bytes: Vec<u8>,
}

impl SavedState {
    /// Room for the state of these drives.
    pub fn of(drives: &impl Drives) -> SavedState {
        SavedState {
            bytes: vec![0; size_of::<Latches>() + drives.state_bytes()],
        }
    }

    /// Takes the state after a scan; its bytes.
    pub fn save(&mut self, latches: &Latches, drives: &impl Drives) -> &[u8] {
        if let Some((head, tail)) = self.bytes.split_at_mut_checked(size_of::<Latches>()) {
            head.copy_from_slice(bytemuck::bytes_of(latches));
            drives.save(tail);
        }
        &self.bytes
    }

    /// Takes what was latched since; the drives are as they were saved last. Its bytes.
    pub fn latch(&mut self, latches: &Latches) -> &[u8] {
        if let Some((head, _)) = self.bytes.split_at_mut_checked(size_of::<Latches>()) {
            head.copy_from_slice(bytemuck::bytes_of(latches));
        }
        &self.bytes
    }

    /// Puts the drives where this state has them; its latches.
    ///
    /// # Errors
    /// The state holds what no machine can have.
    pub fn restore(&self, drives: &mut impl Drives) -> Result<Latches, StateRefused> {
        let (head, tail) = self
            .bytes
            .split_at_checked(size_of::<Latches>())
            .ok_or(StateRefused)?;
        drives.restore(tail)?;
        Ok(bytemuck::pod_read_unaligned(head))
    }
}
