//! Which of two servos on an axis is active (docs/developers/architecture.md, "Standby").

use bus::sample::{AxisCommand, Cause};

/// What became of an axis's commands in one scan.
#[derive(Debug, Clone, Copy)]
pub enum Taken<'a> {
    /// This one drives on.
    Command(&'a AxisCommand),
    /// None in time from a servo that lives: the drive holds the last one.
    Missed,
    /// No servo lives that could drive.
    Lost,
    /// The only one there is must not reach the drive.
    Bad(Cause),
}

/// Scans in a row in which a standby must have been the same before it may take over.
pub(super) const SAME_SCANS: u32 = 2;

/// The switch of one axis.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Switch {
    /// The active role.
    pub role: usize,
    /// Scans in a row in which the other one was the same.
    pub same_scans: u32,
}
