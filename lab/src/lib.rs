//! What breaks and measures a cell: faulty ports, the in-process cell, benches, soak, judges of invariants. May use
//! everything; nothing uses it but the command line.

pub mod bench;
pub mod cell;
pub mod corruption;
pub mod faceted;
pub mod faulty;
pub mod invariants;
pub mod least_time;
pub mod linuxcnc;
pub mod liveness;
pub mod options;
pub(crate) mod processor_time;
pub mod promises;
pub mod reading;
pub mod recording;
pub mod soak;
pub mod staying;
pub mod stock;
pub mod suite;
pub mod tampering;
