//! The return to where the path was left: a straight line at a reduced feed to a point shortly before it, the last
//! piece along the path, then a moment to settle.

use bus::sample::PATH_AXES;
use machine::{AxisKind, Machine};
use path::geometry::{ALL_LINEAR, AxisVector, Element, Feed, Path, Shape};
use path::path_part::PathPart;
use path::profile::PathState;
use path::window::WindowPlanner;

use crate::course::window_planner;
use crate::error::CourseError;

/// The machine is so long at the place, in s, before the program goes on: ten time constants of a position loop of
/// 50/s, so that what the return left is gone before the path is measured again.
const SETTLE_S: f64 = 0.2;

/// The last piece is travelled along the path, in its direction, over this length in mm: friction and lost motion then
/// lie as they did when the path was left. Friction turns round within some hundredths of a mm (docs/methods/physics.md §3).
const RUN_UP_MM: f64 = 0.5;
/// Chords that stand for the path there: 50 µm long, within 0.3 µm of an arc of 1 mm radius.
const RUN_UP_CHORDS: u32 = 10;

/// It may use this share of the axes' accelerations: an axis without a limit of jerk is otherwise at speed before its motor has
/// crossed the lost motion, and the table bounces (22 µm at the whole acceleration on `xy`).
const ACCELERATION_SHARE: f64 = 0.1;

/// Speed of the return with a tap in its thread, in mm/s: some ten turns a minute, which a spindle has at once.
const IN_THREAD_MM_S: f64 = 0.2;

/// Distance in mm up to which a return is a straight line, as after a trip. With the axes beside Z further off, Z goes up first, however
/// little, and goes down last from more than this above the place: the operator had a reason to lift the tool.
const OVER_MM: f64 = 1.0;

/// A planned return.
#[derive(Debug, Clone)]
pub(crate) struct ReturnToPath {
    /// Command positions it starts from, in increments.
    pub from: [i64; PATH_AXES],
    /// State of the program it leads to.
    pub to: PathState,
    /// Plans along it.
    pub windows: WindowPlanner,
}

impl ReturnToPath {
    /// From the command positions to the place of `to` on the path of the program. Both ends are where the axes may stand, so is the line
    /// between them and the corner above; the run-up is on the path, where the tool has been. A tap in its thread goes straight and
    /// slowly.
    pub fn new(
        machine: &Machine,
        from: [i64; PATH_AXES],
        to: PathState,
        program: &PathPart,
        in_thread: bool,
    ) -> Result<ReturnToPath, CourseError> {
        let mut rotary = ALL_LINEAR;
        for (is_rotary, axis) in rotary.iter_mut().zip(machine.program_axes()) {
            *is_rotary = axis.kind == AxisKind::Rotary;
        }
        let (speed_mm_s, chords) = if in_thread {
            (IN_THREAD_MM_S.min(machine.manual.return_mm_s), 0)
        } else {
            (machine.manual.return_mm_s, RUN_UP_CHORDS)
        };
        let feed = Feed::PathMmS(speed_mm_s);
        let start = program::tool_at(machine, &from)?;
        let mut here = start;
        let mut elements = Vec::with_capacity(RUN_UP_CHORDS as usize + 3);
        let run_up = (0..=chords).rev().map(|chord| {
            let back_mm = RUN_UP_MM * f64::from(chord) / f64::from(RUN_UP_CHORDS);
            point_before(program, &to, back_mm).unwrap_or(start)
        });
        let run_up: Vec<AxisVector> = run_up.collect();
        let z_axis = machine.axes.iter().position(|axis| axis.name == "Z");
        let over = z_axis.filter(|_| !in_thread).zip(run_up.first());
        let corner = over.and_then(|(z_axis, first)| corner_above(&start, first, z_axis));
        for there in corner.into_iter().chain(run_up) {
            let line = Shape::Line {
                from: here,
                to: there,
            };
            let element = Element::new(0, line, feed, &rotary);
            // Near the start of the path there is nothing to run up on.
            if element.length_mm > 0.0 {
                elements.push(element);
                here = there;
            }
        }
        elements.push(Element::dwell(0, here, SETTLE_S));
        Ok(ReturnToPath {
            from,
            to,
            windows: window_planner(&gently(machine), Path { elements }, start)?,
        })
    }
}

/// Where a return turns: above its end where it begins above it, and above its beginning otherwise. None where it goes straight.
fn corner_above(from: &AxisVector, to: &AxisVector, z_axis: usize) -> Option<AxisVector> {
    let (from_z, to_z) = (*from.get(z_axis)?, *to.get(z_axis)?);
    let (mut corner, height) = if from_z >= to_z {
        (*to, from_z)
    } else {
        (*from, to_z)
    };
    *corner.get_mut(z_axis)? = height;
    let aside_mm = (corner - if from_z >= to_z { *from } else { *to }).norm();
    let off_height = from_z < to_z || from_z - to_z > OVER_MM;
    (off_height && aside_mm > OVER_MM).then_some(corner)
}

