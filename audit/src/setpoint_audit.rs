//! The judge of setpoints: speeds and accelerations by differences of setpoints, places by the path. It knows nothing of
//! how setpoints were planned.
use thiserror::Error;

use path::geometry::{Element, PATH_AXES};
use path::limits::MotionLimits;
use path::path_part::PathPart;

/// What is wrong with a setpoint.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SetpointFault {
    /// An axis moved further in one scan than its speed allows.
    #[error("setpoint {setpoint}: axis {axis} at {found_mm_s} mm/s: at most {limit_mm_s} mm/s")]
    Velocity {
        /// Setpoints judged before this one.
        setpoint: u64,
        /// Index of the axis.
        axis: usize,
        /// Difference to the setpoint before over the scan period.
        found_mm_s: f64,
        /// The axis' limit.
        limit_mm_s: f64,
    },
    /// An axis changed its speed more from one scan to the next than its acceleration allows.
    #[error("setpoint {setpoint}: axis {axis} at {found_mm_s2} mm/s²: at most {limit_mm_s2} mm/s²")]
    Acceleration {
        /// Setpoints judged before this one.
        setpoint: u64,
        /// Index of the axis.
        axis: usize,
        /// Second difference of three setpoints over the square of the scan period.
        found_mm_s2: f64,
        /// The axis' limit.
        limit_mm_s2: f64,
    },
    /// An axis changed its acceleration more from one scan to the next than its jerk allows.
    #[error("setpoint {setpoint}: axis {axis} at {found_mm_s3} mm/s³: at most {limit_mm_s3} mm/s³")]
    Jerk {
        /// Setpoints judged before this one.
        setpoint: u64,
        /// Index of the axis.
        axis: usize,
        /// Third difference of four setpoints over the cube of the scan period.
        found_mm_s3: f64,
        /// The axis' limit.
        limit_mm_s3: f64,
    },
    /// A setpoint is not where its tag says.
    #[error("setpoint {setpoint}: axis {axis} is {off_increments} increments off the path")]
    OffPath {
        /// Setpoints judged before this one.
        setpoint: u64,
        /// Index of the axis.
        axis: usize,
        /// Distance to the path point of the tag.
        off_increments: f64,
    },
    /// An axis of a straight line that follows a master axis is not on the line.
    #[error(
        "setpoint {setpoint}: axis {axis} is a whole increment or more off the line from start to end"
    )]
    OffLine {
        /// Setpoints judged before this one.
        setpoint: u64,
        /// Index of the axis.
        axis: usize,
    },
    /// The tag names no place of the path.
    #[error("setpoint {setpoint}: element {element} at {distance_mm} mm is not on the path")]
    NoSuchPlace {
        /// Setpoints judged before this one.
        setpoint: u64,
        /// Index of the element.
        element: u32,
        /// Distance along it, in mm.
        distance_mm: f64,
    },
}

/// The largest shares of the limits that setpoints used; 1 is all of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LimitShares {
    /// Of each axis' speed.
    pub velocity: [f64; PATH_AXES],
    /// Of each axis' acceleration.
    pub acceleration: [f64; PATH_AXES],
    /// Of each axis' jerk; 0 where it is not limited.
    pub jerk: [f64; PATH_AXES],
}

impl LimitShares {
    /// The largest of all.
    pub fn max(&self) -> f64 {
        let all = self
            .velocity
            .iter()
            .chain(&self.acceleration)
            .chain(&self.jerk);
        all.fold(0.0, |most: f64, share| most.max(*share))
    }
}

/// Judges setpoints one after the other, without any tolerance.
#[derive(Debug, Clone)]
pub struct SetpointAudit {
    limits: MotionLimits,
    /// The two setpoints before.
    before: [[i64; PATH_AXES]; 2],
    /// How much each axis changed its way before; unknown in the first scan after setpoints in motion.
    change_before: Option<[i64; PATH_AXES]>,
    setpoints: u64,
    shares: LimitShares,
}

impl SetpointAudit {
    /// Starts at rest.
    pub fn at_rest(limits: MotionLimits, position_increments: [i64; PATH_AXES]) -> Self {
        Self {
            change_before: Some([0; PATH_AXES]),
            ..Self::after(limits, [position_increments; 2])
        }
    }

    /// Starts in motion, after two setpoints, the older first.
    pub fn after(limits: MotionLimits, before: [[i64; PATH_AXES]; 2]) -> Self {
        Self {
            limits,
            before,
            change_before: None,
            setpoints: 0,
            shares: LimitShares::default(),
        }
    }

