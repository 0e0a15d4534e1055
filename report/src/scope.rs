//! The scope: signals around a trigger, scan by scan, from a running cell or from a log.
//!
//! One core for both. [`Scope`] takes samples in whatever order their channels come, puts those of one scan together, makes
//! numbers of them ([`signal`]), keeps the last ones in a ring, watches for the trigger ([`trigger`]) and cuts a [`Capture`] out of
//! the ring once its last scan is there. It knows no clock, port or file: the same samples give the same capture.

pub mod csv;
mod error;
pub mod signal;
pub mod span;
#[cfg(test)]
mod tests;
pub mod trigger;

use std::collections::VecDeque;

use machine::Machine;

use crate::align::{Aligner, ScanSet};
pub use error::ScopeError;
use monitor::log::Sample;
use signal::{Eyes, KnownPath, Signal};
use trigger::{Fired, Trigger, Watch};

/// Scans that a scan waits for what has not come of it: a servo that died says nothing more.
const PATIENCE_SCANS: usize = 64;
/// Scans kept beyond what was asked for: a reversal or a death is known only some scans after it.
const LATE_SCANS: u64 = 1024;
/// The most numbers that the ring may hold: 128 MiB.
const NUMBERS_MAX: u64 = 16 << 20;

/// What is asked of a scope.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What to show.
    pub signals: Vec<Signal>,
    /// What starts a capture.
    pub trigger: Trigger,
    /// Scans before the trigger.
    pub before: u64,
    /// Scans from the trigger on.
    pub after: u64,
    /// Triggers in earlier scans do not count.
    pub from: u64,
    /// Whether a trigger that comes again counts only once the scans before it have been seen: for a scope that comes into the
    /// middle of things.
    pub fill_first: bool,
}

impl Settings {
    /// Whether they can be kept.
    ///
    /// # Errors
    /// Nothing is asked for, or too much.
    pub fn check(&self) -> Result<(), ScopeError> {
        if self.signals.is_empty() {
            return Err(ScopeError::Input(
                "no signal is named: --signal X.following_error; --list shows all".into(),
            ));
        }
        if self.before == 0 && self.after == 0 {
            return Err(ScopeError::Input(
                "--before and --after are both 0: there would be nothing to show".into(),
            ));
        }
        let numbers = (self.before + self.after + LATE_SCANS) * (self.signals.len() as u64 + 1);
        if numbers > NUMBERS_MAX {
            return Err(ScopeError::Input(format!(
                "{} signals of {} scans: at most {} scans can be held of so many",
                self.signals.len(),
                self.before + self.after,
                (NUMBERS_MAX / (self.signals.len() as u64 + 1)).saturating_sub(LATE_SCANS)
            )));
        }
        Ok(())
    }
}

/// One scan of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its number.
    pub scan: u64,
    /// A number for each signal; NaN where it is not known.
    pub values: Vec<f64>,
}

/// What was seen around a trigger.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Counted from 1.
    pub number: u64,
    /// Scan of the trigger: zero of the time.
    pub trigger_scan: u64,
    /// What happened in it.
    pub what: String,
    /// Scan period, in µs.
    pub period_us: u32,
    /// The signals, in the order of the values.
    pub signals: Vec<Signal>,
    /// First and last scan asked for.
    pub asked: (u64, u64),
    /// The scans that were seen, in order.
    pub rows: Vec<Row>,
}

impl Capture {
    /// Time of a scan, from the trigger on, in ms.
    pub fn time_ms(&self, scan: u64) -> f64 {
        (scan as i128 - self.trigger_scan as i128) as f64 * f64::from(self.period_us) * 1e-3
    }

    /// Scans that were not seen: before the first, between first and last, after the last.
    pub fn missing(&self) -> (u64, u64, u64) {
        let (Some(first), Some(last)) = (self.rows.first(), self.rows.last()) else {
            return (0, self.asked.1 - self.asked.0 + 1, 0);
        };
        let between = (last.scan - first.scan + 1).saturating_sub(self.rows.len() as u64);
        (
            first.scan.saturating_sub(self.asked.0),
            between,
            self.asked.1.saturating_sub(last.scan),
        )
    }

    /// One line for people: what, where, how much of it was seen.
    pub fn title(&self) -> String {
        let (before, between, after) = self.missing();
        let scan = format!("scan {}", self.trigger_scan);
        let what = if self.what == scan {
            scan
        } else {
            format!("{}, {scan}", self.what)
        };
        let mut title = format!(
            "{what}, {:.3} s: {} scans of {} µs",
            self.trigger_scan as f64 * f64::from(self.period_us) * 1e-6,
            self.rows.len(),
            self.period_us
        );
        for (count, where_) in [
            (before, "before the first that was seen"),
            (between, "not seen in between"),
            (after, "after the last that was seen"),
        ] {
            if count > 0 {
                title += &format!(", {count} {where_}");
            }
        }
        title
    }

    /// Lowest and highest of a signal; none if nothing of it is known.
    pub fn range(&self, signal: usize) -> Option<(f64, f64)> {
        let values = self.rows.iter().filter_map(|row| row.values.get(signal));
        let known = values.filter(|value| value.is_finite());
        known.fold(None, |range, &value| {
            let (low, high) = range.unwrap_or((value, value));
            Some((value.min(low), value.max(high)))
        })
    }

