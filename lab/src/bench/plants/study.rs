//! `quadrant-lab bench plants --random N`: how what is left at reversals is spread over machines that nobody has seen.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use serde::{Deserialize, Serialize};

use super::distribution::{Distribution, percent};
use super::random::{RandomPlant, draw, structures};
use super::workload::{Circle, Ran, Workload};
use super::{NAME, WAYS, Way, summary, write};
use crate::bench::campaign::{Asked, Campaign, Line, Lines};
use crate::bench::lanes::in_order;
use crate::bench::progress::progress_bar;
use crate::options::PlantsOptions;
use console::exit::{Kind, Outcome};
use console::output::say;
use console::signals::Signals;

/// Circles before those that count.
const WARM_UP: [Circle; 2] = [(20.0, 4000.0), (35.0, 8000.0)];
/// Those that count, one slow, one of the middle and one fast.
const CIRCLES: [Circle; 3] = [(10.0, 1000.0), (25.0, 3000.0), (50.0, 10_000.0)];
/// Rest at the end: a second to come to it, four in which it is watched.
const REST_S: f64 = 5.0;
/// By so much the shipped way must be worse than the pulse to count as worse, in µm.
const WORSE_UM: f64 = 0.5;
/// A structure that moves a table at rest.
const SHAKES: &str = "cutting";

/// What each way left on a plant, as a line has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Found {
    structures: Vec<String>,
    ran: Vec<Ran>,
}

/// A plant and what each way left on it.
struct Row {
    number: u64,
    structures: Vec<String>,
    ran: Vec<Ran>,
}

impl Row {
    /// Mean and worst of its circles, of the way of this name.
    fn left(&self, ways: &[&Way], name: &str) -> Option<(f64, f64)> {
        let index = ways.iter().position(|way| way.name == name)?;
        summary(&self.ran.get(index)?.left)
    }

    /// By how much shipped is worse than the pulse: in the mean, and in the worst circle.
    fn worse_um(&self, ways: &[&Way]) -> Option<(f64, f64)> {
        let (own, pulse) = (self.left(ways, "shipped")?, self.left(ways, "pulse")?);
        Some((own.0 - pulse.0, own.1 - pulse.1))
    }

    fn has(&self, structure: &str) -> bool {
        self.structures.iter().any(|of| of == structure)
    }
}

/// The ways that each plant is run with.
fn study_ways() -> Vec<&'static Way> {
    WAYS.iter().filter(|way| way.name != "tuned").collect()
}

/// Random plants, each as shipped, with the pulse and without compensation; or a part of them.
pub(super) fn random(
    options: &PlantsOptions,
    count: u64,
    machine: &Machine,
    plant: &PlantFile,
) -> Outcome {
    let signals = Signals::catch().environment()?;
    let asked = Asked {
        bench: NAME,
        folder: &options.machine,
        program: None,
        seed: options.seed,
        from: options.first,
        count,
    };
    let campaign = Campaign::of(&asked, machine).input()?;
    let lines = Lines::create(&campaign, options.lines.as_deref()).environment()?;
    let ways = study_ways();
    let course = Workload {
        warm_up: WARM_UP.to_vec(),
        circles: CIRCLES.to_vec(),
        turns: 1,
        rest_s: REST_S,
    };
    let drawn = |number: u64| draw(plant, options.seed, number, machine.scan_period_s());
    let part = options.part;
    let numbers: Vec<u64> = (0..)
        .map_while(|place| part.place(place, count))
        .map(|place| options.first.saturating_add(place))
        .collect();
    let jobs = numbers.len() * ways.len();
    let bar = progress_bar(jobs as u64);
    let work = |job: usize, _: usize, failed: &AtomicBool| {
        let number = numbers.get(job / ways.len()).copied();
        let number = number.context("a plant outside the part").environment()?;
        let RandomPlant { file, .. } = drawn(number);
        let mut machine = machine.clone();
        if let Some(way) = ways.get(job % ways.len()) {
            (way.edit)(&mut machine);
        }
        let is_over = || signals.count() > 0 || failed.load(Ordering::Relaxed);
        course.run(&machine, &file, is_over)
    };
    let mut rows: Vec<Row> = Vec::new();
    let mut unwritten = None;
    let done = |ran: &[Ran]| {
        bar.inc(1);
        let from = rows.len() * ways.len();
        for (number, ran) in numbers
            .iter()
            .skip(rows.len())
            .zip(ran.get(from..).unwrap_or_default().chunks_exact(ways.len()))
        {
            let structures = drawn(*number).structures.into_iter().map(String::from);
            let found = Found {
                structures: structures.collect(),
                ran: ran.to_vec(),
            };
            unwritten = lines.write(*number, &found).err().or(unwritten.take());
            rows.push(Row::of(*number, found));
        }
    };
    let ended = in_order(options.jobs as usize, jobs, work, done);
    bar.finish_and_clear();
    ended?;
    if let Some(error) = unwritten {
        return Err(error).environment();
    }
    conclude(&campaign, &rows, options.out.as_deref())
}

