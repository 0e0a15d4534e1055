//! `quadrant-lab bench wakeup`: how punctually the scans of a cell in realtime begin, beside a bare loop of the same priority in the same
//! seconds, half a scan apart; idle and with every processor busy.

mod bare;
mod cell;
mod load;
mod seen;

use anyhow::anyhow;
use bus::realtime::{self, Priority};
use machine::Machine;

use super::figures::Figures;
use super::runs;
use crate::options::WakeupOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use console::signals::Signals;
use load::Load;
use seen::Seen;

/// What was measured under one load.
#[derive(Debug, Default)]
struct Measured {
    /// Two bare loops beside each other.
    loops: [bare::Bare; 2],
    /// The cell, and the bare loop beside it.
    cell: cell::InCell,
    beside: bare::Bare,
}

/// A cell beside a bare loop, and two bare loops beside each other.
///
/// # Errors
/// The machine is wrong, the cell does not start, or it is interrupted.
pub fn wakeup(options: &WakeupOptions, figures: &mut Figures) -> Outcome {
    let signals = Signals::catch().environment()?;
    let machine = Machine::load(&options.machine).input()?;
    let scratch = runs::scratch().environment()?;
    let period_ns = u64::from(machine.scan.period_us) * 1000;
    let time_ns = options.seconds * 1_000_000_000;
    if let Some(bus) = &machine.bus {
        let what = "has [bus]: its scans follow the clock of the drives";
        return Err(anyhow!("{} {what} on {}", machine.name, bus.interface)).input();
    }
    say(&format!(
        "wakeup: {} in realtime beside a bare loop half a scan apart, a scan every {} µs, {} rounds of {} s each; {}",
        machine.name,
        machine.scan.period_us,
        options.rounds,
        options.seconds,
        priority_in_words()
    ));
    say(
        "  late, µs: behind the most punctual of 250, as seen by who waits at the signal of the scans; `itself`: behind its own clock",
    );
    for is_loaded in [false, true] {
        let load = is_loaded.then(Load::start);
        let words = match is_loaded {
            false => "idle",
            true => "every core busy",
        };
        let mut all = Measured::default();
        for _ in 0..options.rounds {
            let interrupted = || signals.count() > 0;
            let loops = bare::two(period_ns, time_ns, &interrupted).environment()?;
            let [first, second] = &loops;
            all.loops[0].join(first).environment()?;
            all.loops[1].join(second).environment()?;
            if interrupted() {
                return Err(Failure::Interrupted);
            }
            let cell = cell::Asked {
                machine: &machine,
                folder: &options.machine,
                scratch: scratch.path(),
                seconds: options.seconds,
            };
            let measured = cell.beside_a_loop(&signals);
            if interrupted() {
                return Err(Failure::Interrupted);
            }
            let (in_cell, beside) = measured.environment()?;
            all.cell.join(&in_cell).environment()?;
            all.beside.join(&beside).environment()?;
        }
        drop(load);
        all.print(words);
        all.note(words, figures);
    }
    Ok(())
}

/// Whether the loops have what the master asks for.
fn priority_in_words() -> String {
    let asked = std::thread::spawn(|| realtime::raise(Priority::Master.level(), 1)).join();
    match asked {
        Ok(Ok(())) => "SCHED_FIFO".into(),
        Ok(Err(error)) => format!("SCHED_FIFO is refused ({error}): ordinary priority"),
        Err(_) => "SCHED_FIFO is not known".into(),
    }
}

impl Measured {
    fn print(&self, load: &str) {
        say(&format!(
            "  {load:<32}  starts     p50     p99   99.9 %      max   late by a scan or more"
        ));
        let row = |what: &str, seen: &Seen| {
            say(&format!("    {what:<30} {}", seen.words()));
        };
        row("cell", &self.cell.seen);
        row("bare loop beside it", &self.beside.seen);
        row("bare loop beside it, itself", &self.beside.itself);
        row("two loops alone: the first", &self.loops[0].seen);
        row("two loops alone: the second", &self.loops[1].seen);
        say(&format!(
            "    cell over bare loop, p50 {:.2}, p99 {:.2}; one bare loop over another {:.2}, {:.2}; missed scans of the cell {}, of {} commands",
            ratio(&self.cell.seen, &self.beside.seen, 0.5),
            ratio(&self.cell.seen, &self.beside.seen, 0.99),
            ratio(&self.loops[0].seen, &self.loops[1].seen, 0.5),
            ratio(&self.loops[0].seen, &self.loops[1].seen, 0.99),
            self.cell.missed,
            self.cell.commands,
        ));
    }

    fn note(&self, load: &str, figures: &mut Figures) {
        for (share, words) in [(0.5, "p50"), (0.99, "p99"), (1.0, "max")] {
            let what = format!("scan starts late, {load}, {words}");
            figures.add("wakeup", what, self.cell.seen.us_at(share), "µs");
            figures.beside("bare loop", self.beside.seen.us_at(share));
            let what = format!("bare loop late beside another, {load}, {words}");
            figures.add("wakeup", what, self.loops[0].seen.us_at(share), "µs");
            figures.beside("the other", self.loops[1].seen.us_at(share));
        }
        let share = |count: u64, of: u64| 1e6 * count as f64 / of.max(1) as f64;
        let what = format!("missed scans of a million, {load}");
        let missed = share(self.cell.missed, self.cell.commands);
        figures.add("wakeup", what, missed, "");
        let beside = &self.beside.itself;
        let late = share(beside.overrun, beside.starts());
        figures.beside("bare loop late by a scan", late);
    }
}

/// How many times as late.
fn ratio(one: &Seen, other: &Seen, share: f64) -> f64 {
    one.us_at(share) / other.us_at(share).max(1e-3)
}
