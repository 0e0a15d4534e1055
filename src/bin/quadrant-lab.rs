//! The `quadrant-lab` command: runs whose servos and planner may send wrong, late or no samples, as a fault script asks. The
//! processes are those of `quadrant`, over faulty ports; no process of `quadrant` itself can be asked for wrong samples.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use launcher::exit::{self, Kind, Outcome};
use launcher::logs;
use launcher::options::RunOptions;
use launcher::run::{self, Injection};
use launcher::signals;
use quadrant::cli::{PlannerOptions, PlantSimOptions, RecorderOptions, ServoOptions};
use quadrant::roles;
use view::live;
use view::options::MonitorOptions;

/// Runs of a cell on simulated drives, with wrong, late and lost samples beside kills and stops.
///
/// As `quadrant run`, and its fault script may also drop, delay and corrupt what servos and planner send:
///
///   quadrant-lab run machines/xy machines/xy/programs/circle-r25-f3000.ngc --faults faults.toml
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Start the process group, run the program to its end with the faults of a script, write the run directory
    Run(RunOptions),
    /// Live view of a running cell
    Monitor(MonitorOptions),
    /// The master over simulated drives (started by `run`)
    PlantSim(PlantSimOptions),
    /// The planner over faulty ports (started by `run`)
    Planner(FaultyOptions<PlannerOptions>),
    /// A servo over faulty ports (started by `run`)
    Servo(FaultyOptions<ServoOptions>),
    /// The recorder (started by `run`)
    Recorder(RecorderOptions),
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
    signals::survive_file_size_limit();
    exit::code(obey(Cli::parse().command))
}

fn obey(command: Command) -> Outcome {
    match command {
        Command::Run(options) => run::run(&options, Injection::WrongSamples).map(|_| ()),
        Command::Monitor(options) => live::monitor(&options),
        Command::PlantSim(options) => roles::plant_sim(&options),
        Command::Recorder(options) => roles::recorder(&options),
        Command::Planner(options) => {
            logs::init_role();
            lab::faulty::planner(&options.role.options(), options.faults.as_deref()).environment()
        }
        Command::Servo(options) => {
            logs::init_role();
            lab::faulty::servo(&options.role.options(), options.faults.as_deref()).environment()
        }
    }
}