/// The lines of all parts of a campaign.
///
/// # Errors
/// A line that is none of this bench, or the figures cannot be written.
pub(crate) fn merge(campaign: &Campaign, lines: Vec<Line>, out: Option<&Path>) -> Outcome {
    let rows = lines.into_iter().map(|line| {
        let found: Found =
            serde_json::from_value(line.found).with_context(|| format!("plant {}", line.number))?;
        Ok(Row::of(line.number, found))
    });
    let rows: anyhow::Result<Vec<Row>> = rows.collect();
    conclude(campaign, &rows.input()?, out)
}

impl Row {
    fn of(number: u64, found: Found) -> Row {
        Row {
            number,
            structures: found.structures,
            ran: found.ran,
        }
    }
}

/// Prints what was found, and writes the figures where asked to.
fn conclude(campaign: &Campaign, rows: &[Row], out: Option<&Path>) -> Outcome {
    let ways = study_ways();
    say(&format!(
        "{} random plants of seed {} from number {} on; {}",
        rows.len(),
        campaign.seed,
        campaign.from,
        campaign.machine
    ));
    print_ways(rows, &ways);
    print_worse(rows, &ways);
    print_structures(rows, &ways);
    print_stopped(rows, &ways, &campaign.axes);
    write(out, &csv(campaign, rows, &ways))
}

fn print_ways(rows: &[Row], ways: &[&Way]) {
    say(&format!(
        "protrusion or undercut on the table, µm, one turn each way of {} circles after {} others:",
        CIRCLES.len(),
        WARM_UP.len()
    ));
    say(&format!(
        "  {:<9} {:^28} {:^28} {:>8} {:>9}",
        "", "mean of a plant's circles", "worst of them", "stopped", "to and"
    ));
    let head = ["10 %", "50 %", "90 %", "most"].map(|word| format!("{word:>7}"));
    let head = head.concat();
    say(&format!(
        "  {:<9} {head} {head} {:>8} {:>9}",
        "way", "runs", "fro, axes"
    ));
    for (index, way) in ways.iter().enumerate() {
        let left = || rows.iter().filter_map(|row| row.left(ways, way.name));
        let mean = Distribution::of(left().map(|(mean, _)| mean));
        let worst = Distribution::of(left().map(|(_, worst)| worst));
        let ran = || rows.iter().filter_map(|row| row.ran.get(index));
        let stopped = ran().filter(|ran| ran.stopped.is_some()).count();
        let calm = rows.iter().filter(|row| !row.has(SHAKES));
        let axes = calm
            .filter_map(|row| row.ran.get(index))
            .flat_map(|ran| &ran.cycling);
        let (cycling, all) = axes.fold((0, 0), |(some, all), axis| {
            (some + usize::from(*axis), all + 1)
        });
        say(&format!(
            "  {:<9} {} {} {stopped:>8} {:>9}",
            way.name,
            mean.words(),
            worst.words(),
            format!("{cycling}/{all}")
        ));
    }
    say(
        "  to and fro: tables that turn round again and again 1 to 5 s after the last motion, without the cut, which shakes them",
    );
}

