//! Two runs of one program side by side: what a changed machine file, plant or fault script did to it.
//!
//! Differences are A − B, per cent those of |B|. Arcs are matched by block, direction and order within it, reversals by axis,
//! block, new direction and order within them; what has no counterpart stands alone.

mod match_up;
mod words;

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use machine::Machine;
use serde::Serialize;

use self::match_up::matched;
use super::json::{
    ArcReport, AxisReport, FaultReport, LimitsReport, OutcomeReport, Report, ReversalReport,
};
use super::{Evaluation, ReportError, circle_plot, evaluate, program_file, tracking_plot};
use crate::log::RunLog;
use crate::measure::arc::plots::PLOTS_MAX;

/// Two runs compared: `report.json` of the comparison.
#[derive(Debug, Clone, Serialize)]
pub struct Against {
    /// Name of the machine of both.
    pub machine: String,
    /// File name of the program in A.
    pub program: String,
    /// The run that is looked at.
    pub a: Side,
    /// The run that it is held against.
    pub b: Side,
    /// Whether both moved the same to the bit; null where one has no digest.
    pub same_motion: Option<bool>,
    /// Settings in which they differ, by the copies in the run directories.
    pub settings: Vec<Setting>,
    /// Machine time, in s.
    pub machine_time_s: Compared,
    /// Wall time, in s.
    pub wall_s: Compared,
    /// Distance of the table from the programmed path.
    pub contour_error_um: ComparedError,
    /// Per axis.
    pub axes: Vec<AxisAgainst>,
    /// Runs of arcs on one circle.
    pub arcs: Vec<ArcAgainst>,
    /// Over all reversals on arcs in steady motion.
    pub protrusions_um: Protrusions,
    /// Reversals on arcs.
    pub reversals: Vec<ReversalAgainst>,
    /// Setpoints beyond limits.
    pub limits: LimitsAgainst,
    /// Scans skipped because the master itself was late.
    pub overrun_scans: Compared,
    /// Samples missing in the log.
    pub samples_lost: Compared,
    /// How many processes were lost.
    pub faults: Compared,
}

/// One of the two runs.
#[derive(Debug, Clone, Serialize)]
pub struct Side {
    /// Name of its directory.
    pub run: String,
    /// Version of the product that recorded it.
    pub quadrant: String,
    /// `lockstep` or `realtime`.
    pub pace: String,
    /// How it ended.
    pub outcome: OutcomeReport,
    /// Why its log ends early; null if it is whole.
    pub cut: Option<String>,
    /// Whether the program in the directory is the one that ran; null if none ran.
    pub program_matches: Option<bool>,
    /// Kept by the master; null without instruments.
    pub motion_digest: Option<String>,
    /// What befell its processes.
    pub faults: Vec<FaultReport>,
}

/// A setting that is not the same.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Setting {
    /// File in the run directory.
    pub file: String,
    /// Path of the key in it.
    pub key: String,
    /// What A has; null if it has none.
    pub a: Option<String>,
    /// What B has.
    pub b: Option<String>,
}

/// One quantity of both.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Compared {
    /// Of A.
    pub a: Option<f64>,
    /// Of B.
    pub b: Option<f64>,
    /// A − B; null where one has none.
    pub difference: Option<f64>,
    /// The same in per cent of |B|; null also where B is 0.
    pub per_cent: Option<f64>,
}

/// Rounded to 1/1000; −0 becomes 0.
fn r3(value: f64) -> f64 {
    libm::round(value * 1e3) / 1e3 + 0.0
}

impl Compared {
    fn of(a: Option<f64>, b: Option<f64>) -> Compared {
        let difference = a.zip(b).map(|(a, b)| r3(a - b));
        Compared {
            a,
            b,
            difference,
            per_cent: difference
                .zip(b.filter(|b| *b != 0.0))
                .map(|(difference, b)| libm::round(difference / b.abs() * 1e4) / 1e2 + 0.0),
        }
    }

    fn both(a: f64, b: f64) -> Compared {
        Compared::of(Some(a), Some(b))
    }

    fn counts(a: u64, b: u64) -> Compared {
        Compared::both(a as f64, b as f64)
    }
}

/// Peak and rms of both.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ComparedError {
    /// Largest value.
    pub peak: Compared,
    /// Root mean square.
    pub rms: Compared,
}

/// Following error of both.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ComparedFollowing {
    /// Largest value.
    pub peak: Compared,
    /// 99 % of the scans do not exceed it.
    pub p99: Compared,
    /// Root mean square.
    pub rms: Compared,
}

/// One axis of both.
#[derive(Debug, Clone, Serialize)]
pub struct AxisAgainst {
    /// Its letter.
    pub axis: String,
    /// Its following error.
    pub following_error_um: ComparedFollowing,
    /// Scans without a command in time.
    pub missed_scans: Compared,
    /// Motor torque.
    pub torque_rms_nm: Compared,
}

