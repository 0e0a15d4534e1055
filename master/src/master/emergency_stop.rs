//! The operator's emergency stop: a trip that is ordered. It stands beside the safety functions of a machine and replaces none of them.

use bus::sample::{Cause, Mode};

use super::Master;
use super::orders::Refusal;
use crate::drives::Drives;

impl<D: Drives> Master<D> {
    /// Trips a machine whose drives are on. Drives that are off stay off, also those that are being switched on; a machine that has
    /// tripped does not go on before somebody enables it.
    pub(super) fn order_emergency_stop(&mut self) -> Result<(), Refusal> {
        self.switching_on = None;
        match self.mode {
            Mode::Disabled => self.cause_is_emergency_stop(),
            Mode::Tripped if self.lost_a_servo() => self.cause_is_emergency_stop(),
            Mode::Tripped => {}
            _ => self.trip(Cause::EmergencyStop, u32::MAX),
        }
        self.may_end |= self.ends();
        Ok(())
    }

    fn cause_is_emergency_stop(&mut self) {
        self.cause = Cause::EmergencyStop;
        self.cause_axis = u32::MAX;
        self.cause_scan = self.scan + 1;
    }
}
