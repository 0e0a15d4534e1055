//! The speed envelope: the highest speed at each border of segments from which everything ahead can still be kept.
//!
//! Squares of speeds, computed backward: `e[k] = min(cap²[k−1], cap²[k], e[k+1] + 2·a·length)`, 0 at the end of the path. It
//! is computed in pieces, as far ahead as needed. A piece starts with 0 beyond its end; from the first border where a cap
//! decides, its values are those that a computation from the end of the path would give, to the bit, and only those
//! are used. So the motion does not depend on how the path was cut into pieces, or on when planning started.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic
)]

use crate::segment::Segment;
use crate::speed_map::SpeedMap;

/// Segments computed at a time at first; more when the motion needs to look further.
const PIECE: usize = 64;

/// What the envelope was computed for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct EnvelopeKey {
    /// Feed override; 1 is the programmed feed.
    pub feed_override: f64,
    /// Whether each block ends at rest.
    pub single_block: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct Envelope {
    key: EnvelopeKey,
    squared_mm2_s2: Vec<f64>,
    /// Borders known: from … to, not including `to`.
    from: usize,
    to: usize,
    piece: usize,
}

impl Envelope {
    pub fn new(map: &SpeedMap) -> Self {
        Self {
            key: EnvelopeKey::default(),
            squared_mm2_s2: vec![0.0; map.segments.len() + 1],
            from: 0,
            to: 0,
            piece: PIECE,
        }
    }

    /// Forgets everything if what is asked for has changed.
    pub fn select(&mut self, key: EnvelopeKey) {
        if self.key != key {
            self.key = key;
            (self.from, self.to) = (0, 0);
        }
    }

    pub fn key(&self) -> EnvelopeKey {
        self.key
    }

    /// Square of the highest speed at the start of segment `border`, in mm²/s².
    pub fn squared_mm2_s2(&mut self, map: &SpeedMap, border: usize) -> f64 {
        if !(self.from..self.to).contains(&border) {
            self.extend(map, border);
        }
        self.squared_mm2_s2.get(border).copied().unwrap_or(0.0)
    }

    fn extend(&mut self, map: &SpeedMap, border: usize) {
        let count = map.segments.len();
        if border != self.to || self.from == self.to {
            (self.from, self.to) = (border, border);
        }
        loop {
            let end = (border + self.piece).min(count);
            // Known for good: the end of the path, else the last border where a cap decides.
            let mut known_to = if end == count { count + 1 } else { 0 };
            let mut ahead = 0.0;
            if let Some(of_end) = self.squared_mm2_s2.get_mut(end) {
                *of_end = 0.0;
            }
            for index in (border..end).rev() {
                let (before, after) = (
                    index
                        .checked_sub(1)
                        .and_then(|index| map.segments.get(index)),
                    map.segments.get(index),
                );
                let Some(after) = after else { break };
                let reachable =
                    ahead + 2.0 * after.acceleration_mm_s2 * (after.to_mm - after.from_mm);
                let cap = self.border_cap_squared(before, after);
                ahead = cap.min(reachable);
                if known_to == 0 && cap <= reachable {
                    known_to = index + 1;
                }
                if let Some(of_border) = self.squared_mm2_s2.get_mut(index) {
                    *of_border = ahead;
                }
            }
            if known_to > border {
                self.to = known_to;
                if known_to - border < self.piece / 2 && end < count {
                    self.piece *= 2;
                }
                return;
            }
            self.piece *= 2;
        }
    }

    fn border_cap_squared(&self, before: Option<&Segment>, after: &Segment) -> f64 {
        let mut cap = after.cap_mm_s(self.key.feed_override);
        if let Some(before) = before {
            cap = cap.min(before.cap_mm_s(self.key.feed_override));
            if self.key.single_block && before.ends_block {
                cap = 0.0;
            }
            if before.rests_before(after) {
                cap = 0.0;
            }
        }
        cap * cap
    }
}
