//! Drives on a bus, seen from outside.

mod inputs;
mod terminals;
