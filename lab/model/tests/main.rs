//! Every order of events, in a small cell.

mod exhaustive;
#[allow(dead_code)]
#[path = "../../../tests/size.rs"]
mod size;
