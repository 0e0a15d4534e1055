//! Where each sample of a cell goes: into the log that is open, the black box, and whoever else listens in this process.

use bus::sample::{
    AxisCommand, Feedback, Instruments, PlannerStatus, Roster, WindowHeader, WindowRow,
};

use crate::black_box::BlackBox;
use crate::log::LogError;
use crate::logbook::Logbook;
use crate::run::MonitorError;
use crate::tap::Tap;

/// All of them.
pub struct Sinks<'a> {
    pub logbook: Logbook,
    pub black_box: BlackBox,
    pub tap: Option<&'a mut dyn Tap>,
}

impl Sinks<'_> {
    pub fn roster(&mut self, sample: &Roster) -> Result<(), LogError> {
        self.black_box.roster(sample);
        if let Some(tap) = &mut self.tap {
            tap.roster(sample);
        }
        self.logbook.record(|log| log.record_roster(sample))
    }

    pub fn instruments(&mut self, sample: &Instruments) -> Result<(), LogError> {
        self.black_box.instruments(sample);
        if let Some(tap) = &mut self.tap {
            tap.instruments(sample);
        }
        self.logbook.record(|log| log.record_instruments(sample))
    }

    pub fn command(&mut self, axis: usize, sample: &AxisCommand) -> Result<(), LogError> {
        self.black_box.command(axis, sample);
        if let Some(tap) = &mut self.tap {
            tap.command(sample);
        }
        self.logbook.record(|log| log.record_command(axis, sample))
    }

    pub fn planner(&mut self, sample: &PlannerStatus) -> Result<(), LogError> {
        self.black_box.planner(sample);
        if let Some(tap) = &mut self.tap {
            tap.planner(sample);
        }
        self.logbook.record(|log| log.record_planner(sample))
    }

    pub fn window(&mut self, header: &WindowHeader, rows: &[WindowRow]) -> Result<(), LogError> {
        self.black_box.window(header, rows);
        self.logbook.record(|log| log.record_window(header, rows))
    }

    /// Of this scan, after all that was made in the scans before, which belongs to the program before. `roster` is the one in
    /// force, `failed` counts receptions that failed so far.
    pub fn feedback(
        &mut self,
        sample: &Feedback,
        roster: Option<&Roster>,
        failed: u64,
    ) -> Result<(), MonitorError> {
        if let Some(tap) = &mut self.tap {
            tap.feedback(sample);
        }
        let begun = self.logbook.turn(sample, failed)?;
        if let Some(home) = self.logbook.new_home() {
            self.black_box.move_to(Some(home));
        }
        if begun && let (Some(log), Some(roster)) = (self.logbook.log(), roster) {
            // It is said only when it changes.
            log.record_roster(roster)?;
        }
        self.logbook.record(|log| log.record_feedback(sample))?;
        if let Some(event) = self.black_box.feedback(sample) {
            self.logbook.record(|log| log.record_event(&event))?;
        }
        Ok(())
    }
}
