//! A running cell, seen: live view in the terminal, scope, metrics.

mod drawing;
pub mod live;
pub mod metrics;
pub mod options;
pub mod scope;
