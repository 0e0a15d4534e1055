//! The course of a run: the program's path with the limits of the machine on it.

use bus::sample::MAX_WINDOW_SETPOINTS;
use machine::{self, AxisKind, Machine, RapidProfile};
use path::geometry::{AxisVector, Element, PATH_AXES, Path};
use path::kinematics::Kinematics;
use path::limits::{AxisLimits, LimitsError, MotionLimits};
use path::pivot::{OutOfReach, PivotY};
use path::positioning::{MotorLoad, Positioning};
use path::rounding::RoundingSettings;
use path::setpoint_settings::{SetpointSettings, StraightLines};
use path::speed_map::{BLOCK_ELEMENTS, LOOK_AHEAD_ELEMENTS};
use path::window::{WindowPlanner, WindowSettings};
use program::kinematics_of;

use crate::error::CourseError;

/// So many elements are known ahead of the tool.
pub(crate) const AHEAD_ELEMENTS: u32 = 16_384;
/// Blocks read in one period while they move: ten times what the fastest machine travels of short chords. Four times as many where the tool comes nearer to
/// the end of what is known: blocks that only reckon have no elements.
pub(crate) const BLOCKS_IN_MOTION: usize = 256;
/// Blocks read at a time.
pub(crate) const BLOCKS_AT_A_TIME: usize = 256;

/// The limits of a machine's axes, and how setpoints are made on it.
///
/// # Errors
/// Increments too coarse for the limits at this scan period.
pub fn motion_limits(machine: &Machine) -> Result<MotionLimits, LimitsError> {
    let axes: Vec<AxisLimits> = machine
        .program_axes()
        .iter()
        .map(|axis| AxisLimits {
            velocity_mm_s: axis.rapid_mm_s,
            acceleration_mm_s2: axis.acceleration_mm_s2,
            jerk_mm_s3: axis.jerk_mm_s3.unwrap_or(f64::INFINITY),
            increment_mm: axis.increment_mm(),
        })
        .collect();
    let setpoints = SetpointSettings {
        straight_lines: match machine.interpolation.straight_lines {
            machine::StraightLines::Rounded => StraightLines::Rounded,
            machine::StraightLines::MasterAxis => StraightLines::MasterAxis,
        },
        kinematics: kinematics_of(machine),
        rounding: rounding_of(machine),
        vibration_hz: machine.path.vibration_hz,
    };
    MotionLimits::with_setpoints(&axes, machine.scan_period_s(), setpoints)
}

/// How paths are rounded on a machine.
fn rounding_of(machine: &Machine) -> RoundingSettings {
    let mut rotary = [false; PATH_AXES];
    for (is_rotary, axis) in rotary.iter_mut().zip(machine.program_axes()) {
        *is_rotary = axis.kind == AxisKind::Rotary;
    }
    RoundingSettings {
        corner_angle_rad: machine.path.corner_angle_deg.to_radians(),
        rotary_tolerance_deg: machine.path.rotary_tolerance_deg,
        rotary,
    }
}

/// What the motors have to move, if rapids are to be travelled at least heat.
///
/// # Errors
/// [`CourseError::Rating`].
fn positioning(machine: &Machine) -> Result<Option<Positioning>, CourseError> {
    if machine.positioning.profile != RapidProfile::MinimumHeat {
        return Ok(None);
    }
    let mut positioning = Positioning::default();
    for (load, axis) in positioning.loads.iter_mut().zip(machine.program_axes()) {
        let Some(model) = &axis.model else { continue };
        let of_axis = MotorLoad::new(
            axis.rated_force_n(),
            model.mass_kg,
            model.coulomb_n,
            model.viscous_n_s_per_m,
        );
        *load = Some(of_axis.map_err(|source| CourseError::Rating {
            axis: axis.name.clone(),
            source,
        })?);
    }
    Ok(Some(positioning))
}

