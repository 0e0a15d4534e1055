//! What `quadrant report` takes.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// What `quadrant report` takes.
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

/// What `quadrant runs` takes.
#[derive(Debug, Clone, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "Without FOLDER: run directories below runs, and of cells that are up. Times are the\nmachine's; errors are the largest ones."
)]
pub struct RunsOptions {
    /// Folder with run directories, or of a cell [default: runs]
    pub folder: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// What is done instead of listing them.
    #[command(subcommand)]
    pub what: Option<RunsCommand>,
}

/// What can be done with runs.
#[derive(Debug, Clone, Subcommand)]
pub enum RunsCommand {
    /// Keep runs: what makes room for new ones takes the others first, and `remove` refuses
    Mark {
        /// Run directories
        #[arg(required = true)]
        run: Vec<PathBuf>,
        /// Why they are kept
        #[arg(long, value_name = "TEXT", default_value = "")]
        reason: String,
    },
    /// Take marks away
    Unmark {
        /// Run directories
        #[arg(required = true)]
        run: Vec<PathBuf>,
    },
    /// Remove run directories with all that is in them; none of them if one is refused
    Remove {
        /// Run directories
        #[arg(required = true)]
        run: Vec<PathBuf>,
        /// Marked ones too
        #[arg(long)]
        marked: bool,
    },
    /// Write command, feedback, table, following error, torque and so on to a file, scan by scan
    Export(ExportOptions),
}

/// What `quadrant runs export` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "csv: one row for each scan, the unit at the end of each name, nothing where nothing is known.\nmcap: one message for each scan and axis on /axis/X, as ROS 2 has it, for Foxglove and PlotJuggler.\nparquet: the columns of csv, NaN where nothing is known; in builds with --features parquet.\n\n  quadrant runs export runs/a --as csv --axes X --from 1.2 --to 1.5 --out x.csv"
)]
pub struct ExportOptions {
    /// A run directory
    pub run: PathBuf,
    /// From this time of the log on, in s, as its rows have it
    #[arg(long, value_name = "S")]
    pub from: Option<f64>,
    /// Until this time
    #[arg(long, value_name = "S")]
    pub to: Option<f64>,
    /// Letters of the axes [default: all]
    #[arg(long, value_name = "X,Y", value_delimiter = ',')]
    pub axes: Vec<String>,
    /// What is written
    #[arg(long = "as", value_name = "FORMAT", value_parser = ["csv", "mcap", "parquet"])]
    pub format: String,
    /// The file [default: name of the run, here, with the format behind it]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}
