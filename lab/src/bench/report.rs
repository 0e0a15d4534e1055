//! `quadrant-lab bench report`: speed and memory of `quadrant report` on a long log.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};
use serde_json::Value;
use tempfile::TempDir;

use super::circles_program;
use super::figures::Figures;
use super::runs::{self, Runs};
use crate::options::BenchReportOptions;
use crate::processor_time;
use console::child;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;

/// Times that the report is made; the median counts.
const ROUNDS: usize = 3;
/// How often the memory of the process is looked at. Its own peak is read, so only what it needs last can be missed.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// What making a report cost.
#[derive(Debug, Clone, Copy)]
struct Cost {
    wall_s: f64,
    cpu_s: f64,
    peak_kb: u64,
}

/// Speed and memory of `quadrant report`, beside reading the same log and doing nothing with it.
///
/// # Errors
/// The log cannot be made, or not be measured.
pub fn report(options: &BenchReportOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let scratch = runs::scratch().environment()?;
    let run_dir = match &options.run {
        Some(run_dir) => run_dir.clone(),
        None => make_log(&scratch, &signals, options)?,
    };
    let (mut floors, mut costs) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        floors.push(floor_of(&run_dir).input()?);
        let cost = cost_of_report(&run_dir, &signals);
        if signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        costs.push(cost.environment()?);
    }
    floors.sort_by(|a, b| a.cpu_s.total_cmp(&b.cpu_s));
    costs.sort_by(|a, b| a.wall_s.total_cmp(&b.wall_s));
    match (floors.get(ROUNDS / 2), costs.get(ROUNDS / 2)) {
        (Some(floor), Some(cost)) => {
            figures.add("report", "processor time of a report", cost.cpu_s, "s");
            figures.beside("reading its log", floor.cpu_s);
            print(&run_dir, floor, cost).environment()
        }
        _ => Ok(()),
    }
}

fn print(run_dir: &Path, floor: &Floor, cost: &Cost) -> anyhow::Result<()> {
    let text = fs::read_to_string(run_dir.join("report.json"))?;
    let report: Value = serde_json::from_str(&text)?;
    let number = |key: &str| report.get(key).and_then(Value::as_f64);
    let scans = number("scans").context("report.json has no scans")?;
    let period_us = number("scan_period_us").context("report.json has no scan_period_us")?;
    let axes = report.get("axes").and_then(Value::as_array);
    let axes = axes.map_or(0, Vec::len);
    let machine_s = scans * period_us * 1e-6;

    say(&format!(
        "report: {machine_s:.1} s of machine time, {scans} scans of {axes} axes, median of {ROUNDS} rounds"
    ));
    say(&format!(
        "  log                  {:7.0} B per scan on disk, {:.0} B uncompressed",
        floor.file_bytes as f64 / scans,
        floor.record_bytes as f64 / scans
    ));
    say(&format!(
        "  wall time            {:7.2} s   {:.0} x real time",
        cost.wall_s,
        machine_s / cost.wall_s
    ));
    say(&format!(
        "  processor time       {:7.2} s   {:.2} µs per scan; two threads",
        cost.cpu_s,
        cost.cpu_s * 1e6 / scans
    ));
    say(&format!(
        "  peak memory          {:7.1} MB resident",
        cost.peak_kb as f64 / 1e3
    ));
    say(&format!(
        "  floor                {:7.2} s   processor time to read, decompress and check it, and nothing else; {:.2} s of wall time",
        floor.cpu_s, floor.wall_s
    ));
    say(&format!(
        "  ratio                {:7.2}      of processor times",
        cost.cpu_s / floor.cpu_s
    ));
    Ok(())
}

/// Runs circles for as long as is asked; the run directory.
fn make_log(
    scratch: &TempDir,
    signals: &Signals,
    options: &BenchReportOptions,
) -> Result<PathBuf, Failure> {
    let program = scratch.path().join("circles.ngc");
    let seconds = u64::from(options.minutes) * 60;
    fs::write(&program, circles_program(seconds)).environment()?;
    let runs = Runs { scratch, signals };
    runs.kept(&options.machine, &program)
}

/// What nobody who reads the log can go below.
#[derive(Debug, Clone, Copy)]
struct Floor {
    wall_s: f64,
    cpu_s: f64,
    file_bytes: u64,
    record_bytes: u64,
}

/// Reads, decompresses and checks the log in this thread.
fn floor_of(run_dir: &Path) -> anyhow::Result<Floor> {
    let (started, cpu_before_s) = (Instant::now(), processor_time::of_thread_s());
    let (mut file_bytes, mut record_bytes) = (0, 0);
    for part in monitor::log::part_files(run_dir)? {
        let (of_file, of_records) = monitor::log::read_only(&part)?;
        file_bytes += of_file;
        record_bytes += of_records;
    }
    Ok(Floor {
        wall_s: started.elapsed().as_secs_f64(),
        cpu_s: processor_time::of_thread_s() - cpu_before_s,
        file_bytes,
        record_bytes,
    })
}

/// Makes the report in a process of its own.
fn cost_of_report(run_dir: &Path, signals: &Signals) -> anyhow::Result<Cost> {
    let started = Instant::now();
    let mut child = child::command("report")
        .arg(run_dir)
        .spawn()
        .context("starting a report")?;
    let proc = PathBuf::from(format!("/proc/{}", child.id()));
    let pid = Pid::from_child(&child);
    // Ended, but still there to be asked how long it took.
    let ended = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT | WaitIdOptions::NOHANG;
    let mut peak_kb = 0;
    while waitid(WaitId::Pid(pid), ended)?.is_none() {
        peak_kb = peak_kb.max(peak_kb_in(&proc).unwrap_or(0));
        if signals.count() > 0 {
            child.kill()?;
        }
        std::thread::sleep(LOOK_EVERY);
    }
    let wall_s = started.elapsed().as_secs_f64();
    let stat = processor_time::stat(child.id());
    let stat = stat.context("/proc says nothing of the report's process")?;
    let status = child.wait()?;
    if !status.success() {
        bail!("the report ended with {status}");
    }
    Ok(Cost {
        wall_s,
        cpu_s: stat.own_s,
        peak_kb,
    })
}

fn peak_kb_in(proc: &Path) -> Option<u64> {
    let status = fs::read_to_string(proc.join("status")).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}
