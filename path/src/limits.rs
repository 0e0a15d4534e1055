//! What the axes may do, and how much of it a plan may use so that setpoints of whole increments stay within it.

use nalgebra::SVector;
use thiserror::Error;

use crate::geometry::{AxisVector, PATH_AXES};
use crate::kinematics::Kinematics;
use crate::setpoint_settings::{SetpointSettings, StraightLines};

/// The limits of one axis, in its own units (mm for slides, degrees for rotary axes).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisLimits {
    /// Highest speed, in mm/s.
    pub velocity_mm_s: f64,
    /// Highest acceleration, in mm/s².
    pub acceleration_mm_s2: f64,
    /// Highest jerk, in mm/s³; infinite where it is not limited.
    pub jerk_mm_s3: f64,
    /// Size of one increment, in mm.
    pub increment_mm: f64,
}

/// The limits of all axes, judged on positions one scan apart, and how those positions are made: what rounding takes of the
/// limits depends on it.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionLimits {
    axes: Vec<AxisLimits>,
    scan_period_s: f64,
    setpoints: SetpointSettings,
}

/// Why limits cannot be planned with.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LimitsError {
    /// No axis or too many.
    #[error("{0} axes: a path moves 1 to {PATH_AXES}")]
    AxisCount(usize),
    /// The scan period is not a positive number.
    #[error("scan period of {0} s: must be above 0")]
    ScanPeriod(f64),
    /// A limit is not a positive number.
    #[error("axis {axis}: {name} of {value}: must be above 0")]
    NotPositive {
        /// Index of the axis.
        axis: usize,
        /// The key at fault.
        name: &'static str,
        /// What was found.
        value: f64,
    },
    /// A straight line of the program is none of the axes.
    #[error("straight lines by a master axis: axes that do not move in straight lines have none")]
    NoStraightLines,
    /// How axes that do not move in straight lines change their acceleration is not known.
    #[error("axis {axis}: a limit of jerk needs axes that move in straight lines")]
    JerkOfCurvedAxes {
        /// Index of the axis.
        axis: usize,
    },
    /// Rounding a position to whole increments would use up more than half of a limit.
    #[error(
        "axis {axis}: increments of {increment_mm} mm are too coarse: rounding to them at a scan period of {scan_period_s} s looks \
         like {rounding} {unit}, more than half of the limit of {limit} {unit}"
    )]
    TooCoarse {
        /// Index of the axis.
        axis: usize,
        /// Its increment, in mm.
        increment_mm: f64,
        /// The scan period, in s.
        scan_period_s: f64,
        /// What rounding can look like.
        rounding: f64,
        /// The limit it takes from.
        limit: f64,
        /// Unit of both.
        unit: &'static str,
    },
}

/// Setpoints in a difference of two setpoints, each off by up to what [`SetpointSettings`] say: half an increment where all axes are rounded,
/// so one increment in all.
const VELOCITY_ROUNDING_ROWS: f64 = 2.0;
/// The same of a second difference: once, twice and once again, so two increments where all axes are rounded.
const ACCELERATION_ROUNDING_ROWS: f64 = 4.0;
/// Covers gaps in the geometry (at most a quarter, see `speed_map`) and the arithmetic of the planner, in increments.
const ACCELERATION_GAP_INCREMENTS: f64 = 0.5;
/// Of a third difference: once, three times, three times and once again, so four increments where all axes are rounded.
const JERK_ROUNDING_ROWS: f64 = 8.0;
/// As of the acceleration; a gap is seen twice as large.
const JERK_GAP_INCREMENTS: f64 = 1.0;
/// Share of an axis' speed that a change of speed is to take the least time for (`smoothing_scans`): what changes within a program are mostly.
const SPEED_CHANGE_SHARE: f64 = 0.2;

impl LimitsError {
    /// Index of the axis that it is about, if it is about one, and the key of the machine file that it is most about.
    pub fn about(&self) -> Option<(usize, &'static str)> {
        match self {
            LimitsError::NotPositive { axis, name, .. } => Some((*axis, name)),
            LimitsError::JerkOfCurvedAxes { axis } => Some((*axis, "jerk_mm_s3")),
            LimitsError::TooCoarse { axis, .. } => Some((*axis, "increment_nm")),
            _ => None,
        }
    }
}

impl MotionLimits {
    /// Checks and takes the limits of all axes; setpoints are rounded, and axes are the program's.
    pub fn new(axes: &[AxisLimits], scan_period_s: f64) -> Result<Self, LimitsError> {
        Self::with_setpoints(axes, scan_period_s, SetpointSettings::default())
    }

