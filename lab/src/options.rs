//! What benches and soak take.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use launcher::options::number;

use crate::bench::PartOf;

mod speed;

pub use speed::{
    Ball, BenchPongOptions, BenchScanPartOptions, IpcOptions, Part, ScanOptions, SimulationOptions,
    WakeupOptions, axis_counts,
};

/// What `quadrant-lab soak` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "A run of a program of lines, arcs, dwells and rapids is started on a copy of the machine, on which every loss is\nfollowed by a restart; every axis has a standby in one run, every second in the next. Its processes are killed\n(SIGKILL: planner, servos, standbys, monitor, plant-sim, two at once) and stopped for a while (SIGSTOP), each time as\nsoon as the cell is whole again and some random microseconds later. With drives on a bus, so are the owner of the bus\nand its standby, which is there in every other run: as long as one of the two is left running, no drive may be lost.\nAfter the loss of the master, and of all drives, the soak sends `enable` and `resume` as an operator does. When the\nprogram is done, the next run begins.\n\nJudged all the while: no step of a command beyond velocity and acceleration limits; commanded points on the path to\nthe increment; modes change only as documented; the end exact; limits in the run's log; nobody grows, nobody stays\ndead, no process and no file of the cell outlives its run.\n\nExit status 0: no violation; 1: some, printed, with the seed and the folder of the run.\n\n  quadrant-lab soak machines/xy --kills 500"
)]
pub struct SoakOptions {
    /// Folder with machine.toml and plant.toml or drive files, or the path of a machine.toml; axes X and Y with 30 mm to either side of 0
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Processes to kill in all, launchers among them
    #[arg(long, value_name = "N", required_unless_present = "hours", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub kills: Option<u64>,
    /// Ends after so many hours (0.1 is six minutes), or when all kills are spent
    #[arg(long, value_name = "H", value_parser = hours)]
    pub hours: Option<f64>,
    /// realtime: scans at absolute times; lockstep: as fast as the machine goes
    #[arg(long, default_value = "realtime", value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Kill these alone (plant-sim: the master, also that of drives on a bus) [default: everybody, also launcher and clients; stop and freeze everybody, hold and stop the machine,
    /// keep the processors busy]
    #[arg(long, value_name = "WHO", value_parser = ["planner", "servo", "monitor", "plant-sim", "fieldbus"])]
    pub only: Option<String>,
    /// Shortest pause between a cell that is whole and the next fault; some random 0 to 300 ms come on top. A process that
    /// lived shorter than 500 ms is restarted only after a while (10 ms, doubled each time)
    #[arg(long, value_name = "MS", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=10_000))]
    pub pause_ms: u64,
    /// Repeats the choices of program and faults; the instants are the PC's [default: another one every time]
    #[arg(long, value_name = "S")]
    pub seed: Option<u64>,
}

fn hours(text: &str) -> Result<f64, String> {
    let hours: f64 = text.parse().map_err(|_| "not a number".to_string())?;
    match hours > 0.0 && hours <= 1000.0 {
        true => Ok(hours),
        false => Err("more than 0 and at most 1000 hours".into()),
    }
}

/// What `quadrant-lab bench` takes.
#[derive(Debug, Clone, Args)]
pub struct BenchOptions {
    /// Which measurement
    #[command(subcommand)]
    pub command: Option<BenchCommand>,
}

