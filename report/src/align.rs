//! Brings the samples of one scan together, whatever order the channels came in.
//!
//! Each channel is in order by itself. A scan is whole when every channel has reached it, so nothing of it can still
//! come. A channel that falls silent (a killed servo) holds the others up for a bounded number of scans.

use std::collections::BTreeMap;

use bus::sample::{AxisCommand, BusCycle, Feedback, Instruments, Signals};

/// Scans that wait for a silent channel.
const WAITING_SCANS_MAX: usize = 4096;

/// Everything of one scan.
#[derive(Debug, Clone, Default)]
pub struct ScanSet {
    /// The scan.
    pub scan: u64,
    /// What the master published.
    pub feedback: Option<Box<Feedback>>,
    /// What the instruments saw.
    pub instruments: Option<Box<Instruments>>,
    /// What the fieldbus did; it comes before the instruments, and no scan waits for it.
    pub bus_cycle: Option<Box<BusCycle>>,
    /// What named inputs and outputs showed; as what the fieldbus did.
    pub signals: Option<Box<Signals>>,
    /// What the servos asked for, per axis; of two roles, which say the same, role a.
    pub commands: Vec<Option<Box<AxisCommand>>>,
}

impl ScanSet {
    /// The command of one axis.
    pub fn command(&self, axis: usize) -> Option<&AxisCommand> {
        self.commands.get(axis)?.as_deref()
    }
}

/// Collects samples into scans.
#[derive(Debug)]
pub struct Aligner {
    waiting: BTreeMap<u64, ScanSet>,
    axis_count: usize,
    /// Last scan of feedback, instruments and each axis' commands.
    reached: Vec<Option<u64>>,
    /// The next scan to be handed out.
    next: u64,
    late: u64,
    patience_scans: usize,
}

impl Aligner {
    /// For a machine with so many axes.
    pub fn new(axis_count: usize) -> Self {
        Self::with_patience(axis_count, WAITING_SCANS_MAX)
    }

    /// The same; scans wait for a silent channel until there are so many of them.
    pub fn with_patience(axis_count: usize, patience_scans: usize) -> Self {
        Aligner {
            waiting: BTreeMap::new(),
            axis_count,
            patience_scans,
            reached: vec![None; axis_count + 2],
            next: 0,
            late: 0,
        }
    }

    /// Samples that came after their scan had been handed out.
    pub fn late(&self) -> u64 {
        self.late
    }

    fn set(&mut self, scan: u64, channel: usize) -> Option<&mut ScanSet> {
        if let Some(reached) = self.reached.get_mut(channel) {
            *reached = (*reached).max(Some(scan));
        }
        if scan < self.next {
            self.late += 1;
            return None;
        }
        let axis_count = self.axis_count;
        Some(self.waiting.entry(scan).or_insert_with(|| ScanSet {
            scan,
            commands: vec![None; axis_count],
            ..ScanSet::default()
        }))
    }

    /// Takes a feedback.
    pub fn feedback(&mut self, sample: Box<Feedback>) {
        if let Some(set) = self.set(sample.scan, 0) {
            set.feedback = Some(sample);
        }
    }

    /// Takes what the instruments saw.
    pub fn instruments(&mut self, sample: Box<Instruments>) {
        if let Some(set) = self.set(sample.scan, 1) {
            set.instruments = Some(sample);
        }
    }

    /// Takes what the fieldbus did.
    pub fn bus_cycle(&mut self, sample: Box<BusCycle>) {
        if let Some(set) = self.waiting.get_mut(&sample.scan) {
            set.bus_cycle = Some(sample);
        }
    }

    /// Takes what named inputs and outputs showed.
    pub fn signals(&mut self, sample: Box<Signals>) {
        if let Some(set) = self.waiting.get_mut(&sample.scan) {
            set.signals = Some(sample);
        }
    }

    /// Takes a command.
    pub fn command(&mut self, sample: Box<AxisCommand>) {
        let axis = sample.axis as usize;
        // A standby says the same as the servo it stands by for, which has come first: that it comes after is no loss.
        let repeats = sample.role > 0 && sample.scan < self.next;
        if axis >= self.axis_count || repeats {
            return;
        }
        let place = self
            .set(sample.scan, 2 + axis)
            .and_then(|set| set.commands.get_mut(axis));
        if let Some(place) = place
            && place.as_ref().is_none_or(|there| there.role > sample.role)
        {
            *place = Some(sample);
        }
    }

    /// The next scan of which everything is there.
    pub fn next_whole(&mut self) -> Option<ScanSet> {
        let first = *self.waiting.first_key_value()?.0;
        let reached = self.reached.iter().all(|reached| *reached >= Some(first));
        if reached || self.waiting.len() > self.patience_scans {
            return self.next_of_rest();
        }
        None
    }

    /// The next scan, whole or not.
    pub fn next_of_rest(&mut self) -> Option<ScanSet> {
        let (scan, set) = self.waiting.pop_first()?;
        self.next = scan.saturating_add(1);
        Some(set)
    }
}
