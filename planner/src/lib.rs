//! The planner process: part program to windows of setpoints.
//!
//! [`run()`] is the process; [`Planner`] its pure part: feedback in, window out.

mod course;
mod events;
mod planner;
pub mod ports;
mod return_to_path;
mod run;

pub use course::{CourseError, course, motion_limits, window_planner};
pub use events::{EventError, Events, acts_on};
pub use planner::{Decision, Inner, Planner};
pub use ports::{BusPorts, PlannerPorts};
pub use run::{Options, PlannerError, cycle, run, run_over};
