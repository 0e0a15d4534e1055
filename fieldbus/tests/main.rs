//! Drives on a bus, seen from outside.

mod inputs;
mod spindle;
mod terminals;
