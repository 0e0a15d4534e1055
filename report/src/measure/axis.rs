//! One axis over the run: following error, torque, heat; and the audit of its setpoints.

pub mod blocks;
pub mod drop;
pub mod percentiles;

use bus::sample::{AxisCommand, AxisFeedback, Feedback, MAX_AXES, Mode};
use machine::{Axis, Machine, WithinPeriod};
use monitor::quantities::Peaks;
use path::travel::Travel;
use serde::Serialize;

use self::percentiles::Percentiles;
use super::prediction::PredictionMeter;
use super::series::{MinMaxSeries, Statistics};

/// Room temperature that winding temperatures are counted from, in °C: the machine reports the rise above it only.
pub const AMBIENT_C: f64 = 20.0;

/// What was measured of one axis.
#[derive(Debug, Clone, Default)]
pub struct AxisMeter {
    /// Command minus feedback, compensation not counted, in mm, while the drives were on.
    pub following_error_mm: Statistics,
    /// Percentiles of its magnitude, in µm.
    pub following_error_um_percentiles: Percentiles,
    /// The same over time, in µm.
    pub following_error_um_series: MinMaxSeries,
    /// Motor torque, in N·m, while the drives were on.
    pub torque_nm: Statistics,
    /// Scans in which the axis's model asked for more torque than is fed forward, while the drives were on.
    pub torque_cut_scans: u64,
    /// What was cut off at most, in N·m.
    pub torque_cut_nm_peak: f64,
    /// What the servo goes by as to friction.
    pub friction: FrictionMeter,
    /// Numbers that are shown as the feedback has them.
    pub quantities: Peaks,
    /// Scans without a command in time.
    pub missed_scans: u32,
    /// Of a second motor its position less that of its axis's first, in mm, while the drives were on.
    pub skew_mm: Statistics,
    /// How far it has dropped; none of an axis without weight.
    pub drop: Option<drop::DropMeter>,
    /// As many had been missed when the run began.
    pub missed_before: u32,
    /// Prediction of the feedback position; none where it is off.
    pub prediction: Option<PredictionMeter>,
}

/// Friction that a servo with a model goes by, while the drives were on.
#[derive(Debug, Clone, Copy, Default)]
pub struct FrictionMeter {
    /// Level at the end, as a part of the tuned one; none without a model.
    pub level: Option<f64>,
    unexplained_sum: f64,
    ways: u64,
    last: f64,
}

impl FrictionMeter {
    fn take(&mut self, command: &AxisCommand) {
        if command.friction_level > 0.0 {
            self.level = Some(command.friction_level);
        }
        // It changes once for each way between two reversals.
        if command.friction_unexplained.is_finite() && command.friction_unexplained != self.last {
            self.last = command.friction_unexplained;
            self.unexplained_sum += self.last;
            self.ways += 1;
        }
    }

    /// What a way between two reversals left unexplained in the mean, in percent of Coulomb friction; none where nothing is followed.
    pub fn unexplained_percent(&self) -> Option<f64> {
        (self.ways > 0).then(|| 100.0 * self.unexplained_sum / self.ways as f64)
    }
}

impl AxisMeter {
    /// For one axis.
    pub fn of(axis: &Axis, scan_s: f64) -> AxisMeter {
        AxisMeter {
            prediction: PredictionMeter::of(axis),
            drop: drop::DropMeter::of(axis, scan_s),
            ..AxisMeter::default()
        }
    }

