//! The command line.

use std::net::SocketAddr;
use std::path::PathBuf;

use bus::member::Pace;
use clap::{Args, Parser, Subcommand};
use monitor::scope::span::Span;

use crate::metrics;

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
    #[command(subcommand)]
    pub command: Command,
}

/// What can be asked for.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Start the process group, run the program to its end, stop the group, write the run directory
    Run(RunOptions),
    /// Check a machine and, if given, a program; start nothing
    Check(CheckOptions),
    /// Plan a program without running it: time, distance, limits, setpoints per scan
    Plan(PlanOptions),
    /// Make report and plots again from a run's log; or hold one run against another
    Report(ReportOptions),
    /// Start the process group and stay; programs are loaded and started from other terminals, until `down`
    Up(UpOptions),
    /// Load a program into a cell that is up; one that was begun and is stopped is given up
    Load(LoadOptions),
    /// Begin the program that is loaded, from where the axes stand
    Start(StartOptions),
    /// End a running cell: the tool comes to rest on the path, then all processes leave
    Down(OperatorOptions),
    /// Feed hold of a running cell: the tool comes to rest on the path and waits for `resume`
    Hold(OperatorOptions),
    /// Go on after a hold or a stop; after a jog, or with the drives off in between, return to the path first
    Resume(OperatorOptions),
    /// Stop a running cell: the tool comes to rest on the path; a `run` ends then
    Stop(OperatorOptions),
    /// Set the feed override of a running cell, 0 to 100 percent; 0 stands like a hold
    Override(OverrideOptions),
    /// Move one axis of a running cell by hand, at the machine file's reduced jog speed: ready, stopped, or at rest in hold
    Jog(JogOptions),
    /// Drives on: ready for a program, or in hold, where nothing moves before `resume`
    Enable(OperatorOptions),
    /// Drives off: at rest in hold or stopped only; the position is not lost when the axes are pushed
    Disable(OperatorOptions),
    /// One look at a running cell: state, program, axes, processes
    Status(StatusOptions),
    /// Live view of a running cell: axes, circle, reversals, processes, events; comes and goes without a trace
    Monitor(MonitorOptions),
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
    /// Identify every axis by short test motions, set its gains and compensations by law, write the machine file
    Tune(TuneOptions),
    /// The project's own measurements, each beside its floor on this machine
    Bench(BenchOptions),
    /// Run a cell and kill its processes at random instants, again and again: does everything hold that must?
    Soak(SoakOptions),
    /// The machine side of a running cell (started by `run`)
    PlantSim(PlantSimOptions),
    /// The planner of a running cell (started by `run`)
    Planner(PlannerOptions),
    /// One servo of a running cell (started by `run`)
    Servo(ServoOptions),
    /// The recorder of a running cell (started by `run`)
    Recorder(RecorderOptions),
    /// Print the completion script of a shell
    Completions(CompletionsOptions),
    /// Write the manual pages
    Man(ManOptions),
    /// The other side of a measurement
    #[command(hide = true)]
    BenchPong(BenchPongOptions),
}

#[derive(Debug, Clone, Args)]
pub struct BenchPongOptions {
    #[arg(long)]
    pub cell: String,
    #[arg(long)]
    pub machine: PathBuf,
    #[arg(long)]
    pub core: usize,
    /// Hand over samples, not bare rings
    #[arg(long)]
    pub samples: bool,
}

#[derive(Debug, Clone, Args)]
pub struct RunOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Part program (RS274/NGC, "G-code")
    pub program: PathBuf,
    /// realtime: scans at absolute times; lockstep: as fast as the machine goes, the same result to the bit every time
    #[arg(long, default_value = "lockstep", value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Run directory to write; made new [default: runs/MACHINE-PROGRAM-TIME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the cell, when several share a PC [default: the machine's own name]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// If the run goes well: learn from it what the model lacks at reversals, into learned.toml beside the machine file
    #[arg(long, conflicts_with = "no_learned")]
    pub learn: bool,
    /// Show `quadrant monitor` in this terminal meanwhile; closing it (q) ends nothing
    #[arg(long)]
    pub view: bool,
    /// Go without what earlier runs have taught (learned.toml beside the machine file)
    #[arg(long)]
    pub no_learned: bool,
    /// Serve metrics for Prometheus (OpenMetrics, docs/metrics.md) at this address or port [without one: 127.0.0.1:7823]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = metrics::DEFAULT_ADDRESS, value_parser = metrics::parse_address)]
    pub metrics: Option<SocketAddr>,
    /// In lockstep: seconds a living process may take for one answer before the run is given up
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600), hide_short_help = true)]
    pub answer_limit: u64,
    /// Orders that the machine side obeys, each at its scan (TOML: `[[order]]` scan, order, axis, value)
    #[arg(long, value_name = "FILE", hide = true)]
    pub orders: Option<PathBuf>,
    /// Faults to inject: kills, stops, lost or corrupted samples, each at its scan, block or reversal (TOML; see docs/faults.md)
    #[arg(long, value_name = "FILE")]
    pub faults: Option<PathBuf>,
}

