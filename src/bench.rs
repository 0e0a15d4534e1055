//! `quadrant bench`: the project's own measurements, each beside its floor on this machine.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use bus::cell::CellPlace;
use bus::page::{CellPhase, Page};
use serde_json::Value;

use crate::check;
use crate::cli::BenchOptions;
use crate::exit::{Kind, Outcome};
use crate::logs;

/// Runs of the whole cell; the median counts.
const RUNS: usize = 5;
/// Hand-overs there and back for the floor.
const ROUND_TRIPS: u32 = 50_000;
/// Scans of physics alone.
const PHYSICS_SCANS: usize = 20_000;

/// Runs the measurement asked for.
pub fn bench(options: &BenchOptions) -> Outcome {
    logs::init_launcher();
    lockstep(options).environment()
}

/// Speed of a lockstep cell beside physics alone and the bare hand-over, all on this machine in one go.
fn lockstep(options: &BenchOptions) -> anyhow::Result<()> {
    let program = options.machine.join("programs/circle-r25-f3000.ngc");
    let checked = check::load(&options.machine, Some(&program))?;
    let period_us = f64::from(checked.machine.scan.period_us);
    let period_scans = f64::from(checked.machine.scan.distribution_period_scans);
    let mut rows = Vec::new();
    for run in 0..RUNS {
        let floor_us = hand_over_us()?;
        let physics_us = physics_us(&checked)?;
        let (scan_us, factor) = cell_us(options, &program, run, period_us)?;
        rows.push((scan_us, factor, physics_us, floor_us));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let median = |take: fn(&(f64, f64, f64, f64)) -> f64| {
        let mut values: Vec<f64> = rows.iter().map(take).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let (scan_us, factor) = (median(|r| r.0), median(|r| r.1));
    let (physics_us, floor_us) = (median(|r| r.2), median(|r| r.3));
    let hand_overs = checked.machine.axes.len() as f64 + 1.0 + 2.0 / period_scans;
    let least_us = physics_us + hand_overs * floor_us;
    println!(
        "lockstep, {} with {}, recorder on, median of {RUNS} runs",
        options.machine.display(),
        program.display()
    );
    println!(
        "  wall time per scan       {scan_us:8.2} µs   ({factor:.1} x real time at {period_us} µs)"
    );
    println!("  physics alone            {physics_us:8.2} µs");
    println!(
        "  hand-overs               {:8.2} µs   ({hand_overs:.2} a scan, {floor_us:.2} µs each: bare futex ping-pong of two processes on one processor)",
        hand_overs * floor_us
    );
    println!(
        "  the rest                 {:8.2} µs   (IPC, control, planning, digests, waiting for the recorder)",
        scan_us - least_us
    );
    println!(
        "  ratio to physics + hand-overs  {:.2}   (goal: at most 1.3)",
        scan_us / least_us
    );
    Ok(())
}

/// One whole run; µs of wall time per scan and the real-time factor, as the report has them.
fn cell_us(
    options: &BenchOptions,
    program: &std::path::Path,
    run: usize,
    period_us: f64,
) -> anyhow::Result<(f64, f64)> {
    let out = std::env::temp_dir().join(format!("quadrant-bench-{}-{run}", std::process::id()));
    let status = Command::new("/proc/self/exe")
        .arg("run")
        .arg(&options.machine)
        .arg(program)
        .args([
            "--pace",
            "lockstep",
            "--cell",
            &format!("bench-{}", std::process::id()),
            "--out",
        ])
        .arg(&out)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::inherit())
        .status()
        .context("starting a run")?;
    let report = std::fs::read_to_string(out.join("report.json"));
    let _ = std::fs::remove_dir_all(&out);
    if !status.success() {
        bail!("a run ended with {status}");
    }
    let report: Value = serde_json::from_str(&report.context("reading its report")?)?;
    let number = |key: &str| {
        report
            .get(key)
            .and_then(Value::as_f64)
            .with_context(|| format!("report.json has no {key}"))
    };
    let factor = number("real_time_factor")?;
    Ok((period_us / factor, factor))
}

/// Physics alone: µs per scan of all axes, at a speed that swings.
fn physics_us(checked: &check::Checked) -> anyhow::Result<f64> {
    let mut simulations = checked.plant.simulations(&checked.machine)?;
    let mut samples = [plant_sim::axis::InstrumentSample::default(); bus::sample::MAX_SUBSAMPLES];
    let taken = checked.machine.subsamples() as usize;
    let period_s = checked.machine.scan_period_s();
    let started = Instant::now();
    for scan in 0..PHYSICS_SCANS {
        let velocity_mm_s = 50.0 * (2.0 * scan as f64 * period_s).sin();
        for simulation in &mut simulations {
            let command = plant_sim::drive::DriveCommand::Velocity {
                velocity_mm_s,
                torque_offset_nm: 0.0,
            };
            simulation.scan(&command, samples.get_mut(..taken).unwrap_or_default());
        }
    }
    Ok(started.elapsed().as_secs_f64() * 1e6 / PHYSICS_SCANS as f64)
}

/// The bare hand-over: half a round trip of two processes at two futex words, both on one processor, in µs.
fn hand_over_us() -> anyhow::Result<f64> {
    let core = bus::realtime::processors().first().copied().unwrap_or(0);
    let name = format!("pong-{}", std::process::id());
    let cell = CellPlace::new(&name)?.own(Duration::ZERO)?;
    let page = Page::create(cell.place())?;
    let mut pong = Command::new("/proc/self/exe")
        .args(["bench-pong", "--cell", &name, "--core", &core.to_string()])
        .stdin(Stdio::null())
        .spawn()
        .context("starting the other side")?;
    while page.ready_incarnation(0) != 1 {
        let seen = page.launcher_bell().count();
        if page.ready_incarnation(0) != 1 {
            page.launcher_bell().wait(seen, Duration::from_millis(100));
        }
        if let Some(status) = pong.try_wait()? {
            bail!("the other side ended with {status}");
        }
    }
    // In a thread of its own, so that the launcher itself stays free to move.
    let round_trip_us = std::thread::scope(|scope| {
        scope
            .spawn(|| {
                bus::realtime::stay_on(core);
                let started = Instant::now();
                for _ in 0..ROUND_TRIPS {
                    let seen = page.machine_bell().count();
                    page.scan_bell().ring();
                    while page.machine_bell().count() == seen {
                        page.machine_bell().wait(seen, Duration::from_secs(1));
                    }
                }
                started.elapsed().as_secs_f64() * 1e6 / f64::from(ROUND_TRIPS)
            })
            .join()
            .unwrap_or(f64::NAN)
    });
    page.set_phase(CellPhase::Ending);
    pong.wait()?;
    Ok(round_trip_us / 2.0)
}

/// The other side of the ping-pong.
pub fn pong(cell: &str, core: usize) -> Outcome {
    let place = CellPlace::new(cell).input()?;
    let page = Page::open(&place).environment()?;
    bus::realtime::stay_on(core);
    let mut seen = page.scan_bell().count();
    page.set_ready(0, 1);
    loop {
        while page.scan_bell().count() == seen {
            page.scan_bell().wait(seen, Duration::from_secs(1));
            if page.phase() == CellPhase::Ending {
                return Ok(());
            }
        }
        seen = page.scan_bell().count();
        if page.phase() == CellPhase::Ending {
            return Ok(());
        }
        page.machine_bell().ring();
    }
}
