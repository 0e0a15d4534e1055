//! Circles with each of the files that were made, and with the present one: the best is written.

use anyhow::anyhow;
use machine::Machine;
use toml_edit::DocumentMut;

use super::bench::Bench;
use super::motions::{self, Circle, Limit};
use super::trial::{self, Column};
use super::{keep, write};
use console::exit::Failure;
use console::output::say;

/// Means that differ by less, in µm, are the same.
const SAME_UM: f64 = 0.1;

/// The candidate that has no gap of a model.
pub const PULSE: &str = "pulse by law";
/// Step in which another gap is tried, and how many.
const GAP_STEP: f64 = 1.25;
const GAP_STEPS: usize = 2;

/// A file, and what it is called.
type Candidate = (&'static str, DocumentMut);

/// The best file, none if the present one is. Of those that are the same, the first.
pub fn choose(
    machine: &Machine,
    limits: &[Limit],
    circles: &[Circle],
    bench: &mut Bench,
    before: &DocumentMut,
    candidates: Vec<Candidate>,
) -> Result<Option<DocumentMut>, Failure> {
    let candidates = readable(candidates)?;
    if circles.is_empty() {
        tracing::warn!(
            "{}: no two slides span a plane for test circles, or there is no room for any: before and after are not compared",
            machine.name
        );
        return without_circles(machine, limits, bench, candidates).map(Some);
    }
    tracing::info!("circles before and after");
    let mut columns: Vec<(&str, Column)> = Vec::new();
    let present = [("before", before.clone())];
    for (name, document) in present.iter().chain(&candidates) {
        let mut allowed = document.clone();
        write::allow(&mut allowed, machine, limits);
        columns.push((name, trial::run(bench, &allowed, circles)?));
    }
    print(circles, &columns);
    let Some(((_, was), found)) = columns.split_first() else {
        return Ok(None);
    };
    let was_um = trial::mean_um(was);
    let means_um: Vec<f64> = found
        .iter()
        .map(|(_, column)| trial::mean_um(column))
        .collect();
    let best_um = means_um.iter().copied().fold(f64::INFINITY, f64::min);
    if best_um.is_infinite() && was_um.is_infinite() {
        return Err(Failure::Stopped(anyhow!(
            "the machine stops on the test circles, with its file as it is and with the settings found: nothing is written"
        )));
    }
    for ((name, _), um) in candidates.iter().zip(&means_um) {
        if um.is_infinite() {
            say(&format!(
                "The machine stops with the settings {name}: undone."
            ));
        }
    }
    if was_um + SAME_UM < best_um {
        say("The machine file does better as it is: nothing is written.");
        return Ok(None);
    }
    let mut both = candidates.into_iter().zip(means_um);
    let Some(((name, document), um)) = both.find(|(_, um)| *um <= best_um + SAME_UM) else {
        return Ok(None);
    };
    say(&format!("Best: {name}."));
    let by_scales = found.iter().all(|(_, column)| trial::by_scales(column));
    if by_scales && name != PULSE {
        return refine(machine, limits, bench, circles, document, um).map(Some);
    }
    Ok(Some(document))
}

/// The same with another gap, as long as the circles get better by it: where lost motion has a hysteresis, a gap is what one makes of it.
fn refine(
    machine: &Machine,
    limits: &[Limit],
    bench: &mut Bench,
    circles: &[Circle],
    document: DocumentMut,
    um: f64,
) -> Result<DocumentMut, Failure> {
    let names = circles
        .first()
        .map_or([const { String::new() }; 2], |of| of.axes.clone());
    let (mut best, mut best_um) = (document.clone(), um);
    for factor in [GAP_STEP, 1.0 / GAP_STEP] {
        let mut tried = 1.0;
        for _ in 0..GAP_STEPS {
            tried *= factor;
            let mut other = document.clone();
            write::scale_gap(&mut other, &names, tried);
            let mut allowed = other.clone();
            write::allow(&mut allowed, machine, limits);
            let other_um = trial::mean_um(&trial::run(bench, &allowed, circles)?);
            if other_um + SAME_UM > best_um {
                break;
            }
            say(&format!(
                "With gaps × {tried:.2}: {other_um:.1} µm in the mean, in place of {best_um:.1} µm."
            ));
            (best, best_um) = (other, other_um);
        }
        if best_um < um {
            break;
        }
    }
    Ok(best)
}

/// Those that the product itself would read.
fn readable(candidates: Vec<Candidate>) -> Result<Vec<Candidate>, Failure> {
    let mut why = None;
    let mut kept = Vec::new();
    for (name, document) in candidates {
        match keep::check(&document) {
            Ok(()) => kept.push((name, document)),
            Err(error) => {
                tracing::warn!("settings {name}: undone: {error:#}");
                why.get_or_insert(error);
            }
        }
    }
    match why {
        Some(error) if kept.is_empty() => Err(Failure::Stopped(error)),
        _ => Ok(kept),
    }
}

/// The first file with which the strokes go well.
fn without_circles(
    machine: &Machine,
    limits: &[Limit],
    bench: &mut Bench,
    candidates: Vec<Candidate>,
) -> Result<DocumentMut, Failure> {
    let mut last = anyhow!("nothing was found to set");
    for (name, document) in candidates {
        let mut plain = document.clone();
        write::plain(&mut plain);
        write::allow(&mut plain, machine, limits);
        match bench.record(&plain, &motions::strokes(machine, limits)) {
            Ok(_) => return Ok(document),
            Err(Failure::Stopped(why)) => {
                say(&format!(
                    "The machine stops with the settings {name}: undone: {why:#}"
                ));
                last = why;
            }
            Err(other) => return Err(other),
        }
    }
    Err(Failure::Stopped(last))
}

fn print(circles: &[Circle], columns: &[(&str, Column)]) {
    let borrowed: Vec<(&str, &Column)> = columns.iter().map(|(name, of)| (*name, of)).collect();
    say(&trial::table(circles, &borrowed));
}