impl RunOptions {
    pub fn pace(&self) -> Pace {
        self.pace.parse().unwrap_or(Pace::Lockstep)
    }
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The drives are off at first. From any other terminal:\n  quadrant enable\n  quadrant load machines/xy/programs/circle-r25-f3000.ngc\n  quadrant start --wait\n  quadrant down\n\nEvery program that is started leaves a run directory with log and report in DIR: DIR/001-circle-r25-f3000 …\nCtrl-C, SIGTERM and `quadrant down` bring the tool to rest on the path before the processes leave."
)]
pub struct UpOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// realtime: scans at absolute times; lockstep: as fast as the machine goes, also while nothing moves
    #[arg(long, default_value = "realtime", value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Folder for the run directories; made new [default: runs/CELL-up-TIME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the cell, when several share a PC [default: the machine's own name]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// Show `quadrant monitor` in this terminal meanwhile; closing it (q) ends nothing
    #[arg(long)]
    pub view: bool,
    /// Go without what earlier runs have taught (learned.toml beside the machine file)
    #[arg(long)]
    pub no_learned: bool,
    /// Serve metrics for Prometheus (OpenMetrics, docs/metrics.md) at this address or port [without one: 127.0.0.1:7823]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = metrics::DEFAULT_ADDRESS, value_parser = metrics::parse_address)]
    pub metrics: Option<SocketAddr>,
    /// In lockstep: seconds a living process may take for one answer before the cell is given up
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600), hide_short_help = true)]
    pub answer_limit: u64,
}

impl UpOptions {
    pub fn pace(&self) -> Pace {
        self.pace.parse().unwrap_or(Pace::Realtime)
    }
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The program is checked against the machine from where its axes stand, and copied: later edits do not reach the\ncell. Exit status 1: the cell cannot take it now; 2: the program is wrong."
)]
pub struct LoadOptions {
    /// Part program (RS274/NGC, \"G-code\")
    pub program: PathBuf,
    #[command(flatten)]
    pub to: CellOptions,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "With --wait, exit status 0: the program is done; 1: it was stopped, tripped or given up, as is printed."
)]
pub struct StartOptions {
    /// Wait until the program is done
    #[arg(long)]
    pub wait: bool,
    #[command(flatten)]
    pub to: CellOptions,
}

/// What every order to a running cell takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Prints what happened, or why it was refused, and exits with 0 or 1; also with 1 if\nno cell runs or it does not answer within 5 s; with 2 on bad usage.\n\nA hold in the middle of a program, a look at the workpiece, and on:\n  quadrant hold\n  quadrant jog Z 20\n  quadrant resume"
)]
pub struct OperatorOptions {
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
}

/// Which running cell to look at.
#[derive(Debug, Clone, Args)]
pub struct CellOptions {
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// See a cell of another machine, on which `quadrant remote serve` runs; read only (docs/remote.md)
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub remote: Option<String>,
}

#[cfg(feature = "remote")]
#[derive(Debug, Clone, Args)]
pub struct RemoteOptions {
    #[command(subcommand)]
    pub command: RemoteCommand,
}

#[cfg(feature = "remote")]
#[derive(Debug, Clone, Subcommand)]
pub enum RemoteCommand {
    /// Let other machines see a cell of this one; read only
    Serve(ServeOptions),
}