    /// Checks and takes the limits of all axes, and how setpoints are made.
    pub fn with_setpoints(
        axes: &[AxisLimits],
        scan_period_s: f64,
        setpoints: SetpointSettings,
    ) -> Result<Self, LimitsError> {
        if axes.is_empty() || axes.len() > PATH_AXES {
            return Err(LimitsError::AxisCount(axes.len()));
        }
        if !(scan_period_s > 0.0 && scan_period_s.is_finite()) {
            return Err(LimitsError::ScanPeriod(scan_period_s));
        }
        if setpoints.straight_lines == StraightLines::MasterAxis
            && setpoints.kinematics != Kinematics::Cartesian
        {
            return Err(LimitsError::NoStraightLines);
        }
        let limits = Self {
            axes: axes.to_vec(),
            scan_period_s,
            setpoints,
        };
        for (axis, of_axis) in axes.iter().enumerate() {
            for (name, value) in [
                ("velocity_mm_s", of_axis.velocity_mm_s),
                ("acceleration_mm_s2", of_axis.acceleration_mm_s2),
                ("increment_mm", of_axis.increment_mm),
            ] {
                if !(value > 0.0 && value.is_finite()) {
                    return Err(LimitsError::NotPositive { axis, name, value });
                }
            }
            let value = of_axis.jerk_mm_s3;
            if value.is_nan() || value <= 0.0 {
                let name = "jerk_mm_s3";
                return Err(LimitsError::NotPositive { axis, name, value });
            }
            if value.is_finite() && limits.setpoints.kinematics != Kinematics::Cartesian {
                return Err(LimitsError::JerkOfCurvedAxes { axis });
            }
            for (rounding, limit, unit) in [
                (
                    limits.velocity_rounding_mm_s(of_axis),
                    of_axis.velocity_mm_s,
                    "mm/s",
                ),
                (
                    limits.acceleration_rounding_mm_s2(of_axis),
                    of_axis.acceleration_mm_s2,
                    "mm/s²",
                ),
                (
                    limits.jerk_rounding_mm_s3(of_axis),
                    of_axis.jerk_mm_s3,
                    "mm/s³",
                ),
            ] {
                if rounding > 0.5 * limit {
                    return Err(LimitsError::TooCoarse {
                        axis,
                        increment_mm: of_axis.increment_mm,
                        scan_period_s,
                        rounding,
                        limit,
                        unit,
                    });
                }
            }
        }
        Ok(limits)
    }

    /// The axes, in the order of an [`AxisVector`].
    pub fn axes(&self) -> &[AxisLimits] {
        &self.axes
    }

    /// How setpoints are made.
    pub fn setpoints(&self) -> &SetpointSettings {
        &self.setpoints
    }

    /// Time from one setpoint to the next, in s.
    pub fn scan_period_s(&self) -> f64 {
        self.scan_period_s
    }

    /// The whole increments nearest to a position; 0 for unused axes.
    pub fn increments(&self, position: &AxisVector) -> [i64; PATH_AXES] {
        self.first_increments(position)
    }

    /// The same where the first axes are all that there are.
    pub(crate) fn first_increments<const AXES: usize>(
        &self,
        position: &SVector<f64, AXES>,
    ) -> [i64; PATH_AXES] {
        let mut increments = [0; PATH_AXES];
        for ((of_axis, component), axis) in increments.iter_mut().zip(position).zip(&self.axes) {
            *of_axis = nearest(component / axis.increment_mm);
        }
        increments
    }

    /// Speed that a plan may use on each axis, in mm/s; infinite for unused axes.
    pub(crate) fn plan_velocity_mm_s(&self) -> [f64; PATH_AXES] {
        self.each(|axis| axis.velocity_mm_s - self.velocity_rounding_mm_s(axis))
    }

    /// Acceleration that a plan may use on each axis, in mm/s²; infinite for unused axes.
    pub(crate) fn plan_acceleration_mm_s2(&self) -> [f64; PATH_AXES] {
        self.each(|axis| axis.acceleration_mm_s2 - self.acceleration_rounding_mm_s2(axis))
    }

    /// Jerk that a plan may use on each axis, in mm/s³; infinite for unused axes and where it is not limited.
    pub(crate) fn plan_jerk_mm_s3(&self) -> [f64; PATH_AXES] {
        self.each(|axis| axis.jerk_mm_s3 - self.jerk_rounding_mm_s3(axis))
    }

    /// Scans over which the motion along the path is averaged (`smoothing`); 0 where it is not.
    ///
    /// Averaged over `τ`, a motion of the acceleration `J·τ/2` keeps the jerk `J`. A change of speed by `Δv` then takes `2·Δv/(J·τ) + τ`, least
    /// for `τ = √(2·Δv/J)`; from `2·A/J` on, the whole acceleration may be used.
    pub fn smoothing_scans(&self) -> u32 {
        let (acceleration, jerk) = (self.plan_acceleration_mm_s2(), self.plan_jerk_mm_s3());
        let of_axes = self.axes.iter().zip(acceleration.iter().zip(&jerk));
        let longest_s = of_axes.map(|(axis, (acceleration, jerk))| {
            let change_mm_s = SPEED_CHANGE_SHARE * axis.velocity_mm_s;
            (2.0 * acceleration / jerk).min((2.0 * change_mm_s / jerk).sqrt())
        });
        let longest_s = longest_s.fold(0.0, f64::max);
        let scans = longest_s / self.scan_period_s;
        match self.setpoints.vibration_hz {
            Some(frequency_hz) => {
                let period_scans = 1.0 / (frequency_hz * self.scan_period_s);
                let periods = libm::ceil(scans / period_scans).max(1.0);
                let whole = libm::round(periods * period_scans);
                (if whole < scans { whole + 1.0 } else { whole }) as u32
            }
            None => libm::ceil(scans - 1e-9) as u32,
        }
    }

