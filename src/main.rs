//! The `quadrant` command: one binary whose subcommands are the launcher's commands and the roles of the process group.

use clap::Parser;
use console::exit::{self, Kind};
use console::{logs, signals};
use launcher::run::Injection;
use quadrant::cli::Cli;

fn main() -> std::process::ExitCode {
    signals::survive_file_size_limit();
    let command = Cli::parse().command;
    let checked = logs::check_filter().input();
    exit::code(checked.and_then(|()| quadrant::obey(command, Injection::KillsAndStops)))
}