#[cfg(feature = "remote")]
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Nobody is asked for a password: who reaches the place sees the machine. It listens on this PC alone; from\nelsewhere, go through ssh:\n  ssh -L 7447:127.0.0.1:7447 controller\n  quadrant monitor --remote tcp/127.0.0.1:7447"
)]
pub struct ServeOptions {
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// Where to listen [default: tcp/127.0.0.1:7447, unless --connect is given]
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub listen: Vec<String>,
    /// A zenoh router to connect to
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub connect: Vec<String>,
    /// Snapshots per second
    #[arg(long, value_name = "HZ", default_value_t = 20, value_parser = clap::value_parser!(u64).range(2..=100))]
    pub rate: u64,
}

#[derive(Debug, Clone, Args)]
#[command(after_help = "Exit status 1: no cell runs, or its machine side says nothing.")]
pub struct StatusOptions {
    #[command(flatten)]
    pub to: CellOptions,
    /// Print JSON; units stand in the names
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Keys: h hold, r resume, s stop (asks first), + - override, ? help, q quit; the machine goes on.\nWhere standard output is no terminal: a line of JSON every 100 ms until the run ends. NO_COLOR is obeyed."
)]
pub struct MonitorOptions {
    #[command(flatten)]
    pub to: CellOptions,
    /// Watch for a moment, print one screen (or one line with --json), and leave
    #[arg(long)]
    pub once: bool,
    /// Lines of JSON, one every 100 ms; what is new since the line before: reversals, events
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Triggers, each in quotes:\n  now                            as soon as the time before it has been seen (default)\n  reversal X | reversal X +      the command of X reverses (to the positive direction)\n  X.following_error > 5um        the condition comes to hold, or holds already; also <\n  X.velocity rising 0            the signal goes through the value upwards; also falling\n  abs X.torque > 3Nm             the same of the magnitude\n  block 12                       line 12 of the program comes under way\n  scan 2210                      this scan\n  trip                           the machine trips\n  mode | mode stopped            the mode changes, or becomes this one\n  order                          mode, feed hold or override change\n  death | death servo-X          a process dies, or this one\n\nWhat does the next reversal of X look like?\n  quadrant scope --signal X.following_error --signal X.torque --trigger \"reversal X\"\nThe same reversal of a run that is over, as a picture and a table:\n  quadrant scope --log runs/a --signal X.following_error,X.wind_up --trigger \"scan 2210\" --svg x.svg --csv x.csv\nWhat led to the trip? (The black box of it was saved without being asked.)\n  quadrant scope --log runs/a/black-box-4000-trip.mcap --signal X.torque,mode --trigger trip --before 1s\nEvery reversal of Y for a minute:\n  quadrant scope --signal Y.following_error --trigger \"reversal Y\" --every --timeout 60s --csv y.csv\n\nExit status: 1 if no cell runs, or the trigger does not come before the timeout, the end of the cell or of the\nlog (it says what was seen instead); 2 for a signal, trigger or length of time that does not exist."
)]
pub struct ScopeOptions {
    /// What to show, once for each or with commas between: X.following_error, X.torque, contour_error; --list shows all
    #[arg(long, value_name = "NAME")]
    pub signal: Vec<String>,
    /// What starts the capture, see below
    #[arg(long, value_name = "WHAT", default_value = "now")]
    pub trigger: String,
    /// Time before the trigger: 50ms, 0.2s, "200 scans"
    #[arg(long, value_name = "TIME", default_value = "50ms")]
    pub before: Span,
    /// Time from the trigger on
    #[arg(long, value_name = "TIME", default_value = "200ms")]
    pub after: Span,
    /// Write a table, one row per scan, units in the names; - is standard output [default: a chart in the terminal]
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Draw a picture; those of further captures are FILE-2.svg and so on
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// So many captures, which do not overlap
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub count: u64,
    /// One capture after the other, until the end, the timeout or Ctrl-C
    #[arg(long, conflicts_with = "count")]
    pub every: bool,
    /// Give up after so long without a trigger [default: wait until the cell ends]
    #[arg(long, value_name = "TIME", conflicts_with = "log")]
    pub timeout: Option<Span>,
    /// Triggers in earlier scans do not count
    #[arg(long, value_name = "SCAN")]
    pub from: Option<u64>,
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME", conflicts_with = "log")]
    pub cell: Option<String>,
    /// A run directory, or an MCAP file of one, in place of a running cell
    #[arg(long, value_name = "RUN")]
    pub log: Option<PathBuf>,
    /// Show the signals of the machine with their units, and leave
    #[arg(long)]
    pub list: bool,
}

