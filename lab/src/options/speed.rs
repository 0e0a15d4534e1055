//! What the benches of speed take.

use std::path::PathBuf;

use bus::sample::MAX_AXES;
use clap::{Args, ValueEnum};

use super::BENCH_MACHINE;

/// What two processes hand to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Ball {
    /// Nothing: they ring at two futex words of a signal page.
    Ring,
    /// A byte in a pipe.
    Pipe,
    /// The bytes of a feedback and of a command through iceoryx2 as it is, then the ring.
    Bare,
    /// A feedback and a command as the cell's processes send them, then the ring.
    Sample,
}

/// What `quadrant-lab bench-pong` takes.
#[derive(Debug, Clone, Args)]
pub struct BenchPongOptions {
    /// Name of the cell
    #[arg(long)]
    pub cell: String,
    /// Axes of the cell
    #[arg(long)]
    pub axes: usize,
    /// The axis whose servo this stands for; that of the first owns the cell
    #[arg(long)]
    pub axis: usize,
    /// Processor to stay on
    #[arg(long)]
    pub core: usize,
    /// What is handed over
    #[arg(long)]
    pub ball: Ball,
    /// Wait awake at first, as a process in lockstep does
    #[arg(long)]
    pub awake: bool,
}

/// Numbers of axes that are measured if none is named: powers of two, and the most that a machine can have.
pub fn axis_counts() -> Vec<usize> {
    let powers = (0..).map(|power| 1_usize << power);
    let mut counts: Vec<usize> = powers.take_while(|count| *count < MAX_AXES).collect();
    counts.push(MAX_AXES);
    counts
}

/// A number of axes.
pub fn axes(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if (1..=MAX_AXES).contains(&count) => Ok(count),
        _ => Err(format!("must be a number from 1 to {MAX_AXES}")),
    }
}

/// What `quadrant-lab bench ipc` takes.
#[derive(Debug, Clone, Args)]
pub struct IpcOptions {
    /// Numbers of axes [default: 1, 2, 4 and so on to the most that a machine can have]
    #[arg(long, value_delimiter = ',', value_name = "N", value_parser = axes)]
    pub axes: Vec<usize>,
    /// Scans of each measurement
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(100..=10_000_000))]
    pub scans: u32,
    /// Rounds of all measurements, one after the other
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: u32,
}

/// What `quadrant-lab bench wakeup` takes.
#[derive(Debug, Clone, Args)]
pub struct WakeupOptions {
    /// Folder with machine.toml and plant.toml; axes X and Y with 25 mm to either side of 0
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Time of each measurement
    #[arg(long, value_name = "S", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub seconds: u64,
    /// Rounds of all measurements, one after the other
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: u32,
}

/// What `quadrant-lab bench simulation` takes.
#[derive(Debug, Clone, Args)]
pub struct SimulationOptions {
    /// Folder with machine.toml, plant.toml and programs/circle-r25-f3000.ngc
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// Scans of each round
    #[arg(long, value_name = "N", default_value_t = 8_000, value_parser = clap::value_parser!(u64).range(100..=1_000_000))]
    pub scans: u64,
    /// Rounds of all measurements; the fastest of each counts
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: u32,
}

/// A part of a scan that is counted by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// One servo's answer to a feedback.
    Servo,
    /// The master over drives that play back.
    Master,
    /// The simulated drives of all axes.
    Physics,
    /// A window of the planner.
    Planning,
}

impl Part {
    /// All of them.
    pub const ALL: [Part; 4] = [Part::Servo, Part::Master, Part::Physics, Part::Planning];

    /// Its word on the command line and in files.
    pub fn word(self) -> &'static str {
        match self {
            Part::Servo => "servo",
            Part::Master => "master",
            Part::Physics => "physics",
            Part::Planning => "planning",
        }
    }
}

/// What `quadrant-lab bench scan` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Instructions are counted by callgrind (Debian: valgrind). They depend on the compiler and on how the command was built:\nthose that are kept are of a release build with the toolchain of rust-toolchain.toml."
)]
pub struct ScanOptions {
    /// Folder with machine.toml, plant.toml and programs/circle-r25-f3000.ngc
    #[arg(default_value = BENCH_MACHINE)]
    pub machine: PathBuf,
    /// File with the instructions that are expected
    #[arg(
        long,
        value_name = "FILE",
        default_value = "lab/scan-instructions.toml"
    )]
    pub counts: PathBuf,
    /// Exit status 1 where a count is off by more than 2 %; where there is no callgrind nothing is checked, and it says so
    #[arg(long, conflicts_with = "renew")]
    pub check: bool,
    /// Write the counts of now into the file
    #[arg(long)]
    pub renew: bool,
    /// This part alone
    #[arg(long, conflicts_with_all = ["check", "renew"])]
    pub part: Option<Part>,
}

/// What `quadrant-lab bench-scan-part` takes.
#[derive(Debug, Clone, Args)]
pub struct BenchScanPartOptions {
    /// Machine
    #[arg(long)]
    pub machine: PathBuf,
    /// Which
    #[arg(long)]
    pub part: Part,
    /// How often it is done
    #[arg(long)]
    pub times: usize,
    /// How often it could be done: as much is prepared
    #[arg(long)]
    pub prepared: usize,
}
