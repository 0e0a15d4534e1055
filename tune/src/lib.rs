//! `quadrant tune`: short test motions on the running cell tell what each axis has to move; laws make the settings of it.
//!
//! 1. strokes with the gains as they are: a first mass, and from it gains by law;
//! 2. strokes, reversals at low and high acceleration, steady speeds: mass, friction, lost motion, gap (`identify`);
//! 3. does the model fit? If not, nothing is written (`judge`);
//! 4. what rings after a change of acceleration (`ringing`), and motion that spares it (`smooth`);
//! 5. settings by law (`laws`), test circles before and after (`trial`);
//! 6. the machine file, the old one kept (`write`, `keep`).
//!
//! **Invariant**: nothing is known of the machine but its machine file and what its encoders and drives say. The plant file
//! is copied for the simulated machine, unread.

mod bench;
mod from_recording;
mod identify;
mod judge;
mod keep;
pub mod laws;
pub mod learn;
mod least_squares;
mod motions;
pub mod options;
mod recording;
mod ringing;
mod smooth;
mod trial;
mod write;

use std::fs;

use anyhow::{Context, anyhow};
use machine::{Machine, PositionFeedback, ReversalMethod, machine_file};
use toml_edit::DocumentMut;

use crate::options::TuneOptions;
use bench::Bench;
pub use from_recording::identify as identify_recording;
use identify::{Found, Lever};
use launcher::exit::{Failure, Kind, Outcome};
use launcher::logs;
use launcher::output::say;
use launcher::signals::Signals;
use ringing::Ringing;

/// Part of the gain by law at which the strokes are repeated: what depends on the gain shows itself so.
const SOFT_PART: f64 = 0.4;
/// Means that differ by less, in µm, are the same.
const SAME_UM: f64 = 0.1;

/// Tunes a machine.
pub fn tune(options: &TuneOptions) -> Outcome {
    logs::init_launcher();
    let path = machine_file(&options.machine);
    let machine = Machine::load(&path).input()?;
    let given_um = lost_motions(&machine, &options.lost_motion_um).input()?;
    let text = fs::read_to_string(&path).input()?;
    let document: DocumentMut = text
        .parse()
        .with_context(|| path.display().to_string())
        .input()?;
    let signals = Signals::catch().environment()?;
    let mut bench = Bench::new(&options.machine, signals)?;
    let (found, rings) = identify(&machine, &document, &mut bench)?;
    say(&keep::findings(&machine, &found));
    say(&keep::ringing(&machine, &rings));
    refuse_misfits(&machine, &found)?;
    let settings = |pulse: bool| {
        let mut tuned = document.clone();
        for (index, (found, given_um)) in found.iter().zip(&given_um).enumerate() {
            let method = method(&machine, index, found, *given_um, pulse);
            write::settings(&mut tuned, &machine, index, found, *given_um, method);
        }
        if let Some(spared) = smooth::worst(&rings) {
            smooth::spare(&mut tuned, &machine, &found, spared);
        }
        tuned
    };
    let tuned = settings(false);
    keep::check(&tuned).map_err(Failure::Stopped)?;
    let Some(best) = choose(&machine, &mut bench, &document, tuned, settings(true))? else {
        return Ok(());
    };
    drop(bench);
    keep::write(options, &path, &best)
}

/// The way of compensating reversals that this axis can have.
fn method(
    machine: &Machine,
    index: usize,
    found: &Found,
    given_um: Option<f64>,
    pulse: bool,
) -> &'static str {
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
    if found.table.is_none() {
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
        tracing::warn!(
            "axis {} has no scale: its lost motion cannot be identified: {why}",
            axis.name
        );
        if axis.model.is_none_or(|m| m.table.is_none()) {
            return "backlash";
        }
    }
    "contact-force"
}

/// Values of `--lost-motion-um`, axis by axis.
fn lost_motions(machine: &Machine, reported: &[String]) -> anyhow::Result<Vec<Option<f64>>> {
    let mut all = vec![None; machine.axes.len()];
    for pair in reported {
        let wrong =
            || anyhow!("--lost-motion-um {pair}: must be AXIS=µm, 0 to 1000 µm, like X=8.3");
        let (name, number) = pair.split_once('=').ok_or_else(wrong)?;
        let number: f64 = number.parse().map_err(|_| wrong())?;
        if !(0.0..=1000.0).contains(&number) {
            return Err(wrong());
        }
        let index = machine.axes.iter().position(|axis| axis.name == name);
        let place = index.and_then(|index| all.get_mut(index));
        *place.ok_or_else(|| {
            anyhow!(
                "--lost-motion-um {pair}: {} has no axis {name}",
                machine.name
            )
        })? = Some(number);
    }
    Ok(all)
}

