//! `quadrant-lab bench lockstep`: speed of a whole cell beside physics alone and the bare hand-over between two processes.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde_json::Value;

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

/// Hand-overs there and back for the floor.
const ROUND_TRIPS: u32 = 50_000;
/// Scans of physics alone.
const PHYSICS_SCANS: usize = 20_000;

/// One round of the measurement, all in µs but the factor.
#[derive(Debug, Clone, Copy)]
struct Round {
    scan_us: f64,
    factor: f64,
    physics_us: f64,
    ring_us: f64,
    sample_us: f64,
}

/// Speed of a lockstep cell beside physics alone and the bare hand-over, all on this machine in one go.
///
/// # Errors
/// A run fails, or the other side of the ping-pong cannot be had.
pub fn lockstep(options: &LockstepOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let scratch = runs::scratch().environment()?;
    let runs = Runs {
        scratch: &scratch,
        signals: &signals,
    };
    if options.axes.is_empty() {
        let own = BenchMachine::own(&options.machine);
        return of_machine(&own, options.rounds, &runs, figures);
    }
    for &axes in &options.axes {
        let made = machines::of_axes(&options.machine, axes, scratch.path()).input()?;
        of_machine(&made, options.rounds, &runs, figures)?;
    }
    Ok(())
}

/// One machine.
fn of_machine(of: &BenchMachine, rounds: u32, runs: &Runs, figures: &mut Figures) -> Outcome {
    let BenchMachine { folder, program } = of;
    let checked = check::load(folder, Some(program), check::Depth::Whole).input()?;
    let period_us = f64::from(checked.machine.scan.period_us);
    let period_scans = f64::from(checked.machine.scan.interpolation_period_scans);
    let axes = checked.machine.axes.len();
    let mut measured = Vec::new();
    for _ in 0..rounds {
        let (scan_us, factor) = cell_us(runs, folder, program, period_us)?;
        measured.push(Round {
            scan_us,
            factor,
            physics_us: physics_us(&checked).environment()?,
            ring_us: hand_over_us(Ball::Ring, runs.signals)?,
            sample_us: hand_over_us(Ball::Sample, runs.signals)?,
        });
    }
    let watched = runs.watched(folder, program, watchers::watch)?;
    let median = |take: fn(&Round) -> f64| {
        let mut values: Vec<f64> = measured.iter().map(take).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let middle = Middle {
        round: Round {
            scan_us: median(|r| r.scan_us),
            factor: median(|r| r.factor),
            physics_us: median(|r| r.physics_us),
            ring_us: median(|r| r.ring_us),
            sample_us: median(|r| r.sample_us),
        },
        // Master to each servo in turn and back; to the planner and back once a period.
        hand_overs: axes as f64 + 1.0 + 1.0 / period_scans,
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
    Ok(())
}

/// The round in the middle.
struct Middle {
    round: Round,
    hand_overs: f64,
}

impl Middle {
    /// Physics and hand-overs that cost so much each.
    fn floor_us(&self, hand_over_us: f64) -> f64 {
        self.round.physics_us + self.hand_overs * hand_over_us
    }

    fn print(&self, period_us: f64) {
        let (round, hand_overs) = (&self.round, self.hand_overs);
        let with_samples_us = hand_overs * round.sample_us;
        let least_us = self.floor_us(round.sample_us);
        say(&format!(
            "  wall time per scan   {:7.2} µs   {:.1} x real time at {period_us} µs",
            round.scan_us, round.factor
        ));
        say(&format!(
            "  physics alone        {:7.2} µs",
            round.physics_us
        ));
        say(&format!(
            "  hand-overs           {with_samples_us:7.2} µs   {hand_overs:.2} a scan, {:.2} µs each: ping-pong of two processes, a sample and a ring",
            round.sample_us
        ));
        say(&format!(
            "  the rest             {:7.2} µs   control, planning, instruments, digest, saved state",
            round.scan_us - least_us
        ));
        say(&format!(
            "  ratio                {:7.2}      to physics + hand-overs with a sample",
            round.scan_us / least_us
        ));
        say(&format!(
            "  ratio                {:7.2}      to physics + hand-overs by a bare ring of {:.2} µs",
            round.scan_us / self.floor_us(round.ring_us),
            round.ring_us
        ));
    }

    fn note(&self, axes: usize, watched: &Watched, figures: &mut Figures) {
        let what = format!("a scan, axes: {axes}, wall time");
        for (floor, hand_over_us) in [
            ("physics and hand-overs with a sample", self.round.sample_us),
            ("physics and hand-overs by a ring", self.round.ring_us),
        ] {
            figures.add("lockstep", &what, self.round.scan_us, "µs");
            figures.beside(floor, self.floor_us(hand_over_us));
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

/// One whole run; µs of wall time per scan and the real-time factor, as the report has them.
fn cell_us(
    runs: &Runs,
    machine: &Path,
    program: &Path,
    period_us: f64,
) -> Result<(f64, f64), Failure> {
    let report = runs.report(machine, program, 0)?;
    let factor = report
        .get("real_time_factor")
        .and_then(Value::as_f64)
        .context("report.json has no real_time_factor")
        .environment()?;
    Ok((period_us / factor, factor))
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

/// Half of a scan of one axis, on one processor, in µs.
fn hand_over_us(ball: Ball, signals: &Signals) -> Result<f64, Failure> {
    let core = bus::realtime::processors().first().copied().unwrap_or(0);
    let game = Game {
        axes: 1,
        ball,
        cores: &[core],
        scans: ROUND_TRIPS,
    };
    Ok(0.5 * game.play(signals)?.mean_us())
}
