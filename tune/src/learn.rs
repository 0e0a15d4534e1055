//! `quadrant run --learn`: what a run that went well teaches for the next one.

use std::path::Path;

use crate::learning::{Learner, Observation, TrainingLimits};
use anyhow::{Context, bail};
use bus::sample::{AxisCommand, Feedback};
use console::exit::{Kind, Outcome};
use console::output::say;
use launcher::run::Completed;
use loops::learned_table::{LearnedTable, LearnedValue};
use machine::learned::{
    Learned, LearnedAxis, LearnedContour, LearnedPass, learned_file, settings_hash,
};
use machine::{AdaptationMode, Axis, Machine, replace_file};
use monitor::log::{LOG_FILE, Reader, Sample, part_files};

use crate::learn_path;
use crate::recording::InStep;

/// Largest learned torque, as a share of the peak torque.
const TORQUE_SHARE: f64 = 0.1;
/// Largest learned lost motion, in mm.
const LOST_MOTION_MM: f64 = 0.02;
/// A pass that finds the same program worse than this, against the best pass, has tried something wrong …
const WORSE: f64 = 1.1;
/// … and by more than this, in µm, by the scale;
const NOTICED_UM: f64 = 0.2;
/// What is on trial must also be no worse than this in the mean: less than that is noise.
const TRIAL_WORSE: f64 = 1.02;
/// where there is none, by more than this share of the rated torque: below it is cogging.
const NOTICED_SHARE: f64 = 0.01;
/// Accelerations above this share of the axis's own are those of rapids, starts and stops: arcs use less (40 % of it).
const ACCELERATION_SHARE: f64 = 0.6;
/// Feeds above this share of the rapid traverse are positioning: nobody measures the path there.
const FEED_SHARE: f64 = 0.7;

/// `quadrant run --learn`: learns from a run that went well and shows what.
///
/// # Errors
/// The log cannot be read, or the file not be written.
pub fn after(run: &Completed) -> Outcome {
    let lines = learn(&run.folder, &run.machine_file, &run.machine).environment()?;
    let path = learned_file(&run.machine_file);
    say(&format!("Learned, {}:", path.display()));
    for line in lines {
        say(&format!("  {line}"));
    }
    Ok(())
}

/// Learns from the log of a run and writes `learned.toml` beside the machine file; a line for each axis.
///
/// # Errors
/// The log cannot be read, or the file not be written.
pub fn learn(
    run_dir: &Path,
    machine_path: &Path,
    machine: &Machine,
) -> anyhow::Result<Vec<String>> {
    // What was tried is in the run directory; what is known beside it, beside the machine file.
    let tried = Learned::beside(&run_dir.join("machine.toml"), machine)?;
    let mut learned =
        Learned::beside(machine_path, machine)?.unwrap_or_else(|| Learned::none(machine));
    let parts = part_files(run_dir)?.len();
    if parts > 1 {
        bail!(
            "{}: the log is in {parts} parts, for the recorder died in the run: scans are missing, and what happened at reversals in them must not be guessed; nothing is learned: run again",
            run_dir.display()
        );
    }
    let mut reader = Reader::open(&run_dir.join(LOG_FILE))?;
    let observed = observe(&mut reader, machine)?;
    refuse_gaps(run_dir, &reader, &observed)?;
    let mut lines = Vec::new();
    // A run that cannot be judged by its scales is judged by its torques.
    let seen = learn_path::observe(run_dir, machine, None).ok();
    for ((index, axis), learner) in machine.axes.iter().enumerate().zip(observed.learners) {
        let Some(learner) = learner else {
            lines.push(format!(
                "{}: has no [axis.model] in use, learns nothing",
                axis.name
            ));
            continue;
        };
        let before = learned.of(machine, axis).cloned();
        let contour = seen
            .as_ref()
            .and_then(|seen| seen.pass.error_of_axis_um(index));
        let shown = Shown {
            learner: &learner,
            program: &observed.program,
            contour: contour.map(|(mean_um, worst_um)| LearnedContour {
                mean_um: rounded(mean_um),
                worst_um: rounded(worst_um),
            }),
            tried: tried
                .as_ref()
                .and_then(|tried| tried.of(machine, axis))
                .map(|of| of.table.clone()),
        };
        let (entry, line) = pass(machine, axis, &shown, before);
        lines.push(line);
        learned.axes.retain(|known| known.name != axis.name);
        learned.axes.extend(entry);
    }
    let path = learned_file(machine_path);
    replace_file(&path, &learned.text()).with_context(|| path.display().to_string())?;
    Ok(lines)
}

