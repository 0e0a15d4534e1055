//! Single block: the planner brings the path to rest at the end of each block, and the master latches there that the operator is
//! waited for. What identifies a stop is the end of its block on the path, so that one that is latched is made once, whoever is killed.

use bus::sample::{HoldReason, Mode, PlannerStatus};

use super::Master;
use crate::drives::Drives;

impl<D: Drives> Master<D> {
    /// The path rests behind a block that single block has not stopped behind yet.
    pub(super) fn heed_block(&mut self, status: &PlannerStatus) {
        let rests = self.program.is_running() && self.windows.at_rest(self.scan);
        if !rests || !self.auxiliary.stops_behind(status) {
            return;
        }
        match self.mode() {
            Mode::Enabled => {
                self.auxiliary.end_block(&status.event, true);
                self.modes.hold(HoldReason::Program);
            }
            // From a stop here it goes on without another one.
            Mode::Stopping | Mode::Stopped => self.auxiliary.end_block(&status.event, false),
            _ => {}
        }
    }
}
