//! A stretch of the path with one cap of speed.
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

/// What the axes have left along the path, by the speed: what a curve takes across the path, it takes with the square of the speed.
///
/// The lower of two straight lines over the square of the speed `x`, `a(x) = a₀ − β·x`, but no less than what is left at every speed; never above
/// what the axes bear.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Acceleration {
    lines: [(f64, f64); 2],
    least: f64,
}

/// Of the highest square of the speed: where the two lines meet. Over an arc at its highest share (`course`), both are then near its ellipse.
const LINES_MEET: f64 = 0.75;

/// Steps of speed in which a function that falls in any form is looked at.
pub(crate) const LOOKS: usize = 10;

impl Acceleration {
    /// Not limited.
    pub const NONE: Self = Self {
        lines: [(f64::INFINITY, 0.0); 2],
        least: f64::INFINITY,
    };

    /// The same at every speed, in mm/s².
    pub fn constant(acceleration_mm_s2: f64) -> Self {
        Self {
            lines: [(acceleration_mm_s2, 0.0); 2],
            least: acceleration_mm_s2,
        }
    }

    /// At most so much at each speed up to the highest, in mm/s, where `at_speed` is concave over the square of the speed.
    pub fn below(highest_mm_s: f64, at_speed: impl Fn(f64) -> f64) -> Self {
        let (at_rest, at_highest) = (at_speed(0.0), at_speed(highest_mm_s));
        let highest = highest_mm_s * highest_mm_s;
        if at_rest <= at_highest || highest <= 0.0 {
            return Self::constant(at_highest.min(at_rest));
        }
        let meet = LINES_MEET * highest;
        let at_meet = at_speed(meet.sqrt()).min(at_rest);
        let first = (at_rest - at_meet) / meet;
        let second = ((at_meet - at_highest) / (highest - meet)).max(first);
        Self {
            lines: [(at_rest, first), (at_highest + second * highest, second)],
            least: 0.0,
        }
    }

    /// The same where what is left falls in any form: what is left at the highest speed, and more where a line over the square of the speed is below
    /// all that is left. `at_speeds` tells what is left at all of the speeds that are looked at.
    pub fn falling(
        highest_mm_s: f64,
        at_speeds: impl FnOnce(&[f64; LOOKS]) -> [f64; LOOKS],
    ) -> Self {
        let mut speeds_mm_s = [highest_mm_s; LOOKS];
        for (look, speed_mm_s) in (1..LOOKS).zip(&mut speeds_mm_s) {
            *speed_mm_s = highest_mm_s * look as f64 / LOOKS as f64;
        }
        let left = at_speeds(&speeds_mm_s);
        // As it falls, it is nowhere between two looks lower than at the second.
        let [at_rest, .., at_highest] = left;
        let highest = highest_mm_s * highest_mm_s;
        if !at_highest.is_finite() || highest <= 0.0 {
            return Self::constant(at_highest);
        }
        let mut fall = 0.0f64;
        for (before_mm_s, left) in speeds_mm_s.iter().zip(left.iter().skip(1)) {
            fall = fall.max((at_rest - left) / (before_mm_s * before_mm_s));
        }
        Self {
            lines: [(at_rest, fall); 2],
            least: at_highest,
        }
    }

    /// At a square of the speed, in mm²/s²; at least 0.
    pub fn at_mm_s2(&self, squared_mm2_s2: f64) -> f64 {
        self.by_lines_mm_s2(squared_mm2_s2).max(self.least)
    }

    /// The lower of the lines; it is concave.
    fn by_lines_mm_s2(&self, squared_mm2_s2: f64) -> f64 {
        let [first, second] = self
            .lines
            .map(|(at_rest, fall)| at_rest - fall * squared_mm2_s2);
        first.min(second)
    }

    /// The highest square of the speed that is reached after so many mm from this one at an acceleration that is left at every speed
    /// between; backward, from which it is braked down to this one.
    pub fn reached_mm2_s2(&self, from_mm2_s2: f64, length_mm: f64) -> f64 {
        let [first, second] = self.lines.map(|(at_rest, fall)| {
            (from_mm2_s2 + 2.0 * at_rest * length_mm) / (1.0 + 2.0 * fall * length_mm)
        });
        first
            .min(second)
            .max(from_mm2_s2 + 2.0 * self.least * length_mm)
    }

    /// No more than either at any speed.
    pub fn least_of(&self, other: &Self) -> Self {
        let [first, second] = self.lines;
        let [of_other_first, of_other_second] = other.lines;
        let least = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        Self {
            lines: [least(first, of_other_first), least(second, of_other_second)],
            least: self.least.min(other.least),
        }
    }

