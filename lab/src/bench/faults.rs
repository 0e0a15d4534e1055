//! `quadrant-lab bench faults`: whole cells in this one process, with faults drawn from seeds; every scan of every run is judged.

mod judges;
mod operator;
mod programs;
mod seed;
mod tally;
mod trial;

use std::sync::Mutex;
use std::time::Instant;

use anyhow::{Context, anyhow};

use super::campaign::{Asked, Campaign, Line, Lines, each_found, each_seed};
use super::figures::Figures;
use crate::options::FaultsOptions;
use console::exit::{Kind, Outcome};
use console::output::say;
use launcher::check;

use programs::{ShortProgram, short_programs};
use seed::{Scenario, Shape, draw};
use tally::{Found, Tally};
use trial::{Machines, Prepared, Verdict, prepare};

/// Seeds between two lines of progress.
const PROGRESS_SEEDS: u64 = 1000;
/// Its name.
pub(super) const NAME: &str = "faults";

/// What every seed is drawn from.
struct Stock {
    machines: Machines,
    programs: Vec<Prepared>,
    shapes: Vec<Shape>,
}

impl Stock {
    fn run(&self, seed: u64) -> anyhow::Result<(Scenario, Verdict)> {
        let scenario = draw(seed, &self.machines.standby, &self.shapes)?;
        let prepared = &self.programs[scenario.program];
        let judged = || self.machines.judge(&scenario, prepared);
        let verdict = std::panic::catch_unwind(std::panic::AssertUnwindSafe(judged));
        let verdict = verdict.unwrap_or_else(|_| Ok(Verdict::panicked()))?;
        Ok((scenario, verdict))
    }
}

/// Runs the seeds, or a part of them.
pub fn faults(options: &FaultsOptions, figures: &mut Figures) -> Outcome {
    let stock = stock(options).input()?;
    let asked = Asked {
        bench: NAME,
        folder: &options.machine,
        program: options.program.as_deref(),
        seed: 0,
        from: options.of.from,
        count: options.seeds,
    };
    let campaign = Campaign::of(&asked, &stock.machines.alone).input()?;
    let lines = Lines::create(&campaign, options.of.lines.as_deref()).environment()?;
    let started = Instant::now();
    let tally = run_all(options, &stock, &lines).environment()?;
    let elapsed_s = started.elapsed().as_secs_f64();
    for prepared in &stock.programs {
        let held = prepared.held_contour_mm.get();
        let held = held.map_or_else(String::new, |mm| {
            format!(", with a feed hold somewhere {:.1} µm", mm * 1e3)
        });
        say(&format!(
            "{:<14}{:>5} scans; undisturbed, its table is at most {:.1} µm off the path{held}",
            prepared.program.name,
            prepared.undisturbed.scans,
            prepared.undisturbed.contour_mm.0 * 1e3
        ));
    }
    let runs_per_minute = tally.runs as f64 / elapsed_s * 60.0;
    say(&format!(
        "in {elapsed_s:.1} s: {runs_per_minute:.0} runs per minute"
    ));
    figures.add(
        NAME,
        "whole cells, each scan judged",
        runs_per_minute,
        "1/min",
    );
    tally.conclude(&campaign)
}

/// Every seed of the part.
fn run_all(options: &FaultsOptions, stock: &Stock, lines: &Lines<'_>) -> anyhow::Result<Tally> {
    let started = Instant::now();
    let tally = Mutex::new(Tally::default());
    let one = |seed: u64| -> anyhow::Result<()> {
        let (scenario, verdict) = stock.run(seed)?;
        if options.verbose {
            tell(stock, seed, &scenario, &verdict);
        }
        let found = Found::of(&scenario, &verdict);
        lines.write(seed, &found)?;
        let mut tally = tally.lock().unwrap_or_else(|e| e.into_inner());
        tally.take(seed, &found);
        if tally.seeds.is_multiple_of(PROGRESS_SEEDS) {
            progress(&tally, options, started);
        }
        Ok(())
    };
    each_seed(&options.of, options.seeds, one)?;
    Ok(tally.into_inner().unwrap_or_else(|e| e.into_inner()))
}