/// The machine with the accelerations of a return. Both of its ends are where the axes have stood, which may be outside by what an axis
/// in position may be off.
fn gently(machine: &Machine) -> Machine {
    let mut machine = machine.clone();
    for axis in &mut machine.axes {
        axis.acceleration_mm_s2 *= ACCELERATION_SHARE;
        let window_mm = axis.in_position_window_um() * 1e-3;
        axis.travel_min_mm -= window_mm;
        axis.travel_max_mm += window_mm;
    }
    if let Some(kinematics) = &mut machine.kinematics {
        let arm = kinematics.arm_index(&machine.axes);
        let arm = arm.and_then(|arm| machine.axes.get(arm));
        let window_deg = arm.map_or(0.0, |arm| arm.in_position_window_um() * 1e-3);
        kinematics.arm_min_deg -= window_deg;
        kinematics.arm_max_deg += window_deg;
    }
    machine
}

/// The point that lies this far before a place along the path; the start of the path at most.
fn point_before(path: &PathPart, place: &PathState, back_mm: f64) -> Option<AxisVector> {
    let mut left_mm = back_mm;
    let mut at_mm = place.distance_mm;
    let mut point = None;
    for index in (path.first()..=place.element).rev() {
        let element = path.get(index)?;
        if index < place.element {
            at_mm = element.length_mm;
        }
        point = Some(element.point((at_mm - left_mm).max(0.0)));
        if left_mm <= at_mm {
            break;
        }
        left_mm -= at_mm;
    }
    point
}

#[cfg(test)]
#[allow(clippy::indexing_slicing, clippy::expect_used)]
mod tests {
    use super::*;
    use path::limits::{AxisLimits, MotionLimits};

    #[test]
    fn a_return_goes_over_the_workpiece_and_never_through_it() {
        let point = |x: f64, z: f64| {
            let mut point = AxisVector::zeros();
            (point[0], point[2]) = (x, z);
            point
        };
        for (from, to, corner) in [
            (point(0.0, 50.0), point(9.0, -2.0), Some(point(9.0, 50.0))),
            (point(9.0, -5.0), point(0.0, 3.0), Some(point(9.0, 3.0))),
            // A planner that dies leaves a start at a line a little below its height.
            (
                point(40.0, -20.26),
                point(0.0, -20.0),
                Some(point(40.0, -20.0)),
            ),
            // Pushed by a trip, lifted straight up, moved aside at its height.
            (point(0.3, 0.2), point(0.0, 0.0), None),
            (point(0.0, 50.0), point(0.2, 3.0), None),
            (point(40.0, 3.5), point(0.0, 3.0), None),
        ] {
            assert_eq!(corner_above(&from, &to, 2), corner);
        }
    }

    #[test]
    fn the_run_up_goes_back_over_element_ends_and_no_farther_than_the_start() {
        let corner = |x: f64, y: f64| {
            let mut point = AxisVector::zeros();
            (point[0], point[1]) = (x, y);
            point
        };
        let feed = Feed::Rapid;
        let path = Path {
            elements: vec![
                Element::line(1, corner(0.0, 0.0), corner(0.2, 0.0), feed),
                Element::dwell(2, corner(0.2, 0.0), 1.0),
                Element::line(3, corner(0.2, 0.0), corner(0.2, 5.0), feed),
            ],
        };
        let slide = AxisLimits {
            velocity_mm_s: 100.0,
            acceleration_mm_s2: 1000.0,
            jerk_mm_s3: f64::INFINITY,
            increment_mm: 1e-6,
        };
        let limits = MotionLimits::new(&[slide; 2], 1e-3).expect("limits");
        let path = PathPart::whole(&path, &limits, 1.0).expect("a path");
        let at = |element, distance_mm| PathState {
            element,
            distance_mm,
            ..PathState::default()
        };
        for (place, back_mm, x, y) in [
            (at(2, 3.0), 0.5, 0.2, 2.5),
            (at(2, 3.0), 0.0, 0.2, 3.0),
            (at(2, 0.3), 0.4, 0.1, 0.0),
            (at(1, 0.0), 0.05, 0.15, 0.0),
            (at(2, 0.1), 0.5, 0.0, 0.0),
            (at(0, 0.0), 0.5, 0.0, 0.0),
        ] {
            let found = point_before(&path, &place, back_mm).expect("a point");
            assert!(
                (found - corner(x, y)).norm() < 1e-12,
                "{place:?} {back_mm}: {found}"
            );
        }
    }
}
