//! The judge of setpoint rows: speeds and accelerations by differences of rows, places by the path. It knows nothing of
//! how rows were planned.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic
)]

use thiserror::Error;

use crate::limits::MotionLimits;
use crate::path::{Element, MAX_AXES, Path};

/// What is wrong with a row.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum RowFault {
    /// An axis moved further in one scan than its speed allows.
    #[error("row {row}: axis {axis} at {found_mm_s} mm/s: at most {limit_mm_s} mm/s")]
    Velocity {
        /// Rows judged before this one.
        row: u64,
        /// Index of the axis.
        axis: usize,
        /// Difference to the row before over the scan period.
        found_mm_s: f64,
        /// The axis' limit.
        limit_mm_s: f64,
    },
    /// An axis changed its speed more from one scan to the next than its acceleration allows.
    #[error("row {row}: axis {axis} at {found_mm_s2} mm/s²: at most {limit_mm_s2} mm/s²")]
    Acceleration {
        /// Rows judged before this one.
        row: u64,
        /// Index of the axis.
        axis: usize,
        /// Second difference of three rows over the square of the scan period.
        found_mm_s2: f64,
        /// The axis' limit.
        limit_mm_s2: f64,
    },
    /// A row is not where its tag says.
    #[error("row {row}: axis {axis} is {off_increments} increments off the path")]
    OffPath {
        /// Rows judged before this one.
        row: u64,
        /// Index of the axis.
        axis: usize,
        /// Distance to the path point of the tag.
        off_increments: f64,
    },
    /// An axis of a straight line that follows a master axis is not on the line.
    #[error("row {row}: axis {axis} is a whole increment or more off the line from start to end")]
    OffLine {
        /// Rows judged before this one.
        row: u64,
        /// Index of the axis.
        axis: usize,
    },
    /// The tag names no place of the path.
    #[error("row {row}: element {element} at {distance_mm} mm is not on the path")]
    NoSuchPlace {
        /// Rows judged before this one.
        row: u64,
        /// Index of the element.
        element: u32,
        /// Distance along it, in mm.
        distance_mm: f64,
    },
}

/// The largest shares of the limits that rows used; 1 is all of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LimitShares {
    /// Of each axis' speed.
    pub velocity: [f64; MAX_AXES],
    /// Of each axis' acceleration.
    pub acceleration: [f64; MAX_AXES],
}

impl LimitShares {
    /// The largest of all.
    pub fn max(&self) -> f64 {
        let all = self.velocity.iter().chain(&self.acceleration);
        all.fold(0.0, |most: f64, share| most.max(*share))
    }
}

/// Judges rows one after the other, without any tolerance.
#[derive(Debug, Clone)]
pub struct RowAudit {
    limits: MotionLimits,
    /// The two rows before.
    before: [[i64; MAX_AXES]; 2],
    rows: u64,
    shares: LimitShares,
}

impl RowAudit {
    /// Starts at rest.
    pub fn at_rest(limits: MotionLimits, position_increments: [i64; MAX_AXES]) -> Self {
        Self::after(limits, [position_increments; 2])
    }

    /// Starts in motion, after two rows, the older first.
    pub fn after(limits: MotionLimits, before: [[i64; MAX_AXES]; 2]) -> Self {
        Self {
            limits,
            before,
            rows: 0,
            shares: LimitShares::default(),
        }
    }

    /// Judges the next row. It counts as executed even if it is at fault.
    pub fn row(&mut self, position_increments: &[i64; MAX_AXES]) -> Result<(), RowFault> {
        let period_s = self.limits.scan_period_s();
        let [oldest, before] = self.before;
        let mut fault = None;
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
                fault = fault.or(Some(RowFault::Velocity {
                    row: self.rows,
                    axis,
                    found_mm_s,
                    limit_mm_s: limit.velocity_mm_s,
                }));
            }
            if found_mm_s2 > limit.acceleration_mm_s2 {
                fault = fault.or(Some(RowFault::Acceleration {
                    row: self.rows,
                    axis,
                    found_mm_s2,
                    limit_mm_s2: limit.acceleration_mm_s2,
                }));
            }
        }
        self.before = [before, *position_increments];
        self.rows += 1;
        fault.map_or(Ok(()), Err)
    }

    /// Judges the end: the last row is held from now on.
    pub fn end(&mut self) -> Result<(), RowFault> {
        let [_, last] = self.before;
        self.row(&last)
    }

    /// Judges whether the row judged last lies within one increment of the place its tag names. Where axes follow a master
    /// axis, that one does, and the others lie within one increment of the line at the master's place.
    pub fn place(&self, path: &Path, element: u32, distance_mm: f64) -> Result<(), RowFault> {
        let row = self.rows.saturating_sub(1);
        let on = path
            .elements
            .get(element as usize)
            .filter(|on| (0.0..=on.length_mm).contains(&distance_mm))
            .ok_or(RowFault::NoSuchPlace {
                row,
                element,
                distance_mm,
            })?;
        let rows = self.limits.rows();
        let point = rows.kinematics.axes(&on.point(distance_mm));
        let [_, last] = self.before;
        let off_increments_max = if rows.follow_master(on) {
            self.on_line(on, &last)?;
            rows.off_place_increments()
        } else {
            1.0
        };
        for (axis, ((increments, component), limit)) in
            last.iter().zip(&point).zip(self.limits.axes()).enumerate()
        {
            let off_increments = (*increments as f64 - component / limit.increment_mm).abs();
            if off_increments > off_increments_max || off_increments.is_nan() {
                return Err(RowFault::OffPath {
                    row,
                    axis,
                    off_increments,
                });
            }
        }
        Ok(())
    }

    /// Judges a row by the line between the rounded ends of its element, in whole numbers and not by the line's own block:
    /// (y − y_start)·Δx and (x − x_start)·Δy are less than |Δx| apart.
    fn on_line(&self, element: &Element, place: &[i64; MAX_AXES]) -> Result<(), RowFault> {
        let row = self.rows.saturating_sub(1);
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
                return Err(RowFault::OffLine { row, axis });
            }
        }
        Ok(())
    }

    /// The largest shares of the limits used so far.
    pub fn shares(&self) -> &LimitShares {
        &self.shares
    }
}