    /// What a chart of a signal reaches from and to; none if nothing of it is known.
    pub fn limits(&self, signal: usize) -> Option<(f64, f64)> {
        let (low, high) = self.range(signal)?;
        if high > low {
            return Some((low, high));
        }
        // A value that does not change is drawn in the middle.
        let half = (low.abs() * 1e-3).max(0.5);
        Some((low - half, high + half))
    }

    /// Value of a signal in the scan of the trigger.
    pub fn at_trigger(&self, signal: usize) -> Option<f64> {
        let at = self
            .rows
            .binary_search_by_key(&self.trigger_scan, |row| row.scan);
        let value = *self.rows.get(at.ok()?)?.values.get(signal)?;
        value.is_finite().then_some(value)
    }
}

/// The scope.
#[derive(Debug)]
pub struct Scope {
    settings: Settings,
    period_us: u32,
    eyes: Eyes,
    aligner: Aligner,
    watch: Watch,
    ring: VecDeque<Row>,
    first_scan: Option<u64>,
    pending: Option<Fired>,
    /// First scan that no capture has yet.
    free_from: u64,
    captured: u64,
    done: VecDeque<Capture>,
}

impl Scope {
    /// For a machine.
    pub fn new(machine: &Machine, settings: Settings) -> Scope {
        Scope {
            period_us: machine.scan.period_us,
            eyes: Eyes::of(machine),
            aligner: Aligner::with_patience(machine.axes.len(), PATIENCE_SCANS),
            watch: Watch::new(settings.trigger.clone(), machine),
            ring: VecDeque::new(),
            first_scan: None,
            pending: None,
            free_from: settings.from,
            captured: 0,
            done: VecDeque::new(),
            settings,
        }
    }

    /// The path of the program, for the samples from the next one on.
    pub fn set_path(&mut self, path: KnownPath) {
        self.eyes.path = Some(path);
    }

    /// Takes the next sample of any channel.
    pub fn take(&mut self, sample: Sample) {
        match sample {
            Sample::Feedback(sample) => self.aligner.feedback(sample),
            Sample::Instruments(sample) => self.aligner.instruments(sample),
            Sample::BusCycle(sample) => self.aligner.bus_cycle(sample),
            Sample::Signals(sample) => self.aligner.signals(sample),
            Sample::Command(sample) => self.aligner.command(sample),
            Sample::Roster(roster) => self.watch.roster(&roster),
            Sample::Window(_) | Sample::Planner(_) | Sample::Event(_) => {}
        }
        while let Some(set) = self.aligner.next_whole() {
            self.scan(&set);
        }
    }

    /// Nothing more comes: a capture that waits for its last scans is cut short.
    pub fn finish(&mut self) {
        while let Some(set) = self.aligner.next_of_rest() {
            self.scan(&set);
        }
        self.cut(true);
    }

    /// The next capture that is whole.
    pub fn next_capture(&mut self) -> Option<Capture> {
        self.done.pop_front()
    }

    /// What was seen in place of the trigger.
    pub fn seen_instead(&self) -> String {
        self.watch.seen_instead()
    }

    /// Whether a trigger has fired whose last scans have not come yet.
    pub fn is_capturing(&self) -> bool {
        self.pending.is_some()
    }

    fn scan(&mut self, set: &ScanSet) {
        let Some(feedback) = set.feedback.as_deref() else {
            return;
        };
        let first = *self.first_scan.get_or_insert(set.scan);
        let kept = (self.settings.before + self.settings.after + LATE_SCANS) as usize;
        let mut row = if self.ring.len() >= kept {
            self.ring.pop_front().unwrap_or_else(empty_setpoint)
        } else {
            empty_setpoint()
        };
        row.scan = set.scan;
        row.values.clear();
        let signals = self.settings.signals.iter();
        row.values
            .extend(signals.map(|signal| self.eyes.see(signal, set, feedback)));
        self.ring.push_back(row);
        if let Some(fired) = self.watch.scan(set, feedback, &self.eyes) {
            let waits = self.settings.fill_first && self.settings.trigger.comes_again();
            let filled = !waits || fired.scan >= first + self.settings.before;
            if self.pending.is_none() && fired.scan >= self.free_from && filled {
                self.pending = Some(fired);
            }
        }
        self.cut(false);
    }

    /// Cuts the capture that waits out of the ring, once its last scan is there or nothing more comes.
    fn cut(&mut self, ended: bool) {
        let Some(fired) = &self.pending else {
            return;
        };
        let after = self.settings.after.max(1);
        let last = fired.scan.saturating_add(after - 1);
        if !ended && self.ring.back().is_none_or(|row| row.scan < last) {
            return;
        }
        let first = fired.scan.saturating_sub(self.settings.before);
        let asked = (first, last);
        let rows = self.ring.iter();
        let rows = rows.filter(|row| (asked.0..=asked.1).contains(&row.scan));
        self.captured += 1;
        self.free_from = last + 1;
        self.done.push_back(Capture {
            number: self.captured,
            trigger_scan: fired.scan,
            what: fired.what.clone(),
            period_us: self.period_us,
            signals: self.settings.signals.clone(),
            asked,
            rows: rows.cloned().collect(),
        });
        self.pending = None;
    }
}

fn empty_setpoint() -> Row {
    Row {
        scan: 0,
        values: Vec::new(),
    }
}
