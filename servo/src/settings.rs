//! What a servo needs of the machine file, in its own units, computed once.
use bus::sample::{Feedback, PATH_AXES};
use loops::backlash::Backlash;
use loops::dual_feedback::DualFeedback;
use loops::feed_forward::FeedForward;
use loops::guards::AxisGuards;
use loops::prediction::Prediction;
use loops::reversal::{BacklashAcceleration, PulseShape};
use loops::trigger::{PositionErrorPart, Trigger};
use loops::velocity_loop::VelocityLoop;
use machine::{
    Axis, DriveMode, Machine, PositionErrorPart as PartSetting, PositionFeedback,
    PulseShape as ShapeSetting, Reversal, ReversalMethod, Trigger as TriggerSetting, WithinPeriod,
};
use path::travel::Travel;

use crate::compensation::ModelSettings;
use crate::manual::ManualController;

/// Speed commands may be that much above the rapid traverse before they trip: position loop and pulses add to the setpoints.
const SPEED_MARGIN: f64 = 1.2;
/// What the position loop makes of this share of the following-error limit never trips a slow axis, whose margin is less.
const SPEED_ERROR_SHARE: f64 = 0.1;
/// Feedback may be beyond the travel by that part of the following-error limit: a command may end exactly at the travel.
const TRAVEL_MARGIN: f64 = 0.25;
/// Time the torque may stay at its limit, in s, before the axis is stopped.
const TORQUE_LIMITED_S: f64 = 0.2;

/// An axis that cannot be served.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ServoSettingsError {
    /// The machine has no axis of this index.
    #[error("axis {axis}: the machine has {count} axes")]
    NoSuchAxis {
        /// The index asked for.
        axis: usize,
        /// Axes there are.
        count: usize,
    },
}

/// Immutable settings of one servo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoSettings {
    /// Index of the axis.
    pub axis: usize,
    /// Its place in setpoints; none of an axis that no program moves: it stays where it is while windows are executed.
    pub path_axis: Option<usize>,
    /// Axes of the machine.
    pub axis_count: usize,
    /// Whether the axis has a second servo, which goes on from the first one's state.
    pub has_standby: bool,
    /// Tp, in s.
    pub scan_s: f64,
    /// N.
    pub scans_per_period: u32,
    /// J, periods of look-ahead.
    pub look_ahead_periods: usize,
    /// Axis units per increment, in mm.
    pub increment_mm: f64,
    /// Position command within an interpolation period.
    pub within_period: WithinPeriod,
    /// Where the position comes from.
    pub feedback: PositionFeedback,
    /// How the scale's position comes into the motor's.
    pub dual_feedback: DualFeedback,
    /// Prediction of the feedback position.
    pub prediction: Prediction,
    /// Who closes the velocity loop.
    pub drive_mode: DriveMode,
    /// Kp, in 1/s.
    pub position_gain_per_s: f64,
    /// α and advance; α is 0 where the feed-forward is off.
    pub feed_forward: FeedForward,
    /// Whether the feed-forward is on.
    pub feed_forward_enabled: bool,
    /// Position backlash compensation; a step of 0 where it is off.
    pub backlash: Backlash,
    /// Backlash acceleration; a pulse of 0 where it is off.
    pub pulse: BacklashAcceleration,
    /// Velocity loop of torque mode.
    pub velocity_loop: VelocityLoop,
    /// What the axis's model adds.
    pub model: ModelSettings,
    /// The second controller and the changeover to it.
    pub manual: ManualController,
    /// Following error, travel and speed guards.
    pub guards: AxisGuards,
    /// Scans in a row at the torque limit that stop the axis.
    pub torque_limited_scans_max: u32,
    /// Quick-stop deceleration, in mm/s².
    pub quick_stop_mm_s2: f64,
    /// Axes of the path.
    pub path_axes: usize,
    /// Their quick-stop decelerations, in mm/s², by place on the path.
    pub path_quick_stops_mm_s2: [f64; PATH_AXES],
    /// Their axis units per increment, in mm.
    pub path_increments_mm: [f64; PATH_AXES],
    /// Largest difference of two setpoints, in increments.
    pub step_max: i64,
    /// Largest second difference of setpoints, in increments.
    pub step_change_max: i64,
}

