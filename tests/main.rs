//! The whole machine, as its users meet it: through the `quadrant` command, with real processes and real shared memory.

mod against;
mod bad_input;
mod bad_samples;
mod bench;
mod compensation;
mod deaths;
mod determinism;
mod faults;
mod faults_rehearsed;
mod house;
mod interruption;
mod leftovers;
mod operator;
mod paces;
mod pivot;
mod positioning;
mod quality;
mod realtime_faults;
mod rehearsed;
mod robust;
mod setpoints;
mod soak;
mod straight_lines;
mod support;
mod triggers;
mod tune;
