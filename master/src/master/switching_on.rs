//! Drives that are being switched on: over many scans, with a limit.

/// Drives that are being switched on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SwitchingOn {
    /// Scans that they may still take.
    pub scans: u64,
    /// Whether the machine is in hold once they are on.
    pub hold: bool,
    /// The master has started with it: nobody has ordered it.
    pub at_start: bool,
    /// A bit for each axis whose drive had a fault when it was ordered: it is reset on the way.
    pub forgiven: u32,
    /// A drive was lost when it was ordered: the bus is started again on the way, and all are lost for a while.
    pub awaits_lost: bool,
    /// Motors of gantries that are not homed are let go first: their bridges relax, and both motors count from one place then.
    pub relaxes: bool,
    /// Scans in a row in which these motors have neither moved nor pulled.
    pub slack_scans: u64,
}
