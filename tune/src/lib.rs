//! `quadrant tune`: short test motions on the running cell tell what each axis has to move; laws make the settings of it.
//!
//! 1. strokes with the gains as they are: a first mass and the dead time of the drives (`dead_time`), and gains by law from them;
//! 2. strokes, reversals at low and high acceleration, steady speeds: mass, friction, lost motion, gap (`identify`);
//! 3. does the model fit? If not, nothing is written (`judge`);
//! 4. what rings after a change of acceleration (`ringing`), and motion that spares it (`smooth`);
//! 5. settings by law (`laws`), test circles before and after (`trial`);
//! 6. the machine file, the old one kept (`write`, `keep`).
//!
//! **Invariant**: nothing is known of the machine but its machine file and what its encoders and drives say. The plant file
//! is copied for the simulated machine, unread.

mod bench;
mod choose;
mod dead_time;
mod from_recording;
mod identify;
mod judge;
mod keep;
pub mod laws;
pub mod learn;
pub mod learn_path;
mod learning;
mod least_squares;
mod motions;
pub mod new_machine;
pub mod options;
mod own_form;
mod path_learning;
mod recording;
mod ringing;
mod smooth;
mod test_motions;
mod trial;
mod write;
mod zero_phase;

use std::fs;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use machine::{Machine, PositionFeedback, ReversalMethod, machine_file};
use own_form::{with_own_units, with_slides};
use toml_edit::DocumentMut;

use crate::options::{TuneOptions, of_axes};
use bench::Bench;
use console::exit::{Failure, Kind, Outcome};
use console::logs;
use console::output::say;
use console::signals::Signals;
use dead_time::DeadTime;
pub use from_recording::identify as identify_recording;
use identify::Found;
use ringing::Ringing;
use test_motions::TestMotions;

/// Tunes a machine.
pub fn tune(options: &TuneOptions) -> Outcome {
    logs::init_launcher();
    let path = machine_file(&options.machine);
    let machine = machine_to_tune(&path).input()?;
    let reported = &options.lost_motion_um;
    let given_um = of_axes(&machine, "--lost-motion-um", reported, 0.0..=1000.0).input()?;
    let limits = motions::limits(&machine, options).input()?;
    let circles = motions::named_circles(&machine, &limits, &options.circles).input()?;
    let text = fs::read_to_string(&path).input()?;
    let original: DocumentMut = text
        .parse()
        .with_context(|| path.display().to_string())
        .input()?;
    // All methods know slides alone; the file is written back as it speaks.
    let document = with_slides(&machine::schema(), &original);
    let signals = Signals::catch().environment()?;
    let mut bench = Bench::new(&options.machine, signals)?;
    let mut tests = TestMotions {
        machine: &machine,
        limits: &limits,
        recordings: options.recordings.as_deref(),
        bench: &mut bench,
    };
    let fast = tests.first_strokes(&document)?;
    let known = &machine;
    let configured = known.scan.dead_time_scans;
    let dead_time = DeadTime::find(configured, known, std::slice::from_ref(&fast));
    let (machine, reckoned) = dead_time.reckoned(known, &document);
    let mut tests = TestMotions {
        machine: &machine,
        ..tests
    };
    let mut strokes = tests.strokes(&reckoned, fast)?;
    let dead_time = DeadTime::find(configured, &machine, &strokes.all);
    dead_time.tell(known);
    let rings = std::mem::take(&mut strokes.rings);
    let models = tests.models(strokes)?;
    let (machine, reckoned) = dead_time.reckoned(known, &document);
    let first: Vec<Found> = models.iter().filter_map(|of| of.first().copied()).collect();
    say_found(&machine, &first, &models, &rings);
    refuse_misfits(&machine, &first)?;
    let settings = |which: usize, pulse: bool| {
        let mut tuned = reckoned.clone();
        for (index, (models, given_um)) in models.iter().zip(&given_um).enumerate() {
            let Some(found) = models.get(which).or(models.first()) else {
                continue;
            };
            let method = method(&machine, index, found, pulse);
            let scans = dead_time.of_axis(index);
            write::settings(&mut tuned, &machine, index, scans, found, *given_um, method);
        }
        if let Some(spared) = smooth::worst(&rings) {
            smooth::spare(&mut tuned, &machine, &first, spared);
        }
        tuned
    };
    warn_of_no_scale(&machine, &first, &given_um);
    let mut candidates = vec![("by torque", settings(0, false))];
    if models.iter().any(|models| models.len() > 1) {
        candidates.push(("by wind-up", settings(1, false)));
    }
    candidates.push((choose::PULSE, settings(0, true)));
    let chosen = choose::choose(
        &machine, &limits, &circles, &mut bench, &document, candidates,
    )?;
    let Some(best) = chosen else {
        return Ok(());
    };
    drop(bench);
    let best = with_own_units(&machine::schema(), &best, &original);
    keep::write(options, &path, &best)?;
    keep::write_drive_files(options, &path, known, &best)
}

