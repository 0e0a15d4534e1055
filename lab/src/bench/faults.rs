//! `quadrant-lab bench faults`: whole cells in this one process, with faults drawn from seeds; every scan of every run is judged.

mod judges;
mod operator;
mod programs;
mod seed;
mod trial;

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use anyhow::{Context, anyhow};

use crate::options::FaultsOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use launcher::check;

use programs::{ShortProgram, short_programs};
use seed::{Scenario, Shape, draw, kind_of};
use trial::{Machines, Prepared, Verdict, prepare};

/// Seeds between two lines of progress.
const PROGRESS_SEEDS: u64 = 1000;
/// The most failing seeds that are printed.
const FAILURES_SHOWN: usize = 20;

/// All seeds together.
#[derive(Debug, Default)]
struct Tally {
    seeds: u64,
    runs: u64,
    scans: u64,
    trips: u64,
    stops: u64,
    missed: u64,
    finished: u64,
    obeyed: u64,
    kinds: BTreeMap<(&'static str, &'static str), u64>,
    deviation_mm: f64,
    failures: BTreeMap<u64, Vec<String>>,
}

impl Tally {
    fn take(&mut self, seed: u64, scenario: &Scenario, verdict: &Verdict) {
        self.seeds += 1;
        self.runs += verdict.runs;
        let shown = &verdict.shown;
        self.scans += shown.scans * verdict.runs;
        self.trips += u64::from(shown.trips);
        self.stops += shown.stops.len() as u64;
        self.missed += u64::from(shown.missed);
        self.obeyed += verdict.obeyed.len() as u64;
        self.finished += u64::from(shown.mode == Some(bus::sample::Mode::Finished));
        self.deviation_mm = self.deviation_mm.max(shown.deviation_mm);
        for (fault, fired) in scenario.faults.faults.iter().zip(&verdict.fired) {
            if *fired {
                *self
                    .kinds
                    .entry(kind_of(fault.process.job, &fault.action))
                    .or_default() += 1;
            }
        }
        if !verdict.violations.is_empty() {
            let words = verdict.violations.iter();
            let words: Vec<String> = words
                .map(|v| format!("scan {}: {}", v.scan, v.what))
                .collect();
            if self.failures.len() < FAILURES_SHOWN {
                say(&format!("  seed {seed}: {}", words.join("; ")));
            }
            self.failures.insert(seed, words);
        }
    }
}

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

/// Runs the seeds.
pub fn faults(options: &FaultsOptions) -> Outcome {
    let stock = stock(options).input()?;
    let started = Instant::now();
    let next = AtomicU64::new(options.from);
    let end = options.from.saturating_add(options.seeds);
    let tally = Mutex::new(Tally::default());
    let broken: Mutex<Option<anyhow::Error>> = Mutex::new(None);
    std::thread::scope(|threads| {
        for _ in 0..options.jobs {
            threads.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= end {
                        return;
                    }
                    match stock.run(seed) {
                        Ok((scenario, verdict)) => {
                            if options.verbose {
                                tell(&stock, seed, &scenario, &verdict);
                            }
                            let mut tally = tally.lock().unwrap_or_else(|e| e.into_inner());
                            tally.take(seed, &scenario, &verdict);
                            if tally.seeds.is_multiple_of(PROGRESS_SEEDS) {
                                progress(&tally, options, started);
                            }
                        }
                        Err(error) => {
                            next.store(end, Ordering::Relaxed);
                            let error = error.context(format!("seed {seed}"));
                            *broken.lock().unwrap_or_else(|e| e.into_inner()) = Some(error);
                            return;
                        }
                    }
                }
            });
        }
    });
    if let Some(error) = broken.into_inner().unwrap_or_else(|e| e.into_inner()) {
        return Err(Failure::Environment(error));
    }
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
    conclude(
        &tally.into_inner().unwrap_or_else(|e| e.into_inner()),
        options,
        started,
    )
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
        options.seeds,
        tally.runs as f64 / elapsed_s,
        tally.failures.len()
    ));
}

fn conclude(tally: &Tally, options: &FaultsOptions, started: Instant) -> Outcome {
    let elapsed_s = started.elapsed().as_secs_f64();
    say(&format!(
        "{} seeds in {elapsed_s:.1} s: {} runs ({:.0} per minute), {:.1} million scans judged",
        tally.seeds,
        tally.runs,
        tally.runs as f64 / elapsed_s * 60.0,
        tally.scans as f64 * 1e-6,
    ));
    say(&format!(
        "{} finished; {} stops on the path; {} trips, at most {:.3} mm from the path; {} missed scans; {} orders that the machine asked for",
        tally.finished, tally.stops, tally.trips, tally.deviation_mm, tally.missed, tally.obeyed
    ));
    for ((whose, what), count) in &tally.kinds {
        say(&format!("  {whose:<13}{what:<8}{count:>7}"));
    }
    if tally.failures.is_empty() {
        say("No invariant was violated.");
        return Ok(());
    }
    let machine = options.machine.display();
    let program = options
        .program
        .as_ref()
        .map_or_else(String::new, |path| format!(" --program {}", path.display()));
    for (seed, words) in tally.failures.iter().take(FAILURES_SHOWN) {
        say(&format!("seed {seed}: {}", words.join("; ")));
        say(&format!(
            "  quadrant-lab bench faults {machine}{program} --from {seed} --seeds 1 -v"
        ));
    }
    Err(Failure::Stopped(anyhow!(
        "{} of {} seeds violate an invariant",
        tally.failures.len(),
        tally.seeds
    )))
}
