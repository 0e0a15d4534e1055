//! `quadrant run --learn`: what a run that went well teaches for the next one.

use std::path::Path;

use anyhow::{Context, bail};
use bus::sample::{AxisCommand, Feedback};
use control::learned_table::{LearnedTable, LearnedValue};
use control::learning::{Learner, Observation, TrainingLimits};
use launcher::exit::{Kind, Outcome};
use launcher::output::say;
use launcher::run::Completed;
use machine::learned::{Learned, LearnedAxis, LearnedPass, learned_file, settings_hash};
use machine::{AdaptationMode, Axis, Machine, replace_file};
use monitor::log::{LOG_FILE, Reader, Sample, part_files};

/// Largest learned torque, as a share of the peak torque.
const TORQUE_SHARE: f64 = 0.1;
/// Largest learned lost motion, in mm.
const LOST_MOTION_MM: f64 = 0.02;
/// A pass that finds the same program worse than this, against the pass before, has learned something wrong.
const WORSE: f64 = 1.1;
/// … and by more than this share of the rated torque: below it is cogging.
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
    let mut learned = Learned::beside(&run_dir.join("machine.toml"), machine)?
        .unwrap_or_else(|| Learned::none(machine));
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
    for (axis, learner) in machine.axes.iter().zip(observed.learners) {
        let Some(learner) = learner else {
            lines.push(format!(
                "{}: has no [axis.model] in use, learns nothing",
                axis.name
            ));
            continue;
        };
        let before = learned.of(machine, axis).cloned();
        let (entry, line) = pass(machine, axis, &learner, before, &observed.program);
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
    let mut axes: Vec<Option<Follower>> = machine
        .axes
        .iter()
        .map(|axis| Follower::new(machine, axis))
        .collect();
    let mut hash = 0;
    let (mut missing_scans, mut last_scan) = (0, None);
    let mut feedback: Option<Box<Feedback>> = None;
    let mut commands: Vec<Option<Box<AxisCommand>>> = vec![None; machine.axes.len()];
    while let Some(sample) = reader.next_sample()? {
        match sample {
            Sample::Feedback(next) => {
                if next.program_hash != 0 {
                    hash = next.program_hash;
                }
                if let Some(last) = last_scan.replace(next.scan) {
                    missing_scans += next.scan.saturating_sub(last + 1);
                }
                feedback = Some(next);
            }
            Sample::Command(command) => {
                if let Some(place) = commands.get_mut(command.axis as usize) {
                    *place = Some(command);
                }
            }
            _ => {}
        }
        let Some(now) = &feedback else { continue };
        let whole = commands
            .iter()
            .all(|c| c.as_ref().is_some_and(|c| c.scan == now.scan));
        if !whole {
            continue;
        }
        for ((follower, command), axis) in axes.iter_mut().zip(&commands).zip(now.axes()) {
            if let (Some(follower), Some(command)) = (follower, command) {
                follower.take(now, axis, command);
            }
        }
        feedback = None;
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

/// What the program says of what an axis has learned before.
enum Verdict {
    /// Nothing: it is another program, or the first pass.
    None,
    /// What the last pass learned is worse than what there was before it.
    Worse,
    /// The best pass is in force, and does as well as it did.
    Settled,
}

fn verdict(axis: &Axis, before: Option<&LearnedAxis>, program: &str, rms_nm: f64) -> Verdict {
    let Some(before) = before.filter(|before| before.program == program) else {
        return Verdict::None;
    };
    let noticed_nm = NOTICED_SHARE * axis.motor.rated_torque_nm;
    let is_worse = rms_nm > WORSE * before.residual_rms_nm + noticed_nm;
    match (before.settled, is_worse) {
        (false, true) => Verdict::Worse,
        (true, false) => Verdict::Settled,
        // A machine that has changed since it settled learns again.
        (true, true) | (false, false) => Verdict::None,
    }
}

/// What one axis knows after this pass, and a line that reports it.
fn pass(
    machine: &Machine,
    axis: &Axis,
    learner: &Learner,
    before: Option<LearnedAxis>,
    program: &str,
) -> (Option<LearnedAxis>, String) {
    let table = before
        .as_ref()
        .map(|of| table_of(&of.table))
        .unwrap_or_default();
    let training = learner.training(&table, &limits(axis));
    if training.samples == 0 {
        return (
            before,
            format!("{}: no reversal on the path, nothing learned", axis.name),
        );
    }
    let rms_nm = training.residual_rms_nm;
    let passes = before.as_ref().map_or(0, |before| before.passes) + 1;
    let found = verdict(axis, before.as_ref(), program, rms_nm);
    let best_rms_nm = before.as_ref().map_or(rms_nm, |of| of.residual_rms_nm);
    let former = before.as_ref().and_then(|of| of.before.as_ref());
    let (next, settled, residual_rms_nm, words) = match found {
        Verdict::Worse => (
            former.map(table_of).unwrap_or_default(),
            true,
            best_rms_nm,
            "; worse than the pass before: back to that, and this program teaches nothing more",
        ),
        Verdict::Settled => (table, true, best_rms_nm, "; as good as its best pass: kept"),
        Verdict::None => (training.table, false, rms_nm, ""),
    };
    let line = format!(
        "{}: pass {passes}, residual {rms_nm:.3} N·m rms near reversals, friction × {:.3}{words}",
        axis.name, next.friction_scale,
    );
    let entry = LearnedAxis {
        name: axis.name.clone(),
        settings: settings_hash(machine, axis),
        passes,
        program: program.to_string(),
        residual_rms_nm,
        settled,
        table: kept(&next),
        before: (!settled).then(|| kept(&table)),
    };
    (Some(entry), line)
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

    fn known(machine: &Machine, rms_nm: f64, settled: bool) -> LearnedAxis {
        let axis = &machine.axes[0];
        LearnedAxis {
            name: axis.name.clone(),
            settings: settings_hash(machine, axis),
            passes: 1,
            program: "a".into(),
            residual_rms_nm: rms_nm,
            settled,
            table: kept(&LearnedTable::default()),
            before: None,
        }
    }

    #[test]
    fn a_pass_is_judged_by_the_same_program_alone_and_one_that_settled_learns_again_when_it_gets_worse()
     {
        let machine = shipped();
        let axis = &machine.axes[0];
        let of = |settled: bool, program: &str, rms_nm: f64| {
            let before = known(&machine, 0.2, settled);
            match verdict(axis, Some(&before), program, rms_nm) {
                Verdict::None => "none",
                Verdict::Worse => "worse",
                Verdict::Settled => "settled",
            }
        };
        assert_eq!(of(false, "a", 0.25), "none");
        assert_eq!(of(false, "a", 0.35), "worse");
        assert_eq!(of(false, "b", 0.35), "none");
        assert_eq!(of(true, "a", 0.25), "settled");
        assert_eq!(of(true, "a", 0.35), "none");
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