/// Nothing is learned from a log that does not have the whole run.
fn refuse_gaps(run_dir: &Path, reader: &Reader, observed: &Observed) -> anyhow::Result<()> {
    let log = run_dir.join(LOG_FILE);
    if let Some(cut) = reader.cut() {
        bail!(
            "{}: is not whole ({cut}): nothing is learned: run again",
            log.display()
        );
    }
    if observed.missing_scans > 0 {
        bail!(
            "{}: {} scans are missing, and what happened at reversals in them must not be guessed; nothing is learned: run again",
            log.display(),
            observed.missing_scans
        );
    }
    Ok(())
}

/// What a log showed.
struct Observed {
    program: String,
    missing_scans: u64,
    learners: Vec<Option<Learner>>,
}

/// Goes through the log once.
fn observe(reader: &mut Reader, machine: &Machine) -> anyhow::Result<Observed> {
    let axes = machine.axes.iter();
    let mut axes: Vec<_> = axes.map(|axis| Follower::new(machine, axis)).collect();
    let mut hash = 0;
    let (mut missing_scans, mut last_scan) = (0, None);
    let mut in_step = InStep::new(machine.axes.len());
    while let Some(sample) = reader.next_sample()? {
        if let Sample::Feedback(next) = &sample {
            if next.program_hash != 0 {
                hash = next.program_hash;
            }
            if let Some(last) = last_scan.replace(next.scan) {
                missing_scans += next.scan.saturating_sub(last + 1);
            }
        }
        let Some(now) = in_step.take(sample) else {
            continue;
        };
        for ((follower, command), axis) in axes.iter_mut().zip(in_step.commands()).zip(now.axes()) {
            if let Some(follower) = follower {
                follower.take(&now, axis, command);
            }
        }
    }
    Ok(Observed {
        program: format!("{hash:016x}"),
        missing_scans,
        learners: axes.into_iter().map(|f| f.map(|f| f.learner)).collect(),
    })
}

/// Brings commands and feedback of one axis together.
struct Follower {
    learner: Learner,
    increment_mm: f64,
    feed_max_mm_s: f64,
    /// Torques fed forward in the last scans, the newest first; the last of them is in the torque that the feedback shows.
    fed_forward_nm: Vec<f64>,
    last_scan: u64,
}

impl Follower {
    fn new(machine: &Machine, axis: &Axis) -> Option<Follower> {
        let model = axis.model?;
        Some(Follower {
            learner: Learner::new(
                model.mass_kg,
                radius_m(axis),
                machine.scan_period_s(),
                ACCELERATION_SHARE * axis.acceleration_mm_s2,
            ),
            increment_mm: axis.increment_mm(),
            feed_max_mm_s: FEED_SHARE * axis.rapid_mm_s,
            fed_forward_nm: vec![0.0; machine.scan.dead_time_scans as usize + 1],
            last_scan: 0,
        })
    }