impl ServoSettings {
    /// For the axis of this index.
    ///
    /// # Errors
    /// The machine has no such axis.
    pub fn new(machine: &Machine, index: usize) -> Result<ServoSettings, ServoSettingsError> {
        let axis = machine
            .axes
            .get(index)
            .ok_or(ServoSettingsError::NoSuchAxis {
                axis: index,
                count: machine.axes.len(),
            })?;
        let scan_s = machine.scan_period_s();
        let increment_mm = axis.increment_mm();
        let model = ModelSettings::new(axis, scan_s, machine.scan.dead_time_scans);
        let mut settings = ServoSettings {
            axis: index,
            path_axis: machine.path_axis(index),
            axis_count: machine.axes.len(),
            has_standby: axis.standby,
            scan_s,
            scans_per_period: machine.scan.interpolation_period_scans,
            look_ahead_periods: machine.scan.look_ahead_periods as usize,
            increment_mm,
            within_period: machine.interpolation.within_period,
            feedback: axis.feedback,
            dual_feedback: DualFeedback::with_time_constant(axis.dual_feedback_ms * 1e-3, scan_s),
            prediction: axis
                .prediction
                .map_or(Prediction::OFF, |p| Prediction { m: p.m }),
            drive_mode: axis.drive_mode,
            position_gain_per_s: axis.position_loop.gain_per_s,
            feed_forward: feed_forward(machine, axis),
            feed_forward_enabled: axis.feed_forward.enabled,
            backlash: Backlash {
                step_mm: match axis.reversal.method {
                    ReversalMethod::None => 0.0,
                    _ => axis.reversal.backlash_um * 1e-3,
                },
            },
            pulse: friction_pulse(machine, axis),
            velocity_loop: VelocityLoop::new(
                axis.velocity_loop.gain_n_s_per_m,
                axis.velocity_loop.integral_time_ms * 1e-3,
                scan_s,
                axis.lead_mm,
                axis.motor.peak_torque_nm,
            ),
            model,
            manual: ManualController::new(machine, axis, model.ahead_scans()),
            guards: guards(axis),
            torque_limited_scans_max: libm::ceil(TORQUE_LIMITED_S / scan_s) as u32,
            quick_stop_mm_s2: axis.quick_stop_mm_s2,
            path_axes: machine.program_axes().len(),
            path_quick_stops_mm_s2: [0.0; PATH_AXES],
            path_increments_mm: [0.0; PATH_AXES],
            // Rounding to increments alone changes a difference by up to 1 and a second difference by up to 2.
            step_max: libm::floor(axis.rapid_mm_s * scan_s / increment_mm) as i64 + 1,
            step_change_max: libm::floor(axis.acceleration_mm_s2 * scan_s * scan_s / increment_mm)
                as i64
                + 2,
        };
        let places = settings
            .path_quick_stops_mm_s2
            .iter_mut()
            .zip(&mut settings.path_increments_mm);
        for ((quick_stop, increment), other) in places.zip(machine.program_axes()) {
            *quick_stop = other.quick_stop_mm_s2;
            *increment = other.increment_mm();
        }
        Ok(settings)
    }

    /// Where the windows of the program in force may have the axis: within its travel, or where it began, which may be outside by
    /// what an axis in position is off.
    pub(crate) fn reach(&self, feedback: &Feedback) -> Travel<i64> {
        let place = self.path_axis;
        let began = place.and_then(|place| feedback.program_start.get(place));
        match began.filter(|_| feedback.program_hash != 0) {
            Some(place) => self.guards.travel.from_place(*place),
            None => self.guards.travel,
        }
    }
}

fn feed_forward(machine: &Machine, axis: &Axis) -> FeedForward {
    let forward = &axis.feed_forward;
    FeedForward {
        scans_per_period: machine.scan.interpolation_period_scans,
        coefficient: if forward.enabled {
            forward.coefficient
        } else {
            0.0
        },
        advance_scans: forward.advance_ms * 1e-3 / machine.scan_period_s(),
    }
}

fn friction_pulse(machine: &Machine, axis: &Axis) -> BacklashAcceleration {
    let reversal = &axis.reversal;
    let scan_s = machine.scan_period_s();
    BacklashAcceleration {
        lead_s: reversal.lead_ms * 1e-3,
        period_s: machine.interpolation_period_s(),
        increment_mm: axis.increment_mm(),
        scan_s,
        trigger: trigger(reversal),
        shape: match reversal.shape {
            ShapeSetting::Constant => PulseShape::Constant,
            ShapeSetting::Decaying => PulseShape::Decaying {
                decay_scans: reversal.pulse_ms * 1e-3 / scan_s,
                presliding_mm: reversal.presliding_um * 1e-3,
            },
        },
        pulse_mm_s: match reversal.method {
            ReversalMethod::FrictionPulse => reversal.pulse_mm_s,
            _ => 0.0,
        },
        pulse_scans: libm::round(reversal.pulse_ms * 1e-3 / scan_s) as u32,
    }
}

fn trigger(reversal: &Reversal) -> Trigger {
    match reversal.trigger {
        TriggerSetting::PositionError => Trigger::PositionError,
        TriggerSetting::FeedForward => Trigger::FeedForward,
        TriggerSetting::VelocityCommand => Trigger::VelocityCommand,
        TriggerSetting::CommandAcceleration => {
            Trigger::CommandAcceleration(match reversal.position_error_part {
                PartSetting::None => PositionErrorPart::None,
                PartSetting::Clamped => PositionErrorPart::Clamped,
                PartSetting::Full => PositionErrorPart::Full,
            })
        }
    }
}

fn guards(axis: &Axis) -> AxisGuards {
    let [min, max] = axis.travel_increments();
    let margin_mm = TRAVEL_MARGIN * axis.following_error_limit_mm;
    let loop_mm_s =
        axis.position_loop.gain_per_s * SPEED_ERROR_SHARE * axis.following_error_limit_mm;
    AxisGuards {
        travel: Travel { min, max },
        travel_margin: libm::round(margin_mm / axis.increment_mm()) as i64,
        following_error_mm: axis.following_error_limit_mm,
        speed_mm_s: (SPEED_MARGIN * axis.rapid_mm_s).max(axis.rapid_mm_s + loop_mm_s),
    }
}
