//! The planner process: part program to windows of setpoints.
//!
//! [`run()`] is the process; [`Planner`] its pure part: feedback in, window out.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

mod ahead;
mod course;
mod error;
mod events;
mod in_step;
mod kept_parameters;
mod kept_places;
mod levels_before;
mod line_search;
mod messages;
mod place;
mod planner;
pub mod ports;
mod program_text;
pub mod questions;
mod return_to_path;
mod run;
mod situation;
mod survey;
#[cfg(test)]
mod test_spindle;

pub use course::{motion_limits, window_planner};
pub use error::{AheadError, CourseError, EventError};
pub use events::{Events, acts_on, course};
pub use in_step::needs as needs_in_step;
pub use kept_parameters::Left;
pub use line_search::{LineError, StartPlace, start_place};
pub use place::Place;
pub use planner::{Decision, Inner, Planner};
pub use ports::{BusPorts, PlannerPorts};
pub use program_text::ProgramText;
pub use run::{Options, PlannerError, cycle, run, run_over};
pub use survey::{Streamed, Survey, survey};
