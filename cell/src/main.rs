//! The `quadrant-cell` command: what a controller PC needs to run a cell, and nothing that shows, prepares or reports.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Parser, Subcommand};
use console::exit::{self, Outcome};
use launcher::options::{CleanOptions, RunOptions, UpOptions};
use launcher::run::Injection;
use launcher::{run, up};

use cell::Role;

/// Runs a cell: the process group, its supervision, its processes.
///
/// All that shows a cell, gives it orders and makes reports is in `quadrant`, on this PC or another one.
#[derive(Debug, Parser)]
#[command(version, name = "quadrant-cell")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Start the process group, run the program to its end, stop the group, write the run directory
    Run(RunOptions),
    /// Start the process group and keep it up
    Up(UpOptions),
    /// Remove what a crashed run has left of a cell
    Clean(CleanOptions),
    #[command(flatten)]
    Role(Role),
}

fn main() -> std::process::ExitCode {
    exit::main(read, obey)
}

/// Reads the command line; of what it does not know it says where that may be.
fn read() -> Command {
    let cli = Cli::try_parse().unwrap_or_else(|mut error| {
        if error.kind() == ErrorKind::UnknownArgument {
            let tip = "this command runs cells alone: what shows them is in `quadrant`";
            let tip = ContextValue::StyledStrs(vec![tip.into()]);
            error.insert(ContextKind::Suggested, tip);
        }
        error.exit()
    });
    cli.command
}

fn obey(command: Command) -> Outcome {
    match command {
        Command::Run(options) => {
            run::run(&options, Injection::KillsAndStops, None).map(|_completed| ())
        }
        Command::Up(options) => up::up(&options, None),
        Command::Clean(options) => run::clean(&options),
        Command::Role(role) => cell::take_part(&role),
    }
}
