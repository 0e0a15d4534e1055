//! How a place of the path becomes a setpoint of whole increments: the one border between the two.
use crate::geometry::{AxisVector, Element, PATH_AXES, Shape};
use crate::kinematics::Kinematics;
use crate::limits::{AxisLimits, MotionLimits, nearest};
use crate::line::StraightLine;
use crate::setpoint_settings::StraightLines;

impl MotionLimits {
    /// The setpoint of the place `distance_mm` along an element, in increments; 0 for unused axes. A pure function of both: any
    /// planner makes the same setpoint there.
    pub fn setpoint(&self, element: &Element, distance_mm: f64) -> [i64; PATH_AXES] {
        let setpoints = self.setpoints();
        if let Shape::Line { from, to } = &element.shape
            && setpoints.kinematics == Kinematics::Cartesian
            && setpoints.straight_lines == StraightLines::Rounded
        {
            let (axes, ends) = (self.axes(), [from, to]);
            return match axes.len() {
                0..=2 => on_line::<2>(axes, element, ends, distance_mm),
                3..=4 => on_line::<4>(axes, element, ends, distance_mm),
                _ => on_line::<PATH_AXES>(axes, element, ends, distance_mm),
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

/// The same for a line of axes that are the program's, each rounded by itself: the very numbers of [`Element::point`], of so many axes alone.
fn on_line<const AXES: usize>(
    axes: &[AxisLimits],
    element: &Element,
    ends: [&AxisVector; 2],
    distance_mm: f64,
) -> [i64; PATH_AXES] {
    let [from, to] = ends.map(first_axes::<AXES>);
    let share = distance_mm / element.length_mm;
    let mut place_mm = if distance_mm <= 0.0 || share <= 0.0 {
        from
    } else if distance_mm >= element.length_mm || share >= 1.0 {
        to
    } else {
        let mut between = from;
        for (between, to) in between.iter_mut().zip(&to) {
            *between += (to - *between) * share;
        }
        between
    };
    if let Some(correction) = &element.rounding
        && let Some(piece) = correction.piece_at(distance_mm.clamp(0.0, element.length_mm))
    {
        let y = distance_mm.clamp(0.0, element.length_mm) - piece.from_mm;
        let (by_three, by_two) = (y / 3.0, y / 2.0);
        let [value, first, second, third] = piece.derivatives.each_ref().map(first_axes::<AXES>);
        let derivatives = value.iter().zip(&first).zip(second.iter().zip(&third));
        for (place_mm, ((value, first), (second, third))) in place_mm.iter_mut().zip(derivatives) {
            *place_mm += value + (first + (second + third * by_three) * by_two) * y;
        }
    }
    let mut increments = [0; PATH_AXES];
    for ((increments, place_mm), axis) in increments.iter_mut().zip(&place_mm).zip(axes) {
        *increments = nearest(place_mm / axis.increment_mm);
    }
    increments
}

fn first_axes<const AXES: usize>(vector: &AxisVector) -> [f64; AXES] {
    let first = vector.as_slice().first_chunk::<AXES>();
    first.copied().unwrap_or([0.0; AXES])
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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
