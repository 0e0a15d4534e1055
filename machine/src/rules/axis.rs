//! Rules of one axis: travel, motor, loops, feedback.

use crate::axis::{Axis, DriveMode, PositionFeedback};
use crate::axis_kind::AxisKind;
use crate::homing::HomingMethod;
use crate::kinematics::Kinematics;
use crate::machine::Machine;
use crate::settings_file::{At, From, Rules};
use crate::transmission;

pub fn judge(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, at: At<'_>) {
    if axis.modulo {
        endless(rules, machine, axis, at);
    } else {
        let (low, high) = (From::Above(axis.travel_min_mm), 100_000.0);
        rules.range(&["travel_max_mm"], at, axis.travel_max_mm, "mm", low, high);
    }
    let (path, motor) = (["motor", "peak_torque_nm"], &axis.motor);
    let (peak_nm, rated_nm) = (motor.peak_torque_nm, motor.rated_torque_nm);
    rules.at_least(&path, at, peak_nm, "N·m", "rated_torque_nm", rated_nm);
    if axis.dual_feedback_ms > 0.0 && axis.feedback != PositionFeedback::Scale {
        let what = format!(
            "= {} ms: needs feedback = \"scale\", without one there is nothing to believe later",
            axis.dual_feedback_ms
        );
        rules.say(&["dual_feedback_ms"], at, &what);
    }
    if let Some(of) = &axis.transmission {
        transmission::judge(rules, at, &[], of, axis.kind);
    }
    drive_period(rules, machine, axis, at);
    homing(rules, axis, at);
    let look_ahead_ms = machine.look_ahead_s() * 1e3;
    let (path, advance_ms) = (["feed_forward", "advance_ms"], axis.feed_forward.advance_ms);
    rules.between(&path, at, advance_ms, "ms", 0.0, look_ahead_ms);
}

/// An axis that turns without end turns, and has no ends.
fn endless(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, at: At<'_>) {
    if axis.kind != AxisKind::Rotary {
        let what = "= true: a slide has ends: needs kind = \"rotary\"";
        rules.say(&["modulo"], at, what);
    }
    for key in ["travel_min_mm", "travel_max_mm"] {
        if rules.has(at, &[key]) {
            let what = "goes without `modulo`: an axis that turns without end has no travel";
            rules.say(&[key], at, what);
        }
    }
    let is_arm = |kinematics: &Kinematics| kinematics.arm_axis == axis.name;
    if machine.kinematics.as_ref().is_some_and(is_arm) {
        let what = "= true: the arm of [kinematics] does not turn without end";
        rules.say(&["modulo"], at, what);
    }
}

/// The drive's loop fits into a scan.
fn drive_period(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, at: At<'_>) {
    let (period_us, scan_us) = (axis.velocity_loop.period_us, machine.scan.period_us);
    let what = if period_us == 0 || !scan_us.is_multiple_of(period_us) {
        format!("= {period_us} µs: must divide scan.period_us = {scan_us} µs")
    } else if axis.drive_mode == DriveMode::Torque && period_us != scan_us {
        format!(
            "= {period_us} µs: in torque mode the servo closes the loop once a scan: must be {scan_us} µs"
        )
    } else {
        return;
    };
    rules.say(&["velocity_loop", "period_us"], at, &what);
}

/// A search can find what it looks for, and the place that it gives is one of the machine.
fn homing(rules: &mut Rules<'_>, axis: &Axis, at: At<'_>) {
    let Some(homing) = &axis.homing else {
        return;
    };
    let (has_switch, input) = (homing.method.has_switch(), homing.switch_input);
    if has_switch && input.is_none() {
        let what = "is missing: this method needs the number of the digital input of the switch";
        rules.say(&["homing", "switch_input"], at, what);
    }
    if let (false, Some(number)) = (has_switch, input) {
        let what = format!("= {number}: this method looks at no switch");
        rules.say(&["homing", "switch_input"], at, &what);
    }
    if homing.method != HomingMethod::Drive && axis.feedback == PositionFeedback::Scale {
        let what = "needs feedback = \"motor\": switch and index give the place of the motor's encoder, not of a scale";
        rules.say(&["homing", "method"], at, what);
    }
    let search_mm_s = homing.search_mm_s;
    let (path, low) = (["homing", "search_mm_s"], homing.latch_mm_s);
    rules.between(&path, at, search_mm_s, "mm/s", low, axis.rapid_mm_s);
    if let Some(rest_mm) = homing.rest_mm {
        let (low, high) = (axis.travel_min_mm, axis.travel_max_mm);
        rules.between(&["homing", "rest_mm"], at, rest_mm, "mm", low, high);
    }
}
