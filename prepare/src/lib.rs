//! What prepares a machine and its runs: `plan`, `doctor`, the tools of a bus and of drive files.

mod bus_scan;
mod bus_sdo;
pub mod check;
pub mod doctor;
pub mod drive_files;
pub mod options;
pub mod plan;
mod time_use;
mod walk;
