//! Single block: the planner brings the path to rest at the end of each block, and the master latches there that the operator is
//! waited for. What identifies a stop is the end of its block on the path, so that one that is latched is made once, whoever is killed.

use bus::sample::{EventCode, Mode, PlannerStatus, Refused, Waiting};

use super::Master;
use super::orders::Refusal;
use crate::drives::Drives;

impl<D: Drives> Master<D> {
    pub(super) fn order_single_block(&mut self, value: f64) -> Result<(), Refusal> {
        if value != 0.0 && value != 1.0 {
            return Err(Refused::BadValue.into());
        }
        self.auxiliary.latches.single_block = u32::from(value == 1.0);
        Ok(())
    }

    /// The path rests behind a block that single block has not stopped behind yet.
    pub(super) fn heed_block(&mut self, status: &PlannerStatus) {
        let auxiliary = &mut self.auxiliary;
        let event = &status.event;
        let is_new = auxiliary.latches.single_block == 1
            && event.code == EventCode::BlockDone as u32
            && event.element > auxiliary.latches.levels.blocks_done
            && auxiliary.is_of_run(status);
        if !is_new || !self.program.is_running() || !self.windows.at_rest(self.scan) {
            return;
        }
        match self.mode {
            Mode::Enabled => {
                // In a stop that the program makes here it is made.
                if auxiliary.latches.stopped_for == Waiting::None as u32 {
                    auxiliary.latches.stopped_for = Waiting::SingleBlock as u32;
                    auxiliary.latches.line = event.line;
                }
                self.hold = true;
            }
            // Whoever goes on from a stop here does not stop here once more.
            Mode::Stopping | Mode::Stopped => {}
            _ => return,
        }
        auxiliary.latches.levels.blocks_done = event.element;
        auxiliary.latched();
    }
}
