//! One piece of a profile: a line or an arc, as a set of points and as a move.

use crate::flat::Flat;

/// A point this near to a piece counts as on it, in mm (and in mm² for cross products).
pub(super) const NEAR: f64 = 1e-6;

/// A profile may run back in Z by this, in mm.
const BACK_MM: f64 = 1e-3;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    pub from: Flat,
    pub to: Flat,
    /// Centre, and whether it goes counter-clockwise.
    pub arc: Option<(Flat, bool)>,
}

/// One move of a cycle, as in a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cut {
    /// In rapid.
    Rapid(Flat),
    /// Straight at feed.
    Feed(Flat),
    /// Round a centre at feed.
    Arc {
        /// End.
        to: Flat,
        /// Centre.
        centre: Flat,
        /// G3 rather than G2.
        counter_clockwise: bool,
    },
}

impl Segment {
    /// A quarter turn clockwise about the zero.
    pub fn turn(&mut self) {
        let turned = |point: Flat| -point.left();
        self.from = turned(self.from);
        self.to = turned(self.to);
        if let Some((centre, _)) = &mut self.arc {
            *centre = turned(*centre);
        }
    }

    /// Mirrored in its first coordinate, its second, or both.
    pub fn mirror(&mut self, over_first: bool, over_second: bool) {
        let mirrored = |point: Flat| {
            let first = if over_first { -point.u } else { point.u };
            Flat::new(first, if over_second { -point.v } else { point.v })
        };
        self.from = mirrored(self.from);
        self.to = mirrored(self.to);
        if let Some((centre, counter_clockwise)) = &mut self.arc {
            *centre = mirrored(*centre);
            *counter_clockwise ^= over_first != over_second;
        }
    }

    pub fn shift(&mut self, by: Flat) {
        self.from = self.from + by;
        self.to = self.to + by;
        if let Some((centre, _)) = &mut self.arc {
            *centre = *centre + by;
        }
    }

    /// Its size: the length of a line, the smaller of chord and radius of an arc.
    pub fn size_mm(&self) -> f64 {
        let chord_mm = (self.from - self.to).length();
        self.arc.map_or(chord_mm, |(centre, _)| {
            chord_mm.min((self.from - centre).length())
        })
    }

    /// Whether it never runs to larger Z. An arc lies in one half of its circle: the upper one counter-clockwise, the lower
    /// one clockwise.
    pub fn is_monotonic(&self) -> bool {
        let along = self.to - self.from;
        let Some((centre, counter_clockwise)) = self.arc else {
            return along.u <= BACK_MM;
        };
        let sign = if counter_clockwise { 1.0 } else { -1.0 };
        let high = |point: Flat| sign * (point - centre).v >= -BACK_MM;
        high(self.from) && high(self.to) && along.u <= -BACK_MM
    }

    /// Where it crosses a level of X: Z of each place, in the order a cycle looks at them.
    pub fn crossings(&self, level: f64) -> Vec<f64> {
        match self.arc {
            None => self.line_crossings(level),
            Some((centre, counter_clockwise)) => {
                self.arc_crossings(centre, counter_clockwise, level)
            }
        }
    }

    fn line_crossings(&self, level: f64) -> Vec<f64> {
        let (low, high) = (self.from.v.min(self.to.v), self.from.v.max(self.to.v));
        if low > level + NEAR || high < level - NEAR {
            return vec![];
        }
        if high - low < NEAR {
            return vec![self.from.u, self.to.u];
        }
        let share = (level - self.from.v) / (self.to.v - self.from.v);
        vec![self.from.u + share * (self.to.u - self.from.u)]
    }

    fn arc_crossings(&self, centre: Flat, counter_clockwise: bool, level: f64) -> Vec<f64> {
        let radius_mm = (self.from - centre).length();
        let above_mm = level - centre.v;
        let squared = (radius_mm - above_mm) * (radius_mm + above_mm);
        // Also for a number that is none.
        if squared.is_nan() || squared < -NEAR {
            return vec![];
        }
        let half_mm = squared.max(0.0).sqrt();
        let sign = if counter_clockwise { 1.0 } else { -1.0 };
        let on_it = |first: f64| {
            let spoke = Flat::new(first, level) - centre;
            sign * (self.from - centre).cross(spoke) >= -NEAR
                && sign * (self.to - centre).cross(spoke) <= NEAR
        };
        let places = [centre.u + half_mm, centre.u - half_mm];
        places.into_iter().filter(|&first| on_it(first)).collect()
    }

    /// The move along it to a point on it.
    pub fn cut_to(&self, to: Flat) -> Cut {
        match self.arc {
            None => Cut::Feed(to),
            Some((centre, counter_clockwise)) => Cut::Arc {
                to,
                centre,
                counter_clockwise,
            },
        }
    }

    /// Where the upper half of its circle ends: its end, or its highest place if it goes on behind that.
    pub fn top(&self, centre: Flat) -> Flat {
        if self.to.u < centre.u {
            centre + Flat::new(0.0, (self.from - centre).length())
        } else {
            self.to
        }
    }

    /// No place on it is lower.
    pub fn lowest(&self) -> f64 {
        let below = self.arc.map_or(f64::INFINITY, |(centre, _)| {
            centre.v - (self.from - centre).length()
        });
        below.min(self.from.v).min(self.to.v)
    }
}
