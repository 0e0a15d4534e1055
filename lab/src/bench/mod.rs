//! `quadrant-lab bench`: the project's own measurements, each beside its floor or its rivals on this machine.

pub(crate) mod all;
mod campaign;
pub(crate) mod circles;
mod cost_plot;
mod faults;
mod fieldbus;
mod figures;
mod ipc;
mod lanes;
mod lockstep;
mod long_program;
mod machines;
mod planning;
pub(crate) mod plants;
mod procedures;
mod progress;
mod punctuality;
mod report;
mod runs;
mod scan;
mod scans;
mod simulation;
mod wakeup;
mod watchers;
mod windows;

use crate::options::{BenchCommand, BenchOptions, FaultsOptions, ProceduresOptions};
use console::exit::Outcome;
use console::logs;
use figures::Figures;
pub(crate) use long_program::circles_program;

pub use campaign::PartOf;
pub use ipc::pong;
pub use scan::part;

/// Runs the measurement asked for.
pub fn bench(options: &BenchOptions) -> Outcome {
    logs::init_launcher();
    match options.command.clone().unwrap_or_default() {
        BenchCommand::All(options) => all::all(&options),
        command => one(command, &mut Figures::default()),
    }
}

/// Runs one of them and notes its figures.
fn one(command: BenchCommand, figures: &mut Figures) -> Outcome {
    match command {
        BenchCommand::All(options) => all::all(&options),
        BenchCommand::Circles(options) => circles::circles(&options, figures),
        BenchCommand::Faults(options) => faults::faults(&options, figures),
        BenchCommand::Fieldbus(options) => fieldbus::fieldbus(&options),
        BenchCommand::Ipc(options) => ipc::ipc(&options, figures),
        BenchCommand::Lockstep(options) => lockstep::lockstep(&options, figures),
        BenchCommand::Merge(options) => campaign::merge(&options),
        BenchCommand::Planning(options) => planning::planning(&options, figures),
        BenchCommand::Plants(options) => plants::plants(&options, figures),
        BenchCommand::Procedures(options) => procedures::procedures(&options, figures),
        BenchCommand::Report(options) => report::report(&options, figures),
        BenchCommand::Scan(options) => scan::scan(&options, figures),
        BenchCommand::Simulation(options) => simulation::simulation(&options, figures),
        BenchCommand::Wakeup(options) => wakeup::wakeup(&options, figures),
    }
}

/// Whole cells with faults, judged.
///
/// # Errors
/// A seed violates an invariant.
pub fn faults(options: &FaultsOptions) -> Outcome {
    faults::faults(options, &mut Figures::default())
}

/// Every procedure, interrupted in every step.
///
/// # Errors
/// A seed violates a rule.
pub fn procedures(options: &ProceduresOptions) -> Outcome {
    procedures::procedures(options, &mut Figures::default())
}
