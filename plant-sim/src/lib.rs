//! Simulated drives, motors, mechanics and friction, and the process that runs a master over them.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod auxiliary;
pub mod axis;
pub mod bridge;
pub mod contacts;
pub mod cross_talk;
pub mod cutting;
pub mod drive;
pub mod drives;
pub mod friction;
mod holding_brake;
pub mod homing;
pub mod inputs;
pub mod lost_motion;
pub mod measurement;
pub mod mechanics;
pub mod pitch_error;
pub mod plant_file;
pub mod probe;
pub mod run;
pub mod script;
pub mod setup;
pub mod sliding_curve;
pub mod spindle;
mod state_bytes;
mod swinging;
pub mod variation;
pub mod winding;

pub use drives::SimulatedDrives;
pub use run::{Options, PlantSimError, run};
