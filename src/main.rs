//! The `quadrant` command: one binary whose subcommands are the launcher's commands and the roles of the process group.

use clap::Parser;
use console::exit;
use launcher::run::Injection;
use quadrant::cli::Cli;

fn main() -> std::process::ExitCode {
    exit::main(
        || Cli::parse().command,
        |command| quadrant::obey(command, Injection::KillsAndStops),
    )
}
