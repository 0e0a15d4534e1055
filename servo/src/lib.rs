//! The servo process: position and velocity loop of one axis in one role.
//!
//! [`Servo`] is pure: windows and feedback in, commands out. The process around it is in `run`.
//!
//! **Invariant**: whatever a command depends on is in the feedback, in the windows held, or in the state that the
//! command before carried; a second controller of the axis goes on from there to the bit.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

mod closed_loop;
mod compensation;
mod controller;
mod held;
mod linear_interpolation;
mod manual;
mod manual_loop;
mod path_correction;
pub mod ports;
mod run;
mod setpoints;
mod settings;
mod state;
mod windows;

pub use controller::Servo;
pub use held::Refusal;
pub use ports::{BusPorts, ServoPorts};
pub use run::{Options, ServoError, cycle, run, run_over};
pub use settings::{ServoSettings, ServoSettingsError};
pub use state::ServoState;
