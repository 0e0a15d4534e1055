//! A run, seen from outside by its feedback.

use bus::cell::CellPaths;
use bus::port::Reader;
use bus::sample::{EndedRun, Feedback, Mode};
use bus::service::{Bus, RECORDER_DEPTH_SCANS, Shape};
use bus::signal_page::SignalPage;

/// An observer of a cell.
pub struct Eyes {
    feedback: Reader<Feedback>,
    _bus: Bus,
    /// The newest.
    pub newest: Option<Feedback>,
    /// Modes, and the first scan of each.
    modes: Vec<(u64, u32)>,
    /// How runs ended, as the master has said it.
    pub ended: Vec<EndedRun>,
    /// Scans before which some were not seen, and the last seen before.
    gaps: Vec<(u64, u64)>,
}

impl Eyes {
    /// Enters the cell of this launcher. Who enters before the launcher has made its page is in the way of it while it cleans up.
    pub fn enter(place: &CellPaths, shape: &Shape, launcher: u32) -> Option<Eyes> {
        let page = SignalPage::open(place).ok()?;
        if page.launcher_pid() != launcher {
            return None;
        }
        let bus = Bus::enter(place, shape, "test", false).ok()?;
        let feedback = bus.feedback_reader(RECORDER_DEPTH_SCANS).ok()?;
        Some(Eyes {
            feedback,
            _bus: bus,
            newest: None,
            modes: Vec::new(),
            ended: Vec::new(),
            gaps: Vec::new(),
        })
    }

    /// Takes in all that has come.
    pub fn look(&mut self) {
        while let Some(feedback) = self.feedback.any() {
            let before = self.newest.map(|before| before.scan);
            if let Some(before) = before
                && feedback.scan != before + 1
            {
                self.gaps.push((feedback.scan, before));
            }
            if self
                .modes
                .last()
                .is_none_or(|(_, mode)| *mode != feedback.mode)
            {
                self.modes.push((feedback.scan, feedback.mode));
            }
            if self.ended.last().map_or(0, |of| of.run) != feedback.ended.run {
                self.ended.push(feedback.ended);
            }
            self.newest = Some(feedback);
        }
    }

    /// The newest scan; 0 if there is none.
    pub fn scan(&self) -> u64 {
        self.newest.map_or(0, |feedback| feedback.scan)
    }

    /// The last feedback has been published.
    pub fn is_over(&self) -> bool {
        self.newest.is_some_and(|feedback| feedback.last == 1)
    }

    /// The mode in a scan, where it was seen.
    pub fn mode_at(&self, scan: u64) -> Option<Mode> {
        let unseen = |(first, before): &(u64, u64)| *before < scan && scan < *first;
        if self.gaps.iter().any(unseen) || scan > self.scan() {
            return None;
        }
        let mode = self.modes.iter().rev().find(|(first, _)| *first <= scan)?;
        Mode::from_wire(mode.1)
    }
}
