//! A running cell, seen: live view in the terminal, scope, metrics.

pub mod live;
pub mod metrics;
pub mod options;
pub mod scope;
