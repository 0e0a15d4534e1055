//! The runs of a path: consecutive elements on one circle, in one direction, at one feed.

use std::f64::consts::TAU;

use path::geometry::{AxisVector, Element, Feed, Path, Shape};
use path::kinematics::Kinematics;

/// Places of a turn looked at for reversals; between two of them an axis reverses at most once.
const REVERSAL_STEPS: u32 = 720;

/// The circle a run of elements lies on.
#[derive(Debug, Clone, PartialEq)]
pub struct Circle {
    /// Indices of the axes of its plane: first, second.
    pub plane: [usize; 2],
    /// Its centre in the plane, in mm.
    pub centre_mm: [f64; 2],
    /// Its radius, in mm.
    pub radius_mm: f64,
    /// Whether it is travelled clockwise, seen with the first axis to the right and the second up.
    pub clockwise: bool,
    /// Programmed feed, in mm/s; none for rapid.
    pub feed_mm_s: Option<f64>,
}

/// A run of elements on one circle.
#[derive(Debug, Clone)]
pub(super) struct Run {
    pub(super) circle: Circle,
    /// Elements, first to last.
    pub(super) elements: (usize, usize),
    pub(super) line: u32,
    pub(super) start_angle_rad: f64,
    /// Angle travelled, positive.
    pub(super) sweep_rad: f64,
    /// Where the axes of its plane reverse, if that is not at the quadrants: (angle in one turn, 0 or 1 for the axis of the
    /// plane), in rising order.
    pub(super) reversals: Option<Vec<(f64, usize)>>,
}

fn circle_of(element: &Element) -> Option<(Circle, f64, f64)> {
    let Shape::Arc {
        centre,
        radius_mm,
        u,
        v,
        start_angle_rad,
        sweep_rad,
        ..
    } = &element.shape
    else {
        return None;
    };
    let axis = |unit: &AxisVector| unit.iter().position(|component| *component == 1.0);
    let plane = [axis(u)?, axis(v)?];
    let circle = Circle {
        plane,
        centre_mm: [centre.dot(u), centre.dot(v)],
        radius_mm: *radius_mm,
        clockwise: *sweep_rad < 0.0,
        feed_mm_s: match element.feed {
            Feed::PathMmS(feed) => Some(feed),
            Feed::Rapid => None,
        },
    };
    Some((circle, *start_angle_rad, sweep_rad.abs()))
}

/// Whether two arcs lie on one circle: centre and radius within 0.1 µm, far above the rounding of a program's numbers
/// carried through arithmetic and far below what is measured.
fn same_circle(a: &Circle, b: &Circle) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-4;
    a.plane == b.plane
        && a.clockwise == b.clockwise
        && a.feed_mm_s == b.feed_mm_s
        && near(a.radius_mm, b.radius_mm)
        && near(a.centre_mm[0], b.centre_mm[0])
        && near(a.centre_mm[1], b.centre_mm[1])
}

/// Where on a circle the axes of its plane reverse: they are found by the sign of their speed and halving. None where they
/// are the program's axes, which reverse at the quadrants.
fn reversals_on(
    element: &Element,
    circle: &Circle,
    kinematics: &Kinematics,
) -> Option<Vec<(f64, usize)>> {
    if *kinematics == Kinematics::Cartesian {
        return None;
    }
    let [first, second] = circle.plane;
    let speed = |angle_rad: f64, axis: usize| {
        let (sine, cosine) = (libm::sin(angle_rad), libm::cos(angle_rad));
        let (mut place, mut tangent) = (element.start(), AxisVector::zeros());
        for (axis, centre_mm, spoke, along) in [
            (first, circle.centre_mm[0], cosine, -sine),
            (second, circle.centre_mm[1], sine, cosine),
        ] {
            if let (Some(place), Some(tangent)) = (place.get_mut(axis), tangent.get_mut(axis)) {
                *place = centre_mm + circle.radius_mm * spoke;
                *tangent = along;
            }
        }
        let of_axes = kinematics.axes_tangent(&place, &tangent);
        of_axes.get(axis).copied().unwrap_or(0.0)
    };
    let mut reversals = Vec::new();
    for (index, axis) in circle.plane.into_iter().enumerate() {
        for step in 0..REVERSAL_STEPS {
            // Off the quadrants, so that a speed of zero there lies between two places.
            let place_rad = |step: u32| (f64::from(step) + 0.5) * TAU / f64::from(REVERSAL_STEPS);
            let (mut low_rad, mut high_rad) = (place_rad(step), place_rad(step + 1));
            let low_speed = speed(low_rad, axis);
            if low_speed * speed(high_rad, axis) >= 0.0 {
                continue;
            }
            for _ in 0..50 {
                let middle_rad = 0.5 * (low_rad + high_rad);
                if low_speed * speed(middle_rad, axis) > 0.0 {
                    low_rad = middle_rad;
                } else {
                    high_rad = middle_rad;
                }
            }
            reversals.push((high_rad, index));
        }
    }
    reversals.sort_by(|a, b| a.0.total_cmp(&b.0));
    Some(reversals)
}

/// Angle travelled on each element's run before it, and on it, in rad.
pub(super) fn sweeps_rad(path: &Path, run_of: &[Option<usize>]) -> Vec<(f64, f64)> {
    let mut before = (None, 0.0);
    let elements = path.elements.iter().zip(run_of);
    elements
        .map(|(element, run)| {
            if before.0 != *run {
                before = (*run, 0.0);
            }
            let sweep_rad = match &element.shape {
                Shape::Arc { sweep_rad, .. } if run.is_some() => sweep_rad.abs(),
                _ => 0.0,
            };
            let before_rad = before.1;
            before.1 += sweep_rad;
            (before_rad, sweep_rad)
        })
        .collect()
}

pub(super) fn find_runs(path: &Path, kinematics: &Kinematics) -> (Vec<Run>, Vec<Option<usize>>) {
    let mut runs: Vec<Run> = Vec::new();
    let mut run_of: Vec<Option<usize>> = Vec::with_capacity(path.elements.len());
    for (index, element) in path.elements.iter().enumerate() {
        let Some((circle, start_angle_rad, sweep_rad)) = circle_of(element) else {
            run_of.push(None);
            continue;
        };
        match runs.last_mut() {
            Some(run) if run.elements.1 + 1 == index && same_circle(&run.circle, &circle) => {
                run.elements.1 = index;
                run.sweep_rad += sweep_rad;
            }
            _ => runs.push(Run {
                reversals: reversals_on(element, &circle, kinematics),
                circle,
                elements: (index, index),
                line: element.line,
                start_angle_rad,
                sweep_rad,
            }),
        }
        run_of.push(Some(runs.len() - 1));
    }
    (runs, run_of)
}
