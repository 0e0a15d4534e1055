//! The `quadrant` command: one binary whose subcommands are the launcher's commands and the roles of the process group.

mod bench;
mod check;
mod cli;
mod doctor;
mod events;
mod exit;
mod fault_desk;
mod group;
mod hangs;
mod learn;
mod live;
mod logs;
mod manual;
mod metrics;
mod operator;
mod output;
mod progress;
mod report;
mod roles;
mod run;
mod run_dir;
mod scope;
mod service_manager;
mod session;
mod settings_difference;
mod signals;
mod soak;
mod supervise;
mod supervisor;
mod tune;
mod up;
mod view;

use bus::sample::Order;
use clap::Parser;

fn main() -> std::process::ExitCode {
    let cli = cli::Cli::parse();
    let outcome = match cli.command {
        cli::Command::Run(options) => run::run(&options),
        cli::Command::Check(options) => check::check(&options),
        cli::Command::Plan(options) => check::plan(&options),
        cli::Command::Report(options) => report::report(&options),
        cli::Command::Doctor(options) => doctor::doctor(&options),
        cli::Command::Clean(options) => run::clean(&options),
        cli::Command::Up(options) => up::up(&options),
        cli::Command::Load(options) => operator::load(&options),
        cli::Command::Start(options) => operator::start(&options),
        cli::Command::Down(options) => operator::down(&options),
        cli::Command::Hold(options) => operator::simple(Order::Hold, &options),
        cli::Command::Resume(options) => operator::simple(Order::Resume, &options),
        cli::Command::Stop(options) => operator::simple(Order::Stop, &options),
        cli::Command::Override(options) => operator::set_override(&options),
        cli::Command::Jog(options) => operator::jog(&options),
        cli::Command::Enable(options) => operator::simple(Order::Enable, &options),
        cli::Command::Disable(options) => operator::simple(Order::Disable, &options),
        cli::Command::Status(options) => live::status(&options),
        cli::Command::Monitor(options) => live::monitor(&options),
        cli::Command::Scope(options) => scope::scope(&options),
        #[cfg(feature = "remote")]
        cli::Command::Remote(options) => match &options.command {
            cli::RemoteCommand::Serve(options) => live::serve::serve(options),
        },
        cli::Command::IceoryxConfig(options) => operator::iceoryx_config(&options),
        cli::Command::Tune(options) => tune::tune(&options),
        cli::Command::Bench(options) => bench::bench(&options),
        cli::Command::Soak(options) => soak::soak(&options),
        cli::Command::BenchPong(options) => bench::pong(&options),
        cli::Command::Completions(options) => manual::completions(&options),
        cli::Command::Man(options) => manual::man(&options),
        cli::Command::PlantSim(options) => roles::plant_sim(&options),
        cli::Command::Planner(options) => roles::planner(&options),
        cli::Command::Servo(options) => roles::servo(&options),
        cli::Command::Recorder(options) => roles::recorder(&options),
    };
    exit::code(outcome)
}
