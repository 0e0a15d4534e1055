//! Everything that crosses a process border: samples, services, ports, the signal page, membership, the scan clock.
//!
//! **Invariant**: this is the only crate that names iceoryx2 (a test in `tests/` holds it).

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

#[macro_use]
mod wire_enum;

pub mod builder_program;
pub mod cell;
pub mod drive_codes;
pub mod drive_page;
mod error;
pub mod files;
pub mod kept_parameters;
pub mod layout;
pub mod limits;
pub mod locks;
mod mapped_page;
pub mod member;
pub mod messages;
mod name;
pub mod numbers;
pub mod observer;
mod ownership;
mod paths;
pub mod patience;
pub mod port;
pub mod process;
pub mod realtime;
mod robust_lock;
mod room;
pub mod sample;
pub mod service;
pub mod signal_page;
pub mod user_codes;
pub mod window;
