//! An exhaustive model of a cell (docs/developers/model.md).
//!
//! Its processes are the product's own: [`master::Master`] over its `cycle`, [`servo::Servo`], [`planner::Planner`], each with its
//! windows, latches and state. What lies between them is small enough to be tried in every order: which of them is killed and when,
//! which sample is lost, when the launcher looks, when somebody orders a stop. Drives, scan and path are as small as they may be.

pub mod bench;
pub mod cell;
pub mod check;
pub mod drives;
pub mod fingerprint;
pub mod launcher;
pub mod members;
pub mod rules;
pub mod scan;
pub mod settling;
