//! The path and the speed along it, seen from outside.

mod lines;
mod look_ahead;
mod positioning;
mod rests;
#[allow(dead_code)]
#[path = "../../tests/size.rs"]
mod size;
mod streaming;
mod windows;
