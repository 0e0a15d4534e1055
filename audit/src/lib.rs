//! Setpoints judged by what they are: speeds, accelerations and jerks by differences, places by the path; and what a program takes in all.

mod setpoint_audit;
mod totals;

pub use setpoint_audit::{LimitShares, SetpointAudit, SetpointFault};
pub use totals::{Ahead, ProgramWalk, Totals};
