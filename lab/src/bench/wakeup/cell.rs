//! A cell in realtime that runs a program, seen from outside by who waits at the signal of its scans.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use bus::cell::CellPaths;
use bus::port::Reader;
use bus::realtime::{self, Priority, now_ns};
use bus::sample::{Feedback, Mode};
use bus::service::{Bus, SCAN_DEPTH};
use bus::signal_page::SignalPage;
use console::child;
use console::signals::Signals;
use machine::Machine;
use rustix::process::{Pid, Signal, kill_process};

use super::bare::{Bare, Running};
use super::seen::{Seen, Start};
use crate::bench::circles_program;

/// A cell that is not up by then never will be.
const UP_LIMIT: Duration = Duration::from_secs(30);
/// How often it is looked for.
const LOOK: Duration = Duration::from_millis(2);
/// Longest wait for a scan without a look whether the cell lives.
const WAIT: Duration = Duration::from_millis(50);
/// Scans before the first that counts.
const WARM_UP_SCANS: usize = 500;
/// The program goes on for so much longer than is measured, in s.
const LONGER_S: u64 = 20;

/// What was seen of a cell.
#[derive(Debug, Default)]
pub(super) struct InCell {
    pub seen: Seen,
    /// Scans in which an axis had no command.
    pub missed: u64,
    /// Scans of all axes.
    pub commands: u64,
}

impl InCell {
    /// Takes another round of the same.
    ///
    /// # Errors
    /// Its times do not fit.
    pub fn join(&mut self, other: &InCell) -> anyhow::Result<()> {
        self.seen.join(&other.seen)?;
        self.missed += other.missed;
        self.commands += other.commands;
        Ok(())
    }
}

/// What is measured.
pub(super) struct Asked<'a> {
    pub machine: &'a Machine,
    pub folder: &'a Path,
    pub scratch: &'a Path,
    pub seconds: u64,
}

impl Asked<'_> {
    /// A cell beside a bare loop.
    ///
    /// # Errors
    /// The cell does not come up, or ends while it is measured.
    pub fn beside_a_loop(&self, signals: &Signals) -> anyhow::Result<(InCell, Bare)> {
        let name = format!("wakeup-{}", std::process::id());
        let program = self.scratch.join("circles.ngc");
        fs::write(&program, circles_program(self.seconds + LONGER_S))?;
        let out = self.scratch.join("wakeup");
        let mut child = child::command("run")
            .arg(self.folder)
            .arg(&program)
            .args(["--pace", "realtime", "--cell", &name, "--out"])
            .arg(&out)
            // It says that it was interrupted, as it is.
            .stderr(Stdio::null())
            .spawn()
            .context("starting a run")?;
        let measured = self.measure(&name, &mut child, signals);
        if child.try_wait()?.is_none() {
            kill_process(Pid::from_child(&child), Signal::INT)?;
        }
        child.wait()?;
        let _ = fs::remove_dir_all(&out);
        measured
    }

    fn measure(
        &self,
        name: &str,
        child: &mut Child,
        signals: &Signals,
    ) -> anyhow::Result<(InCell, Bare)> {
        let mut eyes = self.enter(name, child, signals)?;
        // Who measures has said whether it is refused.
        let _ = realtime::raise(Priority::Fieldbus.level(), 1);
        let watched = eyes.watch(self, signals);
        realtime::lower();
        let measured = watched?;
        if child.try_wait()?.is_some() {
            bail!("the cell ended while it was measured");
        }
        Ok(measured)
    }

    /// Enters the cell once it is up and its drives are on.
    fn enter(&self, name: &str, child: &mut Child, signals: &Signals) -> anyhow::Result<Eyes> {
        let place = CellPaths::new(name)?;
        let since = Instant::now();
        loop {
            // The launcher makes its page last.
            if let Ok(page) = SignalPage::open(&place)
                && page.launcher_pid() == child.id()
                && let Ok(bus) = Bus::enter(&place, &self.machine.shape(), "wakeup", false)
                && let Ok(feedback) = bus.feedback_reader(SCAN_DEPTH)
            {
                return Ok(Eyes {
                    feedback,
                    page,
                    _bus: bus,
                });
            }
            if signals.count() > 0 || since.elapsed() > UP_LIMIT || child.try_wait()?.is_some() {
                bail!("the cell does not come up");
            }
            std::thread::sleep(LOOK);
        }
    }

    fn period_ns(&self) -> u64 {
        u64::from(self.machine.scan.period_us) * 1000
    }
}

/// Who waits at the signal of the scans.
struct Eyes {
    feedback: Reader<Feedback>,
    page: SignalPage,
    _bus: Bus,
}

impl Eyes {
    /// The next scan's feedback, and when it was seen; none where none comes.
    fn next(&mut self) -> Option<(Feedback, u64)> {
        let count = self.page.scan_signal().count();
        self.page.scan_signal().wait(count, WAIT);
        let at_ns = now_ns();
        let mut newest = None;
        while let Some(feedback) = self.feedback.any() {
            newest = Some(feedback);
        }
        Some((newest?, at_ns))
    }

    /// Watches it, with a bare loop half a scan behind it.
    fn watch(&mut self, asked: &Asked<'_>, signals: &Signals) -> anyhow::Result<(InCell, Bare)> {
        let since = Instant::now();
        let mut warm = 0;
        let begun_ns = loop {
            if let Some((feedback, at_ns)) = self.next() {
                warm += usize::from(feedback.mode == Mode::Enabled as u32);
                if warm >= WARM_UP_SCANS {
                    break at_ns;
                }
            }
            if signals.count() > 0 || since.elapsed() > UP_LIMIT {
                bail!("the drives of the cell do not come on");
            }
        };
        let period_ns = asked.period_ns();
        let bare = Running::start(begun_ns + 20 * period_ns + period_ns / 2, period_ns);
        let mut starts = Vec::with_capacity((asked.seconds * 1_000_000_000 / period_ns) as usize);
        let (mut first, mut last): (Option<Feedback>, Option<Feedback>) = (None, None);
        while now_ns() < begun_ns + asked.seconds * 1_000_000_000 && signals.count() == 0 {
            let Some((feedback, at_ns)) = self.next() else {
                continue;
            };
            starts.push(Start {
                scan: feedback.scan,
                at_ns,
                overrun: feedback.overrun_scans.into(),
            });
            first.get_or_insert(feedback);
            last = Some(feedback);
        }
        let bare = bare.end()?;
        let (first, last) = first.zip(last).context("the cell has no scans")?;
        let missed = |feedback: &Feedback| -> u64 {
            let axes = feedback.axes.iter().take(feedback.axis_count as usize);
            axes.map(|axis| u64::from(axis.missed_scans)).sum()
        };
        let in_cell = InCell {
            seen: Seen::of(&starts, period_ns),
            missed: missed(&last).saturating_sub(missed(&first)),
            commands: (last.scan - first.scan) * u64::from(first.axis_count),
        };
        Ok((in_cell, bare))
    }
}