#[derive(Debug, Clone, Args)]
pub struct OverrideOptions {
    /// Share of the programmed feeds and rapids, in percent
    #[arg(allow_negative_numbers = true, value_parser = percent)]
    pub percent: f64,
    #[command(flatten)]
    pub to: OperatorOptions,
}

#[derive(Debug, Clone, Args)]
pub struct JogOptions {
    /// Axis letter
    pub axis: String,
    /// Distance from where the axis stands, in mm (degrees of a rotary axis), signed
    #[arg(allow_negative_numbers = true)]
    pub distance: f64,
    /// Wait until the axis stands
    #[arg(long)]
    pub wait: bool,
    #[command(flatten)]
    pub to: OperatorOptions,
}

#[derive(Debug, Clone, Args)]
pub struct CheckOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Part program to check against the machine
    pub program: Option<PathBuf>,
}

#[derive(Debug, Clone, Args)]
pub struct PlanOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Part program
    pub program: PathBuf,
    /// Write the setpoints of every scan as CSV
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Writes report.txt, report.json, report.html and plots into the run directory; with --against into\nRUN_DIR/against-NAME, NAME being that of the other run's directory, in which nothing is written.\n\nBefore and after a change of the machine file:\n  quadrant report runs/after --against runs/before"
)]
pub struct ReportOptions {
    /// A run directory
    pub run_dir: PathBuf,
    /// The directory of another run of the same program on the same machine, whose settings may differ: both side by side
    #[arg(long, value_name = "RUN_DIR")]
    pub against: Option<PathBuf>,
    /// Print report.json instead of the text
    #[arg(long)]
    pub json: bool,
    /// Yield to everything else on this PC
    #[arg(long, hide = true)]
    pub background: bool,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Each finding is ok, could be better, or must be changed; the last two with the reason and what to type.\nExit status 3: something must be changed before a cell runs in real time."
)]
pub struct DoctorOptions {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "For oneself:\n  quadrant completions bash > ~/.local/share/bash-completion/completions/quadrant\n  quadrant completions zsh > ~/.zfunc/_quadrant        (with ~/.zfunc in fpath, before compinit)\n  quadrant completions fish > ~/.config/fish/completions/quadrant.fish"
)]
pub struct CompletionsOptions {
    /// The shell
    pub shell: clap_complete::Shell,
}

#[derive(Debug, Clone, Args)]
#[command(after_help = "For all users:\n  quadrant man --out /usr/local/share/man/man1")]
pub struct ManOptions {
    /// Folder to write to; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

#[derive(Debug, Clone, Args)]
pub struct CleanOptions {
    /// The cell
    pub cell: String,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The axes move by themselves, one after the other, up to 20 mm (100 mm/s) to either side of the middle of\ntheir travel; then a few circles. Exit status 1: the model that was found does not fit; nothing is written."
)]
pub struct TuneOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// Show what would be written; write nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Write to this file, and leave the machine file as it is
    #[arg(long, value_name = "FILE", conflicts_with = "dry_run")]
    pub out: Option<PathBuf>,
    /// Lost motion of axes that have no scale, as AXIS=µm,…: X=8.3,Y=12.3
    #[arg(long, value_name = "AXIS=UM", value_delimiter = ',')]
    pub lost_motion_um: Vec<String>,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "A run of a program of lines, arcs, dwells and rapids is started on a copy of the machine, on which every loss is\nfollowed by a restart; every axis has a standby in one run, every second in the next. Its processes are killed\n(SIGKILL: planner, servos, standbys, monitor, plant-sim, two at once) and stopped for a while (SIGSTOP), each time as\nsoon as the cell is whole again and some random microseconds later. After the loss of the machine side the soak sends\n`enable` and `resume` as an operator does. When the program is done, the next run begins.\n\nJudged all the while: no step of a command beyond velocity and acceleration limits; commanded points on the path to\nthe increment; modes change only as documented; the end exact; limits in the run's log; nobody grows, nobody stays\ndead, no process and no file of the cell outlives its run.\n\nExit status 0: no violation; 1: some, printed, with the seed and the folder of the run.\n\n  quadrant soak machines/xy --kills 500"
)]
pub struct SoakOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml; axes X and Y with 30 mm to either side of 0
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Processes to kill in all
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub kills: u64,
    /// realtime: scans at absolute times; lockstep: as fast as the machine goes
    #[arg(long, default_value = "realtime", value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Kill these alone [default: everybody, and stop everybody too]
    #[arg(long, value_name = "WHO", value_parser = ["planner", "servo", "monitor", "plant-sim"])]
    pub only: Option<String>,
    /// Shortest pause between a cell that is whole and the next strike; some random 0 to 300 ms come on top. A process that
    /// lived shorter than 500 ms is started anew only after a while (10 ms, doubled each time)
    #[arg(long, value_name = "MS", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=10_000))]
    pub pause_ms: u64,
    /// Repeats the choices of program and strikes; the instants are the PC's [default: another one every time]
    #[arg(long, value_name = "S")]
    pub seed: Option<u64>,
}

