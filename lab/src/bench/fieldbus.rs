//! `quadrant-lab bench fieldbus`: how punctually frames leave and how soon they are back, in a cell and in a bare loop with the same socket.

use std::path::Path;
use std::process::Child;
use std::rc::Rc;
use std::time::{Duration, Instant};

use anyhow::{anyhow, bail};
use bus::cell::CellPaths;
use bus::drive_page::{BusState, Counts, DrivePage, Wiring};
use bus::realtime::{self, Priority, now_ns, sleep_until_ns};
use bytemuck::Zeroable;
use fieldbus::link::{Cycle, Socket, Tag};
use hdrhistogram::Histogram;
use machine::Machine;
use rustix::process::{Pid, Signal, kill_process};

use super::punctuality::{PUNCTUAL_AMONG, late_ns};
use super::runs;
use crate::options::FieldbusBenchOptions;
use console::child;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;

/// Bytes of process data that the bare loop carries, to no slave.
const BARE_BYTES: usize = 4;
/// Time in which a cell has its segment in operation.
const START_LIMIT: Duration = Duration::from_secs(40);
/// Longest wait for another answer.
const WAIT: Duration = Duration::from_millis(20);

/// One frame that came back.
#[derive(Debug, Clone, Copy)]
struct Sent {
    /// How many were sent before it.
    number: u64,
    at_ns: u64,
    round_trip_ns: u64,
}

/// What was seen of a loop.
#[derive(Debug, Default)]
struct Seen {
    frames: Vec<Sent>,
    sent: u64,
    missed: u64,
}

/// A cell over EtherCAT beside a bare loop.
///
/// # Errors
/// No machine with a bus, no right to send raw frames, or the cell does not start.
pub fn fieldbus(options: &FieldbusBenchOptions) -> Outcome {
    let machine = Machine::load(&options.machine).input()?;
    let no_bus = || {
        anyhow!(
            "{}: has no [bus]: its drives are simulated",
            options.machine.display()
        )
    };
    let interface = &machine.bus.as_ref().ok_or_else(no_bus).input()?.interface;
    let period_ns = u64::from(machine.scan.period_us) * 1000;
    let frames = options.seconds * 1_000_000_000 / period_ns.max(1);
    let signals = Signals::catch().environment()?;
    let interrupted = || signals.count() > 0;
    let bare = || bare_loop(interface, period_ns, frames, &interrupted).environment();
    let before = bare()?;
    let cell = in_a_cell(&options.machine, frames, &interrupted).environment()?;
    let after = bare()?;
    if interrupted() {
        return Err(Failure::Interrupted);
    }
    say(&format!(
        "fieldbus: {} on {interface}, a frame every {} µs, {} s each; late: behind the most punctual of {PUNCTUAL_AMONG} frames",
        options.machine.display(),
        machine.scan.period_us,
        options.seconds
    ));
    say("                                 late, µs              round trip, µs");
    say("               frames  missed    p50     p99     max    p50     p99     max");
    for (name, seen) in [
        ("bare loop", &before),
        ("cell", &cell),
        ("bare loop", &after),
    ] {
        say(&row(name, seen, period_ns).environment()?);
    }
    Ok(())
}

/// Frames that carry nothing to anybody, each at its time, by one process alone.
fn bare_loop(
    interface: &str,
    period_ns: u64,
    frames: u64,
    interrupted: &dyn Fn() -> bool,
) -> anyhow::Result<Seen> {
    let socket = Rc::new(Socket::open(interface)?);
    socket.ignore_own();
    let wiring = Wiring {
        nonce: now_ns(),
        image_bytes: BARE_BYTES as u32,
        ..Wiring::zeroed()
    };
    let mut cycle = Cycle::new(socket, &wiring, period_ns, Counts::zeroed());
    if let Err(error) = realtime::raise(Priority::Fieldbus.level(), 1) {
        tracing::warn!("the bare loop has no priority: {error}");
    }
    let mut seen = Seen::default();
    seen.frames.reserve(frames as usize);
    let mut due_ns = now_ns();
    for number in 1..=frames {
        if interrupted() {
            break;
        }
        // After a stall the clock goes on from there.
        due_ns = (due_ns + period_ns).max(now_ns().saturating_sub(period_ns));
        sleep_until_ns(due_ns);
        let tag = Tag {
            frame: number,
            cycle: number,
        };
        cycle.send(tag, &[0; BARE_BYTES]);
        let inputs = cycle.receive(number, due_ns + period_ns, || true);
        if inputs.answered == 1 {
            seen.frames.push(Sent {
                number,
                at_ns: inputs.sent_at_ns,
                round_trip_ns: inputs.round_trip_ns,
            });
        }
    }
    realtime::lower();
    let counts = cycle.counts();
    (seen.sent, seen.missed) = (counts.sent, counts.missed);
    Ok(seen)
}

