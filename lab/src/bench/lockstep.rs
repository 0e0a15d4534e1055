//! `quadrant-lab bench lockstep`: speed of a whole cell beside physics alone and the bare hand-over between two processes.

use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use bus::cell::CellPaths;
use bus::sample::{AxisCommand, Feedback};
use bus::service::{Bus, SCAN_DEPTH};
use bus::signal_page::SignalPage;
use bytemuck::Zeroable;
use machine::Machine;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::runs::{self, Runs};
use crate::options::{BenchPongOptions, LockstepOptions};
use console::child;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;
use launcher::check;

/// Hand-overs there and back for the floor.
const ROUND_TRIPS: u32 = 50_000;
/// How often either side looks whether the other is there, and for an interruption.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// How often this side looks whether the other is ready.
const START_LOOK: Duration = Duration::from_millis(2);
/// Longest time another process that was in the cell may take to leave.
const CLEAN_PATIENCE: Duration = Duration::from_secs(1);
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
pub fn lockstep(options: &LockstepOptions) -> Outcome {
    let program = options.machine.join("programs/circle-r25-f3000.ngc");
    let checked = check::load(&options.machine, Some(&program), check::Depth::Whole).input()?;
    let signals = Signals::catch().environment()?;
    let scratch = runs::scratch().environment()?;
    let runs = Runs {
        scratch: &scratch,
        signals: &signals,
    };
    let period_us = f64::from(checked.machine.scan.period_us);
    let period_scans = f64::from(checked.machine.scan.interpolation_period_scans);
    let mut rounds = Vec::new();
    for _ in 0..options.rounds {
        let (scan_us, factor) = cell_us(&runs, options, &program, period_us)?;
        rounds.push(Round {
            scan_us,
            factor,
            physics_us: physics_us(&checked).environment()?,
            ring_us: hand_over_us(&options.machine, Ball::Ring, &signals)?,
            sample_us: hand_over_us(&options.machine, Ball::Sample, &signals)?,
        });
    }
    let median = |take: fn(&Round) -> f64| {
        let mut values: Vec<f64> = rounds.iter().map(take).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let middle = Round {
        scan_us: median(|r| r.scan_us),
        factor: median(|r| r.factor),
        physics_us: median(|r| r.physics_us),
        ring_us: median(|r| r.ring_us),
        sample_us: median(|r| r.sample_us),
    };
    // Master to each servo in turn and back; to the planner and back once a period.
    let hand_overs = checked.machine.axes.len() as f64 + 1.0 + 1.0 / period_scans;
    say(&format!(
        "lockstep: {} with {}, recorder on, {} processes, median of {} rounds",
        options.machine.display(),
        program.display(),
        checked.machine.axes.len() + 3,
        options.rounds
    ));
    print_round(&middle, hand_overs, period_us);
    Ok(())
}

fn print_round(round: &Round, hand_overs: f64, period_us: f64) {
    let with_samples_us = hand_overs * round.sample_us;
    let least_us = round.physics_us + with_samples_us;
    let bare_us = round.physics_us + hand_overs * round.ring_us;
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
        round.scan_us / bare_us,
        round.ring_us
    ));
}

/// One whole run; µs of wall time per scan and the real-time factor, as the report has them.
fn cell_us(
    runs: &Runs,
    options: &LockstepOptions,
    program: &Path,
    period_us: f64,
) -> Result<(f64, f64), Failure> {
    let report = runs.report(&options.machine, program, 0)?;
    let factor = report
        .get("real_time_factor")
        .and_then(Value::as_f64)
        .context("report.json has no real_time_factor")
        .environment()?;
    Ok((period_us / factor, factor))
}

/// Physics alone: µs per scan of all axes, at a speed that swings.
fn physics_us(checked: &check::Checked) -> anyhow::Result<f64> {
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

/// What is handed over in the floor's ping-pong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ball {
    /// Nothing: a ring of the signal.
    Ring,
    /// A feedback there and a command back, through shared memory, then the ring.
    Sample,
}

