//! Where each sample of a cell goes: into the log that is open, and the black box.

use bus::sample::{Feedback, Roster};

use crate::black_box::BlackBox;
use crate::log::{LogError, SampleRef};
use crate::logbook::Logbook;
use crate::options::MonitorError;
use crate::standbys::Standbys;

/// Both.
pub struct Sinks {
    pub logbook: Logbook,
    pub black_box: BlackBox,
    pub standbys: Standbys,
}

impl Sinks {
    /// Any sample but a feedback.
    pub fn take(&mut self, sample: SampleRef<'_>) -> Result<(), LogError> {
        if let SampleRef::Command(axis, command) = sample
            && self.standbys.repeats(axis, command)
        {
            return self.logbook.record(|log| log.repeat(axis, command));
        }
        self.black_box.take(sample);
        self.logbook.record(|log| log.record(sample))
    }

    /// Of this scan, after all that was made in the scans before, which belongs to the program before. `roster` is the one in
    /// force, `failed` counts receptions that failed so far.
    pub fn feedback(
        &mut self,
        sample: &Feedback,
        roster: Option<&Roster>,
        failed: u64,
    ) -> Result<(), MonitorError> {
        let started = self.logbook.turn(sample, failed)?;
        if let Some(home) = self.logbook.new_home() {
            self.black_box.move_to(Some(home));
        }
        if started && let (Some(log), Some(roster)) = (self.logbook.log(), roster) {
            // It is published only when it changes.
            log.record(SampleRef::Roster(roster))?;
        }
        let feedback = SampleRef::Feedback(sample);
        self.logbook.record(|log| log.record(feedback))?;
        self.logbook.hear(sample);
        if let Some(event) = self.black_box.take(feedback) {
            self.logbook
                .record(|log| log.record(SampleRef::Event(&event)))?;
        }
        Ok(())
    }
}
