//! CiA 402 drives behind the seam that simulated ones have: `master::Drives` over process data.
//!
//! [`Cia402Drives`] turns what the master commands into outputs and what drives show into feedback; a [`Wire`] carries both. Nothing here
//! knows of sockets: the process that owns the bus is another one (`crate::process`), and may be killed.

mod axis;
mod cia402_drives;
mod encoder_place;
mod homing;
mod page_wire;
mod position_target;
mod signal_places;
mod signals;
mod silence;
mod spindle;
mod state_walk;
mod touch_probe;
mod units;

pub use cia402_drives::{Cia402Drives, DriveSetup, Setups, Wire, WireAnswer};
pub(crate) use encoder_place::range as encoder_range;
pub use page_wire::PageWire;
pub use signal_places::{SignalDevice, SignalPlace, SignalPlaces};
pub use signals::TerminalSetup;
pub use state_walk::{DeviceState, StateWalk, Want};
pub(crate) use touch_probe::{Edge, TouchProbe};
pub(crate) use units::Units;
