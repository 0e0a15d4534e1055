//! What only the lab does with real processes: wrong samples, benches, soak.

mod bad_samples;
mod bench;
mod faults_in_process;
mod soak;
