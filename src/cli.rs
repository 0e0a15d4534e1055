//! The command line.

use std::path::PathBuf;

use cell::Role;
use clap::{Args, Parser, Subcommand};
use launcher::options::{CleanOptions, RunOptions, UpOptions};
use operator::options::{
    AlarmsOptions, HomeOptions, JogOptions, JogOverrideOptions, LoadOptions, MdiOptions,
    OffsetsOptions, OperatorOptions, OptionalStopOptions, OverrideOptions, RapidOverrideOptions,
    SignalOptions, SingleBlockOptions, StartOptions, ToolOptions, WheelOptions, ZeroOptions,
};
use prepare::options::{BusOptions, CheckOptions, DoctorOptions, PlanOptions};
use report::options::{ReportOptions, RunsOptions};
use tune::options::{IdentifyOptions, NewMachineOptions, TuneOptions};
use view::options::{
    MetricsOptions, MonitorOptions, ScopeOptions, ShowOptions, StatusOptions, WebOptions,
};
#[cfg(feature = "remote")]
use view::options::{OrderOptions, ServeOptions};

/// Multi-axis motion control made of separate processes over shared memory.
///
/// A planner, one servo process per axis, a machine simulator and a monitor exchange setpoint and feedback samples once
/// a scan. Start with:
///
///   quadrant run machines/xy machines/xy/programs/circle-r25-f3000.ngc
#[derive(Debug, Parser)]
#[command(
    version,
    after_help = "Exit status: 0 done; 1 the machine stopped for a reason that is printed; 2 bad usage or bad input,\nnothing was started; 3 the environment does not allow it; 130 interrupted, after an orderly stop."
)]
pub struct Cli {
    /// Which.
    #[command(subcommand)]
    pub command: Command,
}

/// What the commands that start a cell take.
#[derive(Debug, Args)]
pub struct Started<T: Args> {
    /// Of the cell.
    #[command(flatten)]
    pub options: T,
    /// What is shown of it meanwhile.
    #[command(flatten)]
    pub shown: ShowOptions,
}

/// What `quadrant new` takes.
#[derive(Debug, Args)]
pub struct NewOptions {
    /// What is new.
    #[command(subcommand)]
    pub what: NewWhat,
}

/// What can be new.
#[derive(Debug, Subcommand)]
pub enum NewWhat {
    /// A folder with machine file, plant file and a first program, that checks and runs
    Machine(NewMachineOptions),
}

