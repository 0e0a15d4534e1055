//! The master of a cell: modes, orders, window arbiter, standby switch, watchdogs and latches, over any drives.
//!
//! [`Master`] is pure. [`cycle()`](cycle::cycle) is one scan of it over [`MasterPorts`]; [`run`](run::run) is the process.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod answers;
pub mod bus_ports;
pub mod cycle;
pub mod digest;
pub mod drives;
pub mod error;
mod holding_brake;
pub mod master;
pub mod ports;
pub mod run;
pub mod saved;
pub mod window_arbiter;

pub use answers::Answers;
pub use drives::{
    AuxiliaryFeedback, DriveCommand, DriveFeedback, DriveState, Drives, InputFeedback,
    InstrumentSample, StateRefused,
};
pub use error::MasterError;
pub use master::{Beginning, Inner, InnerAxis, Master, RunEnd, STANDSTILL_MM_S};
pub use ports::{Answered, Flow, MasterPorts};
pub use run::{Options, run};
