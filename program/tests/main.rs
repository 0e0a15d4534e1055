//! The language of part programs, seen from outside.

mod beginning;
mod beside;
mod comments;
mod common;
mod curves_and_threads;
mod cycles;
mod diameters;
mod fanuc;
mod foreign_programs;
mod fuzz;
#[path = "../../lab/src/linuxcnc/generate.rs"]
mod generate;
mod interpreter;
mod language;
mod mutations;
mod parameter_file;
mod questions;
mod reading;
mod shipped_programs;
mod snapshots;
mod straight;
mod system_parameters;
mod tool_centre;
