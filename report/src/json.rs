//! `report.json`: the names of the README, and some more. Lengths of errors are in µm, rounded to 1 nm; deviations of rotary axes
//! in thousandths of a degree, rounded to a millionth.

use program::Note;
use serde::Serialize;

use super::axes::{AxisReport, BlockReport, axes};
use super::causes::{BallBarReport, ContourPartsReport, ball_bars, contour_parts};
use super::evaluation::Evaluation;
pub use super::gaps::ScanRange;
use super::gaps::{missing_scans, samples_lost};
use super::peaks::{PeakReport, contour_peaks};
use super::rounded::{MaxMin, max_min, r3};
use crate::measure::arc::{ArcResult, Deviations};
use crate::measure::auxiliary::AuxiliaryEvent;
use crate::measure::axis::LimitCounts;
use crate::measure::faults::{FaultResult, ProcessResult};
use crate::measure::fit::FitKind;
use crate::measure::outcome::mode_word;
use crate::measure::reversal::ReversalResult;
use bus::messages::TROUBLE;
use bus::sample::{Cause, RunOutcome};
use machine::LogLevel;
use monitor::ended::as_word;
use monitor::said::Line;

/// The whole report.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Version of the product that recorded the run.
    pub quadrant: String,
    /// Name of the machine.
    pub machine: String,
    /// File name of the program.
    pub program: String,
    /// `lockstep` or `realtime`.
    pub pace: String,
    /// Scan period in µs.
    pub scan_period_us: u32,
    /// Scans in one interpolation period.
    pub distribution_period_scans: u32,
    /// How it ended.
    pub outcome: OutcomeReport,
    /// Scans from the first to the last feedback.
    pub scans: u64,
    /// Wall time; null if the recorder did not end the log, or the log is in parts.
    pub wall_s: Option<f64>,
    /// Machine time over wall time.
    pub real_time_factor: Option<f64>,
    /// Over everything recorded.
    pub digest: Option<String>,
    /// Kept by the master; null without instruments.
    pub motion_digest: Option<String>,
    /// Samples missing in the log: feedbacks, instruments, commands and, between parts, windows.
    pub samples_lost: u64,
    /// Scans skipped because the master itself was late.
    pub overrun_scans: u32,
    /// Windows the planner published; null where they are not recorded.
    pub windows: Option<u64>,
    /// Windows that were voided.
    pub windows_voided: u64,
    /// The log itself.
    pub log: LogReport,
    /// The parts of the log: one, and one more for each recorder that took a dead one's place.
    pub parts: Vec<PartReport>,
    /// Scans that the log does not have although they were.
    pub missing_scans: Vec<ScanRange>,
    /// Per axis.
    pub axes: Vec<AxisReport>,
    /// Distance of the table from the programmed path.
    pub contour_error_um: PeakRms,
    /// Where it comes from; null where nothing could be read.
    pub contour_parts: Option<ContourPartsReport>,
    /// Where it was largest, the largest first.
    pub contour_peaks: Vec<PeakReport>,
    /// Peaks per block.
    pub blocks: Vec<BlockReport>,
    /// Runs of arcs on one circle.
    pub arcs: Vec<ArcReport>,
    /// Circles that were travelled both ways; left out where none was.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ball_bar: Vec<BallBarReport>,
    /// Circles that were travelled one way, nearly all round; left out where none was.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub one_way_circles: Vec<BallBarReport>,
    /// Changes of direction of a command.
    pub reversals: Vec<ReversalResult>,
    /// How many more there were; left out where all are listed.
    #[serde(skip_serializing_if = "is_none")]
    pub reversals_not_listed: u64,
    /// Setpoints beyond limits.
    pub limits: LimitCounts,
    /// Who took part.
    pub processes: Vec<ProcessResult>,
    /// What befell them.
    pub faults: Vec<FaultResult>,
    /// What of the program was accepted with a remark; left out where nothing was.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<Note>,
    /// What happened to spindle, coolant, outputs and tool, and what was waited for; left out where nothing did.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub auxiliary_events: Vec<AuxiliaryEvent>,
    /// What the program has said (MSG, DEBUG, PRINT, LOG), the first thousand; left out where it said nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub messages: Vec<Line>,
    /// Messages behind those; all of them are in messages.jsonl.
    #[serde(skip_serializing_if = "is_none")]
    pub messages_more: u64,
    /// Messages that are lost: they were said faster than they could be read.
    #[serde(skip_serializing_if = "is_none")]
    pub messages_dropped: u64,
}

fn is_none(count: &u64) -> bool {
    *count == 0
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct OutcomeReport {
    /// In one word.
    #[serde(serialize_with = "as_word")]
    pub kind: RunOutcome,
    /// Why, if it was not completed.
    pub reason: Option<String>,
}

/// One part of the log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PartReport {
    /// File name in the run directory.
    pub file: String,
    /// First scan in it; null if it holds none.
    pub first_scan: Option<u64>,
    /// Last scan in it.
    pub last_scan: Option<u64>,
    /// Whether it ends early: its recorder died, or the file was damaged.
    pub cut: bool,
}

