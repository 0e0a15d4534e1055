//! The report of a run: `report.json`, `report.txt`, `report.html` and plots, made from its log; and of one run against another.
//!
//! Making it again gives the same bytes; wall time and real-time factor are the recorder's, and stand in the log.

pub mod against;
mod circle_plot;
pub mod comparison;
mod html;
mod json;
mod page;
pub(crate) mod svg;
mod text;
mod tracking_plot;

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use machine::Machine;
use machine::settings_file::SettingsFileError;
use program::{Program, ProgramError, Setup};

pub use json::{
    ArcReport, AxisReport, BlockReport, Death, FaultReport, LimitsReport, LogReport, MaxMin,
    OutcomeReport, PartReport, PeakRms, PeakRmsPercentiles, PredictionReport, ProcessReport,
    Report, ReversalReport, ScanRange,
};

use crate::log::{Foreword, LogError, Part, RunEnd, RunInfo, RunLog, Sample, Start, skim};
use crate::measure::{Analysis, Measurements};

/// A report that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The log.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The copy of the machine file in the run directory.
    #[error(transparent)]
    Machine(#[from] SettingsFileError),
    /// The copy of the program in the run directory.
    #[error(transparent)]
    Program(#[from] ProgramError),
    /// Log and machine file are not of one run.
    #[error("{path}: {what}")]
    Mismatch {
        /// The run directory.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// A file of the report cannot be written.
    #[error("{path}: cannot be written: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Two runs that cannot be compared.
    #[error("{what}")]
    Compare {
        /// Which, and what differs.
        what: String,
    },
    /// A plot cannot be drawn.
    #[error("{path}: cannot be drawn: {what}")]
    Plot {
        /// The file.
        path: PathBuf,
        /// Why.
        what: String,
    },
}

/// What the measurement of one log gave.
pub struct Evaluation {
    /// What was measured.
    pub measurements: Measurements,
    /// What was known when the run began.
    pub info: RunInfo,
    /// What was known when it ended; none if the recorder was killed.
    pub end: Option<RunEnd>,
    /// Digest of everything in the log.
    pub digest: String,
    /// The parts of the log, in order.
    pub parts: Vec<Part>,
    /// Windows that stand in no part of it.
    pub windows_lost: u64,
    /// Why the log ends early, if it does.
    pub cut: Option<String>,
    /// The machine.
    pub machine: Machine,
    /// Whether the program read again is the one that ran; none if nothing ran.
    pub program_matches: Option<bool>,
}

/// Measures the log in a run directory and writes `report.json`, `report.txt`, `report.html` and the plots there.
///
/// # Errors
/// The log, the machine file or the program in the directory cannot be read or do not fit together; or the report
/// cannot be written.
pub fn make_report(run_dir: &Path) -> Result<Report, ReportError> {
    let evaluation = evaluate(run_dir)?;
    let report = Report::new(&evaluation);
    let write = |name: &str, text: String| {
        let path = run_dir.join(name);
        std::fs::write(&path, text).map_err(|source| ReportError::Write { path, source })
    };
    remove_old_circles(run_dir);
    let circles = circle_plot::draw_all(run_dir, &evaluation)?;
    tracking_plot::draw(&run_dir.join("tracking.svg"), &evaluation)?;
    write("report.txt", text::page(&report))?;
    write("report.html", html::page(&report, run_dir, &circles)?)?;
    write("report.json", report.to_json())?;
    Ok(report)
}

/// Measures the log in a run directory and writes nothing.
///
/// # Errors
/// As [`make_report`].
pub fn evaluate(run_dir: &Path) -> Result<Evaluation, ReportError> {
    let machine = Machine::load(run_dir)?;
    fits(run_dir, &machine, &RunLog::open(run_dir)?)?;
    let foreword = skim(run_dir)?;
    let (evaluation, found) = evaluate_knowing(run_dir, &machine, &foreword)?;
    if found == foreword {
        return Ok(evaluation);
    }
    // A damaged log: what stands in it behind the damage is not read, and so was not said.
    Ok(evaluate_knowing(run_dir, &machine, &found)?.0)
}

/// Measures the log, with what has to be known of it before; and what it itself says of that.
fn evaluate_knowing(
    run_dir: &Path,
    machine: &Machine,
    foreword: &Foreword,
) -> Result<(Evaluation, Foreword), ReportError> {
    let mut reader = RunLog::open(run_dir)?;
    let program = match &foreword.start {
        Some(start) => Some(load_program(run_dir, machine, reader.info(), start)?),
        None => None,
    };
    let path = program.as_ref().map(|program| program.path.clone());
    let mut analysis = Analysis::new(machine.clone(), path.unwrap_or_default());
    analysis.begins_at(reader.info().begins_at());
    // Deaths are known before their scans are measured, so that nothing of their consequences is missed.
    for roster in &foreword.rosters {
        analysis.take(Sample::Roster(Box::new(*roster)));
    }
    let mut found = Foreword::default();
    while let Some(sample) = reader.next_sample()? {
        found.take(&sample);
        if !matches!(sample, Sample::Roster(_)) {
            analysis.take(sample);
        }
    }
    let evaluation = Evaluation {
        measurements: analysis.finish(),
        info: reader.info().clone(),
        end: reader.end(),
        digest: reader.digest(),
        parts: reader.parts().to_vec(),
        windows_lost: reader.windows_lost(),
        cut: reader.cut().map(str::to_string),
        program_matches: foreword
            .start
            .zip(program)
            .map(|(start, program)| start.program_hash == program.source_hash),
        machine: machine.clone(),
    };
    Ok((evaluation, found))
}

fn fits(run_dir: &Path, machine: &Machine, reader: &RunLog) -> Result<(), ReportError> {
    let axes: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    let period_us = machine.scan.period_us;
    if axes != reader.axes() || period_us != reader.scan_period_us() {
        return Err(ReportError::Mismatch {
            path: run_dir.into(),
            what: format!(
                "machine.toml has axes {} and a scan of {period_us} µs, the log axes {} and {} µs: they are not of one run",
                axes.join(" "),
                reader.axes().join(" "),
                reader.scan_period_us()
            ),
        });
    }
    Ok(())
}

/// Copy of the program in a run directory.
fn program_file(run_dir: &Path, info: &RunInfo) -> Result<PathBuf, ReportError> {
    let name = Path::new(&info.program);
    // The name comes from a file: it may not lead out of the run directory.
    if name.file_name() != Some(name.as_os_str()) {
        return Err(ReportError::Mismatch {
            path: run_dir.into(),
            what: format!(
                "the log names program {:?}: must be a file name without folders",
                info.program
            ),
        });
    }
    Ok(run_dir.join(name))
}

fn load_program(
    run_dir: &Path,
    machine: &Machine,
    info: &RunInfo,
    start: &Start,
) -> Result<Program, ReportError> {
    let file = program_file(run_dir, info)?;
    let at = program::axes_at(machine, &start.registers);
    let start = program::kinematics_of(machine).tool(&at);
    Ok(program::load(&file, &Setup::of(machine), start)?)
}

/// Letter of a coordinate of the path: the program's, which is not the axis' own where an arm stands in for Y.
fn coordinate(machine: &Machine, index: usize) -> String {
    let setup = Setup::of(machine);
    let axis = setup.axes.get(index);
    axis.map_or("?".into(), |axis| axis.letter.to_string())
}

/// Removes the plots that an earlier report left: it may have had more of them.
fn remove_old_circles(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_circle = name
            .to_str()
            .is_some_and(|name| name.starts_with("circle-") && name.ends_with(".svg"));
        if is_circle {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}
