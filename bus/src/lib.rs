//! What all processes agree on: samples, services, ports, the scan clock, the machine file.
//!
//! **Invariant**: this is the only crate that names iceoryx2 (a test in `tests/` holds it).

pub mod cell;
pub mod fault_file;
pub mod machine;
pub mod member;
pub mod order_file;
pub mod page;
pub mod port;
pub mod realtime;
pub mod sample;
pub mod service;
pub mod settings_file;
pub mod split_mix;
pub mod tamper;
pub mod window;
