//! `quadrant-lab bench lockstep`: speed of a whole cell beside physics alone and the bare hand-overs of its scans.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde_json::Value;

use super::cost_plot::{self, Cost};
use super::figures::Figures;
use super::ipc::Game;
use super::machines::{self, BenchMachine};
use super::runs::{self, Runs};
use super::watchers::{self, Watched};
use crate::options::{Ball, LockstepOptions};
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;
use launcher::check::{self, Checked};

/// Scans of hand-overs alone.
const BARE_SCANS: u32 = 20_000;
/// Scans of physics alone.
const PHYSICS_SCANS: usize = 20_000;

/// One round of the measurement, all in µs but the factor.
#[derive(Debug, Clone, Copy)]
struct Round {
    scans: f64,
    scan_us: f64,
    factor: f64,
    physics_us: f64,
    rings_us: f64,
    samples_us: f64,
}

/// Speed of a lockstep cell beside physics alone and its hand-overs alone, all on this machine in one go.
///
/// # Errors
/// A run fails, or the other side of the hand-overs cannot be had.
pub fn lockstep(options: &LockstepOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let scratch = runs::scratch().environment()?;
    let runs = Runs {
        scratch: &scratch,
        signals: &signals,
    };
    if options.axes.is_empty() {
        let own = BenchMachine::own(&options.machine);
        return of_machine(&own, options.rounds, &runs, figures).map(drop);
    }
    let mut costs = Vec::new();
    for &axes in &options.axes {
        let made = machines::of_axes(&options.machine, axes, scratch.path()).input()?;
        costs.push(of_machine(&made, options.rounds, &runs, figures)?);
    }
    if let Some(file) = &options.plot {
        cost_plot::draw(file, &costs).environment()?;
    }
    Ok(())
}