fn print_worse(rows: &[Row], ways: &[&Way]) {
    let worse: Vec<(f64, f64)> = rows.iter().filter_map(|row| row.worse_um(ways)).collect();
    let share = |of: fn(&(f64, f64)) -> f64| {
        let some = worse.iter().filter(|worse| of(worse) > WORSE_UM).count();
        percent(some, worse.len())
    };
    say(&format!(
        "shipped worse than the pulse by more than {WORSE_UM} µm: {:.1} % of plants in the mean, {:.1} % in the worst circle",
        share(|worse| worse.0),
        share(|worse| worse.1)
    ));
    let most = rows
        .iter()
        .filter_map(|row| Some((row.worse_um(ways)?.0, row)));
    if let Some((um, row)) = most.max_by(|a, b| a.0.total_cmp(&b.0)) {
        let made_of = row.structures.join(", ");
        say(&format!(
            "  most: {um:+.2} µm in the mean, plant {} ({made_of})",
            row.number
        ));
    }
}

/// What each structure makes of it: plants that have it beside those that do not.
fn print_structures(rows: &[Row], ways: &[&Way]) {
    say(
        "median of the plants' means with a structure and without it, µm, and plants on which shipped is worse:",
    );
    say(&format!(
        "  {:<18} {:>7} {:>15} {:>15} {:>17}",
        "structure", "plants", "shipped", "pulse", "worse, %"
    ));
    for structure in structures() {
        let of = |has: bool, name: &str| {
            let rows = rows.iter().filter(|row| row.has(structure.name) == has);
            let means = rows.filter_map(|row| row.left(ways, name));
            let median = Distribution::of(means.map(|(mean, _)| mean)).at(0.5);
            median.map_or("-".into(), |um| format!("{um:.2}"))
        };
        let worse = |has: bool| {
            let rows = rows.iter().filter(|row| row.has(structure.name) == has);
            let worse: Vec<_> = rows.filter_map(|row| row.worse_um(ways)).collect();
            let some = worse.iter().filter(|worse| worse.0 > WORSE_UM).count();
            percent(some, worse.len())
        };
        let plants = rows.iter().filter(|row| row.has(structure.name)).count();
        let both = |name: &str| format!("{} / {}", of(true, name), of(false, name));
        say(&format!(
            "  {:<18} {plants:>7} {:>15} {:>15} {:>17}",
            structure.name,
            both("shipped"),
            both("pulse"),
            format!("{:.1} / {:.1}", worse(true), worse(false))
        ));
    }
}

/// Every run that stopped, and every axis that goes to and fro at rest where nothing shakes it.
fn print_stopped(rows: &[Row], ways: &[&Way], axes: &[String]) {
    for row in rows {
        for (way, ran) in ways.iter().zip(&row.ran) {
            let made_of = || row.structures.join(", ");
            if let Some(why) = &ran.stopped {
                say(&format!(
                    "plant {}, {}: {why} ({})",
                    row.number,
                    way.name,
                    made_of()
                ));
            }
            let cycling = ran.cycling.iter().zip(axes);
            for (_, axis) in cycling.filter(|(cycles, _)| **cycles && !row.has(SHAKES)) {
                say(&format!(
                    "plant {}, {}: axis {} goes to and fro at rest ({})",
                    row.number,
                    way.name,
                    axis,
                    made_of()
                ));
            }
        }
    }
}

fn csv(campaign: &Campaign, rows: &[Row], ways: &[&Way]) -> String {
    let mut text = String::from("machine,seed,plant,structures,way,stopped,to_and_fro_axes");
    for (radius_mm, feed_mm_min) in CIRCLES {
        let _ = write!(text, ",r{radius_mm}_f{feed_mm_min}_worst_um");
    }
    text += "\n";
    for row in rows {
        for (way, ran) in ways.iter().zip(&row.ran) {
            let cycling = ran.cycling.iter().zip(&campaign.axes);
            let cycling = cycling.filter(|(cycles, _)| **cycles);
            let cycling: String = cycling.map(|(_, axis)| axis.as_str()).collect();
            let _ = write!(
                text,
                "{},{},{},{},{},{},{cycling}",
                campaign.name,
                campaign.seed,
                row.number,
                row.structures.join(" "),
                way.name,
                ran.stopped.as_deref().unwrap_or("").replace(',', ";")
            );
            for um in &ran.left {
                let um = um.map_or(String::new(), |um| format!("{um:.3}"));
                let _ = write!(text, ",{um}");
            }
            text += "\n";
        }
    }
    text
}
