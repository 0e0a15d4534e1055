//! What the fieldbus did in a scan, as the master publishes it.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::MAX_AXES;

use crate::table;

/// What became of the cycle of a scan on the fieldbus, and what was counted since the bus started. For observers alone: what a wire
/// does is chance, also in lockstep, so no controller reads it and it counts in no digest. Cells with simulated drives have none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/BusCycle/2")]
#[repr(C)]
pub struct BusCycle {
    /// The scan whose commands the cycle carried.
    pub scan: u64,
    /// First scan in which a reader may act on it.
    pub visible_from: u64,
    /// Cycles that were sent.
    pub sent: u64,
    /// Cycles without an answer in time.
    pub missed: u64,
    /// Cycles that were answered, and that somebody took no part in.
    pub short: u64,
    /// Frames of an earlier cycle, or a second time.
    pub late: u64,
    /// Frames of others, and damaged ones.
    pub foreign: u64,
    /// Cycles in which the master had nothing new.
    pub repeated: u64,
    /// From sending to the answer, in ns; 0 if this cycle was not answered, or answered to an owner of the bus that died meanwhile.
    pub round_trip_ns: u64,
    /// How much later than in the middle between two SYNC0 the frame passed the reference clock, in ns; of this cycle if it was
    /// answered and there are distributed clocks, else 0.
    pub clock_offset_ns: i64,
    /// 1 if the cycle was answered.
    pub answered: u32,
    /// 1 with distributed clocks.
    pub distributed_clocks: u32,
    /// Slaves that were in operation in the last cycle that was answered.
    pub slaves_operational: u32,
    /// Slaves on the segment.
    pub slave_count: u32,
    /// Axes in use.
    pub axis_count: u32,
    /// Kept zero.
    pub reserved: u32,
    /// Digital inputs of the drive of each axis (CiA 402 object 60FDh), 0 where they are not in its process data.
    pub inputs: [u64; MAX_AXES],
}
table!(
    BusCycle: scan, visible_from, sent, missed, short, late, foreign, repeated, round_trip_ns, clock_offset_ns,
    answered, distributed_clocks, slaves_operational, slave_count, axis_count, reserved, inputs @ Axes,
);

impl BusCycle {
    /// Time from sending to the answer, in s; none where it is not known.
    pub fn round_trip_s(&self) -> Option<f64> {
        let known = self.answered == 1 && self.round_trip_ns > 0;
        known.then_some(self.round_trip_ns as f64 / 1e9)
    }

    /// How much later than in the middle between two SYNC0 the frame came, in s; none without an answer or without distributed clocks.
    pub fn clock_offset_s(&self) -> Option<f64> {
        let known = self.answered == 1 && self.distributed_clocks == 1;
        known.then_some(self.clock_offset_ns as f64 / 1e9)
    }
}