/// One machine.
fn of_machine(
    of: &BenchMachine,
    rounds: u32,
    runs: &Runs,
    figures: &mut Figures,
) -> Result<Cost, Failure> {
    let BenchMachine { folder, program } = of;
    let checked = check::load(folder, Some(program), check::Depth::Whole).input()?;
    let period_us = f64::from(checked.machine.scan.period_us);
    let axes = checked.machine.axes.len();
    let mut measured = Vec::new();
    for _ in 0..rounds {
        let (scans, scan_us, factor) = cell_us(runs, folder, program, period_us)?;
        measured.push(Round {
            scans,
            scan_us,
            factor,
            physics_us: physics_us(&checked).environment()?,
            rings_us: hand_overs_us(axes, Ball::Ring, runs.signals)?,
            samples_us: hand_overs_us(axes, Ball::Sample, runs.signals)?,
        });
    }
    let (watched, log_bytes) = runs.watched(folder, program, watchers::watch)?;
    let median = |take: fn(&Round) -> f64| {
        let mut values: Vec<f64> = measured.iter().map(take).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let middle = Round {
        scans: median(|r| r.scans),
        scan_us: median(|r| r.scan_us),
        factor: median(|r| r.factor),
        physics_us: median(|r| r.physics_us),
        rings_us: median(|r| r.rings_us),
        samples_us: median(|r| r.samples_us),
    };
    say(&format!(
        "lockstep: {} with {}, recorder on, axes: {axes}, processes: {}, median of {rounds} rounds",
        folder.display(),
        program.display(),
        axes + 3,
    ));
    middle.print(period_us);
    print_watched(&watched);
    middle.note(axes, &watched, figures);
    let scans = middle.scans.max(1.0);
    let cost = Cost {
        axes,
        wall_us: middle.scan_us,
        floor_us: middle.physics_us + middle.samples_us,
        processor_us: watched.all_s * 1e6 / scans,
        memory_mb: watched.memory_mb,
        log_bytes: log_bytes as f64 / scans,
    };
    say(&format!(
        "  of a scan            {:7.2} µs   of all processors; log {:.0} bytes; memory of the cell (Pss) {:.0} MB",
        cost.processor_us, cost.log_bytes, cost.memory_mb
    ));
    Ok(cost)
}

impl Round {
    fn print(&self, period_us: f64) {
        let least_us = self.physics_us + self.samples_us;
        say(&format!(
            "  wall time per scan   {:7.2} µs   {:.1} x real time at {period_us} µs",
            self.scan_us, self.factor
        ));
        say(&format!(
            "  physics alone        {:7.2} µs",
            self.physics_us
        ));
        say(&format!(
            "  hand-overs           {:7.2} µs   the same processes with their samples, placed and waiting as in a run, without a planner",
            self.samples_us
        ));
        say(&format!(
            "  the rest             {:7.2} µs   control, planning, instruments, digest, saved state",
            self.scan_us - least_us
        ));
        say(&format!(
            "  ratio                {:7.2}      to physics + hand-overs with samples",
            self.scan_us / least_us
        ));
        say(&format!(
            "  ratio                {:7.2}      to physics + hand-overs by bare rings of {:.2} µs",
            self.scan_us / (self.physics_us + self.rings_us),
            self.rings_us
        ));
    }

    fn note(&self, axes: usize, watched: &Watched, figures: &mut Figures) {
        let what = format!("a scan, axes: {axes}, wall time");
        for (floor, hand_overs_us) in [
            ("physics and hand-overs with samples", self.samples_us),
            ("physics and hand-overs by rings", self.rings_us),
        ] {
            figures.add("lockstep", &what, self.scan_us, "µs");
            figures.beside(floor, self.physics_us + hand_overs_us);
        }
        let what = format!("who watches, axes: {axes}, of the run's processor time");
        figures.add("lockstep", what, watched.percent(watched.watching_s()), "%");
    }
}

fn print_watched(watched: &Watched) {
    let of = |part_s: f64| watched.percent(part_s);
    say(&format!(
        "  who watches          {:7.1} %    of the run's {:.2} s of processor time: recorder {:.1} %, launcher {:.1} %, report {:.1} %",
        of(watched.watching_s()),
        watched.all_s,
        of(watched.recorder_s),
        of(watched.launcher_s),
        of(watched.report_s)
    ));
}

/// One whole run; its scans, µs of wall time per scan and the real-time factor, as the report has them.
fn cell_us(
    runs: &Runs,
    machine: &Path,
    program: &Path,
    period_us: f64,
) -> Result<(f64, f64, f64), Failure> {
    let report = runs.report(machine, program, 0)?;
    let number = |key: &str| {
        let found = report.get(key).and_then(Value::as_f64);
        let found = found.with_context(|| format!("report.json has no {key}"));
        found.environment()
    };
    let factor = number("real_time_factor")?;
    Ok((number("scans")?, period_us / factor, factor))
}

/// Physics alone: µs per scan of all axes, at a speed that swings.
fn physics_us(checked: &Checked) -> anyhow::Result<f64> {
    let mut simulations = checked.simulated()?.simulations(&checked.machine)?;
    let mut samples = [master::InstrumentSample::default(); bus::sample::MAX_SUBSAMPLES];
    let taken = checked.machine.subsamples() as usize;
    let period_s = checked.machine.scan_period_s();
    let started = Instant::now();
    for scan in 0..PHYSICS_SCANS {
        let velocity_mm_s = 50.0 * (2.0 * scan as f64 * period_s).sin();
        for simulation in &mut simulations {
            let command = master::DriveCommand::Velocity {
                velocity_mm_s,
                torque_offset_nm: 0.0,
            };
            simulation.scan(&command, samples.get_mut(..taken).unwrap_or_default());
        }
    }
    Ok(started.elapsed().as_secs_f64() * 1e6 / PHYSICS_SCANS as f64)
}

/// A scan of hand-overs alone, master and servos placed as the launcher places them, in µs.
fn hand_overs_us(axes: usize, ball: Ball, signals: &Signals) -> Result<f64, Failure> {
    let cores = bus::realtime::processors();
    let game = Game {
        axes,
        ball,
        cores: cores.get(..2).unwrap_or(&cores),
        awake: true,
        scans: BARE_SCANS,
    };
    Ok(game.play(signals)?.mean_us())
}