/// Lever of an axis: force at the table by torque, in N per N·m.
fn newtons_per_nm(lead_mm: f64) -> f64 {
    2.0 * core::f64::consts::PI / (lead_mm * 1e-3)
}

/// Moves every axis and finds its model.
fn identify(
    machine: &Machine,
    document: &DocumentMut,
    bench: &mut Bench,
) -> Result<(Vec<Found>, Vec<Vec<Ringing>>), Failure> {
    let mut bare = document.clone();
    write::bare(&mut bare, machine);
    tracing::info!("strokes with the gains as they are: a first look at the mass");
    let strokes = motions::strokes(machine);
    let fast = bench.record(&bare, &strokes)?;
    for (index, (axis, recording)) in machine.axes.iter().zip(&fast).enumerate() {
        let mass_kg = identify::mass_kg(recording, &Lever::of_lead(axis.lead_mm));
        if !(mass_kg > 0.0 && mass_kg.is_finite()) {
            return Err(Failure::Stopped(anyhow!(
                "axis {}: its torque does not follow its acceleration: no mass can be found; look at lead_mm",
                axis.name
            )));
        }
        write::gains(&mut bare, machine, index, mass_kg);
    }
    let mut recordings: Vec<Vec<_>> = vec![Vec::new(); machine.axes.len()];
    let mut keep = |all: Vec<_>| {
        for (list, one) in recordings.iter_mut().zip(all) {
            list.push(one);
        }
    };
    tracing::info!("strokes with gains by law, and with part of them: the mass");
    let by_law = bench.record(&bare, &strokes)?;
    let rings = by_law.iter().map(ringing::ringing).collect();
    keep(by_law);
    let mut soft = bare.clone();
    for index in 0..machine.axes.len() {
        write::scale_gain(&mut soft, index, SOFT_PART);
    }
    keep(bench.record(&soft, &strokes)?);
    for (acceleration_mm_s2, length_mm, count) in motions::REVERSALS {
        tracing::info!("reversals at {acceleration_mm_s2} mm/s², {length_mm} mm apart");
        let mut slow = bare.clone();
        write::acceleration(&mut slow, machine, acceleration_mm_s2);
        keep(bench.record(&slow, &motions::reversals(machine, length_mm, count))?);
    }
    tracing::info!("steady speeds: friction against speed");
    let steady = bench.record(&bare, &motions::steady(machine))?;
    let found = machine
        .axes
        .iter()
        .zip(recordings.iter().zip(&steady))
        .map(|(axis, (list, steady))| identify::model(list, steady, &Lever::of_lead(axis.lead_mm)));
    Ok((found.collect(), rings))
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

/// Circles before and after, and with the friction pulse by law; the better file, none if the present one is.
fn choose(
    machine: &Machine,
    bench: &mut Bench,
    before: &DocumentMut,
    model: DocumentMut,
    pulse: DocumentMut,
) -> Result<Option<DocumentMut>, Failure> {
    let circles = trial::circles(machine);
    if circles.is_empty() {
        tracing::warn!(
            "no two slides of {} span a plane for test circles: before and after are not compared",
            machine.name
        );
        return Ok(Some(model));
    }
    tracing::info!("circles before and after");
    let columns = [
        trial::run(bench, before, &circles)?,
        trial::run(bench, &pulse, &circles)?,
        trial::run(bench, &model, &circles)?,
    ];
    let [was, pulsed, modelled] = &columns;
    say(&trial::table(
        &circles,
        &[
            ("before", was),
            ("pulse by law", pulsed),
            ("after", modelled),
        ],
    ));
    let [was_um, pulsed_um, modelled_um] = columns.each_ref().map(trial::mean_um);
    if was_um + SAME_UM < modelled_um.min(pulsed_um) {
        say("The machine file does better as it is: nothing is written.");
        return Ok(None);
    }
    if pulsed_um + SAME_UM < modelled_um {
        say("The friction pulse by law does better than the model: method = \"friction-pulse\".");
        return Ok(Some(pulse));
    }
    if modelled_um.is_infinite() {
        return Err(Failure::Stopped(anyhow!(
            "the machine stops with the settings found: nothing is written"
        )));
    }
    Ok(Some(model))
}
