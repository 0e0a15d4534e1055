//! How a run ended: the master alone decides it, and all who show it read it here.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::Feedback;
use crate::table;

wire_enum! {
    /// How a run ended, in one word.
    pub enum RunOutcome {
        /// The program is done and the machine in position.
        Completed = 1 => "completed",
        /// By an order, where nothing was wrong.
        Interrupted = 2 => "interrupted",
        /// For the cause of a stop or trip, or because a process is lost that the cell needs.
        Stopped = 3 => "stopped",
    }
    /// The word for it in events, reports and lists.
    pub fn word
}

/// The run that ended last, and how. It stays until another one ends, also in a master that replaces this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/EndedRun/1")]
#[repr(C)]
pub struct EndedRun {
    /// The last scan whose feedback is of it.
    pub scan: u64,
    /// First scan with its cause.
    pub cause_scan: u64,
    /// Its number; 0 where none has ended yet.
    pub run: u32,
    /// [`RunOutcome`].
    pub outcome: u32,
    /// [`Mode`](super::Mode) in which it ended.
    pub mode: u32,
    /// [`Cause`](super::Cause) of the stop or trip.
    pub cause: u32,
    /// Axis that caused it (index), or `u32::MAX`.
    pub cause_axis: u32,
    /// What the drive of that axis says of it; 0 for nothing.
    pub drive_code: u32,
    /// [`Order`](super::Order) that ended it; 0 where none did.
    pub order: u32,
    /// Always 0.
    pub reserved: u32,
}
table!(EndedRun: scan, cause_scan, run, outcome, mode, cause, cause_axis, drive_code, order, reserved);

impl Feedback {
    /// How the run of this number ended, if it is the one that ended last.
    pub fn end_of(&self, run: u32) -> Option<(RunOutcome, &EndedRun)> {
        let ended = Some(&self.ended).filter(|ended| run != 0 && ended.run == run)?;
        Some((RunOutcome::from_wire(ended.outcome)?, ended))
    }
}