    /// No more than either at any speed up to the highest, in mm/s, and near the lower of both.
    pub fn least_up_to(&self, other: &Self, highest_mm_s: f64) -> Self {
        let highest = highest_mm_s * highest_mm_s;
        let least = self.at_mm_s2(highest).min(other.at_mm_s2(highest));
        let lines = Self::below(highest_mm_s, |speed_mm_s| {
            let squared = speed_mm_s * speed_mm_s;
            let of_both = [self, other].map(|of| of.by_lines_mm_s2(squared));
            of_both.into_iter().fold(f64::INFINITY, f64::min)
        });
        Self { least, ..lines }
    }

    /// How fast it falls with the square of the speed at most, in 1/mm.
    pub fn steepest_per_mm(&self) -> f64 {
        let [first, second] = self.lines.map(|(_, fall)| fall);
        first.max(second)
    }
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
    /// What is left for changes of speed.
    pub acceleration: Acceleration,
    /// Whether a block of the program ends with it.
    pub ends_block: bool,
    /// Whether it is a rapid.
    pub is_rapid: bool,
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

    /// What is left for changes of speed at every speed that it can be travelled at, in mm/s².
    pub fn least_acceleration_mm_s2(&self) -> f64 {
        self.acceleration
            .at_mm_s2(self.speed_mm_s * self.speed_mm_s)
    }

    /// The highest square of the speed that it can be travelled at anywhere, in mm²/s², at an override and where the square of the speed at
    /// its end is this one. The acceleration that is left there is left everywhere on it.
    pub fn highest_mm2_s2(&self, end_mm2_s2: f64, cap_mm_s: f64) -> f64 {
        let reached = self
            .acceleration
            .reached_mm2_s2(end_mm2_s2, self.to_mm - self.from_mm);
        reached.min(cap_mm_s * cap_mm_s)
    }

    /// Whether the motion rests between this segment and the next: something happens between them, or one of them is on a rapid
    /// from rest to rest.
    pub fn rests_before(&self, next: &Segment) -> bool {
        next.rests_at_start
            || (self.from_rest_to_rest || next.from_rest_to_rest) && self.element != next.element
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// As jerk leaves it: flat at high speeds.
        #[test]
        fn what_falls_in_any_form_is_never_overstated(
            highest in 0.1..300.0f64,
            flat_from in 0.0..1.0f64,
            power in 0.3..6.0f64,
            least in 0.0..1.0f64,
            other in 0.0..2.0f64,
            at in 0.0..1.0f64,
        ) {
            let left = |speed_mm_s: f64| {
                let share = speed_mm_s / highest;
                least + (1.0 - share / flat_from.max(1e-3)).max(0.0).powf(power)
            };
            let falling = Acceleration::falling(highest, |speeds| speeds.map(left));
            let speed_mm_s = at * highest;
            let squared = speed_mm_s * speed_mm_s;
            prop_assert!(falling.at_mm_s2(squared) <= left(speed_mm_s) * (1.0 + 1e-9));
            prop_assert!(falling.at_mm_s2(squared) >= least);
            let both = falling.least_up_to(&Acceleration::constant(other), highest);
            prop_assert!(both.at_mm_s2(squared) <= left(speed_mm_s).min(other) * (1.0 + 1e-9) + 1e-12);
        }

        /// Of an arc, and where all of a curve's acceleration lies along one axis.
        #[test]
        fn what_is_left_is_never_more_than_the_axes_bear_and_is_left_on_the_whole_way(
            radius_mm in 1e-3..1e4f64,
            bearable in 100.0..2e4f64,
            share in 0.01..0.98f64,
            round in any::<bool>(),
            at in 0.0..1.0f64,
            length_mm in 1e-4..1e3f64,
        ) {
            let highest = share * bearable * radius_mm;
            let left = |speed_mm_s: f64| {
                let across = speed_mm_s * speed_mm_s / radius_mm;
                if round {
                    (bearable * bearable - across * across).sqrt()
                } else {
                    bearable - across
                }
            };
            let acceleration = Acceleration::below(highest.sqrt(), left);
            let squared = at * highest;
            let shown = acceleration.at_mm_s2(squared);
            prop_assert!(shown <= left(squared.sqrt()) * (1.0 + 1e-9) && shown >= 0.0);
            let reached = acceleration.reached_mm2_s2(squared, length_mm);
            let again = reached - 2.0 * acceleration.at_mm_s2(reached) * length_mm;
            prop_assert!((again - squared).abs() <= 1e-9 * reached, "{again} {squared}");
        }
    }
}