    fn take(
        &mut self,
        feedback: &Feedback,
        axis: &bus::sample::AxisFeedback,
        command: &AxisCommand,
    ) {
        let mm = |increments: i64| increments as f64 * self.increment_mm;
        let acting_nm = self.fed_forward_nm.last().copied().unwrap_or(0.0);
        let follows = feedback.scan == self.last_scan + 1;
        self.learner.take(Observation {
            command_mm: mm(command.position),
            motor_mm: mm(axis.motor_position),
            scale_mm: mm(axis.scale_position),
            compensation_mm: command.compensation_mm,
            torque_nm: axis.torque_nm,
            fed_forward_nm: acting_nm,
            counts: follows
                && !feedback.window.is_none()
                && command.feed_forward_mm_s.abs() < self.feed_max_mm_s
                && command.cause == 0,
        });
        self.fed_forward_nm.rotate_right(1);
        if let Some(now_nm) = self.fed_forward_nm.first_mut() {
            *now_nm = command.torque_feed_forward_nm;
        }
        self.last_scan = feedback.scan;
    }
}

fn radius_m(axis: &Axis) -> f64 {
    axis.lead_mm * 1e-3 / std::f64::consts::TAU
}

/// What a run has shown of an axis.
struct Shown<'a> {
    learner: &'a Learner,
    /// Hash of the program that ran.
    program: &'a str,
    /// Error at the reversals of the axis; none without a scale.
    contour: Option<LearnedContour>,
    /// The table that it ran with; none without one.
    tried: Option<LearnedPass>,
}

/// What a pass says of the table that it ran with.
#[derive(Debug, PartialEq, Eq)]
enum Verdict {
    /// It is the first pass of this program: what comes is compared with it.
    First,
    /// What was on trial is no worse than the best pass: it is taken, and the next pass tries more.
    Good,
    /// It is worse: the axis stays with what it had.
    Worse,
    /// What had been shown to be good is worse now than it was: the machine has changed.
    Changed,
    /// What had been shown to be good does as well as it did.
    Kept,
}

/// Whether this pass is worse than the best one: by the scale, in mean or worst; where one of them has none, by torque. What is on
/// trial has no credit in the mean.
fn is_worse(
    axis: &Axis,
    best: &LearnedAxis,
    contour: Option<LearnedContour>,
    rms_nm: f64,
    on_trial: bool,
) -> bool {
    match (best.contour, contour) {
        (Some(best), Some(now)) => {
            let beyond = |now_um: f64, best_um: f64| now_um > WORSE * best_um + NOTICED_UM;
            beyond(now.mean_um, best.mean_um)
                || beyond(now.worst_um, best.worst_um)
                || (on_trial && now.mean_um > TRIAL_WORSE * best.mean_um)
        }
        _ => {
            let noticed_nm = NOTICED_SHARE * axis.motor.rated_torque_nm;
            rms_nm > WORSE * best.residual_rms_nm + noticed_nm
        }
    }
}

fn verdict(axis: &Axis, before: Option<&LearnedAxis>, shown: &Shown<'_>, rms_nm: f64) -> Verdict {
    let Some(before) = before.filter(|before| before.program == shown.program) else {
        return Verdict::First;
    };
    let on_trial = before.trial.is_some() && shown.tried == before.trial;
    let worse = is_worse(axis, before, shown.contour, rms_nm, on_trial);
    match (on_trial, worse) {
        (true, false) => Verdict::Good,
        (true, true) => Verdict::Worse,
        (false, true) => Verdict::Changed,
        (false, false) => Verdict::Kept,
    }
}

/// The better of two passes, in mean and in worst.
fn best_of(before: Option<LearnedContour>, now: Option<LearnedContour>) -> Option<LearnedContour> {
    match (before, now) {
        (Some(before), Some(now)) => Some(LearnedContour {
            mean_um: before.mean_um.min(now.mean_um),
            worst_um: before.worst_um.min(now.worst_um),
        }),
        (None, None) => None,
        // One of them was judged by its torque alone: so are those to come, until another program.
        _ => before,
    }
}

