//! What `quadrant report` takes.

use std::path::PathBuf;

use clap::Args;

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