/// The log.
#[derive(Debug, Clone, Serialize)]
pub struct LogReport {
    /// What was recorded. At `axes` nothing of the table, so no error of the contour, no arcs, and no windows.
    pub level: String,
    /// Why it ends early; null if it is whole.
    pub cut: Option<String>,
    /// Samples the recorder's queues lost, as the recorder counted.
    pub queue_losses: u64,
    /// Whether the program in the run directory is the one that ran; null if none ran.
    pub program_matches: Option<bool>,
}

/// Peak and root mean square.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PeakRms {
    /// Largest absolute value.
    pub peak: f64,
    /// Root mean square.
    pub rms: f64,
}

/// One run of arcs on one circle.
#[derive(Debug, Clone, Serialize)]
pub struct ArcReport {
    /// Line of the program.
    pub block: u32,
    /// Axes of its plane.
    pub plane: String,
    /// Programmed centre in machine coordinates.
    pub centre_mm: [f64; 2],
    /// Programmed radius.
    pub radius_mm: f64,
    /// Programmed feed; null at rapid.
    pub feed_mm_min: Option<f64>,
    /// Highest path speed reached.
    pub speed_mm_min: f64,
    /// Direction.
    pub clockwise: bool,
    /// Turns programmed.
    pub turns: f64,
    /// Part that was in steady motion and was measured, in degrees.
    pub measured_deg: f64,
    /// Scans on it that are missing in the log: the deviations are those of the rest.
    pub missing_scans: u64,
    /// What centre and radius were fitted by: `least-squares`, `radius only` (short arc) or `none`.
    pub fit: &'static str,
    /// Highest minus lowest deviation about the least-squares centre (G of ISO 230-4).
    pub circular_deviation_um: f64,
    /// Deviation from the programmed radius about the least-squares centre (F of ISO 230-4).
    pub radial_deviation_um: MaxMin,
    /// Deviation from the programmed radius about the programmed centre.
    pub radial_deviation_programmed_um: MaxMin,
    /// Fitted minus programmed centre; null if it could not be fitted.
    pub centre_offset_um: Option<[f64; 2]>,
    /// Fitted minus programmed radius; null if it could not be fitted.
    pub radius_error_um: Option<f64>,
    /// What remains outside the reversal windows, root mean square.
    pub residual_rms_um: f64,
    /// Circular deviation of the motor side, backlash compensation removed.
    pub motor_circular_deviation_um: f64,
    /// Radius error of the motor side.
    pub motor_radius_error_um: Option<f64>,
}

impl Report {
    /// Puts a measurement into the words of the report.
    pub fn new(evaluation: &Evaluation) -> Report {
        let report = Report::of_log(evaluation);
        match evaluation.info.level() {
            LogLevel::Axes => report.without_instruments(),
            _ => report,
        }
    }

    fn of_log(evaluation: &Evaluation) -> Report {
        let Evaluation {
            measurements,
            info,
            end,
            machine,
            ..
        } = evaluation;
        // The last recorder's wall time is that of its own part.
        let whole = evaluation.parts.len() == 1;
        let wall_s = end.as_ref().filter(|_| whole).map(|end| end.wall_s);
        let machine_s = measurements.scans as f64 * measurements.scan_period_s;
        let real_time = wall_s.filter(|wall_s| *wall_s > 0.0);
        let (ball_bar, one_way_circles) = ball_bars(evaluation);
        let queue_losses = end.as_ref().map_or(0, |end| end.queue_losses);
        Report {
            quadrant: info.quadrant.clone(),
            machine: machine.name.clone(),
            program: info.program.clone(),
            pace: info.pace.clone(),
            scan_period_us: machine.scan.period_us,
            distribution_period_scans: machine.scan.interpolation_period_scans,
            outcome: outcome(evaluation),
            scans: measurements.scans,
            wall_s,
            real_time_factor: real_time.map(|wall_s| r3(machine_s / wall_s)),
            digest: evaluation.digest.clone(),
            motion_digest: measurements.motion_digest.clone(),
            samples_lost: samples_lost(evaluation).max(queue_losses),
            overrun_scans: measurements.overrun_scans,
            windows: Some(measurements.windows + evaluation.windows_lost),
            windows_voided: measurements.windows_voided,
            log: LogReport {
                level: info.level().to_string(),
                cut: evaluation.cut.clone(),
                queue_losses,
                program_matches: evaluation.program_matches,
            },
            parts: parts(evaluation),
            missing_scans: missing_scans(evaluation),
            axes: axes(evaluation),
            contour_error_um: PeakRms {
                peak: r3(measurements.contour_error_mm.peak * 1e3),
                rms: r3(measurements.contour_error_mm.rms() * 1e3),
            },
            contour_parts: contour_parts(evaluation),
            contour_peaks: contour_peaks(evaluation),
            blocks: measurements
                .blocks
                .iter()
                .map(|(line, peaks)| BlockReport::of(*line, peaks, &machine.axes))
                .collect(),
            arcs: measurements
                .arcs
                .iter()
                .map(|result| arc(result, evaluation))
                .collect(),
            ball_bar,
            one_way_circles,
            reversals: measurements.reversals.clone(),
            reversals_not_listed: evaluation.measurements.reversals_not_listed,
            limits: measurements.limits,
            processes: measurements.processes.clone(),
            faults: measurements.faults.clone(),
            notes: evaluation.notes.clone(),
            auxiliary_events: measurements.auxiliary.clone(),
            messages: evaluation.said.lines.clone(),
            messages_more: evaluation.said.more,
            messages_dropped: evaluation.said.dropped,
        }
    }

