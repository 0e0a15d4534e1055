//! What the logic of a machine says, as its process publishes it.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::{SIGNALS_MAX, SignalSet};
use crate::table;

/// In [`LogicAnswer::requests`]: the machine comes to rest on the path.
pub const LOGIC_HOLD: u32 = 1;
/// The program is stopped.
pub const LOGIC_STOP: u32 = 2;
/// No program is started or resumed.
pub const LOGIC_INHIBIT: u32 = 4;
/// The machine brakes at its limits and trips.
pub const LOGIC_TRIP: u32 = 8;

/// Answer of the logic to a scan: the outputs that it sets, and what it asks of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/LogicAnswer/1")]
#[repr(C)]
pub struct LogicAnswer {
    /// Scan whose feedback this answers; takes effect one scan later.
    pub scan: u64,
    /// First scan in which a reader may act on it.
    pub visible_from: u64,
    /// Signals that it has set since it was started.
    pub sets: SignalSet,
    /// Alarms that it raises, a bit each in the order of the machine file.
    pub alarms: u64,
    /// Incarnation of its process.
    pub incarnation: u32,
    /// 1 while the program of the logic answers; 0 once it is lost, until it has been started again.
    pub answers: u32,
    /// [`LOGIC_HOLD`] and the others.
    pub requests: u32,
    /// Signals in use.
    pub count: u32,
    /// Values of the signals that it sets.
    pub values: [f64; SIGNALS_MAX],
    /// Of all that stands before it and is in use (XXH3-64).
    pub checksum: u64,
}
table!(
    LogicAnswer: scan, visible_from, sets, alarms, incarnation, answers, requests, count, values, checksum,
);

impl LogicAnswer {
    /// The values of the signals there are.
    pub fn values(&self) -> &[f64] {
        self.values
            .get(..self.count as usize)
            .unwrap_or(&self.values)
    }
}