/// What one axis knows after this pass, and a line that reports it.
fn pass(
    machine: &Machine,
    axis: &Axis,
    shown: &Shown<'_>,
    before: Option<LearnedAxis>,
) -> (Option<LearnedAxis>, String) {
    let tried = shown.tried.as_ref().map(table_of).unwrap_or_default();
    let training = shown.learner.training(&tried, &limits(axis));
    if training.samples == 0 {
        return (
            before,
            format!("{}: no reversal on the path, nothing learned", axis.name),
        );
    }
    let rms_nm = training.residual_rms_nm;
    let found = verdict(axis, before.as_ref(), shown, rms_nm);
    let passes = before.as_ref().map_or(0, |before| before.passes) + 1;
    let known = before.as_ref().map(|of| of.table.clone());
    let best = before
        .as_ref()
        .filter(|_| matches!(found, Verdict::Good | Verdict::Worse | Verdict::Kept));
    let settled = found == Verdict::Worse
        || found == Verdict::Kept && before.as_ref().is_some_and(|of| of.settled);
    let table = match found {
        Verdict::Good => kept(&tried),
        _ => known.unwrap_or_else(|| kept(&LearnedTable::default())),
    };
    let entry = LearnedAxis {
        name: axis.name.clone(),
        settings: settings_hash(machine, axis),
        passes,
        program: shown.program.to_string(),
        residual_rms_nm: best.map_or(rms_nm, |of| of.residual_rms_nm.min(rms_nm)),
        contour: best.map_or(shown.contour, |of| best_of(of.contour, shown.contour)),
        settled,
        table,
        trial: (!settled).then(|| kept(&training.table)),
    };
    let line = line(axis, &entry, shown, rms_nm, &found);
    (Some(entry), line)
}

fn line(
    axis: &Axis,
    entry: &LearnedAxis,
    shown: &Shown<'_>,
    rms_nm: f64,
    found: &Verdict,
) -> String {
    let words = match (found, entry.settled) {
        (Verdict::First, _) => "the next pass tries what this one has taught",
        (Verdict::Good, _) => "kept: no worse than the best pass",
        (Verdict::Worse, _) => {
            "worse than the best pass: not kept, and this program teaches nothing more"
        }
        (Verdict::Changed, _) => "worse than it was: learns again",
        (Verdict::Kept, true) => "as good as its best pass: kept",
        (Verdict::Kept, false) => {
            "nothing was on trial; the next pass tries what this one has taught"
        }
    };
    let contour = shown.contour.map_or(String::new(), |of| {
        format!(
            ", {:.2} / {:.2} µm mean / worst by the scale",
            of.mean_um, of.worst_um
        )
    });
    let (name, passes, scale) = (&axis.name, entry.passes, entry.table.friction_scale);
    format!(
        "{name}: pass {passes}, residual {rms_nm:.3} N·m rms near reversals{contour}, friction × {scale:.3}; {words}"
    )
}

/// To a nanometre, as the file shows it.
fn rounded(um: f64) -> f64 {
    libm::round(um * 1e3) / 1e3
}

/// Bounds of a pass. The friction of an axis that follows it is not scaled: one of the two decides.
fn limits(axis: &Axis) -> TrainingLimits {
    let follows = axis.adaptation.mode == AdaptationMode::On;
    let scaled = axis
        .model
        .filter(|_| axis.torque_feed_forward.friction && !follows);
    let coulomb_n = scaled.map_or(0.0, |model| model.coulomb_n);
    TrainingLimits {
        coulomb_nm: coulomb_n * radius_m(axis),
        torque_nm: TORQUE_SHARE * axis.motor.peak_torque_nm,
        lost_motion_mm: LOST_MOTION_MM,
    }
}

