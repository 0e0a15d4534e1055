//! `quadrant-lab bench plants`: what is left at reversals on machines of another structure than the controller's model.

mod distribution;
mod foreign;
mod random;
mod study;
mod workload;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use machine::{AdaptationMode, Machine, ReversalMethod, machine_file};
use plant_sim::plant_file::PlantFile;

use self::foreign::{FOREIGN, Foreign};
use self::workload::{Left, Workload};
use super::figures::Figures;
use super::lanes::in_order;
use super::progress::progress_bar;
use crate::options::PlantsOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;

pub(super) use study::merge;

/// Circles before the grid, in which the servos see the machine that they drive: radius in mm, feed in mm/min.
const WARM_UP: [(f64, f64); 6] = [
    (20.0, 2000.0),
    (15.0, 6000.0),
    (60.0, 5000.0),
    (35.0, 1500.0),
    (70.0, 9000.0),
    (30.0, 4000.0),
];
/// The grid.
const RADII_MM: [f64; 4] = [10.0, 25.0, 50.0, 100.0];
const FEEDS_MM_MIN: [f64; 3] = [1000.0, 3000.0, 10_000.0];
/// Turns of a circle in each direction.
const TURNS: usize = 2;

/// A way of compensating: a name and what it changes in the machine file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    /// Its name.
    pub name: &'static str,
    edit: fn(&mut Machine),
}

/// All of them.
pub(crate) const WAYS: [Way; 4] = [
    Way {
        name: "shipped",
        edit: |_| {},
    },
    Way {
        name: "tuned",
        edit: |machine| {
            for axis in &mut machine.axes {
                axis.adaptation.mode = AdaptationMode::Off;
            }
        },
    },
    Way {
        name: "pulse",
        edit: |machine| {
            for axis in &mut machine.axes {
                axis.adaptation.mode = AdaptationMode::Off;
                axis.torque_feed_forward.friction = false;
                axis.disturbance_observer.bandwidth_rad_s = 0.0;
                axis.reversal.method = ReversalMethod::FrictionPulse;
            }
        },
    },
    Way {
        name: "none",
        edit: |machine| {
            for axis in &mut machine.axes {
                axis.adaptation.mode = AdaptationMode::Off;
                axis.torque_feed_forward.friction = false;
                axis.disturbance_observer.bandwidth_rad_s = 0.0;
                axis.reversal.method = ReversalMethod::None;
            }
        },
    },
];
/// Those of the table, if none is named.
const TABLE_WAYS: usize = 3;

/// Its name.
pub(super) const NAME: &str = "plants";

/// Runs every foreign plant with every way and prints the table.
pub fn plants(options: &PlantsOptions, figures: &mut Figures) -> Outcome {
    let file = machine_file(&options.machine);
    let machine = Machine::load(&file).input()?;
    let plant = PlantFile::load(&file.with_file_name("plant.toml")).input()?;
    match options.random {
        Some(count) => study::random(options, count, &machine, &plant),
        None => table(options, &machine, &plant, figures),
    }
}

/// Every foreign plant with every way.
fn table(
    options: &PlantsOptions,
    machine: &Machine,
    plant: &PlantFile,
    figures: &mut Figures,
) -> Outcome {
    let signals = Signals::catch().environment()?;
    let plants = chosen(&options.plants, FOREIGN, |of| of.name).input()?;
    let mut ways = chosen(&options.ways, &WAYS, |of| of.name).input()?;
    if options.ways.is_empty() {
        ways.truncate(TABLE_WAYS);
    }
    say(&format!(
        "protrusion or undercut on the table, mean / worst of twelve circles, µm; {}; after {} other circles",
        options.machine.display(),
        WARM_UP.len()
    ));
    let heads: String = ways.iter().map(|way| format!("{:>15}", way.name)).collect();
    say(&format!(
        "  {:<22}{heads}  shipped over pulse, at most",
        "plant"
    ));
    let jobs: Vec<(&Foreign, &Way)> = plants
        .iter()
        .flat_map(|foreign| ways.iter().map(move |way| (*foreign, *way)))
        .collect();
    let work = |index: usize, _: usize, failed: &AtomicBool| {
        let job = jobs.get(index).context("a job outside the table");
        let (foreign, way) = job.environment()?;
        one(machine, plant, foreign, way, || {
            signals.count() > 0 || failed.load(Ordering::Relaxed)
        })
    };
    let mut told = 0;
    let bar = progress_bar(jobs.len() as u64);
    let found = in_order(options.jobs as usize, jobs.len(), work, |found| {
        bar.inc(1);
        while let Some(row) = found.get(told..told + ways.len()) {
            let name = jobs.get(told).map_or("", |(foreign, _)| foreign.name);
            bar.suspend(|| say(&line(name, &ways, row)));
            told += ways.len();
        }
    });
    bar.finish_and_clear();
    let found = found?;
    for ((foreign, way), left) in jobs.iter().zip(&found) {
        if let Some((mean_um, _)) = summary(left) {
            let what = format!(
                "{}, {}, mean protrusion or undercut",
                foreign.name, way.name
            );
            figures.add(NAME, what, mean_um, "µm");
        }
    }
    write(options.out.as_deref(), &csv(&machine.name, &jobs, &found))
}