/// One run on one circle of both.
#[derive(Debug, Clone, Serialize)]
pub struct ArcAgainst {
    /// Line of the program.
    pub block: u32,
    /// Which of the runs in that block, from 1.
    pub order: usize,
    /// Axes of its plane.
    pub plane: String,
    /// Programmed radius.
    pub radius_mm: f64,
    /// Programmed feed; null at rapid.
    pub feed_mm_min: Option<f64>,
    /// Direction.
    pub clockwise: bool,
    /// G of ISO 230-4.
    pub circular_deviation_um: Compared,
    /// Fitted minus programmed radius.
    pub radius_error_um: Compared,
}

/// One reversal of both.
#[derive(Debug, Clone, Serialize)]
pub struct ReversalAgainst {
    /// The axis.
    pub axis: String,
    /// −1 or 1.
    pub new_direction: i32,
    /// Line of the program.
    pub block: Option<u32>,
    /// Which of the axis' reversals to that direction in that block, from 1.
    pub order: usize,
    /// Highest residual in the window.
    pub protrusion_um: Compared,
    /// Lowest residual.
    pub undercut_um: Compared,
}

/// Reversals on arcs in steady motion, taken together.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Protrusions {
    /// How many there are.
    pub count: Compared,
    /// Mean protrusion.
    pub mean: Compared,
    /// Highest protrusion.
    pub worst: Compared,
    /// Deepest undercut.
    pub deepest_undercut: Compared,
}

/// Setpoints beyond limits of both.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct LimitsAgainst {
    /// Faster than the axis may.
    pub velocity_exceeded: Compared,
    /// Beyond its acceleration.
    pub acceleration_exceeded: Compared,
    /// Beyond its jerk.
    pub jerk_exceeded: Compared,
    /// Outside the travel.
    pub travel_exceeded: Compared,
}

/// What a comparison wrote.
pub struct Written {
    /// Its folder, in the run directory of A.
    pub folder: PathBuf,
    /// The text of its report.txt.
    pub text: String,
    /// The text of its report.json.
    pub json: String,
}

/// Name that people know a run directory by.
fn run_name(run_dir: &Path) -> Result<String, ReportError> {
    let path = run_dir
        .canonicalize()
        .map_err(|source| ReportError::Compare {
            what: format!("{}: cannot be read: {source}", run_dir.display()),
        })?;
    let name = path.file_name().map(|name| name.to_string_lossy());
    Ok(name.map_or_else(|| "root".into(), |name| name.into_owned()))
}

/// Measures both runs and writes `report.txt`, `report.html`, `report.json` and plots into `against-NAME` in the directory
/// of `a`, NAME being that of `b`. Nothing is written into `b`.
///
/// `settings` are the settings in which they differ: the plant's are none of the monitor's business, so whoever may see them
/// compares them.
///
/// # Errors
/// As [`super::make_report`]; also if the runs are of different machines or programs, or one and the same.
pub fn make_against(a: &Path, b: &Path, settings: Vec<Setting>) -> Result<Written, ReportError> {
    let names = [run_name(a)?, run_name(b)?];
    comparable(a, b)?;
    let (of_a, of_b) = (evaluate(a)?, evaluate(b)?);
    let against = Against::new(&of_a, &of_b, names.clone(), settings);
    let folder = a.join(format!("against-{}", names[1]));
    std::fs::create_dir_all(&folder).map_err(|source| ReportError::Write {
        path: folder.clone(),
        source,
    })?;
    super::remove_old_circles(&folder);
    tracking_plot::draw_against(&folder.join("tracking.svg"), [&of_a, &of_b], &names)?;
    let circles = draw_circles(&folder, [&of_a, &of_b], &names)?;
    let (text, json) = (words::text(&against), against.to_json());
    let page = words::html(&against, &folder, &circles)?;
    for (name, content) in [
        ("report.txt", &text),
        ("report.html", &page),
        ("report.json", &json),
    ] {
        let path = folder.join(name);
        std::fs::write(&path, content).map_err(|source| ReportError::Write { path, source })?;
    }
    Ok(Written { folder, text, json })
}