/// The lines of all parts of a campaign.
///
/// # Errors
/// A line that is none of this bench, or a violation in one.
pub(super) fn merge(campaign: &Campaign, lines: Vec<Line>) -> Outcome {
    let mut tally = Tally::default();
    each_found(lines, |seed, found: &Found| tally.take(seed, found)).input()?;
    tally.conclude(campaign)
}

fn stock(options: &FaultsOptions) -> anyhow::Result<Stock> {
    let checked = check::load(
        &options.machine,
        options.program.as_deref(),
        check::Depth::Whole,
    )?;
    let plant = checked.simulated()?.clone();
    let mut alone = checked.machine;
    for axis in &mut alone.axes {
        axis.standby = false;
    }
    let mut standby = alone.clone();
    for axis in &mut standby.axes {
        axis.standby = true;
    }
    let letters: Vec<&str> = alone.axes.iter().map(|axis| axis.name.as_str()).collect();
    let programs = match &options.program {
        Some(path) => vec![ShortProgram {
            name: path.display().to_string(),
            text: std::fs::read_to_string(path).with_context(|| path.display().to_string())?,
        }],
        None => short_programs(&letters),
    };
    if programs.is_empty() {
        return Err(anyhow!(
            "{}: the built-in programs need axes X and Y; name one with --program",
            options.machine.display()
        ));
    }
    let machines = Machines {
        alone,
        standby,
        plant,
    };
    let programs = programs
        .into_iter()
        .map(|program| prepare(&machines, program))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let shapes = programs
        .iter()
        .map(|prepared| Shape {
            scans: prepared.undisturbed.scans,
            elements: u64::from(prepared.course.path.end()),
        })
        .collect();
    Ok(Stock {
        machines,
        programs,
        shapes,
    })
}

/// What a seed stands for and what became of it.
fn tell(stock: &Stock, seed: u64, scenario: &Scenario, verdict: &Verdict) {
    let prepared = &stock.programs[scenario.program];
    let shown = &verdict.shown;
    let standby = if scenario.standby {
        "\n# standby = true in every [[axis]] of the machine file"
    } else {
        "\n# standby = false in every [[axis]] of the machine file"
    };
    let supervised = if scenario.supervised {
        "\n# killed processes are replaced by the launcher's rules, not by restart_after_scans"
    } else {
        ""
    };
    let tampering = scenario.tampering.map_or_else(String::new, |tampering| {
        format!("\n# damaged on its way: {}", tampering.words())
    });
    let mode = shown.mode.map_or("nothing", bus::sample::Mode::word);
    let mut text = format!(
        "# seed {seed}, faults.toml for `quadrant run --no-learned --faults`{standby}{supervised}{tampering}\n{}",
        scenario.faults_text
    );
    if !scenario.orders_text.is_empty() {
        text += &format!("\n# orders.toml for --orders\n{}", scenario.orders_text);
    }
    text += &format!("\n# {}\n", prepared.program.name);
    for line in prepared.program.text.lines() {
        text += &format!("#   {line}\n");
    }
    text += &format!(
        "# {} scans, {mode}; {} stops, {} trips, {} missed scans; {:.4} mm from the path (undisturbed {:.4}), {:.4} mm in a trip; digest {:016x}{:016x}",
        shown.scans,
        shown.stops.len(),
        shown.trips,
        shown.missed,
        shown.contour_mm.0,
        prepared.undisturbed.contour_mm.0,
        shown.deviation_mm,
        shown.digest.0,
        shown.digest.1,
    );
    for (scan, order) in &verdict.obeyed {
        text += &format!("\n# ordered as it asked: {} in scan {scan}", order.word());
    }
    for stop in &shown.stops {
        let how = if stop.foreseen { "foreseen" } else { "braked" };
        let until = stop
            .until
            .map_or("the end".into(), |scan| format!("scan {scan}"));
        text += &format!("\n# stop {how}: scan {} to {until}", stop.from);
    }
    for violation in &verdict.violations {
        text += &format!("\n# VIOLATION, scan {}: {}", violation.scan, violation.what);
    }
    say(&text);
}

fn progress(tally: &Tally, options: &FaultsOptions, started: Instant) {
    let elapsed_s = started.elapsed().as_secs_f64();
    say(&format!(
        "{:>7} of {} seeds, {:.0} runs/s, {} violated",
        tally.seeds,
        options.of.part.share(options.seeds),
        tally.runs as f64 / elapsed_s,
        tally.violated()
    ));
}
