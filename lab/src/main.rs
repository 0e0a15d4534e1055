//! The `quadrant-lab` command: all that `quadrant` can do, and what measures and breaks a cell. Its runs may have servos and a planner
//! that send wrong, late or no samples, as a fault script asks; no process of `quadrant` itself can be asked for that.

use std::path::PathBuf;

use cell::{PlannerOptions, ServoOptions};
use clap::{Args, Parser, Subcommand};
use console::exit::{self, Kind, Outcome};
use console::logs;
use lab::linuxcnc::LinuxcncCommand;
use lab::options::{BenchOptions, BenchPongOptions, BenchScanPartOptions, SoakOptions};
use lab::reading::ReadingCommand;
use lab::suite::SuiteOptions;
use launcher::run::Injection;

/// What measures and breaks a cell; beside it all that `quadrant` can do.
///
/// The fault script of `quadrant-lab run` may also drop, delay and corrupt what servos and planner send:
///
///   quadrant-lab run machines/xy machines/xy/programs/circle-r25-f3000.ngc --faults faults.toml
#[derive(Debug, Parser)]
#[command(version, name = "quadrant-lab")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The project's own measurements, each beside its floor on this machine
    Bench(BenchOptions),
    /// Run a cell and kill its processes at random instants, again and again: does everything hold that must?
    Soak(SoakOptions),
    /// The interpreter beside LinuxCNC's
    Linuxcnc {
        #[command(subcommand)]
        command: LinuxcncCommand,
    },
    /// How fast long programs are read, and in how much memory
    Reading {
        #[command(subcommand)]
        command: ReadingCommand,
    },
    /// All tests of the project, and where their time goes
    Suite(SuiteOptions),
    /// The other side of a measurement
    #[command(hide = true)]
    BenchPong(BenchPongOptions),
    /// A part of a scan, again and again, under a counter of instructions
    #[command(hide = true)]
    BenchScanPart(BenchScanPartOptions),
    /// The planner over faulty ports (started by `run`)
    #[command(hide = true)]
    FaultyPlanner(FaultyOptions<PlannerOptions>),
    /// A servo over faulty ports (started by `run`)
    #[command(hide = true)]
    FaultyServo(FaultyOptions<ServoOptions>),
    #[command(flatten)]
    Quadrant(quadrant::cli::Command),
}

#[derive(Debug, Clone, Args)]
struct FaultyOptions<O: Args> {
    #[command(flatten)]
    role: O,
    /// Fault script
    #[arg(long)]
    faults: Option<PathBuf>,
}

fn main() -> std::process::ExitCode {
    exit::main(|| Cli::parse().command, obey)
}

fn obey(command: Command) -> Outcome {
    match command {
        Command::Bench(options) => lab::bench::bench(&options),
        Command::Soak(options) => lab::soak::soak(&options),
        Command::Linuxcnc { command } => lab::linuxcnc::linuxcnc(&command),
        Command::Reading { command } => lab::reading::reading(&command),
        Command::Suite(options) => lab::suite::suite(&options),
        Command::BenchPong(options) => lab::bench::pong(&options),
        Command::BenchScanPart(options) => lab::bench::part(&options),
        Command::FaultyPlanner(options) => {
            logs::init_role();
            lab::faulty::planner(&options.role.options(), options.faults.as_deref()).environment()
        }
        Command::FaultyServo(options) => {
            logs::init_role();
            lab::faulty::servo(&options.role.options(), options.faults.as_deref()).environment()
        }
        Command::Quadrant(command) => quadrant::obey(command, Injection::WrongSamples),
    }
}
