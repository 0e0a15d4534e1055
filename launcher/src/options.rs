//! What the launcher's and the operator's commands take.

use std::net::SocketAddr;
use std::path::PathBuf;

use bus::member::Pace;
use clap::Args;

use crate::metrics_socket as metrics;
use crate::web;

/// What `quadrant run` takes.
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
    /// What is recorded: full, every sample and a report; events, what happened to the processes alone; off, neither (a report needs full)
    #[arg(long, value_name = "WHAT", default_value = "full", value_parser = ["off", "events", "full"])]
    pub log: String,
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
    /// Show `quadrant monitor` in this terminal meanwhile; closing it (q) ends nothing
    #[arg(long)]
    pub view: bool,
    /// Go without what earlier runs have learned (learned.toml and learned-path/ beside the machine file)
    #[arg(long)]
    pub no_learned: bool,
    /// Serve metrics for Prometheus (OpenMetrics, docs/howto/metrics.md) at this address or port [without one: 127.0.0.1:7823]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = metrics::DEFAULT_ADDRESS, value_parser = metrics::parse_address)]
    pub metrics: Option<SocketAddr>,
    /// Show the cell as a page in the browser (docs/howto/web.md) at this address or port [without one: 127.0.0.1:8640]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = web::DEFAULT_ADDRESS, value_parser = web::parse_address)]
    pub web: Option<SocketAddr>,
    /// With --web: file with the token that orders from the page need; made if it is not there [default: a new token, printed]
    #[arg(long, value_name = "FILE", requires = "web")]
    pub token: Option<PathBuf>,
    /// In lockstep: seconds a living process may take for one answer before the run is given up
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600), hide_short_help = true)]
    pub answer_limit: u64,
    /// Orders that the master obeys, each at its scan (TOML: `[[order]]` scan, order, axis, value)
    #[arg(long, value_name = "FILE", hide = true)]
    pub orders: Option<PathBuf>,
    /// Faults to inject: kills, stops, lost or corrupted samples, each at its scan, block or reversal (TOML; see docs/reference/fault-scripts.md)
    #[arg(long, value_name = "FILE")]
    pub faults: Option<PathBuf>,
    /// With --faults on a machine with [bus]: its drives are real, and what is killed may let them stop hard
    #[arg(long, requires = "faults")]
    pub with_drives: bool,
}

impl RunOptions {
    /// The pace it names.
    pub fn pace(&self) -> Pace {
        self.pace.parse().unwrap_or(Pace::Lockstep)
    }

    /// The same for one of its passes, from 1: each has a run directory of its own.
    pub fn of_pass(&self, pass: u32) -> RunOptions {
        let out = self.out.clone();
        RunOptions {
            out: out.map(|out| match self.passes {
                0 | 1 => out,
                _ => out.join(format!("pass-{pass}")),
            }),
            ..self.clone()
        }
    }
}

/// What `quadrant up` takes.
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
    /// What is recorded: full, every sample and a report; events, what happened to the processes alone; off, neither (a report needs full)
    #[arg(long, value_name = "WHAT", default_value = "full", value_parser = ["off", "events", "full"])]
    pub log: String,
    /// Show `quadrant monitor` in this terminal meanwhile; closing it (q) ends nothing
    #[arg(long)]
    pub view: bool,
    /// Go without what earlier runs have learned (learned.toml beside the machine file)
    #[arg(long)]
    pub no_learned: bool,
    /// Serve metrics for Prometheus (OpenMetrics, docs/howto/metrics.md) at this address or port [without one: 127.0.0.1:7823]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = metrics::DEFAULT_ADDRESS, value_parser = metrics::parse_address)]
    pub metrics: Option<SocketAddr>,
    /// Show the cell as a page in the browser (docs/howto/web.md) at this address or port [without one: 127.0.0.1:8640]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = web::DEFAULT_ADDRESS, value_parser = web::parse_address)]
    pub web: Option<SocketAddr>,
    /// With --web: file with the token that orders from the page need; made if it is not there [default: a new token, printed]
    #[arg(long, value_name = "FILE", requires = "web")]
    pub token: Option<PathBuf>,
    /// In lockstep: seconds a living process may take for one answer before the cell is given up
    #[arg(long, value_name = "SECONDS", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..=3600), hide_short_help = true)]
    pub answer_limit: u64,
}

impl UpOptions {
    /// The pace it names.
    pub fn pace(&self) -> Pace {
        self.pace.parse().unwrap_or(Pace::Realtime)
    }
}

/// Which running cell to look at.
#[derive(Debug, Clone, Args)]
pub struct CellOptions {
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// See a cell of another machine, on which `quadrant remote serve` runs; read only (docs/howto/remote.md)
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub remote: Option<String>,
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
