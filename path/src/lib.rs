//! The path of a program and the speed along it: geometry, rounding, limits of the axes, windows that end at rest.
//!
//! Nothing here knows of processes, clocks, files or shared memory.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod axis_rates;
mod braking_limit;
mod course;
mod envelope;
pub mod geometry;
pub mod kinematics;
pub mod limits;
pub mod line;
pub mod path_part;
mod path_state;
pub mod pivot;
pub mod positioning;
pub mod profile;
pub mod rounding;
mod segment;
pub mod setpoint_settings;
pub mod setpoints;
mod sharing;
mod smoothing;
pub mod speed_map;
pub mod spindle_following;
pub mod tool_centre;
pub mod travel;
pub mod window;
