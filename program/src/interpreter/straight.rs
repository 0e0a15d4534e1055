//! Straight motion as most blocks have it, without the detour over the words of all blocks.

use super::*;
use crate::straight::{FEED, Straight};

impl Interpreter {
    /// Does a block of straight motion; false, and nothing done, if it needs more than that or is refused.
    pub fn straight(&mut self, line: u32, block: &Straight) -> bool {
        let goes_on = matches!(
            self.motion,
            Motion::Rapid | Motion::Line | Motion::Arc { .. } | Motion::None
        );
        let plain = self.state_known
            && goes_on
            && self.beside.is_none()
            && self.stands.is_none()
            && self.offsets.turn.is_none()
            && self.modes.feed_mode == FeedMode::PerMinute
            && self.splines.is_idle();
        let moved = block.present & !FEED;
        if !plain || moved == 0 || moved & !self.axes.letters != 0 {
            return false;
        }
        let rapid = match (block.rapid, self.motion) {
            (Some(rapid), _) => rapid,
            (None, Motion::Rapid) => true,
            (None, Motion::Line) => false,
            _ => return false,
        };
        let Some(feed_word) = self.feed_of(block) else {
            return false;
        };
        let target = self.straight_target(block);
        if !self.is_inside(&target) || self.output.check_room(1.0, 0).is_err() {
            return false;
        }
        let feed = match (rapid, feed_word) {
            (true, _) => Feed::Rapid,
            (false, None) => return false,
            (false, Some(word)) => self.straight_feed(word, &target),
        };
        let from = std::mem::replace(&mut self.position, target);
        let length_mm = displacement_length_mm(&(target - from), &self.rotary);
        self.modes.feed = feed_word;
        self.motion = if rapid { Motion::Rapid } else { Motion::Line };
        self.output.straight_feeds += u32::from(!rapid);
        if length_mm > 0.0 {
            let (tolerance, rests_before) = self.path_mode();
            self.output.add_finite(Element {
                line,
                shape: Shape::Line { from, to: target },
                feed,
                length_mm,
                rests_before,
                tolerance,
                rounding: None,
            });
        }
        true
    }

    /// The feed that is in force behind the block; none where its F word needs more.
    #[expect(clippy::option_option, reason = "a feed that is none is one")]
    fn feed_of(&self, block: &Straight) -> Option<Option<FeedWord>> {
        if block.present & FEED == 0 {
            return Some(self.modes.feed);
        }
        let value = block.values.get(FEED.trailing_zeros() as usize).copied()?;
        let unit_mm = self.unit_mm();
        (value > 0.0).then_some(Some(FeedWord { value, unit_mm }))
    }

    fn straight_target(&self, block: &Straight) -> AxisVector {
        let unit_mm = self.unit_mm();
        let x = usize::from(b'X' - b'A');
        let mut target = self.position;
        let places = target
            .iter_mut()
            .zip(&self.rotary)
            .zip(self.offsets.zero.iter());
        for (&(letter, ..), ((component, rotary), zero)) in self.axes.each.iter().zip(places) {
            if block.present & (1 << letter) == 0 {
                continue;
            }
            let unit = if *rotary { 1.0 } else { unit_mm };
            let mut value = block.values.get(letter).copied().unwrap_or_default() * unit;
            if letter == x {
                value = self.radius_of(value);
            }
            let from = if self.modes.incremental {
                *component
            } else {
                *zero
            };
            *component = from + value;
        }
        if self.axes.has_endless && !self.modes.incremental {
            return self.shorter_ways(target);
        }
        target
    }

    fn is_inside(&self, target: &AxisVector) -> bool {
        let mut places = self.axes.each.iter().zip(target.iter());
        places.all(|(&(_, low, high), place)| *place >= low && *place <= high)
    }

    fn straight_feed(&self, word: FeedWord, target: &AxisVector) -> Feed {
        if self.axes.has_rotary {
            return self.feed_per_minute(word, target);
        }
        Feed::PathMmS(word.value * word.unit_mm / 60.0)
    }
}
