//! A whole cell in one process: machine side, planner and servos take turns in the order that lockstep gives them.
//!
//! It calls the same `scan` functions as the real processes do and hands the same samples over, each visible in the scan
//! that the real one is visible in; so the machine side's digest is the same to the bit (docs/architecture.md). Also with
//! faults: a script kills, stops and restarts them and spoils their samples as it does to real processes, and what a process
//! remembers goes with it. What it leaves out is what lies between processes: shared memory, wake-ups, the launcher.
//!
//! [`invariants`] judges what is said, scan by scan.

mod cell;
pub mod invariants;
mod processes;
mod queues;
mod saved;

pub use cell::{Rehearsal, RehearsalError, Said, Script};
pub use queues::Window;