/// Refuses runs whose numbers say nothing about each other.
fn comparable(a: &Path, b: &Path) -> Result<(), ReportError> {
    let refused = |what: String| {
        Err(ReportError::Compare {
            what: format!(
                "{} cannot be held against {}: {what}",
                a.display(),
                b.display()
            ),
        })
    };
    if a.canonicalize().ok() == b.canonicalize().ok() {
        return refused("it is the same run".into());
    }
    let machines = [Machine::load(a)?, Machine::load(b)?];
    let mut differ = Vec::new();
    let [first, second] = &machines;
    if first.name != second.name {
        differ.push(format!(
            "their machines are {} and {}",
            first.name, second.name
        ));
    }
    let axes = machines.each_ref().map(|machine| {
        let names: Vec<&str> = machine.axes.iter().map(|a| a.name.as_str()).collect();
        names.join(" ")
    });
    if axes[0] != axes[1] {
        differ.push(format!("their axes are {} and {}", axes[0], axes[1]));
    }
    let program = |run_dir: &Path| -> Result<(String, String), ReportError> {
        let reader = RunLog::open(run_dir)?;
        let path = program_file(run_dir, reader.info())?;
        let text = std::fs::read(&path).map_err(|source| ReportError::Compare {
            what: format!("{}: cannot be read: {source}", path.display()),
        })?;
        let text = String::from_utf8_lossy(&text).into_owned();
        Ok((reader.info().program.clone(), text))
    };
    let ((name_a, text_a), (name_b, text_b)) = (program(a)?, program(b)?);
    if let Some(line) = first_difference(&text_a, &text_b) {
        let shown = |text: &str| match text.lines().nth(line - 1) {
            Some(text) => format!("\"{}\"", words::shortened(text.trim(), 60)),
            None => "nothing".into(),
        };
        differ.push(format!(
            "their programs, {name_a} and {name_b}, differ from line {line} on: {} and {}",
            shown(&text_a),
            shown(&text_b)
        ));
    }
    if differ.is_empty() {
        return Ok(());
    }
    refused(format!(
        "{}; only runs of one program on one machine are compared, their settings may differ",
        differ.join("; ")
    ))
}

/// First line, from 1, in which two programs differ; ends of lines do not count.
fn first_difference(a: &str, b: &str) -> Option<usize> {
    let (mut a, mut b) = (a.lines(), b.lines());
    let mut line = 0;
    loop {
        line += 1;
        match (a.next(), b.next()) {
            (None, None) => return None,
            (a, b) if a == b => {}
            _ => return Some(line),
        }
    }
}

type ArcKey = (u32, String, bool);

fn arc_key(arc: &ArcReport) -> ArcKey {
    (arc.block, arc.plane.clone(), arc.clockwise)
}

fn draw_circles(
    folder: &Path,
    runs: [&Evaluation; 2],
    names: &[String; 2],
) -> Result<Vec<String>, ReportError> {
    let [of_a, of_b] = runs;
    let (arcs_a, arcs_b) = (&of_a.measurements.arcs, &of_b.measurements.arcs);
    let key = |arc: &crate::measure::arc::ArcResult| {
        let circle = &arc.circle;
        (arc.line, circle.plane, circle.clockwise)
    };
    let pairs = matched(arcs_a, arcs_b, key);
    let both = pairs.iter().filter_map(|pair| pair.a.zip(pair.b));
    let both = both.filter(|(a, b)| !a.curve.is_empty() && !b.curve.is_empty());
    let mut files = Vec::new();
    for (index, (a, b)) in both.take(PLOTS_MAX).enumerate() {
        let name = format!("circle-{}.svg", index + 1);
        circle_plot::draw_against(&folder.join(&name), [(a, of_a), (b, of_b)], names)?;
        files.push(name);
    }
    Ok(files)
}

impl Against {
    /// Compares two measurements.
    pub fn new(
        of_a: &Evaluation,
        of_b: &Evaluation,
        names: [String; 2],
        settings: Vec<Setting>,
    ) -> Against {
        let (a, b) = (Report::new(of_a), Report::new(of_b));
        let [name_a, name_b] = names;
        let time_s =
            |report: &Report| r3(report.scans as f64 * f64::from(report.scan_period_us) * 1e-6);
        let digests = a.motion_digest.as_ref().zip(b.motion_digest.as_ref());
        Against {
            machine: a.machine.clone(),
            program: a.program.clone(),
            same_motion: digests.map(|(a, b)| a == b),
            settings,
            machine_time_s: Compared::both(time_s(&a), time_s(&b)),
            wall_s: Compared::of(a.wall_s.map(r3), b.wall_s.map(r3)),
            contour_error_um: ComparedError {
                peak: Compared::both(a.contour_error_um.peak, b.contour_error_um.peak),
                rms: Compared::both(a.contour_error_um.rms, b.contour_error_um.rms),
            },
            axes: a
                .axes
                .iter()
                .zip(&b.axes)
                .map(|(a, b)| axis(a, b))
                .collect(),
            arcs: arcs(&a, &b),
            protrusions_um: protrusions(&a, &b),
            reversals: reversals(&a, &b),
            limits: limits(&a.limits, &b.limits),
            overrun_scans: Compared::counts(a.overrun_scans.into(), b.overrun_scans.into()),
            samples_lost: Compared::counts(a.samples_lost, b.samples_lost),
            faults: Compared::counts(a.faults.len() as u64, b.faults.len() as u64),
            a: side(a, name_a),
            b: side(b, name_b),
        }
    }

