//! The course of a run: the program's path with the limits of the machine on it.

use bus::machine::Machine;
use bus::sample::{MAX_AXES, MAX_WINDOW_ROWS};
use control::limits::{AxisLimits, LimitsError, MotionLimits};
use control::path::{AxisVector, Element, Path};
use control::window::{PlanError, WindowPlanner, WindowSettings};

/// Highest override, as a share of the programmed feed.
const OVERRIDE_MAX: f64 = 1.0;

/// Why a program cannot be planned on a machine.
#[derive(Debug, thiserror::Error)]
pub enum CourseError {
    /// The limits do not go with the increments and the scan.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// The path does not go with the limits.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

/// The limits of a machine's axes.
///
/// # Errors
/// Increments too coarse for the limits at this scan period.
pub fn motion_limits(machine: &Machine) -> Result<MotionLimits, LimitsError> {
    let axes: Vec<AxisLimits> = machine
        .axes
        .iter()
        .map(|axis| AxisLimits {
            velocity_mm_s: axis.rapid_mm_s,
            acceleration_mm_s2: axis.acceleration_mm_s2,
            increment_mm: axis.increment_mm(),
        })
        .collect();
    MotionLimits::new(&axes, machine.scan_period_s())
}

/// A planner of windows along a program's path. A program without motion waits at `start` for no time.
///
/// # Errors
/// [`CourseError`].
pub fn window_planner(
    machine: &Machine,
    mut path: Path,
    start: AxisVector,
) -> Result<WindowPlanner, CourseError> {
    if path.elements.is_empty() {
        path.elements.push(Element::dwell(1, start, 0.0));
    }
    let intended_rows_max = machine.intended_rows();
    let settings = WindowSettings {
        intended_rows_max,
        braking_rows_max: (MAX_WINDOW_ROWS as u32).saturating_sub(intended_rows_max + 1),
        override_max: OVERRIDE_MAX,
    };
    Ok(WindowPlanner::new(path, motion_limits(machine)?, settings)?)
}

/// A position in axis units.
pub(crate) fn point_of(machine: &Machine, increments: &[i64; MAX_AXES]) -> AxisVector {
    let mut point = AxisVector::zeros();
    for ((value, axis), increments) in point.iter_mut().zip(&machine.axes).zip(increments) {
        *value = *increments as f64 * axis.increment_mm();
    }
    point
}
