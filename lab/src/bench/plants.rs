//! `quadrant bench plants`: what is left at reversals on machines of another structure than the controller's model.

mod foreign;

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use bus::sample::Mode;
use control::path::AxisVector;
use machine::{AdaptationMode, Machine, ReversalMethod, machine_file};
use monitor::log::Sample;
use monitor::measure::{Analysis, Outcome as RunOutcome};
use plant_sim::plant_file::PlantFile;
use program::Setup;

use super::lanes::in_order;
use crate::cell::InProcessCell;
use crate::options::PlantsOptions;
use launcher::exit::{Failure, Kind, Outcome};
use launcher::output::say;
use launcher::signals::Signals;

pub(crate) use foreign::{FOREIGN, Foreign};

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
pub(crate) const WAYS: [Way; 3] = [
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
];

/// What a program of circles left, circle by circle of the grid, in µm; none where the machine stopped before.
type Left = Vec<Option<f64>>;

/// Runs every foreign plant with every way and prints the table.
pub fn plants(options: &PlantsOptions) -> Outcome {
    let signals = Signals::catch().environment()?;
    let file = machine_file(&options.machine);
    let machine = Machine::load(&file).input()?;
    let plant = PlantFile::load(&file.with_file_name("plant.toml")).input()?;
    let plants = chosen(&options.plants, FOREIGN, |of| of.name).input()?;
    let ways = chosen(&options.ways, &WAYS, |of| of.name).input()?;
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
        one(&machine, &plant, foreign, way, || {
            signals.count() > 0 || failed.load(Ordering::Relaxed)
        })
    };
    let mut told = 0;
    let found = in_order(options.jobs as usize, jobs.len(), work, |found| {
        while let Some(row) = found.get(told..told + ways.len()) {
            let name = jobs.get(told).map_or("", |(foreign, _)| foreign.name);
            say(&line(name, &ways, row));
            told += ways.len();
        }
    })?;
    if let Some(out) = &options.out {
        let named = || format!("{}: cannot be written", out.display());
        fs::write(out, csv(&machine.name, &jobs, &found))
            .with_context(named)
            .environment()?;
        say(&format!("{}", out.display()));
    }
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
    left(&machine, &plant, is_over)
}

/// What the program of circles leaves on this machine.
pub(crate) fn left(
    machine: &Machine,
    plant: &PlantFile,
    is_over: impl Fn() -> bool,
) -> Result<Left, Failure> {
    let circles = grid();
    let (text, lines) = program(&circles);
    let name = "circles.ngc";
    let path = program::interpret(name, &text, &Setup::of(machine), AxisVector::zeros())
        .map_err(|problem| anyhow::anyhow!("{problem:?}"))
        .input()?;
    let mut analysis = Analysis::new(machine.clone(), path.path);
    let mut cell = InProcessCell::new(machine, plant, name, &text).input()?;
    let mut scans = 0_u64;
    while let Some(published) = cell.scan() {
        analysis.take(Sample::Feedback(Box::new(*published.feedback)));
        analysis.take(Sample::Instruments(Box::new(*published.instruments)));
        for command in published.commands {
            analysis.take(Sample::Command(Box::new(*command)));
        }
        scans += 1;
        if scans.is_multiple_of(4096) && is_over() {
            return Err(Failure::Interrupted);
        }
        if published.feedback.mode == Mode::Tripped as u32 {
            break;
        }
    }
    let measured = analysis.finish();
    let completed = measured.outcome == RunOutcome::Completed;
    let worst = lines.iter().map(|lines| {
        let of_circle = measured.reversals.iter().filter(|reversal| {
            let line = reversal.line.unwrap_or(0);
            reversal.steady && lines.contains(&line)
        });
        let worst_um = of_circle
            .filter_map(|of| Some(of.protrusion_um?.max(-of.undercut_um?)))
            .fold(0.0, f64::max);
        completed.then_some(worst_um)
    });
    Ok(worst.collect())
}

fn grid() -> Vec<(f64, f64)> {
    let of_radius = |radius_mm| FEEDS_MM_MIN.map(|feed_mm_min| (radius_mm, feed_mm_min));
    RADII_MM.into_iter().flat_map(of_radius).collect()
}

/// The program, and the lines of each circle of the grid.
fn program(circles: &[(f64, f64)]) -> (String, Vec<Vec<u32>>) {
    let mut text = String::from("G21 G17 G90 G94\n");
    let mut lines = Vec::new();
    for (index, (radius_mm, feed_mm_min)) in WARM_UP.iter().chain(circles).enumerate() {
        let of_circle = circle(&mut text, *radius_mm, *feed_mm_min);
        if index >= WARM_UP.len() {
            lines.push(of_circle);
        }
    }
    text += "M2\n";
    (text, lines)
}

/// Turns counter-clockwise and clockwise from 45°; the lines that they stand in.
fn circle(text: &mut String, radius_mm: f64, feed_mm_min: f64) -> Vec<u32> {
    let at_mm = radius_mm * libm::cos(0.25 * PI);
    let _ = write!(text, "G0 X{at_mm:.6} Y{at_mm:.6}\nG4 P0.2\n");
    let mut lines = Vec::new();
    for word in ["G3", "G2"] {
        for _ in 0..TURNS {
            let _ = writeln!(
                text,
                "{word} X{at_mm:.6} Y{at_mm:.6} I{:.6} J{:.6} F{feed_mm_min}",
                -at_mm, -at_mm
            );
            lines.push(text.lines().count() as u32);
        }
        *text += "G4 P0.2\n";
    }
    lines
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
