//! The least time in which a path can be travelled within the axes' velocities and accelerations: a bound for the planner, by another way.
//!
//! On a grid along the path, with `x` the square of the path speed and `u` its acceleration, each axis bears
//! `|q'·u + q''·x| ≤ A` and `q'²·x ≤ V²`, and `x` changes by `2·u·h` over a step. Backward from each rest the highest `x` of every place
//! from which the rest can still be reached, then forward as fast as that allows: time-optimal path parametrization by reachability (Pham
//! and Pham, IEEE Transactions on Robotics 34(3), 2018). A jump of the tangent is crossed at the speed whose jump of the velocity takes
//! the whole acceleration for one scan.

use path::geometry::{AxisVector, Element, Feed, Shape};
use path::limits::MotionLimits;
use path::path_part::PathPart;

/// Halvings until the highest speed at a place is known.
const HALVINGS: u32 = 40;

/// A step of the grid.
struct Step {
    length_mm: f64,
    tangent: AxisVector,
    curvature_per_mm: AxisVector,
    /// Highest square of the speed, in mm²/s².
    cap: f64,
}

impl Step {
    /// Lowest and highest acceleration along the path at a square of the speed; the one above the other where there is none.
    fn accelerations(&self, limits: &MotionLimits, squared: f64) -> (f64, f64) {
        let (mut lowest, mut highest) = (f64::NEG_INFINITY, f64::INFINITY);
        for (axis, limit) in limits.axes().iter().enumerate() {
            let (along, across) = (self.tangent[axis], self.curvature_per_mm[axis] * squared);
            let bearable = limit.acceleration_mm_s2;
            if along.abs() < 1e-12 {
                if across.abs() > bearable {
                    return (1.0, -1.0);
                }
                continue;
            }
            let (a, b) = ((-bearable - across) / along, (bearable - across) / along);
            lowest = lowest.max(a.min(b));
            highest = highest.min(a.max(b));
        }
        (lowest, highest)
    }

    /// The highest square of the speed at its start from which its end can be passed at no more than `ahead`.
    fn highest_before(&self, limits: &MotionLimits, ahead: f64) -> f64 {
        let reaches = |squared: f64| {
            let (lowest, highest) = self.accelerations(limits, squared);
            lowest <= highest && squared + 2.0 * lowest * self.length_mm <= ahead
        };
        if reaches(self.cap) {
            return self.cap;
        }
        let (mut low, mut high) = (0.0, self.cap);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if reaches(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

fn steps_of(element: &Element, limits: &MotionLimits, step_mm: f64, steps: &mut Vec<Step>) {
    let count = (element.length_mm / step_mm).ceil().max(4.0) as usize;
    let length_mm = element.length_mm / count as f64;
    for index in 0..count {
        let at_mm = (index as f64 + 0.5) * length_mm;
        let tangent = element.tangent(at_mm);
        let mut cap_mm_s = match element.feed {
            Feed::Rapid => f64::INFINITY,
            Feed::PathMmS(feed_mm_s) => feed_mm_s,
        };
        for (along, limit) in tangent.iter().zip(limits.axes()) {
            if along.abs() > 0.0 {
                cap_mm_s = cap_mm_s.min(limit.velocity_mm_s / along.abs());
            }
        }
        steps.push(Step {
            length_mm,
            tangent,
            curvature_per_mm: element.curvature_per_mm(at_mm),
            cap: cap_mm_s * cap_mm_s,
        });
    }
}

/// Square of the speed at which a jump of the tangent can be crossed.
fn crossing(before: &Element, after: &Element, limits: &MotionLimits) -> f64 {
    let jump = after.tangent(0.0) - before.tangent(before.length_mm);
    let mut speed_mm_s = f64::INFINITY;
    for (jump, limit) in jump.iter().zip(limits.axes()) {
        if jump.abs() > 1e-9 {
            let of_axis_mm_s = limit.acceleration_mm_s2 * limits.scan_period_s() / jump.abs();
            speed_mm_s = speed_mm_s.min(of_axis_mm_s);
        }
    }
    speed_mm_s * speed_mm_s
}

/// Time from rest to rest along these steps, where the borders between them are passed at no more than these squares of the speed.
fn section_s(steps: &[Step], borders: &[f64], limits: &MotionLimits) -> f64 {
    let mut highest = vec![0.0; steps.len() + 1];
    for index in (0..steps.len()).rev() {
        let before = steps[index].highest_before(limits, highest[index + 1]);
        highest[index] = before.min(borders[index]);
    }
    let (mut squared, mut time_s) = (0.0f64, 0.0);
    for (step, ahead) in steps.iter().zip(&highest[1..]) {
        let (lowest, fastest) = step.accelerations(limits, squared);
        let after = squared + 2.0 * fastest.max(lowest) * step.length_mm;
        let after = after.clamp(0.0, *ahead);
        time_s += 2.0 * step.length_mm / (squared.sqrt() + after.sqrt());
        squared = after;
    }
    time_s
}

/// The least time, in s, for a path that is at hand as a whole, on a grid of so many mm.
pub fn least_time_s(path: &PathPart, step_mm: f64) -> f64 {
    let limits = path.limits();
    let (mut steps, mut borders) = (Vec::new(), Vec::new());
    let mut time_s = 0.0;
    let mut before: Option<&Element> = None;
    for element in (path.first()..path.end()).filter_map(|index| path.get(index)) {
        if element.rests_before || element.is_dwell() {
            time_s += section_s(&steps, &borders, limits);
            steps.clear();
            borders.clear();
            before = None;
        }
        if let Shape::Dwell { seconds, .. } = element.shape {
            time_s += seconds;
        }
        if element.is_dwell() || element.length_mm <= 0.0 {
            continue;
        }
        borders.push(before.map_or(0.0, |before| crossing(before, element, limits)));
        steps_of(element, limits, step_mm, &mut steps);
        borders.resize(steps.len(), f64::INFINITY);
        before = Some(element);
    }
    time_s + section_s(&steps, &borders, limits)
}
