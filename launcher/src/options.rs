//! What the launcher's and the operator's commands take.

use std::path::PathBuf;

use bus::member::Pace;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use machine::{Dialect, LogLevel, Machine};

/// What every start of a cell takes.
#[derive(Debug, Clone, Args)]
pub struct StartOptions {
    /// Folder with machine.toml and plant.toml, or the path of a machine.toml
    pub machine: PathBuf,
    /// realtime: scans at absolute times; lockstep: as fast as the machine goes
    #[arg(long, default_value = "lockstep", value_parser = ["realtime", "lockstep"])]
    pub pace: String,
    /// Folder to write; made new
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the cell, when several share a PC [default: the machine's own name]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// What is recorded: nothing; what happened to the processes; every axis, and a report; also windows and instruments; every
    /// sample whole, with the servos' states [default: control, or what the machine file says]
    #[arg(long, value_name = "LEVEL", value_parser = levels())]
    pub log: Option<LogLevel>,
    /// Go without what earlier runs have learned
    #[arg(long)]
    pub no_learned: bool,
    /// In lockstep: seconds a living process may take for one answer
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600), hide_short_help = true)]
    pub answer_limit: u64,
}

fn levels() -> impl TypedValueParser<Value = LogLevel> {
    PossibleValuesParser::new(LogLevel::ALL.map(|(_, name)| name)).try_map(|name| name.parse())
}

impl StartOptions {
    /// The pace it names.
    pub fn pace(&self) -> Pace {
        self.pace.parse().unwrap_or(Pace::Lockstep)
    }

    /// What is recorded of this machine.
    pub fn level(&self, machine: &Machine) -> LogLevel {
        self.log.unwrap_or(machine.log.level)
    }
}

/// In which language a program is written.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct DialectOption {
    /// Language of the program: LinuxCNC's, or Fanuc's and Haas' [default: what the machine file says]
    #[arg(long, value_name = "DIALECT", value_parser = dialects())]
    pub dialect: Option<Dialect>,
}

fn dialects() -> impl TypedValueParser<Value = Dialect> {
    PossibleValuesParser::new(Dialect::ALL.map(|(_, name)| name)).try_map(|name| name.parse())
}

/// What `quadrant run` takes of a cell.
#[derive(Debug, Clone, Args)]
#[command(
    mut_arg("pace", |pace| pace.help("realtime: scans at absolute times; lockstep: as fast as the machine goes, the same result to the bit every time")),
    mut_arg("out", |out| out.help("Run directory to write; made new [default: runs/MACHINE-PROGRAM-TIME]")),
    mut_arg("no_learned", |without| without.help("Go without what earlier runs have learned (learned.toml and learned-path/ beside the machine file)")),
    mut_arg("answer_limit", |limit| limit.help("In lockstep: seconds a living process may take for one answer before the run is given up")),
)]
pub struct RunOptions {
    /// What every start takes.
    #[command(flatten)]
    pub start: StartOptions,
    /// Part program (RS274/NGC, "G-code")
    pub program: PathBuf,
    /// Its language.
    #[command(flatten)]
    pub of_program: DialectOption,
    /// If the run goes well: learn from it what the model lacks at reversals, into learned.toml beside the machine file
    #[arg(long, conflicts_with_all = ["no_learned", "log"], group = "learns")]
    pub learn: bool,
    /// If the run goes well: learn from it what this program leaves of error along its path by the table's scales, into
    /// learned-path/PROGRAM.csv beside the machine file; the best pass is kept
    #[arg(long, conflicts_with_all = ["no_learned", "learn", "log"], group = "learns")]
    pub learn_path: bool,
    /// With --learn or --learn-path: run so often, each pass with a run directory of its own
    #[arg(long, value_name = "N", default_value_t = 1, requires = "learns", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub passes: u32,
    /// Block by block: the machine rests at the end of every block, and `quadrant resume` from another terminal runs the next
    #[arg(long, conflicts_with = "learns")]
    pub single_block: bool,
    /// Begin at this line of the program: modes, tool, spindle, coolant and outputs are as the blocks before it leave them, and the
    /// tool goes there with Z last (or first, if it is below)
    #[arg(long, value_name = "LINE", conflicts_with = "learns", value_parser = clap::value_parser!(u32).range(1..))]
    pub from_line: Option<u32>,
    /// Orders of an operator, each at its scan (TOML; see docs/reference/fault-scripts.md, "Orders")
    #[arg(long, value_name = "FILE")]
    pub orders: Option<PathBuf>,
    /// Faults to inject: kills, stops, lost or corrupted samples, each at its scan, block or reversal (TOML; see docs/reference/fault-scripts.md)
    #[arg(long, value_name = "FILE")]
    pub faults: Option<PathBuf>,
    /// With --faults on a machine with [bus]: its drives are real, and what is killed may let them stop hard
    #[arg(long, requires = "faults")]
    pub with_drives: bool,
}

impl RunOptions {
    /// The same for one of its passes, from 1: each has a run directory of its own.
    pub fn of_pass(&self, pass: u32) -> RunOptions {
        let mut of_pass = self.clone();
        if let Some(out) = of_pass.start.out.as_mut().filter(|_| self.passes > 1) {
            out.push(format!("pass-{pass}"));
        }
        of_pass
    }
}

/// What `quadrant up` takes of a cell.
#[derive(Debug, Clone, Args)]
#[command(
    mut_arg("pace", |pace| pace.default_value("realtime").help("realtime: scans at absolute times; lockstep: as fast as the machine goes, also while nothing moves")),
    mut_arg("out", |out| out.help("Folder for the run directories; made new [default: runs/CELL-up-TIME]")),
    mut_arg("no_learned", |without| without.help("Go without what earlier runs have learned (learned.toml beside the machine file)")),
    mut_arg("answer_limit", |limit| limit.help("In lockstep: seconds a living process may take for one answer before the cell is given up")),
    after_help = "The drives are off at first. From any other terminal:\n  quadrant enable\n  quadrant load machines/xy/programs/circle-r25-f3000.ngc\n  quadrant start --wait\n  quadrant down\n\nEvery program that is started leaves a run directory with log and report in DIR: DIR/001-circle-r25-f3000 …\nCtrl-C, SIGTERM and `quadrant down` bring the tool to rest on the path before the processes leave."
)]
pub struct UpOptions {
    /// What every start takes.
    #[command(flatten)]
    pub start: StartOptions,
}

/// What `quadrant clean` takes.
#[derive(Debug, Clone, Args)]
pub struct CleanOptions {
    /// The cell
    pub cell: String,
}

/// A finite number.
///
/// # Errors
/// It is none, in words.
pub fn number(text: &str) -> Result<f64, String> {
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