    /// Takes one scan.
    pub fn take(
        &mut self,
        scan: u64,
        feedback: &AxisFeedback,
        command: Option<&AxisCommand>,
        drives_on: bool,
    ) {
        // A master that was restarted counts from nothing.
        self.missed_before = self.missed_before.min(feedback.missed_scans);
        self.missed_scans = feedback.missed_scans - self.missed_before;
        self.quantities.take(feedback);
        if !drives_on {
            return;
        }
        self.torque_nm.take(feedback.torque_nm);
        if let Some(prediction) = &mut self.prediction {
            prediction.take(scan, feedback);
        }
        if let Some(command) = command {
            self.torque_cut_scans += u64::from(command.torque_cut_nm != 0.0);
            self.torque_cut_nm_peak = self.torque_cut_nm_peak.max(command.torque_cut_nm.abs());
            self.friction.take(command);
            self.following_error_mm.take(command.following_error_mm);
            self.following_error_um_percentiles
                .take(command.following_error_mm * 1e3);
            self.following_error_um_series
                .take(scan, command.following_error_mm * 1e3);
        }
    }
}

/// Setpoints (one per axis and scan) that were beyond a limit of the machine file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct LimitCounts {
    /// Faster than the rapid traverse.
    #[serde(rename = "velocity_exceeded")]
    pub velocity: u64,
    /// Acceleration beyond the limit.
    #[serde(rename = "acceleration_exceeded")]
    pub acceleration: u64,
    /// Jerk beyond the limit, where there is one.
    #[serde(rename = "jerk_exceeded")]
    pub jerk: u64,
    /// Outside the travel.
    #[serde(rename = "travel_exceeded")]
    pub travel: u64,
}

/// The limits of one axis, in increments per scan.
#[derive(Debug, Clone, Copy)]
struct AxisLimit {
    /// Its place on the path, if it has one.
    path_axis: Option<usize>,
    step: f64,
    step_change: f64,
    /// Between two changes of steps; infinite where jerk is not limited.
    turn: f64,
    travel: Travel<i64>,
}

/// Audit of the command positions that the master publishes, while it executes windows.
///
/// A command position is a rounded position: a step of one scan may be one increment too long by rounding alone, the change
/// between two steps two increments, the difference of two such changes four.
///
/// Where the servos split each interpolation period evenly (`[interpolation] within_period = "linear"`) the speed steps at every period
/// boundary, by as much as it changes in a whole period: acceleration is judged there on the means of whole periods, that
/// is on the command positions at their ends and the period in place of the scan.
#[derive(Debug, Clone)]
pub struct LimitsAudit {
    limits: Vec<AxisLimit>,
    /// Scans over which acceleration is judged: one, or an interpolation period that is split evenly.
    stride: u64,
    /// The command positions at the last ends of such a stride, newest first, while they were contiguous.
    ends: Vec<[i64; MAX_AXES]>,
    /// The command positions of the scan before, if it was contiguous.
    before: Option<[i64; MAX_AXES]>,
    last_scan: u64,
    /// What was found.
    pub counts: LimitCounts,
}

impl LimitsAudit {
    /// For one machine.
    pub fn new(machine: &Machine) -> Self {
        let period_s = machine.scan_period_s();
        let stride = match machine.interpolation.within_period {
            WithinPeriod::Exact => 1,
            WithinPeriod::Linear => machine.scan.interpolation_period_scans,
        };
        let stride_s = period_s * f64::from(stride);
        let limits = machine.axes.iter().enumerate().map(|(index, axis)| {
            let increment_mm = axis.increment_mm();
            let [min, max] = axis.travel_increments();
            AxisLimit {
                path_axis: machine.path_axis(index),
                step: axis.rapid_mm_s * period_s / increment_mm * (1.0 + 1e-9) + 1.0,
                step_change: axis.acceleration_mm_s2 * stride_s * stride_s / increment_mm
                    * (1.0 + 1e-9)
                    + 2.0,
                turn: axis.jerk_mm_s3.unwrap_or(f64::INFINITY) * stride_s.powi(3) / increment_mm
                    * (1.0 + 1e-9)
                    + 4.0,
                travel: Travel { min, max }.widened(1),
            }
        });
        LimitsAudit {
            limits: limits.collect(),
            stride: stride.into(),
            ends: Vec::new(),
            before: None,
            last_scan: 0,
            counts: LimitCounts::default(),
        }
    }

