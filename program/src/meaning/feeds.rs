//! How fast a motion is: the feed in force, per minute, per turn or by its time.

use std::fmt::Display;

use path::geometry::{AxisVector, Feed, PathTolerance, Shape, displacement_length_mm};

use super::{Acts, Cause, Group, Refusal, State, Words, refuse};
use crate::state::{FeedMode, FeedWord};
use crate::surface::FeedPerTurn;

/// The longest dwell, in s: more than a day.
const DWELL_MAX_S: f64 = 100_000.0;

/// What is right of the time of a dwell.
pub fn dwell_right() -> String {
    format!("a time is 0 to {DWELL_MAX_S} s; M0 waits for the operator")
}

/// Whether a dwell may have this time, in s.
pub fn is_dwell(seconds: f64) -> bool {
    (0.0..=DWELL_MAX_S).contains(&seconds)
}

impl State {
    /// The feed of a motion to `target`, by the feed that is in force.
    pub fn feed(&self, target: &AxisVector, offset: usize) -> Result<Feed, Refusal> {
        let Some(feed) = self.in_force.feed else {
            let right = match self.in_force.feed_mode {
                FeedMode::PerMinute => {
                    "give an F word (mm/min) in or before the first G1, G2 or G3"
                }
                FeedMode::PerRevolution => "give an F word (mm per revolution) behind G95",
                FeedMode::InverseTime => "in G93 each feed motion has an F word of its own",
            };
            return refuse(offset, "a feed motion without a feed", right);
        };
        if self.in_force.feed_mode == FeedMode::PerRevolution {
            if self.in_force.spindle.speed <= 0.0 {
                let right = "in G95 the feed follows the spindle: S and M3 or M4 before it";
                return refuse(offset, "a feed per revolution without S", right);
            }
            let mm_s = feed.value * feed.unit_mm * self.spindle_rpm_at(target) / 60.0;
            return Ok(Feed::PathMmS(mm_s));
        }
        Ok(self.feed_per_minute(feed, target))
    }

    /// The feed of a motion to `target` by an F word of G94.
    pub(super) fn feed_per_minute(&self, feed: FeedWord, target: &AxisVector) -> Feed {
        let FeedWord { value, unit_mm } = feed;
        let rotary = &self.equipment.rotary;
        let travel = target - self.position;
        let mut components = travel.iter().zip(rotary);
        let slides_move = components.any(|(component, rotary)| !rotary && *component != 0.0);
        let rotary_only = !slides_move && displacement_length_mm(&travel, rotary) > 0.0;
        Feed::PathMmS(if rotary_only {
            value / 60.0
        } else {
            value * unit_mm / 60.0
        })
    }

    /// The same along shapes, whose length counts in G93.
    pub fn feed_along(
        &self,
        cause: Cause,
        shapes: &[Shape],
        target: &AxisVector,
    ) -> Result<Feed, Refusal> {
        if self.in_force.feed_mode != FeedMode::InverseTime {
            return self.feed(target, cause.offset);
        }
        let Some(f) = cause.words.value('F').filter(|f| f.value > 0.0) else {
            let right = "in G93 each feed motion has an F word of its own";
            return cause.refuse("a feed motion without a feed", right);
        };
        let rotary = &self.equipment.rotary;
        let lengths = shapes.iter().map(|of| of.length_with_rotary_mm(rotary));
        let length: f64 = lengths.sum();
        Ok(Feed::PathMmS(length * f.value / 60.0))
    }

    /// Speed of the spindle with the tool at a place of the machine, in rev/min.
    fn spindle_rpm_at(&self, place: &AxisVector) -> f64 {
        let Some(surface) = &self.in_force.surface else {
            return self.in_force.spindle.speed;
        };
        let axis = self.equipment.axis_index('X');
        let x_mm = axis.and_then(|axis| place.get(axis).copied());
        surface.rpm(x_mm.unwrap_or(0.0), self.equipment.spindle_max_rpm())
    }

    /// The feed per turn in force, where the speed follows the radius.
    pub fn feed_per_turn(&self) -> Option<FeedPerTurn> {
        let surface = self.in_force.surface?;
        let feed = self.in_force.feed?;
        (self.in_force.feed_mode == FeedMode::PerRevolution).then_some(FeedPerTurn {
            surface,
            mm_per_turn: feed.value * feed.unit_mm,
            axis: self.equipment.axis_index('X')?,
            speed_max_rpm: self.equipment.spindle_max_rpm(),
        })
    }

    /// A motion that needs a spindle of one speed.
    pub(super) fn check_speed_is_constant(
        &self,
        code: impl Display,
        offset: usize,
    ) -> Result<(), Refusal> {
        if self.in_force.surface.is_none() {
            return Ok(());
        }
        let found = format!("{code} in G96");
        let right = "one speed of the spindle: G97 and S in rev/min before it";
        refuse(offset, found, right)
    }

    /// How far the path may be left now, and whether the tool rests before and behind each motion.
    #[inline]
    pub fn exactness(&self) -> (PathTolerance, bool) {
        let tolerance = self.in_force.tolerance(self.equipment.tolerance_mm);
        (tolerance, self.in_force.stops_exactly())
    }

    /// G4.
    pub fn dwell(&self, words: &Words, acts: &mut Acts) -> Result<(), Refusal> {
        let Some((40, dwell)) = words.code(Group::Once) else {
            return Ok(());
        };
        let Some(p) = words.value('P') else {
            let right = "the time in seconds, such as G4 P0.5";
            return refuse(dwell.offset, "G4 without P", right);
        };
        if !is_dwell(p.value) {
            return p.refuse(dwell_right());
        }
        if p.value >= 100.0 && p.value.fract() == 0.0 {
            acts.note("G4 P is in seconds; Fanuc's P without a point is in milliseconds");
        }
        if p.value > 0.0 {
            acts.dwell(p.value);
        }
        Ok(())
    }
}