    /// Judges the next setpoint. It counts as executed even if it is at fault.
    pub fn setpoint(
        &mut self,
        position_increments: &[i64; PATH_AXES],
    ) -> Result<(), SetpointFault> {
        let period_s = self.limits.scan_period_s();
        let [oldest, before] = self.before;
        let mut fault = None;
        let mut changes = [0; PATH_AXES];
        for (axis, limit) in self.limits.axes().iter().enumerate() {
            let (Some(now), Some(before), Some(oldest)) = (
                position_increments.get(axis),
                before.get(axis),
                oldest.get(axis),
            ) else {
                break;
            };
            let way = now.saturating_sub(*before);
            let change = way.saturating_sub(before.saturating_sub(*oldest));
            let found_mm_s = way.unsigned_abs() as f64 * limit.increment_mm / period_s;
            let found_mm_s2 =
                change.unsigned_abs() as f64 * limit.increment_mm / (period_s * period_s);
            if let Some(share) = self.shares.velocity.get_mut(axis) {
                *share = share.max(found_mm_s / limit.velocity_mm_s);
            }
            if let Some(share) = self.shares.acceleration.get_mut(axis) {
                *share = share.max(found_mm_s2 / limit.acceleration_mm_s2);
            }
            if found_mm_s > limit.velocity_mm_s {
                fault = fault.or(Some(SetpointFault::Velocity {
                    setpoint: self.setpoints,
                    axis,
                    found_mm_s,
                    limit_mm_s: limit.velocity_mm_s,
                }));
            }
            if found_mm_s2 > limit.acceleration_mm_s2 {
                fault = fault.or(Some(SetpointFault::Acceleration {
                    setpoint: self.setpoints,
                    axis,
                    found_mm_s2,
                    limit_mm_s2: limit.acceleration_mm_s2,
                }));
            }
            if let Some(of_axis) = changes.get_mut(axis) {
                *of_axis = change;
            }
            let change_before = self.change_before.as_ref().and_then(|all| all.get(axis));
            let turn = change_before.map_or(0, |before| change.saturating_sub(*before));
            let found_mm_s3 = turn.unsigned_abs() as f64 * limit.increment_mm / period_s.powi(3);
            if let Some(share) = self.shares.jerk.get_mut(axis) {
                *share = share.max(found_mm_s3 / limit.jerk_mm_s3);
            }
            if found_mm_s3 > limit.jerk_mm_s3 {
                fault = fault.or(Some(SetpointFault::Jerk {
                    setpoint: self.setpoints,
                    axis,
                    found_mm_s3,
                    limit_mm_s3: limit.jerk_mm_s3,
                }));
            }
        }
        self.before = [before, *position_increments];
        self.change_before = Some(changes);
        self.setpoints += 1;
        fault.map_or(Ok(()), Err)
    }

    /// Judges the end: the last setpoint is held from now on.
    pub fn end(&mut self) -> Result<(), SetpointFault> {
        let [_, last] = self.before;
        self.setpoint(&last)
    }

    /// Judges whether the setpoint judged last lies within one increment of the place its tag names. Where axes follow a master
    /// axis, that one does, and the others lie within one increment of the line at the master's place.
    pub fn place(
        &self,
        path: &PathPart,
        element: u32,
        distance_mm: f64,
    ) -> Result<(), SetpointFault> {
        let setpoint = self.setpoints.saturating_sub(1);
        let on = path
            .get(element)
            .filter(|on| (0.0..=on.length_mm).contains(&distance_mm))
            .ok_or(SetpointFault::NoSuchPlace {
                setpoint,
                element,
                distance_mm,
            })?;
        let setpoints = self.limits.setpoints();
        let point = setpoints.kinematics.axes(&on.point(distance_mm));
        let [_, last] = self.before;
        let off_increments_max = if setpoints.follow_master(on) {
            self.on_line(on, &last)?;
            setpoints.off_place_increments()
        } else {
            1.0
        };
        for (axis, ((increments, component), limit)) in
            last.iter().zip(&point).zip(self.limits.axes()).enumerate()
        {
            let off_increments = (*increments as f64 - component / limit.increment_mm).abs();
            if off_increments > off_increments_max || off_increments.is_nan() {
                return Err(SetpointFault::OffPath {
                    setpoint,
                    axis,
                    off_increments,
                });
            }
        }
        Ok(())
    }

    /// Judges a setpoint by the line between the rounded ends of its element, in whole numbers and not by the line's own block:
    /// (y − y_start)·Δx and (x − x_start)·Δy are less than |Δx| apart.
    fn on_line(&self, element: &Element, place: &[i64; PATH_AXES]) -> Result<(), SetpointFault> {
        let setpoint = self.setpoints.saturating_sub(1);
        let from = self.limits.increments(&element.start());
        let to = self.limits.increments(&element.end());
        let ends = from.iter().zip(&to).zip(place);
        let ways = ends.map(|((from, to), place)| {
            let [from, to, place] = [from, to, place].map(|p| i128::from(*p));
            (place - from, to - from)
        });
        let (along, whole) = ways.clone().fold((0, 0i128), |longest: (i128, i128), way| {
            if way.1.abs() > longest.1.abs() {
                way
            } else {
                longest
            }
        });
        for (axis, (way, travel)) in ways.enumerate() {
            if (way * whole - along * travel).abs() >= whole.abs().max(1) {
                return Err(SetpointFault::OffLine { setpoint, axis });
            }
        }
        Ok(())
    }

    /// The largest shares of the limits used so far.
    pub fn shares(&self) -> &LimitShares {
        &self.shares
    }
}
