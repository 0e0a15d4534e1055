//! What a master remembers beside what it shows: for a model that asks whether two masters will do the same from now on.

use bus::sample::{Driver, Mode, WindowId};

use super::Master;
use crate::drives::Drives;

/// What a later scan depends on beside the feedback, the latches and the drives. Counts that only report are left out, and a count
/// stops where more of it changes nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Inner {
    /// The window that waits to be decided about.
    pub pending: WindowId,
    /// Scans at rest at the end of a run, and those spent on the way into position.
    pub settled_scans: [u32; 2],
    /// Scans at rest.
    pub rest_scans: u32,
    /// Drives that are being switched on: scans left, whether in hold, whether at the start.
    pub switching_on: Option<(u64, bool, bool)>,
    /// A motion by hand: the mode it goes back to, and the scans that the hand stays on.
    pub by_hand: Option<(Mode, u64)>,
    /// Whether the run may end, was ordered to, ends with its program, and shows its last feedback.
    pub ends: [bool; 4],
    /// Scans since the planner answered last, up to what makes it lost.
    pub planner_silent_scans: u64,
    /// Each axis.
    pub axes: Vec<InnerAxis>,
}

/// The same of one axis.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InnerAxis {
    /// The active role, and the scans in which the other was the same.
    pub switch: (usize, u32),
    /// Whether its servo answered the last scan well.
    pub followed: bool,
    /// Whether the master commands it.
    pub silent: bool,
    /// Deviation of the open loop.
    pub deviation: i64,
    /// Step of its brake, and the scans in it.
    pub brake: (u32, u32),
    /// Its motion by hand.
    pub hand: [u64; 6],
    /// The window that its command in force holds as pending.
    pub pending: WindowId,
}

impl<D: Drives> Master<D> {
    /// What it remembers beside what it shows.
    pub fn inner(&self) -> Inner {
        let by_hand = self
            .axes
            .iter()
            .any(|axis| axis.hand.driver() != Driver::Program);
        let (settled_scans, rest_scans, ends) = self.modes.inner();
        Inner {
            pending: self.windows.pending(),
            settled_scans,
            rest_scans,
            switching_on: self.switching_on.inner(),
            by_hand: by_hand.then_some((self.modes.jog_from(), self.manual.inner())),
            ends,
            planner_silent_scans: self.losses.inner(),
            axes: self
                .axes
                .iter()
                .map(|axis| {
                    let (deviation, brake) = axis.inner();
                    let (switch, followed, silent, pending) = axis.servos.inner();
                    InnerAxis {
                        switch,
                        followed,
                        silent,
                        deviation,
                        brake,
                        hand: axis.hand.inner(self.scan),
                        pending,
                    }
                })
                .collect(),
        }
    }
}
