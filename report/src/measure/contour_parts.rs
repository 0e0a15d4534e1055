//! Which part of the contour error comes from where, for any program, in memory that no length of a run enlarges.
//!
//! One reading a scan, at its end. Let a(p) be the vector from the nearest place of the programmed path to a point p: it
//! lies across the path, so a lag along the path does not count. With the setpoint s, the motor side m (compensation of
//! lost motion removed) and the table t, all in the coordinates of the program,
//!
//! `a(t) = a(s) + [a(m) − a(s)] + [a(t) − a(m)]`.
//!
//! - *command*: a(s). Rounding of corners (G64), smoothing, and what is left of either where nothing is programmed.
//! - *reversal* of an axis: R = a(t) − a(s) as far as it lies in the axis's own direction while the axis is in the window
//!   behind its reversal: 50 ms, and until it has gone 0.1 mm, whichever is later. Friction turns round in it.
//! - *lost motion* of an axis: outside these windows, the step of a(t) − a(m) with the direction that the axis last
//!   travelled in: by least squares over the run, `a(t) − a(m) = Σ (c_i + b_i·sgn_i)·P·e_i + rest`, P the projection across
//!   the path and e_i the direction in which axis i moves the tool. Positive: the table stays behind.
//! - *following*: outside the windows, a(m) − a(s). Dynamics of the axes.
//! - *rest*: outside the windows, what is left of a(t) − a(m): wind-up of the screw by acceleration and load, and what
//!   nobody knows.
//!
//! *Share*: the mean square of a part over time, among the sum of those of all parts. Parts that work against each other
//! make this sum larger than the mean square of the error.

#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, DVector};
use path::geometry::{AxisVector, PATH_AXES};
use path::kinematics::Kinematics;
use serde::Serialize;

use crate::contour::Nearest;
use crate::turns::{Turns, WINDOW_S};

/// Travel behind a reversal up to which friction turns round, in mm: beyond every presliding distance.
const WINDOW_MM: f64 = 0.1;
/// Step for the direction in which an axis moves the tool, in axis units.
const STEP_MM: f64 = 1e-4;
/// Added to the diagonal of the normal matrix, as a part of its largest entry.
const RIDGE: f64 = 1e-9;

/// Where a part of the contour error comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ContourCause {
    /// What is commanded leaves the programmed path.
    Command,
    /// Friction turns round behind the reversal of an axis.
    Reversal,
    /// The table stays behind the motor by the direction of an axis.
    LostMotion,
    /// The motor side leaves what is commanded.
    Following,
    /// The table leaves the motor side otherwise.
    Rest,
}

/// One part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContourPart {
    /// Where it comes from.
    pub cause: ContourCause,
    /// Of which axis.
    pub axis: Option<usize>,
    /// Root mean square over the run, in mm.
    pub rms_mm: f64,
    /// Largest, in mm; none where it is known only for the whole run.
    pub peak_mm: Option<f64>,
    /// Step between the directions, of lost motion, in mm.
    pub step_mm: Option<f64>,
    /// Its share, in percent.
    pub share_percent: f64,
}

/// The parts of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ContourParts {
    /// Scans that were read.
    pub readings: u64,
    /// Root mean square of the error in these readings, in mm.
    pub rms_mm: f64,
    /// The largest first.
    pub parts: Vec<ContourPart>,
}

/// One reading.
#[derive(Debug, Clone, Copy)]
pub struct Reading {
    /// The table.
    pub table: Nearest,
    /// The motor side, compensation removed.
    pub motor: Nearest,
    /// The setpoint.
    pub setpoint: Nearest,
    /// Where the axes are.
    pub axes: AxisVector,
}

/// Sum of squares and peak.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    square_mm2: f64,
    peak_mm: f64,
}

impl Sum {
    fn take(&mut self, square_mm2: f64) {
        self.square_mm2 += square_mm2;
        self.peak_mm = self.peak_mm.max(libm::sqrt(square_mm2));
    }
}

/// One axis.
struct Track {
    turns: Turns<()>,
    increment_mm: f64,
    /// −1 or 1; 0 before it has turned or moved.
    direction: i32,
    last: Option<i64>,
    /// Scans since it turned and the position then; none outside the window.
    turned: Option<(u64, i64)>,
    reversal: Sum,
}

