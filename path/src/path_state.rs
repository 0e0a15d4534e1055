//! A place and a speed on a path.

use crate::path_part::PathPart;

/// A place and a speed on a path at the end of a scan: all that the motion from there depends on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathState {
    /// Index of the element.
    pub element: u32,
    /// Scans still to wait there, if the element is a dwell.
    pub dwell_remaining_scans: u32,
    /// Distance along the element, in mm.
    pub distance_mm: f64,
    /// Speed along the path, in mm/s.
    pub speed_mm_s: f64,
    /// Stopped at the end of a block in single block; goes on when started.
    pub waits_for_start: bool,
    /// Scans still to rest at a place of rest until the tool is there, which this state leads (`smoothing`).
    pub settling_scans: u32,
}

impl PathState {
    /// The state at rest at a path tag, as a restarted planner finds it in the feedback. `None` for a tag that is not on
    /// the path.
    pub fn resume(
        path: &PathPart,
        element: u32,
        distance_mm: f64,
        dwell_remaining_scans: u32,
    ) -> Option<Self> {
        let on = path.get(element)?;
        if !(0.0..=on.length_mm).contains(&distance_mm) {
            return None;
        }
        Some(Self {
            element,
            dwell_remaining_scans: if on.is_dwell() {
                dwell_remaining_scans
            } else {
                0
            },
            distance_mm,
            ..Self::default()
        })
    }

    /// Whether it is at rest.
    pub fn is_at_rest(&self) -> bool {
        self.speed_mm_s == 0.0
    }
}
