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

/// What `quadrant identify` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "The file is text: a line of column names, then a line for each instant, evenly spaced, separated by commas,\nsemicolons or tabs; lines that begin with # are comments. Names tell units; other columns are left alone:\n\n  time_s time_ms time_us                   or give --scan-us\n  position_m position_mm position_um       the motor's encoder, as travel\n  force_n force_kn | torque_nm torque_mnm  what drives the axis; a torque needs --lead-mm\n  scale_m scale_mm scale_um                the table's own scale, if there is one\n  velocity_command_mm_s velocity_command_m_s  with --velocity-gain-n-s-per-m: for drives whose torque shows its steps\n\nStrokes there and back, slow and fast, with hard and soft reversals, tell most. With --validate the model is held\nagainst other files: the force that it leaves unexplained, and the motion that it simulates from the force alone.\n\n  quadrant identify strokes.csv --validate other.csv\n\nExit status 1: nothing can be identified; what to look at is printed."
)]
pub struct IdentifyOptions {
    /// Recording of an axis, as text
    #[arg(value_name = "FILE")]
    pub recording: PathBuf,
    /// Other recordings of the same axis, to hold the model against
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    pub validate: Vec<PathBuf>,
    /// Travel in a turn of the motor, in mm: for a torque, and for what repeats with each turn
    #[arg(long, value_name = "MM", value_parser = positive)]
    pub lead_mm: Option<f64>,
    /// Length of the two running means that force and motion go through, in ms
    #[arg(long, value_name = "MS", default_value_t = 10.0, value_parser = positive)]
    pub smoothing_ms: f64,
    /// Period of the recording, in µs, where it has no times
    #[arg(long, value_name = "US", value_parser = positive)]
    pub scan_us: Option<f64>,
    /// Kv of the drive while it was recorded, in N·s/m at the table
    #[arg(long, value_name = "KV", default_value_t = 0.0)]
    pub velocity_gain_n_s_per_m: f64,
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "must be a number".to_string())?;
    if number > 0.0 && number.is_finite() {
        Ok(number)
    } else {
        Err("must be above 0".into())
    }
}