/// The machine, if `tune` can move it: its motions begin by themselves, so nobody is there to home an axis first.
fn machine_to_tune(path: &Path) -> anyhow::Result<Machine> {
    let machine = Machine::load(path)?;
    let file = path.display();
    if let Some(pair) = machine.gantries().next() {
        let [first, second] = [pair.leader, pair.follower].map(|axis| machine.axis_name(axis));
        bail!(
            "{file}: {first} and {second} are the two motors of a gantry: tune moves one motor at a time and would skew it; set the \
             loops of such a machine by hand, or tune one end with the bridge taken off, as a machine of its own"
        );
    }
    let homed = machine.axes.iter().filter(|axis| axis.homing.is_some());
    let homed: Vec<&str> = homed.map(|axis| axis.name.as_str()).collect();
    if !homed.is_empty() {
        bail!(
            "{file}: {} must be homed, and tune moves by itself: tune a copy of the machine without [axis.homing], with absolute \
             encoders in its plant file, and take the values over",
            homed.join(" ")
        );
    }
    Ok(machine)
}

/// Says what was found, with the screw taken in both ways, and what rings.
fn say_found(machine: &Machine, first: &[Found], models: &[Vec<Found>], rings: &[Vec<Ringing>]) {
    say(&keep::findings(machine, first));
    if let Some(second) = models.iter().map(|of| of.get(1).copied()).collect() {
        let second: Vec<Found> = second;
        say("the screw by its wind-up, in place of the torque:");
        say(&keep::findings(machine, &second));
    }
    say(&keep::ringing(machine, rings));
}

/// The way of compensating reversals that this axis can have.
fn method(machine: &Machine, index: usize, found: &Found, pulse: bool) -> &'static str {
    let Some(axis) = machine.axes.get(index) else {
        return "none";
    };
    if axis.feedback == PositionFeedback::Scale {
        // The scale sees the lost motion; nobody has to make up for it.
        return match axis.reversal.method {
            ReversalMethod::FrictionPulse => "friction-pulse",
            ReversalMethod::Backlash => "backlash",
            _ => "none",
        };
    }
    if pulse {
        return "friction-pulse";
    }
    if found.table.is_none() && axis.model.is_none_or(|m| m.table.is_none()) {
        return "backlash";
    }
    "contact-force"
}

/// Says of each axis that shows no table what becomes of its lost motion.
fn warn_of_no_scale(machine: &Machine, found: &[Found], given_um: &[Option<f64>]) {
    for ((axis, found), given_um) in machine.axes.iter().zip(found).zip(given_um) {
        if found.table.is_some() || axis.feedback == PositionFeedback::Scale {
            continue;
        }
        let why = match (axis.model.and_then(|m| m.table), given_um) {
            (Some(_), None) => "the table and the gap stay as the machine file has them",
            (Some(_), Some(_)) => {
                "the table stays as the machine file has it, the gap follows from the lost motion reported"
            }
            (None, Some(_)) => {
                "the lost motion is the one reported, and crossed in one step (\"backlash\")"
            }
            (None, None) => {
                "backlash_um stays as the machine file has it, and is crossed in one step (\"backlash\"); measure the lost motion with a \
                 dial gauge and tell it: --lost-motion-um"
            }
        };
        let has = if found.no_table.is_some() {
            "has a scale that shows no table"
        } else {
            "has no scale"
        };
        tracing::warn!(
            "axis {} {has}: its lost motion cannot be identified: {why}",
            axis.name
        );
    }
}

/// Lever of an axis: force at the table by torque, in N per N·m.
fn newtons_per_nm(lead_mm: f64) -> f64 {
    2.0 * core::f64::consts::PI / (lead_mm * 1e-3)
}

/// Says what was found beside the model, and names every axis with which nothing can be done.
fn refuse_misfits(machine: &Machine, found: &[Found]) -> Outcome {
    let mut misfits = Vec::new();
    for (axis, found) in machine.axes.iter().zip(found) {
        for remark in judge::remarks(found) {
            say(&format!("{:4} {remark}", axis.name));
        }
        if let Some(why) = judge::refusal(Some(axis.rated_force_n()), found) {
            misfits.push(format!("axis {}: {why}", axis.name));
        }
    }
    if misfits.is_empty() {
        return Ok(());
    }
    Err(Failure::Stopped(anyhow!(
        "the model does not fit, nothing is written: {}",
        misfits.join("; ")
    )))
}
