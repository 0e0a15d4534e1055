//! The travel of an axis: where it may be commanded to, and where it may stand.

/// Lower and upper end of a travel, in increments or in mm.
///
/// ```text
/// a target:   within the travel, to the increment; from a place outside also anywhere between that place and the travel
/// standing:   within the travel, or outside by what an axis in position may be off (`may_stand_at` of the machine file's axis)
/// ```
///
/// An axis that has moved to the end of its travel stands a little beyond it: by its following error, by the lost motion that it was
/// thought to have taken up, by the noise of its encoder. So no motion may end farther out than it begins, and every motion inwards is
/// allowed. Comparisons are written so that a place that is not a number is outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Travel<T> {
    /// Lower end.
    pub min: T,
    /// Upper end.
    pub max: T,
}

impl<T: Copy + PartialOrd> Travel<T> {
    /// Where an axis may be commanded to that is here now.
    #[must_use]
    pub fn from_place(self, place: T) -> Travel<T> {
        Travel {
            min: if place < self.min { place } else { self.min },
            max: if place > self.max { place } else { self.max },
        }
    }

    /// Whether a place is not outside.
    pub fn holds(&self, place: T) -> bool {
        place >= self.min && place <= self.max
    }
}

impl Travel<i64> {
    /// The travel, longer by a number of increments at both ends.
    #[must_use]
    pub fn widened(self, by: i64) -> Travel<i64> {
        Travel {
            min: self.min.saturating_sub(by),
            max: self.max.saturating_add(by),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRAVEL: Travel<i64> = Travel {
        min: -100,
        max: 200,
    };

    #[test]
    fn from_within_a_target_is_within_and_from_outside_it_is_no_farther_out() {
        for (place, low, high) in [(0, -100, 200), (-103, -103, 200), (999, -100, 999)] {
            let reach = TRAVEL.from_place(place);
            assert!(reach.holds(low) && reach.holds(high) && reach.holds(place));
            assert!(!reach.holds(low - 1) && !reach.holds(high + 1));
        }
        let widened = TRAVEL.widened(3);
        assert!(widened.holds(-103) && widened.holds(203) && !widened.holds(204));
    }

    #[test]
    fn what_is_not_a_number_is_outside_and_widens_nothing() {
        let travel = Travel {
            min: -1.0,
            max: 2.0,
        };
        assert!(!travel.holds(f64::NAN));
        assert_eq!(travel.from_place(f64::NAN), travel);
    }
}