#[derive(Debug, Clone, Args)]
pub struct BenchOptions {
    #[command(subcommand)]
    pub command: Option<BenchCommand>,
}

/// What can be measured; lockstep if nothing is named.
#[derive(Debug, Clone, Subcommand)]
pub enum BenchCommand {
    /// Speed of a whole cell in lockstep, beside physics alone and the bare hand-over
    Lockstep(LockstepOptions),
    /// Quadrant protrusions over radii and feeds, by way of compensation
    Circles(CirclesOptions),
    /// Whole cells in one process with faults drawn from seeds; every scan is judged by the invariants of docs/faults.md
    Faults(FaultsOptions),
    /// Speed and memory of `quadrant report` on a long log, beside reading, decompressing and checking the same bytes
    Report(BenchReportOptions),
}

impl Default for BenchCommand {
    fn default() -> Self {
        BenchCommand::Lockstep(LockstepOptions {
            machine: BENCH_MACHINE.into(),
        })
    }
}

/// Machine that is measured if none is named.
const BENCH_MACHINE: &str = "machines/xy";

#[derive(Debug, Clone, Args)]
pub struct LockstepOptions {
    /// Folder with machine.toml, plant.toml and programs/circle-r25-f3000.ngc
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
}

#[derive(Debug, Clone, Args)]
pub struct BenchReportOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml; axes X and Y with 25 mm to either side of 0
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Machine time of the log that is made, by a run in lockstep; an hour of two axes takes 3.4 GB of temporary space
    #[arg(long, value_name = "MINUTES", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1440))]
    pub minutes: u32,
    /// Measure with this run's log in place of a new one; its report is made anew
    #[arg(long, value_name = "DIR", conflicts_with_all = ["machine", "minutes"])]
    pub run: Option<PathBuf>,
}

#[derive(Debug, Clone, Args)]
pub struct CirclesOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Ways of compensating, in the order of the table [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAMES", value_parser = clap::builder::PossibleValuesParser::new(crate::bench::method_names()))]
    pub methods: Vec<String>,
    /// Radii in mm
    #[arg(long, value_delimiter = ',', value_name = "MM", default_value = "10,25,50,100", value_parser = above_zero)]
    pub radii: Vec<f64>,
    /// Feeds in mm/min
    #[arg(long, value_delimiter = ',', value_name = "MM/MIN", default_value = "1000,3000,10000", value_parser = above_zero)]
    pub feeds: Vec<f64>,
    /// Where circles start, in degrees; off the axes, every reversal lies in steady motion
    #[arg(
        long,
        value_name = "DEGREES",
        default_value_t = 45.0,
        allow_negative_numbers = true
    )]
    pub start_deg: f64,
    /// Centre of the circles in mm, in X and Y of the program
    #[arg(long, value_name = "X,Y", default_value = "0,0", value_parser = point, allow_hyphen_values = true)]
    pub centre: (f64, f64),
    /// Folder for circles.csv and circles.svg
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Runs at the same time, each on a processor of its own
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=64))]
    pub jobs: u64,
}

#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Each seed draws a program, a machine with or without standbys, one to four faults, restart policies and\nnow and then orders of an operator. Exit status 1: a seed violates an invariant; the command that repeats it\nis printed."
)]
pub struct FaultsOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// How many seeds
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    pub seeds: u64,
    /// The first seed
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub from: u64,
    /// Part program, in place of the built-in short ones
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
    /// Runs at the same time
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=64))]
    pub jobs: u64,
    /// Print the script of every seed, as files for `quadrant run --faults` and `--orders`, and what became of it
    #[arg(short, long)]
    pub verbose: bool,
}

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .trim()
        .parse()
        .map_err(|_| format!("{text:?} is no number"))?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err("must be finite".into())
    }
}