/// Half a round trip of two processes at two signals of a signal page, both on one processor, in µs.
fn hand_over_us(machine: &Path, ball: Ball, signals: &Signals) -> Result<f64, Failure> {
    let core = bus::realtime::processors().first().copied().unwrap_or(0);
    let place = CellPaths::new(&format!("pong-{}", std::process::id())).environment()?;
    let pong = child::command("bench-pong")
        .args(["--cell", place.name(), "--core", &core.to_string()])
        .arg("--machine")
        .arg(machine)
        .args((ball == Ball::Sample).then_some("--samples"))
        .spawn();
    let pong = pong.context("starting the other side").environment()?;
    let mut ping = Ping { pong, signals };
    let before = bus::realtime::processors();
    let round_trip_us = ping.round_trip_us(&place, machine, ball, core);
    bus::realtime::stay_on_all(&before);
    let _ = kill_process(Pid::from_child(&ping.pong), Signal::TERM);
    if !ping.pong.wait().environment()?.success() {
        // What it has left goes.
        place.own(CLEAN_PATIENCE).environment()?;
    }
    Ok(round_trip_us? / 2.0)
}

/// This side of the ping-pong.
struct Ping<'a> {
    pong: Child,
    signals: &'a Signals,
}

impl Ping<'_> {
    fn round_trip_us(
        &mut self,
        place: &CellPaths,
        machine: &Path,
        ball: Ball,
        core: usize,
    ) -> Result<f64, Failure> {
        let page = loop {
            match SignalPage::open(place) {
                Ok(page) if page.ready_incarnation(0) == 1 => break page,
                _ => self.look()?,
            }
            std::thread::sleep(START_LOOK);
        };
        let shape = Machine::load(machine).environment()?.shape();
        let bus = Bus::enter(place, &shape, "ping", false).environment()?;
        let mut feedback_out = bus.feedback_writer().environment()?;
        let mut commands_in = bus.command_reader(0, 0, SCAN_DEPTH).environment()?;
        let mut feedback = Feedback::zeroed();
        bus::realtime::stay_on(core);
        let started = Instant::now();
        for scan in 0..ROUND_TRIPS {
            let seen = page.master_signal().count();
            if ball == Ball::Sample {
                feedback.scan = scan.into();
                feedback.visible_from = feedback.scan;
                feedback_out.send(&feedback);
            }
            page.scan_signal().raise();
            while page.master_signal().count() == seen {
                page.master_signal().wait(seen, LOOK_EVERY);
                if page.master_signal().count() == seen {
                    self.look()?;
                }
            }
            if ball == Ball::Sample && commands_in.any().is_none() {
                return Err(anyhow!("the other side sent nothing")).environment();
            }
        }
        Ok(started.elapsed().as_secs_f64() * 1e6 / f64::from(ROUND_TRIPS))
    }

    /// Whether the other side is there, and nobody interrupts.
    fn look(&mut self) -> Outcome {
        if self.signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        match self.pong.try_wait().environment()? {
            None => Ok(()),
            Some(status) => Err(anyhow!("the other side ended with {status}")).environment(),
        }
    }
}

/// The other side of the ping-pong, which plays until it is told to end, or its parent has ended. The cell is its own: so that
/// nothing of it stays where the bench is killed.
pub fn pong(options: &BenchPongOptions) -> Outcome {
    let signals = Signals::catch().environment()?;
    pong_until_ended(options, &signals).environment()
}

fn pong_until_ended(options: &BenchPongOptions, signals: &Signals) -> anyhow::Result<()> {
    let cell = CellPaths::new(&options.cell)?.own(Duration::ZERO)?;
    let machine = Machine::load(&options.machine)?;
    let bus = Bus::enter(cell.place(), &machine.shape(), "pong", true)?;
    let _services = bus.create_all()?;
    let page = SignalPage::create(cell.place())?;
    let mut feedback_in = bus.feedback_reader(SCAN_DEPTH)?;
    let mut commands_out = bus.command_writer(0, 0)?;
    bus::realtime::stay_on(options.core);
    let mut seen = page.scan_signal().count();
    page.set_ready(0, 1);
    loop {
        if page.scan_signal().count() == seen {
            page.scan_signal().wait(seen, LOOK_EVERY);
            if page.scan_signal().count() == seen && signals.count() > 0 {
                return Ok(());
            }
            continue;
        }
        seen = page.scan_signal().count();
        if options.samples
            && let Some(feedback) = feedback_in.any()
        {
            commands_out.send(&AxisCommand {
                scan: feedback.scan,
                ..AxisCommand::zeroed()
            });
        }
        page.master_signal().raise();
    }
}