/// A table as the file has it.
fn kept(table: &LearnedTable) -> LearnedPass {
    let column = |direction: usize, of: fn(&LearnedValue) -> f64| -> Vec<f64> {
        let cells = table.directions.get(direction);
        cells
            .into_iter()
            .flatten()
            .map(|v| libm::round(of(v) * 1e6) / 1e6)
            .collect()
    };
    LearnedPass {
        friction_scale: table.friction_scale,
        negative_torque_nm: column(0, |v| v.torque_nm),
        positive_torque_nm: column(1, |v| v.torque_nm),
        negative_lost_motion_um: column(0, |v| v.lost_motion_mm * 1e3),
        positive_lost_motion_um: column(1, |v| v.lost_motion_mm * 1e3),
    }
}

fn table_of(of: &LearnedPass) -> LearnedTable {
    LearnedTable::from_columns(
        of.friction_scale,
        [&of.negative_torque_nm, &of.positive_torque_nm],
        [&of.negative_lost_motion_um, &of.positive_lost_motion_um],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped() -> Machine {
        let text = include_str!("../../machines/xy/machine.toml");
        Machine::parse("machine.toml", text).expect("a machine")
    }

    fn known(machine: &Machine) -> LearnedAxis {
        let axis = &machine.axes[0];
        LearnedAxis {
            name: axis.name.clone(),
            settings: settings_hash(machine, axis),
            passes: 1,
            program: "a".into(),
            residual_rms_nm: 0.2,
            contour: Some(LearnedContour {
                mean_um: 2.0,
                worst_um: 4.0,
            }),
            settled: false,
            table: kept(&LearnedTable::default()),
            trial: Some(scaled(1.2)),
        }
    }

    fn scaled(friction_scale: f64) -> LearnedPass {
        kept(&LearnedTable {
            friction_scale,
            ..LearnedTable::default()
        })
    }

    fn judged(
        machine: &Machine,
        program: &str,
        tried: LearnedPass,
        contour: Option<(f64, f64)>,
        rms_nm: f64,
    ) -> Verdict {
        let learner = Learner::new(800.0, 1.59e-3, 1e-3, 3000.0);
        let shown = Shown {
            learner: &learner,
            program,
            contour: contour.map(|(mean_um, worst_um)| LearnedContour { mean_um, worst_um }),
            tried: Some(tried),
        };
        verdict(&machine.axes[0], Some(&known(machine)), &shown, rms_nm)
    }

    #[test]
    fn a_trial_is_taken_only_if_the_same_program_shows_it_to_be_no_worse_by_the_scale_than_the_best_pass()
     {
        let machine = shipped();
        let of = |program: &str, contour: (f64, f64)| {
            judged(&machine, program, scaled(1.2), Some(contour), 9.0)
        };
        assert_eq!(of("a", (2.03, 4.59)), Verdict::Good);
        assert_eq!(of("a", (2.05, 4.0)), Verdict::Worse);
        assert_eq!(of("a", (1.0, 4.61)), Verdict::Worse);
        assert_eq!(of("b", (9.0, 9.0)), Verdict::First);
        // With the table that had been shown to be good.
        let known = |contour| judged(&machine, "a", scaled(1.0), Some(contour), 0.2);
        assert_eq!(known((2.3, 4.0)), Verdict::Kept);
        assert_eq!(known((3.3, 4.0)), Verdict::Changed);
    }

    #[test]
    fn without_a_scale_a_trial_is_judged_by_its_torque() {
        let machine = shipped();
        let of = |rms_nm: f64| judged(&machine, "a", scaled(1.2), None, rms_nm);
        assert_eq!(of(0.25), Verdict::Good);
        assert_eq!(of(0.35), Verdict::Worse);
    }

    #[test]
    fn friction_that_is_followed_is_not_scaled_by_what_is_learned() {
        let mut machine = shipped();
        machine.axes[0].adaptation.mode = AdaptationMode::On;
        assert_eq!(limits(&machine.axes[0]).coulomb_nm, 0.0);
        machine.axes[0].adaptation.mode = AdaptationMode::Off;
        assert!(limits(&machine.axes[0]).coulomb_nm > 0.5);
    }
}