    fn each(&self, value: impl Fn(&AxisLimits) -> f64) -> [f64; PATH_AXES] {
        let mut values = [f64::INFINITY; PATH_AXES];
        for (of_axis, axis) in values.iter_mut().zip(&self.axes) {
            *of_axis = value(axis);
        }
        values
    }

    fn velocity_rounding_mm_s(&self, axis: &AxisLimits) -> f64 {
        let increments = VELOCITY_ROUNDING_ROWS * self.setpoints.off_place_increments();
        increments * axis.increment_mm / self.scan_period_s
    }

    fn jerk_rounding_mm_s3(&self, axis: &AxisLimits) -> f64 {
        let increments =
            JERK_ROUNDING_ROWS * self.setpoints.off_place_increments() + JERK_GAP_INCREMENTS;
        increments * axis.increment_mm / self.scan_period_s.powi(3)
    }

    fn acceleration_rounding_mm_s2(&self, axis: &AxisLimits) -> f64 {
        let increments = ACCELERATION_ROUNDING_ROWS * self.setpoints.off_place_increments()
            + ACCELERATION_GAP_INCREMENTS;
        increments * axis.increment_mm / (self.scan_period_s * self.scan_period_s)
    }
}

/// The nearest whole number, of two as near the one further from 0: as `libm::round`, whose number is whole already before it is cut.
pub(crate) fn nearest(value: f64) -> i64 {
    (value + f64::copysign(0.5 - 0.25 * f64::EPSILON, value)) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pivot::{Carries, PivotY};

    const SLIDE: AxisLimits = AxisLimits {
        velocity_mm_s: 250.0,
        acceleration_mm_s2: 2000.0,
        jerk_mm_s3: f64::INFINITY,
        increment_mm: 1e-6,
    };

    #[test]
    fn increments_too_coarse_for_the_scan_are_refused_with_the_reason() {
        let coarse = AxisLimits {
            increment_mm: 1e-3,
            ..SLIDE
        };
        let error = MotionLimits::new(&[SLIDE, coarse], 1e-3).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("axis 1: increments of 0.001 mm are too coarse"),
            "{error}"
        );
        assert!(MotionLimits::new(&[SLIDE, SLIDE], 250e-6).is_ok());
    }

    #[test]
    fn nan_and_zero_limits_are_refused() {
        for value in [f64::NAN, 0.0, -1.0, f64::INFINITY] {
            let axis = AxisLimits {
                acceleration_mm_s2: value,
                ..SLIDE
            };
            assert!(matches!(
                MotionLimits::new(&[axis], 1e-3),
                Err(LimitsError::NotPositive {
                    axis: 0,
                    name: "acceleration_mm_s2",
                    ..
                })
            ));
            assert!(MotionLimits::new(&[SLIDE], value).is_err());
        }
        assert_eq!(MotionLimits::new(&[], 1e-3), Err(LimitsError::AxisCount(0)));
    }

    #[test]
    fn a_master_axis_takes_more_of_the_limits_and_goes_with_straight_axes_only() {
        let master = SetpointSettings {
            straight_lines: StraightLines::MasterAxis,
            ..SetpointSettings::default()
        };
        let rounded = MotionLimits::new(&[SLIDE], 1e-3).unwrap();
        let by_master = MotionLimits::with_setpoints(&[SLIDE], 1e-3, master).unwrap();
        // An increment is 1 mm/s² at 1 nm and 1 ms: 2.5 and 10.5 of them.
        for (limits, left_mm_s2) in [(rounded, 1997.5), (by_master, 1989.5)] {
            let found_mm_s2 = limits.plan_acceleration_mm_s2()[0];
            assert!((found_mm_s2 - left_mm_s2).abs() < 1e-9, "{found_mm_s2}");
        }
        let arm = PivotY {
            slide: 0,
            arm: 1,
            arm_length_mm: 100.0,
            arm_min_deg: -45.0,
            arm_max_deg: 45.0,
            carries: Carries::Arm,
        };
        let both = SetpointSettings {
            kinematics: Kinematics::PivotY(arm),
            ..master
        };
        assert_eq!(
            MotionLimits::with_setpoints(&[SLIDE, SLIDE], 1e-3, both),
            Err(LimitsError::NoStraightLines)
        );
    }

    #[test]
    fn positions_round_to_the_nearest_increment_and_unused_axes_stay_zero() {
        let limits = MotionLimits::new(&[SLIDE], 1e-3).unwrap();
        let mut position = AxisVector::zeros();
        position[0] = 1.000_000_6;
        position[1] = 5.0;
        assert_eq!(
            limits.increments(&position),
            [1_000_001, 0, 0, 0, 0, 0, 0, 0, 0]
        );
    }
}
