//! `quadrant bench`: the project's own measurements, each beside its floor or its rivals on this machine.

mod circles;
mod lockstep;

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use serde_json::Value;

use crate::cli::BenchOptions;
use crate::exit::{Kind, Outcome};
use crate::logs;

pub use lockstep::pong;

/// Runs the measurement asked for.
pub fn bench(options: &BenchOptions) -> Outcome {
    logs::init_launcher();
    match options.name.as_str() {
        "circles" => circles::circles(options).environment(),
        _ => lockstep::lockstep(options).environment(),
    }
}

/// Runs a program in lockstep, through real processes in a cell of its own; the report.
fn run_report(machine: &Path, program: &Path) -> anyhow::Result<Value> {
    let out = std::env::temp_dir().join(format!("quadrant-bench-{}", std::process::id()));
    let cell = format!("bench-{}", std::process::id());
    let status = Command::new("/proc/self/exe")
        .arg("run")
        .arg(machine)
        .arg(program)
        .args(["--pace", "lockstep", "--cell", &cell, "--out"])
        .arg(&out)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::inherit())
        .status()
        .context("starting a run")?;
    let report = std::fs::read_to_string(out.join("report.json"));
    let _ = std::fs::remove_dir_all(&out);
    if !status.success() {
        bail!("a run ended with {status}");
    }
    Ok(serde_json::from_str(
        &report.context("reading its report")?,
    )?)
}