/// Writes the figures where asked to.
fn write(out: Option<&Path>, text: &str) -> Outcome {
    let Some(out) = out else { return Ok(()) };
    let named = || format!("{}: cannot be written", out.display());
    fs::write(out, text).with_context(named).environment()?;
    say(&format!("{}", out.display()));
    Ok(())
}

/// Those of these names, all if none is named.
fn chosen<'a, T>(
    names: &[String],
    all: &'a [T],
    name_of: impl Fn(&T) -> &'static str,
) -> anyhow::Result<Vec<&'a T>> {
    if names.is_empty() {
        return Ok(all.iter().collect());
    }
    let find = |name: &String| {
        let found = all.iter().find(|of| name_of(of) == name);
        found.with_context(|| format!("there is no {name:?}"))
    };
    names.iter().map(find).collect()
}

/// One plant, one way: the warm-up and the grid in one program.
fn one(
    machine: &Machine,
    plant: &PlantFile,
    foreign: &Foreign,
    way: &Way,
    is_over: impl Fn() -> bool,
) -> Result<Left, Failure> {
    let (mut machine, mut plant) = (machine.clone(), plant.clone());
    (way.edit)(&mut machine);
    (foreign.edit)(&mut plant);
    Ok(course().run(&machine, &plant, is_over)?.left)
}

fn grid() -> Vec<workload::Circle> {
    let of_radius = |radius_mm| FEEDS_MM_MIN.map(|feed_mm_min| (radius_mm, feed_mm_min));
    RADII_MM.into_iter().flat_map(of_radius).collect()
}

/// All of it in one program.
fn course() -> Workload {
    Workload {
        warm_up: WARM_UP.to_vec(),
        circles: grid(),
        turns: TURNS,
        rest_s: 0.0,
    }
}

/// Mean and worst.
fn summary(left: &Left) -> Option<(f64, f64)> {
    let all: Option<Vec<f64>> = left.iter().copied().collect();
    let all = all?;
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    Some((mean, all.iter().copied().fold(0.0, f64::max)))
}

/// By how much the first way is worse than the last on a circle, at most.
fn worse_um(ways: &[&Way], lefts: &[Left]) -> Option<f64> {
    let of = |name: &str| {
        let index = ways.iter().position(|way| way.name == name)?;
        lefts.get(index)
    };
    let pairs = of("shipped")?.iter().zip(of("pulse")?);
    pairs
        .map(|(own, pulse)| Some((*own)? - (*pulse)?))
        .try_fold(f64::NEG_INFINITY, |most, of| Some(most.max(of?)))
}

fn line(name: &str, ways: &[&Way], lefts: &[Left]) -> String {
    let cells = lefts.iter().map(|left| match summary(left) {
        Some((mean, worst)) => format!("{:>15}", format!("{mean:.2} / {worst:.2}")),
        None => format!("{:>15}", "stopped"),
    });
    let worse = worse_um(ways, lefts).map_or(String::new(), |um| format!("{um:>10.2}"));
    format!("  {name:<22}{}{worse}", cells.collect::<String>())
}

fn csv(machine: &str, jobs: &[(&Foreign, &Way)], found: &[Left]) -> String {
    let mut text = String::from("machine,plant,way,radius_mm,feed_mm_min,worst_um\n");
    for ((foreign, way), left) in jobs.iter().zip(found) {
        for ((radius_mm, feed_mm_min), um) in grid().iter().zip(left) {
            let um = um.map_or(String::new(), |um| format!("{um:.3}"));
            let _ = writeln!(
                text,
                "{machine},{},{},{radius_mm},{feed_mm_min},{um}",
                foreign.name, way.name
            );
        }
    }
    text
}

/// Names of all plants.
pub fn names() -> Vec<&'static str> {
    FOREIGN.iter().map(|foreign| foreign.name).collect()
}

/// Names of all ways.
pub fn way_names() -> Vec<&'static str> {
    WAYS.iter().map(|way| way.name).collect()
}