impl Track {
    fn take(&mut self, position: i64, window_scans: u64) {
        if let Some((scans, from)) = &mut self.turned {
            *scans += 1;
            let way_mm = position.saturating_sub(*from) as f64 * self.increment_mm;
            if *scans > window_scans && way_mm.abs() > WINDOW_MM {
                self.turned = None;
            }
        }
        if let Some((_, direction)) = self.turns.take(position, |_| ()) {
            self.direction = direction;
            self.turned = Some((0, position));
        }
        let last = self.last.replace(position);
        if self.direction == 0
            && let Some(last) = last
        {
            self.direction = position.saturating_sub(last).signum() as i32;
        }
    }

    fn interrupt(&mut self) {
        self.turns.interrupt();
        self.last = None;
        self.turned = None;
        self.direction = 0;
    }
}

/// Collects the parts, scan by scan.
pub struct ContourPartsMeter {
    kinematics: Kinematics,
    window_scans: u64,
    tracks: Vec<Track>,
    command: Sum,
    following: Sum,
    error_mm2: f64,
    readings: u64,
    /// Normal equations of a(t) − a(m): for each axis a step with its direction, then for each axis a constant.
    normal: DMatrix<f64>,
    right: DVector<f64>,
    screw_mm2: f64,
}

impl ContourPartsMeter {
    /// For axes of these increments, in mm.
    pub fn new(kinematics: &Kinematics, increments_mm: &[f64], period_s: f64) -> Self {
        let tracks = increments_mm.iter().take(PATH_AXES).map(|mm| Track {
            turns: Turns::new(*mm),
            increment_mm: *mm,
            direction: 0,
            last: None,
            turned: None,
            reversal: Sum::default(),
        });
        let tracks: Vec<Track> = tracks.collect();
        let size = 2 * tracks.len();
        ContourPartsMeter {
            kinematics: *kinematics,
            window_scans: libm::round(WINDOW_S.1 / period_s) as u64,
            tracks,
            command: Sum::default(),
            following: Sum::default(),
            error_mm2: 0.0,
            readings: 0,
            normal: DMatrix::zeros(size, size),
            right: DVector::zeros(size),
            screw_mm2: 0.0,
        }
    }

    /// Scans are missing.
    pub fn interrupt(&mut self) {
        self.tracks.iter_mut().for_each(Track::interrupt);
    }

    /// Takes the command position of an axis, in increments, once a scan.
    pub fn command(&mut self, axis: usize, position: i64) {
        if let Some(track) = self.tracks.get_mut(axis) {
            track.take(position, self.window_scans);
        }
    }

    /// Takes one reading.
    pub fn take(&mut self, reading: &Reading) {
        let (command, motor) = (reading.setpoint.across_mm, reading.motor.across_mm);
        let table = reading.table.across_mm;
        let all = [command, motor, table];
        if !all.iter().all(|vector| vector.norm_squared().is_finite()) {
            return;
        }
        self.readings += 1;
        self.error_mm2 += table.norm_squared();
        self.command.take(command.norm_squared());
        let across = self.moves_across(reading);
        let in_window = self.take_reversals(&across, (table - command).norm_squared());
        let outside = 1.0 - in_window;
        self.following
            .take(outside * (motor - command).norm_squared());
        self.take_screw(&across, &(table - motor), outside);
    }

    /// How each axis moves the tool across the path.
    fn moves_across(&self, reading: &Reading) -> Vec<AxisVector> {
        let tangent = reading.table.tangent;
        let squared = tangent.norm_squared();
        let axes = 0..self.tracks.len();
        axes.map(|axis| {
            let mut unit = AxisVector::zeros();
            if let Some(place) = unit.get_mut(axis) {
                *place = 1.0;
            }
            let moves = match self.kinematics {
                Kinematics::Cartesian => unit,
                _ => {
                    let there = self.kinematics.tool(&(reading.axes + unit * STEP_MM));
                    (there - self.kinematics.tool(&reading.axes)) / STEP_MM
                }
            };
            if squared > 0.0 {
                moves - tangent * (moves.dot(&tangent) / squared)
            } else {
                moves
            }
        })
        .collect()
    }

    /// Gives each axis in its window its share of the deviation; the sum of the shares.
    fn take_reversals(&mut self, across: &[AxisVector], deviation_mm2: f64) -> f64 {
        let weights = || across.iter().map(AxisVector::norm_squared);
        // In a plane, the squares of what the axes do across the path add up to one; with more axes to more.
        let in_window = self.tracks.iter().zip(weights());
        let in_window = in_window.filter(|(track, _)| track.turned.is_some());
        let sum: f64 = in_window.map(|(_, weight)| weight).sum();
        let scale = f64::max(sum, 1.0);
        for (track, weight) in self.tracks.iter_mut().zip(weights()) {
            if track.turned.is_some() {
                track.reversal.take(deviation_mm2 * weight / scale);
            }
        }
        sum / scale
    }

