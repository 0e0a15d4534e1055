//! The last scans, with what was seen of each: channels that arrive apart meet here.

use bus::sample::{MAX_AXES, PathTag};

/// Scans that are kept: four queues' worth.
pub const KEPT_SCANS: u64 = 4096;

/// What was seen of one scan.
#[derive(Debug, Clone, Copy)]
pub struct Note {
    /// Its number.
    pub scan: u64,
    /// Where on the path its row stands.
    pub tag: PathTag,
    /// Radial deviation of the table on the arc of this scan, outward positive, in µm; NaN if it was not seen.
    pub radial_um: f64,
    /// Following error of each axis, in µm; NaN if it was not seen.
    pub error_um: [f64; MAX_AXES],
}

/// A ring of the last [`KEPT_SCANS`] scans, addressed by scan.
#[derive(Debug)]
pub struct Track {
    notes: Vec<Option<Note>>,
}

impl Default for Track {
    fn default() -> Self {
        Track {
            notes: vec![None; KEPT_SCANS as usize],
        }
    }
}

impl Track {
    /// Begins a scan.
    pub fn begin(&mut self, scan: u64, tag: PathTag) {
        if let Some(slot) = self.notes.get_mut((scan % KEPT_SCANS) as usize) {
            *slot = Some(Note {
                scan,
                tag,
                radial_um: f64::NAN,
                error_um: [f64::NAN; MAX_AXES],
            });
        }
    }

    /// What was seen of a scan, if its feedback was and it is not too long ago.
    pub fn of(&self, scan: u64) -> Option<&Note> {
        let note = self.notes.get((scan % KEPT_SCANS) as usize)?.as_ref()?;
        (note.scan == scan).then_some(note)
    }

    /// The same, to add to.
    pub fn of_mut(&mut self, scan: u64) -> Option<&mut Note> {
        let note = self.notes.get_mut((scan % KEPT_SCANS) as usize)?.as_mut()?;
        (note.scan == scan).then_some(note)
    }

    /// Scans `from` to `to` without `to`; `None` for those that were not seen.
    pub fn range(&self, from: u64, to: u64) -> impl Iterator<Item = Option<&Note>> {
        (from..to.min(from + KEPT_SCANS)).map(|scan| self.of(scan))
    }
}
