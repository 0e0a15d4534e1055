//! The speed envelope: the highest speed at each border of segments from which everything ahead can still be kept.
//!
//! Squares of speeds, computed backward: `e[k] = min(cap²[k−1], cap²[k], e[k+1] + 2·a·length)`, 0 at the end of the path, where `a` is
//! what the axes have left on the piece at the highest speed that it can then be travelled at (`segment`). It
//! is computed in pieces, as far ahead as needed. A piece starts with 0 beyond its end; from the first border where a cap
//! decides, its values are those that a computation from the end of the path would give, to the bit, and only those
//! are used. So the motion does not depend on how the path was cut into pieces, or on when planning started.
//!
//! On a block of the map no end of the path further away counts than the [horizon](SpeedMap::horizon) of that block: there it is 0 too.
use std::collections::VecDeque;

use crate::segment::Segment;
use crate::speed_map::{Horizon, SpeedMap};

/// Segments computed at a time at first; more when the motion needs to look further.
const PIECE: usize = 64;
/// The most at a time, where no cap asks for more.
const PIECE_MAX: usize = 1 << 20;

/// What the envelope was computed for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct EnvelopeKey {
    /// Feed override; 1 is the programmed feed.
    pub feed_override: f64,
    /// Share of rapids beside it.
    pub rapid_override: f64,
    /// Whether each block ends at rest.
    pub single_block: bool,
}

impl EnvelopeKey {
    /// Share of its speed that a segment is travelled at: no rapid is faster than the axes, and its own override counts besides.
    pub fn share(&self, segment: &Segment) -> f64 {
        if segment.is_rapid {
            self.feed_override.min(1.0) * self.rapid_override
        } else {
            self.feed_override
        }
    }

    /// Speed cap of a segment.
    pub fn cap_mm_s(&self, segment: &Segment) -> f64 {
        segment.cap_mm_s(self.share(segment))
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Envelope {
    pub key: EnvelopeKey,
    squared_mm2_s2: VecDeque<f64>,
    /// Border of the first of them.
    first: usize,
    /// Borders known: from … to, not including `to`.
    from: usize,
    to: usize,
    piece: usize,
    /// A border was asked for that the map does not reach far enough to know.
    pub ran_short: bool,
    /// The lowest speed at the end of a block that was so low only for what lies behind it being looked at no further.
    pub limited_mm_s: Option<f64>,
}

impl Envelope {
    pub fn new() -> Self {
        Self {
            key: EnvelopeKey::default(),
            squared_mm2_s2: VecDeque::new(),
            first: 0,
            from: 0,
            to: 0,
            piece: PIECE,
            ran_short: false,
            limited_mm_s: None,
        }
    }

    /// Makes room for the borders of a map that has grown or let go of its start.
    pub fn follow(&mut self, map: &SpeedMap) {
        let gone = map.first_segment.saturating_sub(self.first);
        self.squared_mm2_s2
            .drain(..gone.min(self.squared_mm2_s2.len()));
        self.first = map.first_segment;
        self.from = self.from.max(self.first);
        if self.to < self.from {
            self.to = self.from;
        }
        self.squared_mm2_s2
            .resize(map.segment_end() + 1 - self.first, 0.0);
    }

    /// Forgets everything if what is asked for has changed.
    pub fn select(&mut self, key: EnvelopeKey) {
        self.ran_short = false;
        if self.key != key {
            self.key = key;
            (self.from, self.to) = (0, 0);
        }
    }

    /// Square of the highest speed at the start of segment `border`, in mm²/s².
    pub fn squared_mm2_s2(&mut self, map: &SpeedMap, border: usize) -> f64 {
        if !(self.from..self.to).contains(&border) {
            self.extend(map, border);
        }
        let at = border
            .checked_sub(self.first)
            .and_then(|index| self.squared_mm2_s2.get(index));
        at.copied().unwrap_or(0.0)
    }

    fn extend(&mut self, map: &SpeedMap, border: usize) {
        if border != self.to || self.from == self.to {
            (self.from, self.to) = (border, border);
        }
        let Some(horizon) = map.horizon(border) else {
            self.ran_short = true;
            (self.from, self.to) = (border, border);
            return self.set(border, 0.0);
        };
        loop {
            let end = (border + self.piece).min(horizon.rests_at);
            let is_last = end == horizon.rests_at;
            // Known for good: up to the last border where a cap decides.
            let mut known_to = 0;
            let mut ahead = 0.0;
            self.set(end, 0.0);
            for index in (border..end).rev() {
                let (before, after) = (
                    index.checked_sub(1).and_then(|index| map.segment(index)),
                    map.segment(index),
                );
                let Some(after) = after else { break };
                let highest = after.highest_mm2_s2(ahead, self.key.cap_mm_s(after));
                let acceleration_mm_s2 = after.acceleration.at_mm_s2(highest);
                let reachable = ahead + 2.0 * acceleration_mm_s2 * (after.to_mm - after.from_mm);
                let cap = self.border_cap_squared(before, after);
                ahead = cap.min(reachable);
                if known_to == 0 && cap <= reachable {
                    known_to = index + 1;
                }
                self.set(index, ahead);
            }
            if is_last && known_to < horizon.holds_to {
                known_to = horizon.holds_to;
                self.note_limit(&horizon);
            }
            if known_to > border {
                self.to = known_to;
                if known_to - border < self.piece / 2 && !is_last {
                    self.piece = (self.piece * 2).min(PIECE_MAX);
                }
                return;
            }
            self.piece *= 2;
        }
    }

    /// The speed at the last border that a horizon decides.
    fn note_limit(&mut self, horizon: &Horizon) {
        let last = (horizon.holds_to - 1).checked_sub(self.first);
        let squared = last.and_then(|index| self.squared_mm2_s2.get(index));
        if let Some(squared) = squared.filter(|_| !horizon.is_end) {
            let before_mm_s = self.limited_mm_s.unwrap_or(f64::INFINITY);
            self.limited_mm_s = Some(before_mm_s.min(squared.sqrt()));
        }
    }

    fn set(&mut self, border: usize, squared_mm2_s2: f64) {
        let index = border.checked_sub(self.first);
        if let Some(of_border) = index.and_then(|index| self.squared_mm2_s2.get_mut(index)) {
            *of_border = squared_mm2_s2;
        }
    }

    fn border_cap_squared(&self, before: Option<&Segment>, after: &Segment) -> f64 {
        let mut cap = self.key.cap_mm_s(after);
        if let Some(before) = before {
            cap = cap.min(self.key.cap_mm_s(before));
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