/// A cell whose drives are off: the frames are those of a program.
fn in_a_cell(machine: &Path, frames: u64, interrupted: &dyn Fn() -> bool) -> anyhow::Result<Seen> {
    let scratch = runs::scratch()?;
    let name = format!("bench-{}", std::process::id());
    let mut child = child::command("up")
        .arg(machine)
        .args(["--cell", &name, "--out"])
        .arg(scratch.path().join("up"))
        .spawn()?;
    let seen = observe(&name, &mut child, frames, interrupted);
    if child.try_wait()?.is_none() {
        kill_process(Pid::from_child(&child), Signal::INT)?;
    }
    child.wait()?;
    seen
}

/// Looks at the answers of a cell's bus, from the outside; one or another is overwritten before it is seen.
fn observe(
    name: &str,
    child: &mut Child,
    frames: u64,
    interrupted: &dyn Fn() -> bool,
) -> anyhow::Result<Seen> {
    let place = CellPaths::new(name)?;
    let started = Instant::now();
    let page = loop {
        let page = DrivePage::open(&place).ok();
        let cycles =
            |page: &DrivePage| page.state() == BusState::Cycling && page.answered().is_some();
        if let Some(page) = page.filter(cycles) {
            break page;
        }
        if child.try_wait()?.is_some() || interrupted() || started.elapsed() > START_LIMIT {
            bail!("the cell did not start");
        }
        std::thread::sleep(WAIT);
    };
    let mut seen = Seen::default();
    seen.frames.reserve(frames as usize);
    let mut first: Option<Counts> = None;
    loop {
        let signal = page.answered_signal();
        let count = signal.count();
        if let Some(inputs) = page.newest_inputs().filter(|inputs| inputs.answered == 1) {
            let counts = inputs.counts;
            let from = *first.get_or_insert(counts);
            (seen.sent, seen.missed) = (counts.sent - from.sent, counts.missed - from.missed);
            let newer = seen
                .frames
                .last()
                .is_none_or(|last| last.number < counts.sent);
            if newer {
                seen.frames.push(Sent {
                    number: counts.sent,
                    at_ns: inputs.sent_at_ns,
                    round_trip_ns: inputs.round_trip_ns,
                });
            }
            if seen.sent >= frames || interrupted() {
                return Ok(seen);
            }
        }
        if child.try_wait()?.is_some() {
            bail!("the cell ended while it was measured");
        }
        signal.wait(count, WAIT);
    }
}

/// Spread of a loop, in words.
fn row(name: &str, seen: &Seen, period_ns: u64) -> anyhow::Result<String> {
    let mut late = Histogram::<u64>::new(3)?;
    let mut round_trip = Histogram::<u64>::new(3)?;
    let off = |sent: &Sent| i128::from(sent.at_ns) - i128::from(sent.number * period_ns);
    for (late_ns, sent) in late_ns(&seen.frames, off).zip(&seen.frames) {
        late.record(late_ns)?;
        round_trip.record(sent.round_trip_ns)?;
    }
    let us = |histogram: &Histogram<u64>| {
        let at = |part: f64| histogram.value_at_quantile(part) as f64 * 1e-3;
        let most = histogram.max() as f64 * 1e-3;
        format!("{:6.1} {:7.1} {most:7.0}", at(0.5), at(0.99))
    };
    let (late, round_trip) = (us(&late), us(&round_trip));
    let (sent, missed) = (seen.sent, seen.missed);
    Ok(format!(
        "  {name:<11} {sent:7} {missed:7} {late} {round_trip}"
    ))
}