/// What can be measured; lockstep if nothing is named.
#[derive(Debug, Clone, Subcommand)]
pub enum BenchCommand {
    /// Every bench, short; one table in Markdown and one file of JSON
    All(AllOptions),
    /// Speed of a whole cell in lockstep, beside physics alone and the bare hand-over
    Lockstep(LockstepOptions),
    /// Quadrant protrusions over radii and feeds, by way of compensation
    Circles(CirclesOptions),
    /// Whole cells in one process with faults drawn from seeds; every scan is judged by the invariants of docs/developers/invariants.md
    Faults(FaultsOptions),
    /// How punctually frames leave and how soon they are back: a cell over EtherCAT in real time, beside a bare loop with the same socket
    Fieldbus(FieldbusBenchOptions),
    /// What a scan costs between processes alone, for numbers of axes, beside a futex ring, a pipe and bare iceoryx2
    Ipc(IpcOptions),
    /// Blocks planned in a second on one core, beside reading alone, and what a window takes of its period
    Planning(PlanningOptions),
    /// Quadrant protrusions on machines of another structure than the controller's model: friction by place and direction, LuGre, noise,
    /// lost motion with hysteresis, modes, cutting forces, a soft frame, cross-talk; or on random ones
    Plants(PlantsOptions),
    /// Every procedure of an operator (homing, tool change, probing, jog, return to the path …) interrupted in every step by orders, trips, faults
    /// of drives and deaths, once and again: whether the machine can be moved afterwards, as it says
    Procedures(ProceduresOptions),
    /// Speed and memory of `quadrant report` on a long log, beside reading, decompressing and checking the same bytes
    Report(BenchReportOptions),
    /// Instructions and time of the parts of a scan, and whether the instructions are those that are expected
    Scan(ScanOptions),
    /// Whole cells in one process: scans a second, and what of a scan is physics and what control
    Simulation(SimulationOptions),
    /// How punctually the scans of a cell in realtime begin, beside a bare loop in the same seconds, idle and with every core busy
    Wakeup(WakeupOptions),
    /// Adds up what the parts of `bench faults`, `bench procedures` and `bench plants --random` have found
    Merge(MergeOptions),
}

impl Default for BenchCommand {
    fn default() -> Self {
        BenchCommand::Lockstep(LockstepOptions {
            machine: BENCH_MACHINE.into(),
            rounds: ROUNDS,
            axes: Vec::new(),
            plot: None,
        })
    }
}

/// Rounds of `quadrant-lab bench lockstep` if no number is given.
const ROUNDS: u32 = 5;
/// Machine that is measured if none is named.
const BENCH_MACHINE: &str = "machines/xy";

/// What `quadrant-lab bench lockstep` takes.
#[derive(Debug, Clone, Args)]
pub struct LockstepOptions {
    /// Folder with machine.toml, plant.toml and programs/circle-r25-f3000.ngc
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Rounds of all measurements; the median counts
    #[arg(long, value_name = "N", default_value_t = ROUNDS, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: u32,
    /// Machines of so many axes, made of this one by copying axes, each beside its own floor [default: this one]
    #[arg(long, value_delimiter = ',', value_name = "N", value_parser = speed::axes)]
    pub axes: Vec<usize>,
    /// With --axes: draws what a scan costs by the number of axes into this file (SVG)
    #[arg(long, value_name = "FILE", requires = "axes")]
    pub plot: Option<PathBuf>,
}

/// What `quadrant-lab bench fieldbus` takes.
#[derive(Debug, Clone, Args)]
pub struct FieldbusBenchOptions {
    /// Folder with machine.toml of a machine with [bus]
    #[arg(default_value = "machines/xy-ethercat")]
    pub machine: PathBuf,
    /// Time of each measurement: bare loop, cell, bare loop
    #[arg(long, value_name = "S", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub seconds: u64,
}

/// What `quadrant-lab bench all` takes.
#[derive(Debug, Clone, Args)]
pub struct AllOptions {
    /// Folder for bench.md and bench.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// These alone
    #[arg(long, value_delimiter = ',', value_name = "NAMES", value_parser = clap::builder::PossibleValuesParser::new(crate::bench::all::names()))]
    pub only: Vec<String>,
    /// As short as can be, to see that all of it works: the figures mean nothing
    #[arg(long)]
    pub shortest: bool,
}

/// What `quadrant-lab bench merge` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Exit status 1: a seed violates an invariant. 2: lines of different campaigns, one number twice, or one that is missing."
)]
pub struct MergeOptions {
    /// Files of `--lines`, in any order
    #[arg(value_name = "FILES", required = true)]
    pub files: Vec<PathBuf>,
    /// File for the figures of every circle, as CSV; of `bench plants` alone
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// What `quadrant-lab bench planning` takes.
#[derive(Debug, Clone, Args)]
pub struct PlanningOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Part programs [default: a curve in chords of 0.05 mm with noise of 1 µm, rounded by G64 P0.01]
    #[arg(value_name = "PROGRAM")]
    pub programs: Vec<PathBuf>,
}

