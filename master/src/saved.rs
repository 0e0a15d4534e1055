//! What outlives a master: its latches and the state of its drives, saved each scan, so that a replacement knows where the
//! axes really are and where the path was left.

use bus::sample::MAX_AXES;
use bytemuck::{Pod, Zeroable};

use crate::drives::{Drives, StateRefused};
use crate::master::{AuxiliaryLatches, HomingLatches, QuestionLatches};
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
    pub program_start: [i64; MAX_AXES],
    /// Override in percent.
    pub override_percent: u32,
    /// Scans overrun so far.
    pub overrun_scans: u32,
    /// 1 if somebody had asked for a stop: the run may end.
    pub may_end: u32,
    /// 1 if the cell was ordered to end.
    pub ends: u32,
    /// Number of the program that was loaded last.
    pub load: u32,
    /// [`ProgramState`](bus::sample::ProgramState) of it.
    pub program: u32,
    /// Programs started so far.
    pub run: u32,
    /// 1 while feed hold is latched.
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
}

/// One saved state: the latches, then the drives.
#[derive(Debug, Clone)]
pub struct SavedState {
    bytes: Vec<u8>,
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

    /// The bytes, to be filled with a state that was saved.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.bytes
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
