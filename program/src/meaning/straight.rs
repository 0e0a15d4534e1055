//! Straight motion as most blocks have it, without the detour over the words of all blocks.

use super::{AxisVector, Feed, State};
use crate::state::{FeedMode, FeedWord, Motion};
use crate::straight::{FEED, Straight};

/// A block of straight motion, understood.
#[derive(Debug, Clone, Copy)]
pub struct StraightLeg {
    /// Its end, in machine coordinates.
    pub to: AxisVector,
    pub feed: Feed,
    /// The F word that is in force behind it.
    pub feed_word: Option<FeedWord>,
}

impl State {
    /// What a block of straight motion means; none if it needs more than that or is to be refused.
    #[inline]
    pub fn straight(&self, block: &Straight) -> Option<StraightLeg> {
        let axes = &self.equipment.straight_axes;
        let plain = self.stands.is_none()
            && self.axes.is_none()
            && self.plane.is_none()
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
        let to = self.target_by(|letter| {
            let value = block.values.get(letter).copied();
            value.filter(|_| block.present & (1 << letter) != 0)
        });
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

    fn straight_feed(&self, word: FeedWord, target: &AxisVector) -> Feed {
        if self.equipment.straight_axes.has_rotary {
            return self.feed_per_minute(word, target);
        }
        Feed::PathMmS(word.value * word.unit_mm / 60.0)
    }
}