    /// Takes one feedback.
    pub fn take(&mut self, feedback: &Feedback) {
        let commanded = !feedback.window.is_none()
            && !matches!(
                Mode::from_wire(feedback.mode),
                Some(Mode::Disabled | Mode::Tripped) | None
            );
        // A command position that no command reached is at rest and catches up: that is a missed scan, not a setpoint.
        let missed = feedback.axes().iter().any(|axis| axis.missed_in_a_row > 0);
        if !commanded || missed || feedback.scan != self.last_scan + 1 {
            self.before = None;
            self.ends.clear();
        }
        self.last_scan = feedback.scan;
        if !commanded || missed {
            return;
        }
        let mut now = [0; MAX_AXES];
        for (now, axis) in now.iter_mut().zip(feedback.axes()) {
            *now = axis.command_position;
        }
        let step = |a: &[i64; MAX_AXES], b: &[i64; MAX_AXES], axis: usize| {
            let value = |row: &[i64; MAX_AXES]| row.get(axis).copied().unwrap_or(0);
            value(a).saturating_sub(value(b)) as f64
        };
        for (axis, limit) in self.limits.iter().enumerate() {
            let value = |row: &[i64; MAX_AXES]| row.get(axis).copied().unwrap_or(0);
            let Some(one) = &self.before else {
                continue;
            };
            let reach = limit.travel.from_place(value(one));
            let began = limit
                .path_axis
                .and_then(|axis| feedback.program_start.get(axis));
            let reach = began.map_or(reach, |began| reach.from_place(*began));
            self.counts.travel += u64::from(!reach.holds(value(&now)));
            let last_step = step(&now, one, axis);
            self.counts.velocity += u64::from(last_step.abs() > limit.step);
        }
        self.before = Some(now);
        // A command position is the command of the scan before: at a period's first scan it is the period's end.
        if !feedback.scan.is_multiple_of(self.stride) {
            return;
        }
        if let [one, two, before @ ..] = self.ends.as_slice() {
            for (axis, limit) in self.limits.iter().enumerate() {
                let change = step(&now, one, axis) - step(one, two, axis);
                self.counts.acceleration += u64::from(change.abs() > limit.step_change);
                if let [three, ..] = before {
                    let turn = change - (step(one, two, axis) - step(two, three, axis));
                    self.counts.jerk += u64::from(turn.abs() > limit.turn);
                }
            }
        }
        self.ends.truncate(2);
        self.ends.insert(0, now);
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn friction_that_is_not_explained_counts_once_for_each_way_between_two_reversals() {
        let mut meter = AxisMeter::default();
        let feedback = AxisFeedback::zeroed();
        assert_eq!(meter.friction.unexplained_percent(), None);
        for (scan, unexplained, drives_on) in [
            (1, 0.0, true),
            (2, 0.1, true),
            (3, 0.1, true),
            (4, 0.3, true),
            (5, 0.9, false),
        ] {
            let mut command = AxisCommand::zeroed();
            command.friction_level = 0.8;
            command.friction_unexplained = unexplained;
            meter.take(scan, &feedback, Some(&command), drives_on);
        }
        assert_eq!(meter.friction.level, Some(0.8));
        let percent = meter.friction.unexplained_percent().expect("two ways");
        assert!((percent - 20.0).abs() < 1e-9, "{percent}");
    }

    #[test]
    fn torque_that_is_cut_off_is_counted_and_its_most_kept_while_the_drives_are_on() {
        let mut meter = AxisMeter::default();
        let feedback = AxisFeedback::zeroed();
        for (scan, cut_nm, drives_on) in [
            (1, 0.0, true),
            (2, 1.5, true),
            (3, -4.25, true),
            (4, 0.0, true),
            (5, 9.0, false),
        ] {
            let mut command = AxisCommand::zeroed();
            command.torque_cut_nm = cut_nm;
            meter.take(scan, &feedback, Some(&command), drives_on);
        }
        assert_eq!(
            (meter.torque_cut_scans, meter.torque_cut_nm_peak),
            (2, 4.25)
        );
    }
}
