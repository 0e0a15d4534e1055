//! CiA 402 drives over EtherCAT: what their vendors say of them (ESI, ETG.2000), the drive file that is made of it, and the drives
//! themselves behind the master's seam.
//!
//! Two processes share the work: [`master`](mod@master_process) runs a cell over [`drives`], and [`fieldbus`](process) owns the network
//! interface, starts the segment up and exchanges cycles. They meet in the drive page (`bus::drive_page`), so that either may be killed.
//!
//! The only crate that names ethercrab, for the start-up, and only with the feature `ethercat`.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod cia402;
pub mod drive_file;
pub mod drives;
pub mod field;
pub mod link;
pub mod master_process;
pub mod process;
pub mod process_data;
pub mod setups;
pub mod start_up;
pub mod terminal_file;
