//! Straight motion as most blocks have it, without the detour over the words of all blocks.

use path::geometry::{AxisVector, Feed};

use super::State;
use crate::state::{FeedMode, FeedWord, Motion};
use crate::straight::{FEED, Straight};

/// A block of straight motion, understood.
#[derive(Debug, Clone, Copy)]
pub struct StraightLeg {
    /// Its end, in machine coordinates.
    pub to: AxisVector,
    pub feed: Feed,
    /// The F word that is in force behind it.
    feed_word: Option<FeedWord>,
}

impl State {
    /// What a block of straight motion means; none if it needs more than that or is to be refused.
    #[inline]
    pub fn straight(&self, block: &Straight) -> Option<StraightLeg> {
        let axes = self.equipment.straight_axes();
        let plain = self.stands.is_none()
            && !self.offsets.is_turned()
            && self.in_force.feed_mode == FeedMode::PerMinute;
        let moved = block.present & !FEED;
        if !plain || moved == 0 || moved & !axes.letters != 0 {
            return None;
        }
        let rapid = match (block.rapid, self.in_force.motion()) {
            // A block that ends a cycle, a spline or a thread does more than move.
            (Some(rapid), Motion::Rapid | Motion::Line | Motion::Arc { .. } | Motion::None) => {
                rapid
            }
            (None, Motion::Rapid) => true,
            (None, Motion::Line) => false,
            _ => return None,
        };
        let feed_word = self.feed_of(block)?;
        let to = self.straight_target(block);
        let mut places = axes.each.iter().zip(to.iter());
        if !places.all(|(&(_, low, high), place)| *place >= low && *place <= high) {
            return None;
        }
        let feed = if rapid {
            Feed::Rapid
        } else {
            self.straight_feed(feed_word?, &to)
        };
        Some(StraightLeg {
            to,
            feed,
            feed_word,
        })
    }

    /// Goes along a block of straight motion; its start.
    #[inline]
    pub fn go_straight(&mut self, leg: &StraightLeg) -> AxisVector {
        self.in_force
            .move_straight(leg.feed == Feed::Rapid, leg.feed_word);
        std::mem::replace(&mut self.position, leg.to)
    }

    /// The feed that is in force behind the block; none where its F word needs more.
    #[expect(clippy::option_option, reason = "a feed that is none is one")]
    fn feed_of(&self, block: &Straight) -> Option<Option<FeedWord>> {
        if block.present & FEED == 0 {
            return Some(self.in_force.feed);
        }
        let value = block.values.get(FEED.trailing_zeros() as usize).copied()?;
        let unit_mm = self.in_force.unit_mm();
        (value > 0.0).then_some(Some(FeedWord { value, unit_mm }))
    }

    fn straight_target(&self, block: &Straight) -> AxisVector {
        let axes = self.equipment.straight_axes();
        let unit_mm = self.in_force.unit_mm();
        let incremental = self.in_force.incremental;
        let x = usize::from(b'X' - b'A');
        let mut target = self.position;
        let places = target
            .iter_mut()
            .zip(self.equipment.rotary())
            .zip(self.offsets.zero().iter());
        for (&(letter, ..), ((component, rotary), zero)) in axes.each.iter().zip(places) {
            if block.present & (1 << letter) == 0 {
                continue;
            }
            let unit = if *rotary { 1.0 } else { unit_mm };
            let mut value = block.values.get(letter).copied().unwrap_or_default() * unit;
            if letter == x {
                value = self.in_force.radius_of(value);
            }
            let from = if incremental { *component } else { *zero };
            *component = from + value;
        }
        if axes.has_endless && !incremental {
            return self.shorter_ways(target);
        }
        target
    }

    fn straight_feed(&self, word: FeedWord, target: &AxisVector) -> Feed {
        if self.equipment.straight_axes().has_rotary {
            return self.feed_per_minute(word, target);
        }
        Feed::PathMmS(word.value * word.unit_mm / 60.0)
    }
}
