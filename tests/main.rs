//! The whole machine, as its users meet it: through the `quadrant` command, with real processes and real shared memory.

mod bad_input;
mod deaths;
mod determinism;
mod house;
mod interruption;
mod leftovers;
mod operator;
mod paces;
mod quality;
mod setpoints;
mod support;
