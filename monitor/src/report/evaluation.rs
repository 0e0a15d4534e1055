//! The log of a run, read and measured.

use std::path::{Path, PathBuf};

use machine::Machine;
use program::{Program, Setup};
use serde_json::Value;

use super::error::ReportError;
use crate::log::{Part, Prescan, RunEnd, RunInfo, RunLog, Sample, Start, skim};
use crate::measure::{Analysis, Measurements};

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
    /// The last scan that the launcher saw; none if it did not see the end of the run, or noted it elsewhere.
    pub last_scan: Option<u64>,
    /// Windows that are in no part of it.
    pub windows_lost: u64,
    /// Why the log ends early, if it does.
    pub cut: Option<String>,
    /// The machine.
    pub machine: Machine,
    /// Whether the program read again is the one that ran; none if nothing ran.
    pub program_matches: Option<bool>,
}

impl Evaluation {
    /// Letter of a coordinate of the path: the program's, which is not the axis' own where an arm is in for Y.
    pub(super) fn coordinate(&self, index: usize) -> String {
        let setup = Setup::of(&self.machine);
        let axis = setup.axes.get(index);
        axis.map_or("?".into(), |axis| axis.letter.to_string())
    }
}

/// Measures the log in a run directory and writes nothing.
///
/// # Errors
/// The log, the machine file or the program in the directory cannot be read or do not fit together.
pub fn evaluate(run_dir: &Path) -> Result<Evaluation, ReportError> {
    let machine = Machine::load(run_dir)?;
    fits(run_dir, &machine, &RunLog::open(run_dir)?)?;
    let prescan = skim(run_dir)?;
    let (evaluation, found) = evaluate_knowing(run_dir, &machine, &prescan)?;
    if found == prescan {
        return Ok(evaluation);
    }
    // A damaged log: what is in it behind the damage is not read, and so does not count.
    Ok(evaluate_knowing(run_dir, &machine, &found)?.0)
}

/// Measures the log, with what has to be known of it before; and what it itself says of that.
fn evaluate_knowing(
    run_dir: &Path,
    machine: &Machine,
    prescan: &Prescan,
) -> Result<(Evaluation, Prescan), ReportError> {
    let mut reader = RunLog::open(run_dir)?;
    let program = match &prescan.start {
        Some(start) => Some(load_program(run_dir, machine, reader.info(), start)?),
        None => None,
    };
    let path = program.as_ref().map(|program| program.path.clone());
    let mut analysis = Analysis::new(machine.clone(), path.unwrap_or_default());
    analysis.begins_at(reader.info().begins_at());
    // Deaths are known before their scans are measured, so that nothing of their consequences is missed.
    for roster in &prescan.rosters {
        analysis.take(Sample::Roster(Box::new(*roster)));
    }
    let mut found = Prescan::default();
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
        last_scan: last_scan(run_dir),
        windows_lost: reader.windows_lost(),
        cut: reader.cut().map(str::to_string),
        program_matches: prescan
            .start
            .zip(program)
            .map(|(start, program)| start.program_hash == program.source_hash),
        machine: machine.clone(),
    };
    Ok((evaluation, found))
}

/// The scan with which the run ended, as the launcher noted it among the events.
fn last_scan(run_dir: &Path) -> Option<u64> {
    let events = std::fs::read_to_string(run_dir.join("events.jsonl")).ok()?;
    let events = events.lines().rev();
    let mut events = events.filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let ended = events.find(|event| event["event"] == "ended")?;
    ended["scan"].as_u64()
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
pub(super) fn program_file(run_dir: &Path, info: &RunInfo) -> Result<PathBuf, ReportError> {
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
    Ok(program::load_from(
        machine,
        &start.command_positions,
        &file,
    )?)
}
