//! The path and the speed along it, seen from outside.

mod lines;
mod look_ahead;
mod positioning;
mod rests;
mod streaming;
mod windows;
