//! The log of a run, read and measured.

use std::path::{Path as FilePath, PathBuf};

use machine::{AxisKind, LogLevel, Machine};
use path::geometry::Path;
use program::{Along, Answer, Note, ResumeError, Setup};

use super::error::ReportError;
use crate::measure::{Analysis, Measurements, RunPath};
use crate::said::Said;
use crate::skim::{Answers, Prescan, Start, skim};
use monitor::ended::Ended;
use monitor::log::{Part, RunEnd, RunInfo, RunLog, Sample};

/// What the measurement of one log gave.
pub struct Evaluation {
    /// The run directory.
    pub run_dir: PathBuf,
    /// What was measured.
    pub measurements: Measurements,
    /// What was known when the run began.
    pub info: RunInfo,
    /// What was known when it ended; none if the recorder was killed.
    pub end: Option<RunEnd>,
    /// Digest of everything in the log.
    pub digest: Option<String>,
    /// The parts of the log, in order.
    pub parts: Vec<Part>,
    /// How the run ended; none if nobody has noted it.
    pub ended: Option<Ended>,
    /// What the program has said.
    pub said: Said,
    /// Windows that are in no part of it.
    pub windows_lost: u64,
    /// Why the log ends early, if it does.
    pub cut: Option<String>,
    /// The machine.
    pub machine: Machine,
    /// Whether the program read again is the one that ran; none if nothing ran.
    pub program_matches: Option<bool>,
    /// What of the program was accepted with a remark; nothing of a long one.
    pub notes: Vec<Note>,
}

impl Evaluation {
    /// Letter of a coordinate of the path: the program's, which is not the axis' own where an arm is in for Y.
    pub(super) fn coordinate(&self, index: usize) -> String {
        let setup = Setup::of(&self.machine);
        let axis = setup.axes.get(index);
        axis.map_or("?".into(), |axis| axis.letter.to_string())
    }

    /// Unit of a coordinate of the path.
    pub(super) fn coordinate_unit(&self, index: usize) -> &'static str {
        let setup = Setup::of(&self.machine);
        let rotary = setup.axes.get(index).is_some_and(|axis| axis.rotary);
        let kind = if rotary {
            AxisKind::Rotary
        } else {
            AxisKind::Linear
        };
        kind.unit()
    }
}

/// Messages of the program that a report lists.
const MESSAGES_MAX: usize = 1000;

/// Measures the log in a run directory and writes nothing.
///
/// # Errors
/// The log, the machine file or the program in the directory cannot be read or do not fit together.
pub fn evaluate(run_dir: &FilePath) -> Result<Evaluation, ReportError> {
    let machine = Machine::load(run_dir)?;
    fits(run_dir, &machine, &RunLog::open(run_dir)?)?;
    let prescan = skim(run_dir)?;
    let (evaluation, found) = evaluate_knowing(run_dir, &machine, &prescan)?;
    if found == prescan {
        return Ok(evaluation);
    }
    // The machine has answered what the program asked: the way behind is known now. Or the log is damaged: what is in it behind the
    // damage is not read, and so does not count.
    Ok(evaluate_knowing(run_dir, &machine, &found)?.0)
}

/// The path of the program that ran in a run directory; none if nothing ran.
///
/// # Errors
/// As [`evaluate`].
pub fn run_path(run_dir: &FilePath) -> Result<Option<RunPath>, ReportError> {
    let machine = Machine::load(run_dir)?;
    let reader = RunLog::open(run_dir)?;
    fits(run_dir, &machine, &reader)?;
    let prescan = skim(run_dir)?;
    let Some(start) = &prescan.start else {
        return Ok(None);
    };
    let known = (start, &prescan.answers);
    Ok(Some(
        load_path(run_dir, &machine, reader.info(), known)?.path,
    ))
}

/// Measures the log, with what has to be known of it before; and what it itself says of that.
fn evaluate_knowing(
    run_dir: &FilePath,
    machine: &Machine,
    prescan: &Prescan,
) -> Result<(Evaluation, Prescan), ReportError> {
    let mut reader = RunLog::open(run_dir)?;
    let (path, source_hash, notes) = match &prescan.start {
        Some(start) => {
            let known = (start, &prescan.answers);
            let read = load_path(run_dir, machine, reader.info(), known)?;
            (read.path, Some(read.source_hash), read.notes)
        }
        None => (Path::default().into(), None, Vec::new()),
    };
    let mut analysis = Analysis::new(machine.clone(), path);
    analysis.begins_at(reader.info().begins_at());
    if reader.info().level() < LogLevel::Control {
        analysis.without_instruments();
    }
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
    let end = reader.end();
    let mut measurements = analysis.finish();
    let noted = end.as_ref().and_then(|end| end.motion_digest.clone());
    measurements.motion_digest = measurements.motion_digest.or(noted);
    let evaluation = Evaluation {
        run_dir: run_dir.into(),
        measurements,
        info: reader.info().clone(),
        end,
        digest: reader.digest(),
        parts: reader.parts().to_vec(),
        ended: Ended::read(run_dir),
        said: Said::read(run_dir, MESSAGES_MAX),
        windows_lost: reader.windows_lost(),
        cut: reader.cut().map(str::to_string),
        program_matches: prescan
            .start
            .zip(source_hash)
            .map(|(start, source_hash)| start.program_hash == source_hash),
        machine: machine.clone(),
        notes,
    };
    Ok((evaluation, found))
}

pub(super) fn fits(
    run_dir: &FilePath,
    machine: &Machine,
    reader: &RunLog,
) -> Result<(), ReportError> {
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
pub(super) fn program_file(run_dir: &FilePath, info: &RunInfo) -> Result<PathBuf, ReportError> {
    let name = FilePath::new(&info.program);
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

/// A program that ran, read again.
struct Read {
    path: RunPath,
    source_hash: u64,
    notes: Vec<Note>,
}

/// The program that ran, with what the machine has answered to it.
fn load_path(
    run_dir: &FilePath,
    machine: &Machine,
    info: &RunInfo,
    (start, answers): (&Start, &Answers),
) -> Result<Read, ReportError> {
    let file = program_file(run_dir, info)?;
    let positions = &start.command_positions;
    let given = answers.given().iter();
    let said = given.map(|(answer, probes)| Answer::said(machine, answer, *probes));
    let said: Vec<Answer> = said.collect::<Result<_, _>>().map_err(ResumeError::from)?;
    let short = |said: &[Answer]| {
        program::load_if_short(machine, positions, &file, program::SHORT_ELEMENTS, said)
    };
    // The last answer may be the one that ended the program; a log with gaps may lack one in between.
    let all_but_last = said.split_last().map_or(&[][..], |(_, others)| others);
    let read = short(&said).or_else(|_| short(all_but_last));
    if let Some(program) = read.or_else(|_| short(&[]))? {
        return Ok(Read {
            path: program.path.into(),
            source_hash: program.source_hash,
            notes: program.notes,
        });
    }
    let along = Along::open(machine, positions, &file, &said)?;
    let source_hash = along.source_hash();
    Ok(Read {
        path: RunPath::Near(Box::new(along)),
        source_hash,
        notes: Vec::new(),
    })
}
