//! What `quadrant tune` takes.

use std::path::PathBuf;

use clap::Args;

/// What `quadrant tune` takes.
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
