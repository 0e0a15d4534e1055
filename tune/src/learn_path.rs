//! `quadrant run --learn-path`: what a run of a program teaches for the next one of the same program, along its path.

mod judge;
mod observe;

use std::fs;
use std::path::Path;

use crate::path_learning::{CORNER_HZ, PathKnot};
use anyhow::Context;
use console::exit::{Kind, Outcome};
use console::output::say;
use launcher::run::Completed;
use machine::learned::Learned;
use machine::learned_path::{
    LEARNED_PATH_FILE, LEARNED_PATH_VERSION, LearnedKnot, LearnedPath, LearnedPathHead,
    LearnedPathPass, learned_path_file, path_settings_hash, trial_path_file,
};
use machine::{Machine, replace_file};

use judge::{Next, Standing, judged};
use observe::Observed;
pub(crate) use observe::observe;

/// Learns along the path of a run that went well, and shows what.
///
/// # Errors
/// The log cannot be read, is not one to learn from, or a file not be written.
pub fn after(run: &Completed) -> Outcome {
    let line = learn(&run.folder, &run.machine_file, &run.machine).environment()?;
    say(&format!("Learned along the path: {line}"));
    Ok(())
}

/// Learns from the log of a run, and writes best and next correction beside the machine file; a line that reports the pass.
///
/// # Errors
/// The log cannot be read or is not one to learn from: then nothing is written; or a file cannot be written.
pub fn learn(run_dir: &Path, machine_path: &Path, machine: &Machine) -> anyhow::Result<String> {
    let in_force = LearnedPath::load(&run_dir.join(LEARNED_PATH_FILE), machine)?;
    let seen = observe(run_dir, machine, in_force.as_ref())?;
    let best_file = learned_path_file(machine_path, &seen.program);
    let trial_file = trial_path_file(machine_path, &seen.program);
    let learned = Learned::beside(&run_dir.join("machine.toml"), machine)?;
    let settings = path_settings_hash(machine, learned.as_ref());
    let best = LearnedPath::load(&best_file, machine)?
        .filter(|best| best.unfit(seen.program_hash, &settings).is_none());
    let error = seen.pass.error();
    let now = LearnedPathPass {
        pass: best.as_ref().map_or(0, passes_of) + 1,
        mean_um: rounded(error.mean_um),
        worst_um: rounded(error.worst_um),
        rms_um: rounded(error.rms_um),
    };
    let standing = best.as_ref().and_then(standing_of);
    let ran_best = best
        .as_ref()
        .is_some_and(|best| knots_of(in_force.as_ref()) == knots_of(Some(best)));
    let verdict = judged(standing.as_ref(), ran_best, now);
    let blank = blank(machine, &seen, settings);
    let mut kept = best
        .clone()
        .filter(|_| !verdict.takes)
        .unwrap_or_else(|| LearnedPath {
            knots: knots_of(in_force.as_ref()).to_vec(),
            ..blank.clone()
        });
    kept.head.passes = best
        .as_ref()
        .map_or(Vec::new(), |best| best.head.passes.clone());
    kept.note(now);
    kept.head.measured = Some(verdict.standing.best);
    kept.head.gain = verdict.standing.gain;
    kept.head.passes_no_better = verdict.standing.passes_no_better;
    kept.head.settled = verdict.standing.settled;
    if verdict.next != Next::Learn {
        remove(&trial_file)?;
    }
    write(&best_file, &kept)?;
    if verdict.next == Next::Learn {
        let learned = seen.pass.learned(verdict.standing.gain, CORNER_HZ);
        let trial = LearnedPath {
            knots: learned
                .iter()
                .map(|knot| row(knot, machine.axes.len()))
                .collect(),
            ..blank
        };
        write(&trial_file, &trial)?;
    }
    let last = best.as_ref().and_then(|best| best.head.passes.last());
    Ok(line(&now, last, &verdict.standing.best, verdict.words))
}

fn passes_of(best: &LearnedPath) -> u32 {
    best.head.passes.last().map_or(0, |pass| pass.pass)
}

fn standing_of(best: &LearnedPath) -> Option<Standing> {
    Some(Standing {
        best: best.head.measured?,
        gain: best.head.gain,
        passes_no_better: best.head.passes_no_better,
        settled: best.head.settled,
    })
}

/// A correction of this program that has no knots yet.
fn blank(machine: &Machine, seen: &Observed, settings: String) -> LearnedPath {
    LearnedPath {
        head: LearnedPathHead {
            version: LEARNED_PATH_VERSION,
            machine: machine.name.clone(),
            program: seen.program.clone(),
            program_hash: format!("{:016x}", seen.program_hash),
            settings,
            gain: 0.0,
            passes_no_better: 0,
            settled: false,
            measured: None,
            passes: Vec::new(),
        },
        axes: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
        elements: seen.elements.clone(),
        knots: Vec::new(),
    }
}

fn knots_of(path: Option<&LearnedPath>) -> &[LearnedKnot] {
    path.map_or(&[], |path| &path.knots)
}

fn row(knot: &PathKnot, axes: usize) -> LearnedKnot {
    LearnedKnot {
        place_mm: knot.place_mm,
        speed_mm_s: knot.speed_mm_s,
        correction_mm: knot.correction_mm.iter().take(axes).copied().collect(),
    }
}

/// To a nanometre, as the file shows it.
fn rounded(um: f64) -> f64 {
    libm::round(um * 1e3) / 1e3
}

fn write(file: &Path, path: &LearnedPath) -> anyhow::Result<()> {
    let named = || format!("{}: cannot be written", file.display());
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).with_context(named)?;
    }
    replace_file(file, &path.text()).with_context(named)
}

fn remove(file: &Path) -> anyhow::Result<()> {
    match fs::remove_file(file) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be removed", file.display()))
        }
        _ => Ok(()),
    }
}

fn line(
    now: &LearnedPathPass,
    before: Option<&LearnedPathPass>,
    best: &LearnedPathPass,
    words: &str,
) -> String {
    let pair = |of: &LearnedPathPass| format!("{:.2} / {:.2}", of.mean_um, of.worst_um);
    let before = before.map_or("none".to_string(), pair);
    format!(
        "pass {}: {} µm mean / worst by the scale at reversals, before {before}, best {}; {words}",
        now.pass,
        pair(now),
        pair(best)
    )
}
