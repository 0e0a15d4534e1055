//! `quadrant-lab bench`: the project's own measurements, each beside its floor or its rivals on this machine.

pub(crate) mod circles;
mod faults;
mod fieldbus;
mod lanes;
mod lockstep;
mod planning;
pub(crate) mod plants;
mod progress;
mod report;
mod runs;

use crate::options::{BenchCommand, BenchOptions};
use console::exit::Outcome;
use console::logs;

pub use faults::faults;
pub use lockstep::pong;

/// Runs the measurement asked for.
pub fn bench(options: &BenchOptions) -> Outcome {
    logs::init_launcher();
    match options.command.clone().unwrap_or_default() {
        BenchCommand::Circles(options) => circles::circles(&options),
        BenchCommand::Faults(options) => faults::faults(&options),
        BenchCommand::Fieldbus(options) => fieldbus::fieldbus(&options),
        BenchCommand::Lockstep(options) => lockstep::lockstep(&options),
        BenchCommand::Planning(options) => planning::planning(&options),
        BenchCommand::Plants(options) => plants::plants(&options),
        BenchCommand::Report(options) => report::report(&options),
    }
}
