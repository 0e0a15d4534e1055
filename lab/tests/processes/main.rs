//! What only the lab does with real processes: wrong samples, benches, soak.

// Each test binary uses a part of it.
#[allow(dead_code)]
#[path = "../../../tests/support.rs"]
mod support;

mod bad_samples;
mod bench;
mod faults_in_process;
mod soak;