/// What `quadrant-lab bench plants` takes.
#[derive(Debug, Clone, Args)]
pub struct PlantsOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml; axes X and Y with 100 mm to either side of 0
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Plants, in the order of the table [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAMES", value_parser = clap::builder::PossibleValuesParser::new(crate::bench::plants::names()))]
    pub plants: Vec<String>,
    /// Ways of compensating: the machine file as it is, the same without following friction, the friction pulse, nothing [default:
    /// shipped,tuned,pulse]
    #[arg(long, value_delimiter = ',', value_name = "NAMES", value_parser = clap::builder::PossibleValuesParser::new(crate::bench::plants::way_names()))]
    pub ways: Vec<String>,
    /// So many random plants in place of the table: every parameter of the plant file ± 40 %, any effects of the table together; each as
    /// shipped, with the friction pulse and without compensation
    #[arg(long, value_name = "N", conflicts_with_all = ["plants", "ways"], value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub random: Option<u64>,
    /// Which random plants
    #[arg(long, value_name = "S", default_value_t = 1, requires = "random")]
    pub seed: u64,
    /// Number of the first of them: one plant again is `--random 1 --first K` with the same seed
    #[arg(long, value_name = "K", default_value_t = 0, requires = "random")]
    pub first: u64,
    /// Part I of N of them: every Nth
    #[arg(long, value_name = "I/N", default_value = "1/1", requires = "random")]
    pub part: PartOf,
    /// File for a line of JSON for each of them, as `bench merge` reads them
    #[arg(long, value_name = "FILE", requires = "random")]
    pub lines: Option<PathBuf>,
    /// File for the figures of every circle, as CSV
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Runs at the same time
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=64))]
    pub jobs: u64,
}

/// Which seeds of a campaign are run, and where it stands what became of them.
#[derive(Debug, Clone, Args)]
pub struct SeedOptions {
    /// The first seed
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub from: u64,
    /// Part I of N of them: every Nth
    #[arg(long, value_name = "I/N", default_value = "1/1")]
    pub part: PartOf,
    /// File for a line of JSON for each of them, as `bench merge` reads them
    #[arg(long, value_name = "FILE")]
    pub lines: Option<PathBuf>,
    /// Runs at the same time
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=64))]
    pub jobs: u64,
}

/// What `quadrant-lab bench procedures` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "As many seeds as the table of procedures, steps and interruptions has cells take each cell once. Each seed draws\nbesides what comes later, while the machine is brought on again. Exit status 1: a seed violates a rule; the\ncommand that repeats it is printed."
)]
pub struct ProceduresOptions {
    /// Folder of a mill, with machine.toml and plant.toml and axes X, Y and Z; the other machines are made
    #[arg(default_value = "machines/xyz-mill")]
    pub machine: PathBuf,
    /// How many seeds [default: as many as the table has cells]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub seeds: Option<u64>,
    /// Which of them
    #[command(flatten)]
    pub of: SeedOptions,
    /// Print what each seed stands for, what was ordered, and what became of it
    #[arg(short, long)]
    pub verbose: bool,
}

/// What `quadrant-lab bench report` takes.
#[derive(Debug, Clone, Args)]
pub struct BenchReportOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml; axes X and Y with 25 mm to either side of 0
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Machine time of the log that is made, by a run in lockstep; an hour of two axes takes 3.4 GB of temporary space
    #[arg(long, value_name = "MINUTES", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1440))]
    pub minutes: u32,
    /// Measure with this run's log in place of a new one; its report is made again
    #[arg(long, value_name = "DIR", conflicts_with_all = ["machine", "minutes"])]
    pub run: Option<PathBuf>,
}

/// What `quadrant-lab bench circles` takes.
#[derive(Debug, Clone, Args)]
pub struct CirclesOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Ways of compensating, in the order of the table [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAMES", value_parser = clap::builder::PossibleValuesParser::new(crate::bench::circles::methods::names()))]
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

/// What `quadrant-lab bench faults` takes.
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
    /// Which of them
    #[command(flatten)]
    pub of: SeedOptions,
    /// Part program, in place of the built-in short ones
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
    /// Print the script of every seed, as files for `quadrant run --faults` and `--orders`, and what became of it
    #[arg(short, long)]
    pub verbose: bool,
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
