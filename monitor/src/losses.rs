//! What the recorders of a cell have lost, in a file of the cell: a log that has a gap is known of while it is being written.

use std::fs;
use std::path::PathBuf;

use bus::cell::CellPaths;
use bus::sample::Feedback;

/// Name of the file in the cell's folder; without it nothing is lost.
const FILE: &str = "recorder-losses";

/// Scans that the recorders of this cell did not get, and receptions that failed.
pub fn lost_samples(cell: &CellPaths) -> u64 {
    let text = fs::read_to_string(cell.folder().join(FILE)).ok();
    text.and_then(|text| text.parse().ok()).unwrap_or(0)
}

/// Counts them.
#[derive(Debug)]
pub(crate) struct Losses {
    file: PathBuf,
    /// Those of the recorders before this one.
    before: u64,
    newest: Option<u64>,
    skipped: u64,
    told: u64,
}

impl Losses {
    pub fn of(cell: &CellPaths) -> Losses {
        Losses {
            file: cell.folder().join(FILE),
            before: lost_samples(cell),
            newest: None,
            skipped: 0,
            told: 0,
        }
    }

    /// A feedback has come.
    pub fn feedback(&mut self, feedback: &Feedback) {
        let before = self.newest.replace(feedback.scan);
        let next = before.map_or(feedback.scan, |scan| scan.saturating_add(1));
        self.skipped += feedback.scan.saturating_sub(next);
    }

    /// Tells how many there are; so many receptions have failed.
    pub fn tell(&mut self, failed: u64) {
        let lost = self.skipped + failed;
        if lost == self.told {
            return;
        }
        self.told = lost;
        // Whoever reads it finds a whole number, the old one or the new one.
        let new = self.file.with_extension("new");
        let written = fs::write(&new, (self.before + lost).to_string());
        let _ = written.and_then(|()| fs::rename(&new, &self.file));
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn what_a_recorder_loses_is_known_and_one_that_replaces_it_counts_on() {
        let name = format!("losses{}", std::process::id());
        let cell = CellPaths::new(&name).expect("a name");
        fs::create_dir(cell.folder()).expect("the cell's folder");
        let recorded = |scans: &[u64], failed: u64| {
            let mut losses = Losses::of(&cell);
            for scan in scans {
                let mut feedback = Feedback::zeroed();
                feedback.scan = *scan;
                losses.feedback(&feedback);
            }
            losses.tell(failed);
            lost_samples(&cell)
        };
        let counts = [
            recorded(&[7, 8, 9], 0),
            recorded(&[7, 9, 12], 1),
            recorded(&[20, 22], 0),
        ];
        let _ = fs::remove_dir_all(cell.folder());
        assert_eq!(counts, [0, 4, 5]);
    }
}