    fn take_screw(&mut self, across: &[AxisVector], screw: &AxisVector, weight: f64) {
        self.screw_mm2 += weight * screw.norm_squared();
        let axes = self.tracks.len();
        let sign = |column: usize| match self.tracks.get(column) {
            Some(track) => f64::from(track.direction),
            None => 1.0,
        };
        let of = |column: usize| across.get(column % axes.max(1)).map(|a| a * sign(column));
        for column in 0..2 * axes {
            let Some(one) = of(column) else { continue };
            if let Some(right) = self.right.get_mut(column) {
                *right += weight * one.dot(screw);
            }
            for row in 0..2 * axes {
                if let (Some(other), Some(entry)) = (of(row), self.normal.get_mut((row, column))) {
                    *entry += weight * one.dot(&other);
                }
            }
        }
    }

    /// Ends the measurement.
    pub fn finish(self) -> ContourParts {
        let mut parts = Vec::new();
        let mut add = |cause, axis, square_mm2: f64, peak_mm: Option<f64>, step_mm| {
            parts.push(ContourPart {
                cause,
                axis,
                rms_mm: libm::sqrt((square_mm2 / self.readings.max(1) as f64).max(0.0)),
                peak_mm,
                step_mm,
                share_percent: 0.0,
            });
        };
        for (cause, sum) in [
            (ContourCause::Command, &self.command),
            (ContourCause::Following, &self.following),
        ] {
            add(cause, None, sum.square_mm2, Some(sum.peak_mm), None);
        }
        for (axis, track) in self.tracks.iter().enumerate() {
            let Sum {
                square_mm2,
                peak_mm,
            } = track.reversal;
            add(
                ContourCause::Reversal,
                Some(axis),
                square_mm2,
                Some(peak_mm),
                None,
            );
        }
        let (steps, rest_mm2) = self.steps();
        for (axis, (step_mm, square_mm2)) in steps.into_iter().enumerate() {
            add(
                ContourCause::LostMotion,
                Some(axis),
                square_mm2,
                None,
                Some(step_mm),
            );
        }
        add(ContourCause::Rest, None, rest_mm2, None, None);
        parts.retain(|part| part.rms_mm > 0.0);
        parts.sort_by(|a, b| {
            let by_size = b.rms_mm.total_cmp(&a.rms_mm);
            by_size
                .then(a.cause.cmp(&b.cause))
                .then(a.axis.cmp(&b.axis))
        });
        let sum_mm2: f64 = parts.iter().map(|part| part.rms_mm * part.rms_mm).sum();
        for part in &mut parts {
            part.share_percent = 100.0 * part.rms_mm * part.rms_mm / sum_mm2;
        }
        ContourParts {
            readings: self.readings,
            rms_mm: libm::sqrt(self.error_mm2 / self.readings.max(1) as f64),
            parts,
        }
    }

    /// Step of each axis in mm and the sum of its squares, and the sum of squares of what is left.
    fn steps(&self) -> (Vec<(f64, f64)>, f64) {
        let axes = self.tracks.len();
        let largest = self.normal.diagonal().iter().copied().fold(0.0, f64::max);
        let mut normal = self.normal.clone();
        for index in 0..2 * axes {
            if let Some(entry) = normal.get_mut((index, index)) {
                *entry += RIDGE * largest + f64::MIN_POSITIVE;
            }
        }
        let solved = normal
            .cholesky()
            .map(|cholesky| cholesky.solve(&self.right));
        let mut of_steps = solved.unwrap_or_else(|| DVector::zeros(2 * axes));
        // A constant is no lost motion: it stays in the rest.
        for constant in of_steps.iter_mut().skip(axes) {
            *constant = 0.0;
        }
        let explained_mm2 = of_steps.dot(&(&self.normal * &of_steps));
        let rest_mm2 = self.screw_mm2 - 2.0 * of_steps.dot(&self.right) + explained_mm2;
        let steps = of_steps.iter().take(axes).enumerate().map(|(axis, half)| {
            let weight = self.normal.get((axis, axis)).copied().unwrap_or(0.0);
            (-2.0 * half, half * half * weight)
        });
        (steps.collect(), rest_mm2.max(0.0))
    }
}
