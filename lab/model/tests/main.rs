//! Every order of events, in a small cell and on the signal page.

mod exhaustive;
mod page;
#[allow(dead_code)]
#[path = "../../../tests/size.rs"]
mod size;
