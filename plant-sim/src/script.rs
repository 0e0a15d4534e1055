//! Scripts of a simulated run: faults to inject and orders to obey, each at its scan, so that the run repeats to the bit.
//! Real drives have none of this.

pub mod faults;
pub mod injector;
pub mod orders;
pub mod ports;
pub mod reach;
pub mod rng;