/// A number, with or without its sign of percent.
fn percent(text: &str) -> Result<f64, String> {
    number(text.strip_suffix('%').unwrap_or(text))
}

fn above_zero(text: &str) -> Result<f64, String> {
    match number(text)? {
        value if value > 0.0 => Ok(value),
        _ => Err("must be above 0".into()),
    }
}

fn point(text: &str) -> Result<(f64, f64), String> {
    let (x, y) = text.split_once(',').ok_or("must be X,Y")?;
    Ok((number(x)?, number(y)?))
}

/// What every role is told by the launcher.
#[derive(Debug, Clone, Args)]
pub struct SeatOptions {
    /// Name of the cell
    #[arg(long)]
    pub cell: String,
    /// Machine file
    #[arg(long)]
    pub machine: PathBuf,
    /// Place in the roster
    #[arg(long)]
    pub place: usize,
    /// Which process in that place this is
    #[arg(long, default_value_t = 1)]
    pub incarnation: u32,
    /// Process id of the launcher whose cell this is
    #[arg(long)]
    pub launcher: u32,
    /// Pace of the cell
    #[arg(long, value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Processor to stay on
    #[arg(long)]
    pub core: Option<usize>,
    /// Processor to keep off, where there is another
    #[arg(long)]
    pub avoid_core: Option<usize>,
    /// Scans up to this one are none of its business: it replaces a process that was lost
    #[arg(long)]
    pub after_scan: Option<u64>,
}

impl SeatOptions {
    pub fn seat(&self) -> bus::member::Seat {
        bus::member::Seat {
            cell: self.cell.clone(),
            machine: self.machine.clone(),
            place: self.place,
            incarnation: self.incarnation,
            launcher: self.launcher,
            pace: self.pace.parse().unwrap_or(Pace::Lockstep),
            core: self.core,
            avoid_core: self.avoid_core,
            after_scan: self.after_scan,
        }
    }
}

#[derive(Debug, Clone, Args)]
pub struct PlantSimOptions {
    #[command(flatten)]
    pub seat: SeatOptions,
    /// Plant file
    #[arg(long)]
    pub plant: PathBuf,
    /// Drives on from the first scan
    #[arg(long)]
    pub enabled: bool,
    /// End when the program is done or the machine has stopped
    #[arg(long)]
    pub end_after_program: bool,
    /// Seconds a living process may take for one answer
    #[arg(long, default_value_t = 30)]
    pub answer_limit: u64,
    /// Orders to obey, each at its scan
    #[arg(long)]
    pub orders: Option<PathBuf>,
    /// Faults to inject
    #[arg(long)]
    pub faults: Option<PathBuf>,
    /// Where blocks that the faults name begin on the path, as LINE=ELEMENT
    #[arg(long, value_delimiter = ',')]
    pub fault_block: Vec<String>,
}

#[derive(Debug, Clone, Args)]
pub struct PlannerOptions {
    #[command(flatten)]
    pub seat: SeatOptions,
    /// Part program; without one, those that are loaded into the cell
    #[arg(long)]
    pub program: Option<PathBuf>,
    /// Faults to commit
    #[arg(long)]
    pub faults: Option<PathBuf>,
}

#[derive(Debug, Clone, Args)]
pub struct ServoOptions {
    #[command(flatten)]
    pub seat: SeatOptions,
    /// Axis letter
    #[arg(long)]
    pub axis: String,
    /// Role: a drives, b stands by
    #[arg(long, default_value = "a", value_parser = ["a", "b"])]
    pub role: String,
    /// Faults to commit
    #[arg(long)]
    pub faults: Option<PathBuf>,
}

#[derive(Debug, Clone, Args)]
pub struct RecorderOptions {
    #[command(flatten)]
    pub seat: SeatOptions,
    /// Run directory to record into; without a program, the folder in which each one that is started gets its own
    #[arg(long)]
    pub out: PathBuf,
    /// Part program, for the log's metadata
    #[arg(long)]
    pub program: Option<PathBuf>,
    /// Serve metrics at the listening socket that standard input is
    #[arg(long)]
    pub metrics: bool,
}
