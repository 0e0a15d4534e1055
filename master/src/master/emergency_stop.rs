//! The operator's emergency stop: a trip that is ordered. It stands beside the safety functions of a machine and replaces none of them.

use bus::sample::{Cause, Mode};

use super::Master;
use super::orders::Refusal;
use crate::drives::Drives;

impl<D: Drives> Master<D> {
    /// Trips a machine whose drives are on. Drives that are off stay off, also those that are being switched on; a machine that has
    /// tripped does not go on before somebody enables it.
    pub(super) fn order_emergency_stop(&mut self) -> Result<(), Refusal> {
        self.switching_on.cancel();
        match self.mode() {
            Mode::Tripped if !self.modes.lost_a_servo() => {}
            Mode::Disabled | Mode::Tripped => {
                let cause = Cause::EmergencyStop;
                self.modes.blame(cause, u32::MAX, self.scan);
            }
            _ => self.trip(Cause::EmergencyStop, u32::MAX),
        }
        self.modes.let_end();
        Ok(())
    }
}
