//! Run directories, and what is known of each without its log.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use bus::cell::CellPaths;
use bus::observer::Observer;
use chrono::{DateTime, SecondsFormat, Utc};
use launcher::retention::{EVENTS_FILE, RUNS, bytes_of, folders, is_open};
use monitor::ended::Ended;
use monitor::log::LOG_FILE;
use monitor::{MARK_FILE, run_number};
use serde_json::{Value, json};

use crate::rounded::r3;

/// Levels below a folder in which runs are: those of a cell lie in the folder of the cell.
const DEPTH: u32 = 2;

/// The runs below a folder, or below `runs` and in the folders of cells that are up; the oldest first.
pub(super) fn find(folder: Option<&Path>) -> anyhow::Result<Vec<Value>> {
    let mut places = vec![folder.unwrap_or(RUNS.as_ref()).to_path_buf()];
    if let Some(folder) = folder {
        let shown = super::shown(folder);
        fs::read_dir(folder).with_context(|| format!("{shown}: cannot be read as a folder"))?;
    } else {
        places.extend(CellPaths::names().into_iter().filter_map(of_cell));
    }
    let runs = in_order(&places);
    Ok(runs.map(|(began, run)| known_of(&run, began)).collect())
}

/// The newest runs of a cell that is up, and of those before it where they lie beside it, as `quadrant runs --json` says them; the
/// newest first.
pub fn newest(cell: &str, most: usize) -> Vec<Value> {
    let place = of_cell(cell.into()).map(|of| match of.parent() {
        Some(runs) if runs.ends_with(RUNS) => runs.to_path_buf(),
        _ => of,
    });
    let runs = in_order(place.as_slice()).rev();
    let runs = runs.filter(|(_, run)| run_number(run).is_some()).take(most);
    runs.map(|(began, run)| known_of(&run, began)).collect()
}

/// The runs below these folders, and when they began; the oldest first.
fn in_order(
    places: &[PathBuf],
) -> impl DoubleEndedIterator<Item = (DateTime<Utc>, PathBuf)> + use<> {
    let mut runs = BTreeMap::new();
    for run in places.iter().flat_map(|place| runs_below(place, DEPTH)) {
        let copied = fs::metadata(run.join("machine.toml")).and_then(|of| of.modified());
        let began = copied.map(DateTime::<Utc>::from).unwrap_or_default();
        // A cell's folder may lie below `runs`.
        let itself = fs::canonicalize(&run).unwrap_or_else(|_| run.clone());
        runs.entry(itself).or_insert((began, run));
    }
    let mut runs: Vec<(DateTime<Utc>, PathBuf)> = runs.into_values().collect();
    runs.sort();
    runs.into_iter()
}

/// The folder of a cell that is up.
fn of_cell(name: String) -> Option<PathBuf> {
    let cell = Observer::of(CellPaths::new(&name).ok()?)?;
    let folder = fs::read(cell.place.runs_file()).ok()?;
    Some(OsString::from_vec(folder).into())
}

fn runs_below(folder: &Path, depth: u32) -> Vec<PathBuf> {
    let inner = folders(folder).filter(|_| depth > 0);
    let inner: Vec<PathBuf> = inner.flat_map(|of| runs_below(&of, depth - 1)).collect();
    if inner.is_empty() && is_run(folder) {
        return vec![folder.into()];
    }
    inner
}

/// What report.json says; nothing where there is none.
pub(super) fn report_of(run: &Path) -> Value {
    let report = fs::read(run.join("report.json")).unwrap_or_default();
    serde_json::from_slice(&report).unwrap_or_default()
}

fn known_of(run: &Path, began: DateTime<Utc>) -> Value {
    let report = report_of(run);
    let ended = Ended::read(run);
    let under_way = ended.is_none() && is_busy(run) && is_last(run);
    let period_us = report["scan_period_us"].as_f64();
    let took = report["scans"].as_f64().zip(period_us);
    // Of all slides, and of all rotary axes.
    let worst = |key: &str| {
        let axes = report["axes"].as_array().into_iter().flatten();
        let peaks = axes.filter_map(|axis| axis[key]["peak"].as_f64());
        peaks.reduce(f64::max)
    };
    let mark = fs::read(run.join(MARK_FILE)).ok();
    json!({
        "run": run.to_string_lossy(),
        "began": began.to_rfc3339_opts(SecondsFormat::Secs, true),
        "program": report["program"],
        "outcome": ended.map_or(report["outcome"]["kind"].clone(), |ended| json!(ended.outcome.word())),
        "under_way": under_way,
        "took_s": took.map(|(scans, period_us)| r3(scans * period_us * 1e-6)),
        "contour_error_um": report["contour_error_um"]["peak"],
        "following_error_um": worst("following_error_um"),
        "following_error_mdeg": worst("following_error_mdeg"),
        "bytes": bytes_of(run),
        "marked": mark.map(|reason| String::from_utf8_lossy(&reason).trim().to_string()),
    })
}

/// Whether a folder has what a run leaves, or a copy of it.
pub(super) fn is_run(run: &Path) -> bool {
    run.join("machine.toml").exists() && (is_made(run) || run.join(LOG_FILE).exists())
}

/// Whether a launcher has made it, which notes what happens there; of a run of a cell in the folder of the cell.
pub(super) fn is_made(run: &Path) -> bool {
    let has_events = |folder: PathBuf| folder.join(EVENTS_FILE).exists();
    has_events(run.into()) || cell_of(run).is_some_and(has_events)
}

/// The folder of the cell that a run is of; none of a run of its own.
fn cell_of(run: &Path) -> Option<PathBuf> {
    run_number(run)?;
    Some(fs::canonicalize(run).ok()?.parent()?.into())
}

/// Whether a run goes on, or its report is still to come.
pub(super) fn is_busy(run: &Path) -> bool {
    let of_cell = |cell: PathBuf| is_open(&cell) && !run.join("report.json").exists();
    is_open(run) || cell_of(run).is_some_and(of_cell)
}

/// Whether no run of the same cell came after it.
fn is_last(run: &Path) -> bool {
    let others = cell_of(run).into_iter().flat_map(|cell| folders(&cell));
    others.filter_map(|other| run_number(&other)).max() <= run_number(run)
}