    /// The text of `report.json`.
    pub fn to_json(&self) -> String {
        // A struct of numbers and strings: it cannot fail, and if it did the file would show it.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }
}

fn side(report: Report, run: String) -> Side {
    Side {
        run,
        quadrant: report.quadrant,
        pace: report.pace,
        outcome: report.outcome,
        cut: report.log.cut,
        program_matches: report.log.program_matches,
        motion_digest: report.motion_digest,
        faults: report.faults,
    }
}

fn axis(a: &AxisReport, b: &AxisReport) -> AxisAgainst {
    let (error_a, error_b) = (&a.following_error_um, &b.following_error_um);
    AxisAgainst {
        axis: a.axis.clone(),
        following_error_um: ComparedFollowing {
            peak: Compared::both(error_a.peak, error_b.peak),
            p99: Compared::both(error_a.p99, error_b.p99),
            rms: Compared::both(error_a.rms, error_b.rms),
        },
        missed_scans: Compared::counts(a.missed_scans.into(), b.missed_scans.into()),
        torque_rms_nm: Compared::both(a.torque_rms_nm, b.torque_rms_nm),
    }
}

fn arcs(a: &Report, b: &Report) -> Vec<ArcAgainst> {
    let pairs = matched(&a.arcs, &b.arcs, arc_key).into_iter();
    pairs
        .filter_map(|pair| {
            let any = pair.a.or(pair.b)?;
            let deviation = |arc: &ArcReport| arc.circular_deviation_um;
            let radius = |arc: &ArcReport| arc.radius_error_um;
            Some(ArcAgainst {
                block: any.block,
                order: pair.order,
                plane: any.plane.clone(),
                radius_mm: any.radius_mm,
                feed_mm_min: any.feed_mm_min,
                clockwise: any.clockwise,
                circular_deviation_um: Compared::of(pair.a.map(deviation), pair.b.map(deviation)),
                radius_error_um: Compared::of(pair.a.and_then(radius), pair.b.and_then(radius)),
            })
        })
        .collect()
}

fn reversals(a: &Report, b: &Report) -> Vec<ReversalAgainst> {
    let key = |r: &ReversalReport| (r.axis.clone(), r.block, r.new_direction);
    // All are matched, so that the order is that of travel; those on arcs have something to compare.
    let pairs = matched(&a.reversals, &b.reversals, key).into_iter();
    pairs
        .filter_map(|pair| {
            let any = pair.a.or(pair.b)?;
            let protrusion = |r: &ReversalReport| r.protrusion_um;
            let undercut = |r: &ReversalReport| r.undercut_um;
            let reversal = ReversalAgainst {
                axis: any.axis.clone(),
                new_direction: any.new_direction,
                block: any.block,
                order: pair.order,
                protrusion_um: Compared::of(
                    pair.a.and_then(protrusion),
                    pair.b.and_then(protrusion),
                ),
                undercut_um: Compared::of(pair.a.and_then(undercut), pair.b.and_then(undercut)),
            };
            let measured = reversal.protrusion_um.a.or(reversal.protrusion_um.b);
            measured.map(|_| reversal)
        })
        .collect()
}

fn protrusions(a: &Report, b: &Report) -> Protrusions {
    let steady = |report: &Report| -> Vec<(f64, f64)> {
        let steady = report.reversals.iter().filter(|reversal| reversal.steady);
        steady
            .filter_map(|reversal| reversal.protrusion_um.zip(reversal.undercut_um))
            .collect()
    };
    let (a, b) = (steady(a), steady(b));
    let of = |value: fn(&[(f64, f64)]) -> Option<f64>| Compared::of(value(&a), value(&b));
    Protrusions {
        count: of(|all| Some(all.len() as f64)),
        mean: of(|all| {
            let sum: f64 = all.iter().map(|(protrusion, _)| protrusion).sum();
            (!all.is_empty()).then(|| r3(sum / all.len() as f64))
        }),
        worst: of(|all| {
            all.iter()
                .map(|(protrusion, _)| *protrusion)
                .reduce(f64::max)
        }),
        deepest_undercut: of(|all| all.iter().map(|(_, undercut)| *undercut).reduce(f64::min)),
    }
}

fn limits(a: &LimitsReport, b: &LimitsReport) -> LimitsAgainst {
    LimitsAgainst {
        velocity_exceeded: Compared::counts(a.velocity_exceeded, b.velocity_exceeded),
        acceleration_exceeded: Compared::counts(a.acceleration_exceeded, b.acceleration_exceeded),
        jerk_exceeded: Compared::counts(a.jerk_exceeded, b.jerk_exceeded),
        travel_exceeded: Compared::counts(a.travel_exceeded, b.travel_exceeded),
    }
}