/// What can be asked for.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Start the process group, run the program to its end, stop the group, write the run directory
    Run(Started<RunOptions>),
    /// Check a machine and, if given, a program; start nothing
    Check(CheckOptions),
    /// Plan a program without running it: time, where it goes, limits, setpoints per scan
    Plan(PlanOptions),
    /// Make report and plots again from a run's log; or hold one run against another
    Report(ReportOptions),
    /// Run directories: which there are and how they ended; mark, remove or export them
    Runs(RunsOptions),
    /// Write the folder of a new machine: asked for, or from a few numbers for each axis
    New(NewOptions),
    /// Start the process group and stay; programs are loaded and started from other terminals, until `down`
    Up(Started<UpOptions>),
    /// Load a program into a cell that is up; one that was started and is stopped is discarded
    Load(LoadOptions),
    /// Begin the program that is loaded, from where the axes are
    Start(StartOptions),
    /// Run typed-in blocks, as a small program of their own: ready, and no program under way
    Mdi(MdiOptions),
    /// End a running cell: the tool comes to rest on the path, then all processes leave
    Down(OperatorOptions),
    /// Feed hold of a running cell: the tool comes to rest on the path and waits for `resume`
    Hold(OperatorOptions),
    /// Go on after a hold or a stop; after a jog, or with the drives off in between, return to the path first
    Resume(OperatorOptions),
    /// Stop a running cell: the tool comes to rest on the path; a `run` ends then
    Stop(OperatorOptions),
    /// Set the feed override of a running cell, 0 to 100 percent, up to 200 where its machine file allows it; 0 stands like a hold
    Override(OverrideOptions),
    /// Set the override of rapids and returns to the path, 0 to 100 percent
    RapidOverride(RapidOverrideOptions),
    /// Set the override of jogs, 0 to 200 percent, of those under way too; at 0 they rest until there is more
    JogOverride(JogOverrideOptions),
    /// Give up what is left of the program: it is loaded, from its beginning; axes and drives stay as they are
    Reset(OperatorOptions),
    /// Let M1 stop the program of a running cell, or pass it
    OptionalStop(OptionalStopOptions),
    /// Run the program of a running cell block by block: it rests at the end of each, and `resume` runs the next
    SingleBlock(SingleBlockOptions),
    /// Move axes of a running cell by hand, by a distance or until Ctrl-C: ready, stopped, or at rest in hold
    Jog(JogOptions),
    /// Move an axis of a running cell by the running count of a handwheel, from standard input
    Wheel(WheelOptions),
    /// Home axes of a running cell that have no absolute encoder, one after another: ready, or at rest in hold before a program has begun
    Home(HomeOptions),
    /// Show or change the work offsets that programs begin with
    Offsets(OffsetsOptions),
    /// Show or change the tool table that programs begin with
    Tool(ToolOptions),
    /// Show the alarms of a running cell's machine, or acknowledge them
    Alarms(AlarmsOptions),
    /// Show the named inputs and outputs of a running cell, set or force one
    Signal(SignalOptions),
    /// Touch-off: the place where axes are reads 0, or a value, in a work offset
    Zero(ZeroOptions),
    /// Drives on: ready for a program, or in hold, where nothing moves before `resume`
    Enable(OperatorOptions),
    /// Drives off: at rest in hold or stopped only; the position is not lost when the axes are pushed
    Disable(OperatorOptions),
    /// Emergency stop by the operator: all axes brake at their limits, spindle and coolant go off, in every state; `enable` ends it
    Estop(OperatorOptions),
    /// One look at a running cell: state, program, axes, processes
    Status(StatusOptions),
    /// Live view of a running cell: axes, circle, reversals, processes, events; comes and goes without a trace
    Monitor(MonitorOptions),
    /// The live view of a running cell as a page in the browser, with a token also its orders; comes and goes without a trace
    Web(WebOptions),
    /// Metrics of a running cell at the listening socket that standard input is (started by `run` and `up`)
    #[command(hide = true)]
    Metrics(MetricsOptions),
    /// Signals around a trigger, of a running cell or of a log: chart in the terminal, CSV or SVG
    Scope(ScopeOptions),
    /// Seeing a cell from another machine
    #[cfg(feature = "remote")]
    Remote(RemoteOptions),
    /// Print the iceoryx2 configuration of a running cell: for iox2 and for programs of your own
    IceoryxConfig(OperatorOptions),
    /// Remove what a crash left of a cell in which nobody lives
    Clean(CleanOptions),
    /// What this PC offers for real time, what to change, and why: kernel, priorities, limits, timer, memory, processors
    Doctor(DoctorOptions),
    /// Drives on EtherCAT: who is on the cable, objects of drives, drive files made of a vendor's ESI file and checked
    Bus(BusOptions),
    /// Identify every axis by short test motions, set its gains and compensations by law, write the machine file
    Tune(TuneOptions),
    /// Identify an axis from a recording that somebody else made: mass, friction, what they do not explain
    Identify(IdentifyOptions),
    /// A process of a running cell
    #[command(flatten)]
    Role(Role),
    /// Print the completion script of a shell
    Completions(CompletionsOptions),
    /// Write the manual pages
    Man(ManOptions),
    /// Print what the machine file, the plant file, a drive file or a terminal file may hold: the page of the reference, or the schema for editors
    Reference(ReferenceOptions),
}

/// What `quadrant remote` takes.
#[cfg(feature = "remote")]
#[derive(Debug, Clone, Args)]
pub struct RemoteOptions {
    /// Which.
    #[command(subcommand)]
    pub command: RemoteCommand,
}

/// What can be asked for of a cell on another machine.
#[cfg(feature = "remote")]
#[derive(Debug, Clone, Subcommand)]
pub enum RemoteCommand {
    /// Let other machines see a cell of this one, and operators with a certificate give it orders
    Serve(ServeOptions),
    /// Give an order to a cell on another machine
    Order(OrderOptions),
}

/// What `quadrant completions` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "For oneself:\n  quadrant completions bash > ~/.local/share/bash-completion/completions/quadrant\n  quadrant completions zsh > ~/.zfunc/_quadrant        (with ~/.zfunc in fpath, before compinit)\n  quadrant completions fish > ~/.config/fish/completions/quadrant.fish"
)]
pub struct CompletionsOptions {
    /// The shell
    pub shell: clap_complete::Shell,
}

/// What `quadrant man` takes.
#[derive(Debug, Clone, Args)]
#[command(after_help = "For all users:\n  quadrant man --out /usr/local/share/man/man1")]
pub struct ManOptions {
    /// Folder to write to; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Pages of the book in place of manual pages
    #[arg(long, hide = true)]
    pub markdown: bool,
}

/// What `quadrant reference` takes.
#[derive(Debug, Clone, Args)]
pub struct ReferenceOptions {
    /// Which file
    #[arg(value_parser = ["machine", "plant", "drive", "terminal"])]
    pub file: String,
    /// The JSON Schema for editors in place of the page
    #[arg(long)]
    pub schema: bool,
}
