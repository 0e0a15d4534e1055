//! The command line of Quadrant: what can be asked for.

pub mod cli;
pub mod manual;
mod reference;

use bus::sample::Order;
use console::exit::{Failure, Kind, Outcome};
use launcher::desk::Desk;
use launcher::options::RunOptions;
use launcher::run::Injection;
use launcher::{run, up};
use prepare::{check, doctor, drive_files, plan};
use view::options::ShowOptions;
use view::{live, metrics, scope, web};

use operator::options::{JogOverrideOptions, OverrideOptions, RapidOverrideOptions};

use crate::cli::Command;

/// Starts a cell with what this command has beside it, and shows it meanwhile.
fn start<T>(
    shown: &ShowOptions,
    start: impl FnOnce(Option<Desk<'_>>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    shown.check().input()?;
    start(Some(Desk {
        say_what_realtime_lacks: doctor::say_what_realtime_lacks,
        observers: &|| shown.observers(),
    }))
}

/// Runs a program, as often as it is to be learnt from.
fn run_passes(started: &cli::Started<RunOptions>, injection: Injection) -> Outcome {
    let cli::Started { options, shown } = started;
    for pass in 1..=options.passes {
        let options = options.of_pass(pass);
        let completed = start(shown, |desk| run::run(&options, injection, desk))?;
        if options.learn {
            tune::learn::after(&completed)?;
        }
        if options.learn_path {
            tune::learn_path::after(&completed)?;
        }
    }
    Ok(())
}

/// Carries a command out; the fault script of a run may do so much.
///
/// # Errors
/// It could not be carried out, and why.
pub fn obey(command: Command, injection: Injection) -> Outcome {
    match command {
        Command::Run(started) => run_passes(&started, injection),
        Command::Check(options) => check::check(&options),
        Command::Plan(options) => plan::plan(&options),
        Command::Report(options) => report::command::report(&options),
        Command::Runs(options) => report::runs::runs(&options),
        Command::Doctor(options) => doctor::doctor(&options),
        Command::Clean(options) => run::clean(&options),
        Command::New(options) => match &options.what {
            cli::NewWhat::Machine(options) => tune::new_machine::new_machine(options),
        },
        Command::Up(cli::Started { options, shown }) => {
            start(&shown, |desk| up::up(&options, desk))
        }
        Command::Load(options) => operator::load(&options),
        Command::Start(options) => operator::start(&options),
        Command::Down(options) => operator::down(&options),
        Command::Hold(options) => operator::simple(Order::Hold, &options),
        Command::Resume(options) => operator::simple(Order::Resume, &options),
        Command::Stop(options) => operator::simple(Order::Stop, &options),
        Command::Override(OverrideOptions { percent, to }) => {
            operator::set_override(Order::Override, percent, &to)
        }
        Command::RapidOverride(RapidOverrideOptions { percent, to }) => {
            operator::set_override(Order::RapidOverride, percent, &to)
        }
        Command::JogOverride(JogOverrideOptions { percent, to }) => {
            operator::set_override(Order::JogOverride, percent, &to)
        }
        Command::Reset(options) => operator::simple(Order::Reset, &options),
        Command::OptionalStop(options) => operator::optional_stop(&options),
        Command::SingleBlock(options) => operator::single_block(&options),
        Command::Jog(options) => operator::jog(&options),
        Command::Wheel(options) => operator::wheel(&options),
        Command::Home(options) => operator::home(&options),
        Command::Offsets(options) => operator::offsets(&options),
        Command::Tool(options) => operator::tool(&options),
        Command::Alarms(options) => operator::alarms_of(&options),
        Command::Signal(options) => operator::signal(&options),
        Command::Zero(options) => operator::zero(&options),
        Command::Enable(options) => operator::simple(Order::Enable, &options),
        Command::Mdi(options) => operator::mdi(&options),
        Command::Estop(options) => operator::simple(Order::EmergencyStop, &options),
        Command::Disable(options) => operator::simple(Order::Disable, &options),
        Command::Status(options) => live::status(&options),
        Command::Monitor(options) => live::monitor(&options),
        Command::Web(options) => web::web(&options),
        Command::Metrics(options) => metrics::serve(&options),
        Command::Scope(options) => scope::scope(&options),
        #[cfg(feature = "remote")]
        Command::Remote(options) => match &options.command {
            cli::RemoteCommand::Serve(options) => live::serve::serve(options),
            cli::RemoteCommand::Order(options) => live::remote_orders::give(options),
        },
        Command::IceoryxConfig(options) => operator::iceoryx_config(&options),
        Command::Bus(options) => drive_files::bus(&options),
        Command::Tune(options) => tune::tune(&options),
        Command::Identify(options) => tune::identify_recording(&options),
        Command::Completions(options) => manual::completions(&options),
        Command::Man(options) => manual::man(&options),
        Command::Reference(options) => manual::reference(&options),
        Command::Role(role) => cell::take_part(&role),
    }
}