/// A planner of windows along a program's path, from where the tool is at the start. A program without motion waits
/// there for no time.
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
    let limits = motion_limits(machine)?;
    let reach = Reach::of(machine, &limits);
    for element in &path.elements {
        reach.check(element)?;
    }
    let positioning = positioning(machine)?;
    let settings = window_settings(machine, &limits);
    Ok(WindowPlanner::with_positioning(
        path,
        limits,
        settings,
        positioning.as_ref(),
    )?)
}

/// A planner of windows along a path that is read as it is travelled, from the element `first` on, of which `start_mm` lie before it.
///
/// # Errors
/// [`CourseError`].
pub(crate) fn window_planner_ahead(
    machine: &Machine,
    first: u32,
    start_mm: f64,
) -> Result<WindowPlanner, CourseError> {
    let positioning = positioning(machine)?;
    let limits = motion_limits(machine)?;
    let settings = window_settings(machine, &limits);
    Ok(WindowPlanner::of_part(
        limits,
        settings,
        positioning.as_ref(),
        first,
        start_mm,
    )?)
}

/// Most setpoints of a window: those of a second, but 1024 at least. A tool that cannot brake in a second is not looked so far ahead for.
pub(crate) fn window_setpoints(machine: &Machine) -> u32 {
    (WINDOW_US / machine.scan.period_us.max(1)).clamp(1024, MAX_WINDOW_SETPOINTS as u32)
}

/// The longest window, where it has more than 1024 setpoints, in µs.
const WINDOW_US: u32 = 1_024_000;

fn window_settings(machine: &Machine, limits: &MotionLimits) -> WindowSettings {
    let intended_setpoints_max = machine.intended_setpoints();
    WindowSettings {
        intended_setpoints_max,
        braking_setpoints_max: window_setpoints(machine).saturating_sub(intended_setpoints_max + 1),
        override_max: f64::from(machine.path.feed_override_max_percent) / 100.0,
        elements_per_s_max: elements_per_s_max(machine, limits),
    }
}

/// So many elements of a path are read in a second while the tool moves, and known ahead of it: more than the motion depends on by as many as it may pass
/// from one reading to the last setpoint of a window.
fn elements_per_s_max(machine: &Machine, limits: &MotionLimits) -> f64 {
    let read_per_s = f64::from(BLOCKS_IN_MOTION as u32) / machine.interpolation_period_s();
    let ahead_scans = machine.intended_setpoints() + limits.smoothing_scans();
    let ahead_s = f64::from(ahead_scans) * machine.scan_period_s();
    let known = AHEAD_ELEMENTS - LOOK_AHEAD_ELEMENTS - AT_ONCE_ELEMENTS;
    let known_per_s = f64::from(known) / (ahead_s + 2.0 * machine.interpolation_period_s());
    (READ_SHARE * read_per_s).min(known_per_s).min(READ_PER_S)
}

/// Elements that are read and mapped in a quarter of a processor's time.
const READ_PER_S: f64 = 32_000.0;

/// Of the elements that can be read, so many are passed: some blocks of a program have none.
const READ_SHARE: f64 = 0.75;
/// So many elements may be passed at once, at the end of one block of the speed map and the beginning of the next, and read at once.
pub(crate) const AT_ONCE_ELEMENTS: u32 = 2 * BLOCK_ELEMENTS + BLOCKS_AT_A_TIME as u32;

/// Where an arm and the slide under it can bring the tool.
#[derive(Debug, Clone)]
pub(crate) struct Reach {
    pivot: Option<(PivotY, f64, f64)>,
}

impl Reach {
    pub fn of(machine: &Machine, limits: &MotionLimits) -> Reach {
        let Kinematics::PivotY(pivot) = limits.setpoints().kinematics else {
            return Reach { pivot: None };
        };
        let slide = machine.axes.get(pivot.slide);
        Reach {
            pivot: slide.map(|slide| (pivot, slide.travel_min_mm, slide.travel_max_mm)),
        }
    }

    /// Whether the machine can bring its tool along an element.
    pub fn check(&self, element: &Element) -> Result<(), OutOfReach> {
        match &self.pivot {
            Some((pivot, low_mm, high_mm)) => pivot.check_element(element, *low_mm, *high_mm),
            None => Ok(()),
        }
    }
}
