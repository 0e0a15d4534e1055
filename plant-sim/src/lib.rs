//! The machine side, simulated: the clock of the cell, drives, motors and mechanics.

pub mod axis;
pub mod digest;
pub mod drive;
pub mod fault_desk;
pub mod friction;
pub mod machine_side;
pub mod mechanics;
pub mod plant_file;
pub mod run;
pub mod saved;
pub mod setup;
pub mod winding;
pub mod window_book;

pub use machine_side::RunEnd;
pub use run::{MachineSideError, Options, run};