    /// What could not be measured is no number, rather than none of it.
    fn without_instruments(self) -> Report {
        let mut report = self;
        report.windows = None;
        report.contour_error_um = PeakRms {
            peak: f64::NAN,
            rms: f64::NAN,
        };
        for block in &mut report.blocks {
            block.contour_error_um_peak = f64::NAN;
        }
        for fault in &mut report.faults {
            fault.contour_error_mm = f64::NAN;
        }
        report
    }

    /// The text of `report.json`.
    pub fn to_json(&self) -> String {
        // A struct of numbers and strings: it cannot fail, and if it did the file would show it.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }
}

/// As the master has said it: in the run directory, or else in the last feedback of the log.
fn outcome(evaluation: &Evaluation) -> OutcomeReport {
    let from_outside = evaluation.end.as_ref().and_then(|end| end.reason.clone());
    let measured = &evaluation.measurements;
    let Some(ended) = evaluation.ended.as_ref().or(measured.ended.as_ref()) else {
        let words = measured.last.map_or_else(
            || "the log holds no feedback".into(),
            |(scan, mode)| {
                format!(
                    "the log ends at scan {scan} with the machine {}",
                    mode_word(mode)
                )
            },
        );
        return OutcomeReport {
            kind: RunOutcome::Stopped,
            reason: from_outside.or(Some(words)),
        };
    };
    let why = ended.text.clone() + &said_at_the_end(evaluation, ended.cause);
    let why = from_outside.or(Some(why).filter(|why| !why.is_empty()));
    OutcomeReport {
        kind: ended.outcome,
        reason: why.filter(|_| ended.outcome != RunOutcome::Completed),
    }
}

/// What a program that has given itself up said then, or its planner where that could not go on.
fn said_at_the_end(evaluation: &Evaluation, cause: u32) -> String {
    let says_why = |said: &&Line| match Cause::from_wire(cause) {
        Some(Cause::Abort) => said.number != TROUBLE,
        Some(Cause::Planner) => said.number == TROUBLE,
        _ => false,
    };
    match evaluation.said.last.as_ref().filter(says_why) {
        Some(Line {
            line: Some(line),
            text,
            ..
        }) => format!(", line {line}: {text}"),
        Some(Line { text, .. }) => format!(", {text}"),
        None => String::new(),
    }
}

fn parts(evaluation: &Evaluation) -> Vec<PartReport> {
    let parts = evaluation.parts.iter();
    parts
        .map(|part| PartReport {
            file: part.file.clone(),
            first_scan: part.first_scan,
            last_scan: part.last_scan,
            cut: part.cut.is_some(),
        })
        .collect()
}

fn arc(result: &ArcResult, evaluation: &Evaluation) -> ArcReport {
    let letter = |axis: usize| evaluation.coordinate(axis);
    let circle = &result.circle;
    let fit = &result.table.fit;
    let radius_error = |series: &Deviations| {
        (series.fit.kind != FitKind::None).then(|| r3(series.fit.radius_error_mm * 1e3))
    };
    ArcReport {
        block: result.line,
        plane: circle.plane.iter().map(|axis| letter(*axis)).collect(),
        centre_mm: circle.centre_mm.map(|mm| libm::round(mm * 1e6) / 1e6 + 0.0),
        radius_mm: libm::round(circle.radius_mm * 1e6) / 1e6,
        feed_mm_min: circle.feed_mm_s.map(|feed| r3(feed * 60.0)),
        speed_mm_min: r3(result.speed_mm_s * 60.0),
        clockwise: circle.clockwise,
        turns: r3(result.turns),
        measured_deg: r3(result.measured_deg),
        missing_scans: result.missing_scans,
        fit: fit.kind.word(),
        circular_deviation_um: r3(result.table.circular_um),
        radial_deviation_um: max_min(result.table.radial_um),
        radial_deviation_programmed_um: max_min(result.table.programmed_um),
        centre_offset_um: (fit.kind == FitKind::LeastSquares)
            .then(|| fit.centre_mm.map(|mm| r3(mm * 1e3))),
        radius_error_um: radius_error(&result.table),
        residual_rms_um: r3(fit.residual_rms_mm * 1e3),
        motor_circular_deviation_um: r3(result.motor.circular_um),
        motor_radius_error_um: radius_error(&result.motor),
    }
}
