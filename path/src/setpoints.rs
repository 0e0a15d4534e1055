//! How a place of the path becomes a setpoint of whole increments: the one border between the two.
use crate::geometry::{Element, PATH_AXES};
use crate::kinematics::Kinematics;
use crate::limits::MotionLimits;
use crate::line::StraightLine;

impl MotionLimits {
    /// The setpoint of the place `distance_mm` along an element, in increments; 0 for unused axes. A pure function of both: any
    /// planner makes the same setpoint there.
    pub fn setpoint(&self, element: &Element, distance_mm: f64) -> [i64; PATH_AXES] {
        let setpoints = self.setpoints();
        if setpoints.kinematics == Kinematics::Cartesian && !setpoints.follow_master(element) {
            return match self.axes().len() {
                0..=2 => self.first_increments(&element.first_at::<2>(distance_mm)),
                3..=4 => self.first_increments(&element.first_at::<4>(distance_mm)),
                _ => self.increments(&element.point(distance_mm)),
            };
        }
        let axes = setpoints.kinematics.axes(&element.point(distance_mm));
        let rounded = self.increments(&axes);
        if !setpoints.follow_master(element) {
            return rounded;
        }
        let line = self.line(element);
        line.at_master(rounded.get(line.master).copied().unwrap_or(0))
    }

    /// The line between the rounded ends of a straight element.
    pub(crate) fn line(&self, element: &Element) -> StraightLine {
        StraightLine::new(
            self.increments(&element.start()),
            self.increments(&element.end()),
        )
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use crate::limits::nearest;

    proptest! {
        #[test]
        fn the_nearest_whole_number_is_that_of_libm(bits in any::<u64>(), halves in -1_000_000_000_000i64..1_000_000_000_000) {
            let any = f64::from_bits(bits);
            prop_assert_eq!(nearest(any), libm::round(any) as i64);
            let half = 0.5 * halves as f64;
            for value in [half, half.next_up(), half.next_down()] {
                prop_assert_eq!(nearest(value), libm::round(value) as i64);
            }
        }
    }
}
