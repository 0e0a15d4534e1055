//! A stretch of the path with one cap of speed.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use thiserror::Error;

use crate::pivot::OutOfReach;

/// Why a path cannot be planned.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MapError {
    /// Nothing in it.
    #[error("the path has no elements")]
    Empty,
    /// More pieces than a tag can name.
    #[error("the path has {0} elements: at most {max} can be planned", max = u32::MAX)]
    TooLong(usize),
    /// A number that is none.
    #[error("line {line}: the geometry or the feed is not finite")]
    NotFinite {
        /// Line of the program.
        line: u32,
    },
    /// A feed that goes nowhere.
    #[error("line {line}: feed of {feed_mm_s} mm/s: must be above 0")]
    Feed {
        /// Line of the program.
        line: u32,
        /// The feed found.
        feed_mm_s: f64,
    },
    /// Motion of an axis that the machine does not have.
    #[error("line {line}: moves an axis that the machine does not have")]
    NoSuchAxis {
        /// Line of the program.
        line: u32,
    },
    /// A place that the machine's axes cannot bring the tool to.
    #[error(transparent)]
    OutOfReach(#[from] OutOfReach),
    /// An element does not start where the one before ends, or an arc does not run into its own end.
    #[error("line {line}: the path jumps by {gap_mm} mm here")]
    Gap {
        /// Line of the program.
        line: u32,
        /// How far.
        gap_mm: f64,
    },
}

/// A piece of one element on which the limits are constant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Segment {
    /// Element it lies on.
    pub element: u32,
    /// Whether it is a wait: no length, no speed.
    pub is_dwell: bool,
    /// Scans to wait.
    pub dwell_scans: u32,
    /// Distance on the element where it starts, in mm.
    pub from_mm: f64,
    /// Distance on the element where it ends, in mm.
    pub to_mm: f64,
    /// Speed that the axes and junctions bear, in mm/s; 0 for a dwell.
    pub speed_mm_s: f64,
    /// Speed that the program asks for at 100 %, in mm/s; for rapids what the axes bear.
    pub feed_mm_s: f64,
    /// Acceleration along the path, in mm/s².
    pub acceleration_mm_s2: f64,
    /// Whether a block of the program ends with it.
    pub ends_block: bool,
    /// Whether its element begins and ends at rest whatever comes before and after (`positioning`).
    pub from_rest_to_rest: bool,
    /// The tool rests before it: it is the first piece after a place where something happens.
    pub rests_at_start: bool,
    /// Its profile among the moves of the map, if it is travelled at least heat.
    pub of_move: Option<u32>,
}

impl Segment {
    /// Speed cap at an override.
    pub fn cap_mm_s(&self, feed_override: f64) -> f64 {
        self.speed_mm_s.min(self.feed_mm_s * feed_override)
    }

    /// Whether the motion rests between this segment and the next: something happens between them, or one of them is on a rapid
    /// from rest to rest.
    pub fn rests_before(&self, next: &Segment) -> bool {
        next.rests_at_start
            || (self.from_rest_to_rest || next.from_rest_to_rest) && self.element != next.element
    }
}
