//! The `quadrant` command: one binary whose subcommands are the launcher's commands and the roles of the process group.

use bus::sample::Order;
use clap::Parser;
use launcher::exit::{self, Kind, Outcome};
use launcher::run::Injection;
use launcher::{check, doctor, drive_files, logs, operator, plan, report, run, signals, up};
use quadrant::cli::{Cli, Command};
use quadrant::{manual, roles};
use view::{live, scope, web};

fn main() -> std::process::ExitCode {
    signals::survive_file_size_limit();
    let command = Cli::parse().command;
    exit::code(logs::check_filter().input().and_then(|()| obey(command)))
}

fn obey(command: Command) -> Outcome {
    match command {
        Command::Run(options) => {
            for pass in 1..=options.passes {
                let completed = run::run(&options.of_pass(pass), Injection::KillsAndStops)?;
                if options.learn {
                    tune::learn::after(&completed)?;
                }
                if options.learn_path {
                    tune::learn_path::after(&completed)?;
                }
            }
            Ok(())
        }
        Command::Check(options) => check::check(&options),
        Command::Plan(options) => plan::plan(&options),
        Command::Report(options) => report::report(&options),
        Command::Doctor(options) => doctor::doctor(&options),
        Command::Clean(options) => run::clean(&options),
        Command::New(options) => match &options.what {
            quadrant::cli::NewWhat::Machine(options) => tune::new_machine::new_machine(options),
        },
        Command::Up(options) => up::up(&options),
        Command::Load(options) => operator::load(&options),
        Command::Start(options) => operator::start(&options),
        Command::Down(options) => operator::down(&options),
        Command::Hold(options) => operator::simple(Order::Hold, &options),
        Command::Resume(options) => operator::simple(Order::Resume, &options),
        Command::Stop(options) => operator::simple(Order::Stop, &options),
        Command::Override(options) => operator::set_override(&options),
        Command::RapidOverride(options) => operator::set_rapid_override(&options),
        Command::Reset(options) => operator::simple(Order::Reset, &options),
        Command::OptionalStop(options) => operator::optional_stop(&options),
        Command::SingleBlock(options) => operator::single_block(&options),
        Command::Jog(options) => operator::jog(&options),
        Command::Home(options) => operator::home(&options),
        Command::Offsets(options) => operator::offsets(&options),
        Command::Tool(options) => operator::tool(&options),
        Command::Zero(options) => operator::zero(&options),
        Command::Enable(options) => operator::simple(Order::Enable, &options),
        Command::Mdi(options) => operator::mdi(&options),
        Command::Estop(options) => operator::simple(Order::EmergencyStop, &options),
        Command::Disable(options) => operator::simple(Order::Disable, &options),
        Command::Status(options) => live::status(&options),
        Command::Monitor(options) => live::monitor(&options),
        Command::Web(options) => web::web(&options),
        Command::Scope(options) => scope::scope(&options),
        #[cfg(feature = "remote")]
        Command::Remote(options) => match &options.command {
            quadrant::cli::RemoteCommand::Serve(options) => live::serve::serve(options),
            quadrant::cli::RemoteCommand::Order(options) => live::remote_orders::give(options),
        },
        Command::IceoryxConfig(options) => operator::iceoryx_config(&options),
        Command::Bus(options) => drive_files::bus(&options),
        Command::Tune(options) => tune::tune(&options),
        Command::Identify(options) => tune::identify_recording(&options),
        Command::Bench(options) => lab::bench::bench(&options),
        Command::Soak(options) => lab::soak::soak(&options),
        Command::BenchPong(options) => lab::bench::pong(&options),
        Command::Completions(options) => manual::completions(&options),
        Command::Man(options) => manual::man(&options),
        Command::Reference(options) => manual::reference(&options),
        Command::PlantSim(options) => roles::plant_sim(&options),
        Command::Master(options) => roles::master(&options),
        Command::Fieldbus(options) => roles::fieldbus(&options),
        Command::Planner(options) => roles::planner(&options),
        Command::Servo(options) => roles::servo(&options),
        Command::Recorder(options) => roles::recorder(&options),
    }
}
