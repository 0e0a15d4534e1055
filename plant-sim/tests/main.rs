//! The simulated machine, seen from outside.

mod closed_loop;
mod dead_time;
mod structures;
