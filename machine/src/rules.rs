//! The rules of the machine file, each a line of this table: key, range, unit.

use super::{
    DriveMode, KickShape, Machine, PREDICTION_M_MAX, PREDICTION_M_MIN, PositionErrorPart,
    ReversalMethod, Trigger, model, positioning,
};
use crate::settings_file::{At, From, Rules, SettingsFileError};
use bus::cell::is_cell_name;
use bus::sample::{MAX_AXES, MAX_SUBSAMPLES};

/// Letters a part program can move.
const AXIS_LETTERS: &str = "XYZABCUVW";

/// Checks every rule of the machine file.
///
/// # Errors
/// Every rule that is broken, in the order of the file.
pub fn judge(name: &str, text: &str, machine: &Machine) -> Result<(), SettingsFileError> {
    let mut rules = Rules::of(name, text);
    cell(&mut rules, machine);
    positioning::judge(&mut rules, machine);
    super::kinematics::judge(&mut rules, machine);
    for (index, axis) in machine.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        axis_identity(&mut rules, machine, index);
        axis_motion(&mut rules, axis, at);
        model::judge(&mut rules, axis, at, machine.scan_period_s());
        axis_loops(&mut rules, machine, axis, at);
    }
    rules.judge()
}

fn cell(rules: &mut Rules, machine: &Machine) {
    if !is_cell_name(&machine.name) {
        rules.say(
            &["name"],
            None,
            &format!(
                "= {:?}: must be 1 to {} lower-case letters, digits or hyphens",
                machine.name,
                bus::cell::CELL_NAME_LENGTH_MAX
            ),
        );
    }
    let scan = &machine.scan;
    let most_us = 250.0 * MAX_SUBSAMPLES as f64;
    rules.range(
        &["scan", "period_us"],
        None,
        scan.period_us.into(),
        "µs",
        From::AtLeast(125.0),
        most_us,
    );
    if scan.period_us > 250 && !scan.period_us.is_multiple_of(250) {
        rules.say(
            &["scan", "period_us"],
            None,
            &format!(
                "= {} µs: above 250 it must be a multiple of 250 µs, the instruments' period",
                scan.period_us
            ),
        );
    }
    rules.range(
        &["scan", "distribution_period_scans"],
        None,
        scan.distribution_period_scans.into(),
        "scans",
        From::AtLeast(2.0),
        32.0,
    );
    rules.range(
        &["scan", "watchdog_scans"],
        None,
        scan.watchdog_scans.into(),
        "scans",
        From::AtLeast(1.0),
        1000.0,
    );
    rules.range(
        &["scan", "look_ahead_periods"],
        None,
        scan.look_ahead_periods.into(),
        "periods",
        From::AtLeast(1.0),
        16.0,
    );
    rules.range(
        &["scan", "settle_scans"],
        None,
        scan.settle_scans.into(),
        "scans",
        From::AtLeast(1.0),
        100_000.0,
    );
    if machine.axes.is_empty() || machine.axes.len() > MAX_AXES {
        rules.say(
            &["axis"],
            None,
            &format!(
                "has {} tables: a machine has 1 to {MAX_AXES} axes",
                machine.axes.len()
            ),
        );
    }
    manual(rules, machine);
    super::restart::judge(rules, machine);
    for (letter, value) in &machine.program.work_offset_mm {
        let path = ["program", "work_offset_mm", letter.as_str()];
        if super::kinematics::judge_work_offset(rules, machine, letter, *value) {
            continue;
        }
        match machine.axes.iter().find(|a| &a.name == letter) {
            None => rules.say(&path, None, "names an axis that the machine does not have"),
            Some(axis) => rules.range(
                &path,
                None,
                *value,
                "mm",
                From::AtLeast(axis.travel_min_mm),
                axis.travel_max_mm,
            ),
        }
    }
}

/// Fastest motion off the path, in mm/s: "reduced" is to mean something on every machine.
const MANUAL_MM_S_MAX: f64 = 100.0;

fn manual(rules: &mut Rules, machine: &Machine) {
    for (key, value) in [
        ("jog_mm_s", machine.manual.jog_mm_s),
        ("return_mm_s", machine.manual.return_mm_s),
    ] {
        rules.range(
            &["manual", key],
            None,
            value,
            "mm/s",
            From::Above(0.0),
            MANUAL_MM_S_MAX,
        );
    }
}

fn axis_identity(rules: &mut Rules, machine: &Machine, index: usize) {
    let Some(axis) = machine.axes.get(index) else {
        return;
    };
    let at = Some((index, axis.name.as_str()));
    let mut letters = axis.name.chars();
    let single = letters.next().filter(|_| letters.next().is_none());
    if !single.is_some_and(|c| AXIS_LETTERS.contains(c)) {
        rules.say(
            &["name"],
            at,
            &format!("= {:?}: must be one of {AXIS_LETTERS}", axis.name),
        );
    }
    let twice = machine
        .axes
        .iter()
        .take(index)
        .any(|other| other.name == axis.name);
    if twice {
        rules.say(&["name"], at, "stands twice: every axis has its own letter");
    }
}

fn axis_motion(rules: &mut Rules, axis: &super::Axis, at: At) {
    rules.range(
        &["increment_nm"],
        at,
        axis.increment_nm,
        "nm",
        From::AtLeast(0.01),
        10_000.0,
    );
    rules.range(
        &["travel_min_mm"],
        at,
        axis.travel_min_mm,
        "mm",
        From::AtLeast(-100_000.0),
        100_000.0,
    );
    rules.range(
        &["travel_max_mm"],
        at,
        axis.travel_max_mm,
        "mm",
        From::Above(axis.travel_min_mm),
        100_000.0,
    );
    rules.range(
        &["rapid_mm_s"],
        at,
        axis.rapid_mm_s,
        "mm/s",
        From::Above(0.0),
        5000.0,
    );
    rules.range(
        &["acceleration_mm_s2"],
        at,
        axis.acceleration_mm_s2,
        "mm/s²",
        From::Above(0.0),
        200_000.0,
    );
    rules.range(
        &["quick_stop_mm_s2"],
        at,
        axis.quick_stop_mm_s2,
        "mm/s²",
        From::Above(0.0),
        500_000.0,
    );
    rules.range(
        &["following_error_limit_mm"],
        at,
        axis.following_error_limit_mm,
        "mm",
        From::Above(0.0),
        100.0,
    );
    rules.range(
        &["in_position_um"],
        at,
        axis.in_position_um,
        "µm",
        From::Above(0.0),
        10_000.0,
    );
    rules.range(
        &["lead_mm"],
        at,
        axis.lead_mm,
        "mm",
        From::Above(0.0),
        1000.0,
    );
    rules.range(
        &["motor", "rated_torque_nm"],
        at,
        axis.motor.rated_torque_nm,
        "N·m",
        From::Above(0.0),
        10_000.0,
    );
    rules.range(
        &["motor", "peak_torque_nm"],
        at,
        axis.motor.peak_torque_nm,
        "N·m",
        From::Above(0.0),
        50_000.0,
    );
    if axis.motor.peak_torque_nm < axis.motor.rated_torque_nm {
        rules.say(
            &["motor", "peak_torque_nm"],
            at,
            &format!(
                "= {} N·m: must be at least rated_torque_nm = {} N·m",
                axis.motor.peak_torque_nm, axis.motor.rated_torque_nm
            ),
        );
    }
}

fn axis_loops(rules: &mut Rules, machine: &Machine, axis: &super::Axis, at: At) {
    rules.range(
        &["position_loop", "gain_per_s"],
        at,
        axis.position_loop.gain_per_s,
        "1/s",
        From::Above(0.0),
        1000.0,
    );
    rules.range(
        &["velocity_loop", "gain_n_s_per_m"],
        at,
        axis.velocity_loop.gain_n_s_per_m,
        "N·s/m",
        From::Above(0.0),
        1e9,
    );
    rules.range(
        &["velocity_loop", "integral_time_ms"],
        at,
        axis.velocity_loop.integral_time_ms,
        "ms",
        From::AtLeast(0.1),
        10_000.0,
    );
    let period_us = axis.velocity_loop.period_us;
    if period_us == 0 || !machine.scan.period_us.is_multiple_of(period_us) {
        rules.say(
            &["velocity_loop", "period_us"],
            at,
            &format!(
                "= {period_us} µs: must divide scan.period_us = {} µs",
                machine.scan.period_us
            ),
        );
    } else if axis.drive_mode == DriveMode::Torque && period_us != machine.scan.period_us {
        rules.say(
            &["velocity_loop", "period_us"],
            at,
            &format!("= {period_us} µs: in torque mode the servo closes the loop once a scan: must be {} µs", machine.scan.period_us),
        );
    }
    rules.range(
        &["feed_forward", "coefficient"],
        at,
        axis.feed_forward.coefficient,
        "",
        From::AtLeast(0.0),
        1.5,
    );
    let look_ahead_ms =
        (f64::from(machine.scan.look_ahead_periods) - 0.5) * machine.distribution_period_s() * 1e3;
    rules.range(
        &["feed_forward", "advance_ms"],
        at,
        axis.feed_forward.advance_ms,
        "ms",
        From::AtLeast(0.0),
        look_ahead_ms,
    );
    if let Some(prediction) = &axis.prediction {
        rules.range(
            &["prediction", "m"],
            at,
            prediction.m,
            "",
            From::AtLeast(PREDICTION_M_MIN),
            PREDICTION_M_MAX,
        );
    }
    triggers(rules, axis, at);
    let reversal = &axis.reversal;
    rules.range(
        &["reversal", "backlash_um"],
        at,
        reversal.backlash_um,
        "µm",
        From::AtLeast(0.0),
        1000.0,
    );
    rules.range(
        &["reversal", "kick_mm_s"],
        at,
        reversal.kick_mm_s,
        "mm/s",
        From::AtLeast(0.0),
        100.0,
    );
    rules.range(
        &["reversal", "kick_ms"],
        at,
        reversal.kick_ms,
        "ms",
        From::AtLeast(0.0),
        1000.0,
    );
    rules.range(
        &["reversal", "presliding_um"],
        at,
        reversal.presliding_um,
        "µm",
        From::AtLeast(0.0),
        1000.0,
    );
    if reversal.shape == KickShape::Constant && reversal.presliding_um > 0.0 {
        rules.say(
            &["reversal", "presliding_um"],
            at,
            &format!(
                "= {} µm: needs shape = \"decaying\", a constant kick does not follow the distance",
                reversal.presliding_um
            ),
        );
    }
    rules.range(
        &["reversal", "lead_ms"],
        at,
        reversal.lead_ms,
        "ms",
        From::AtLeast(0.0),
        look_ahead_ms,
    );
    if reversal.method == ReversalMethod::Kick
        && (reversal.kick_mm_s == 0.0 || reversal.kick_ms == 0.0)
    {
        rules.say(
            &["reversal"],
            at,
            "method = \"kick\" needs kick_mm_s and kick_ms above 0",
        );
    }
}

/// Settings of the trigger that belong together.
fn triggers(rules: &mut Rules, axis: &super::Axis, at: At) {
    let (reversal, forward) = (&axis.reversal, &axis.feed_forward);
    let fed = forward.enabled && forward.coefficient > 0.0;
    if reversal.method == ReversalMethod::Kick && reversal.trigger == Trigger::FeedForward && !fed {
        rules.say(
            &["reversal", "trigger"],
            at,
            "= \"feed-forward\": needs feed_forward.enabled = true and a coefficient above 0, without them its sign never changes",
        );
    }
    let clamped = reversal.position_error_part == PositionErrorPart::Clamped;
    if clamped && !(forward.enabled && forward.coefficient >= 0.5) {
        rules.say(
            &["reversal", "position_error_part"],
            at,
            "= \"clamped\": needs feed_forward.enabled = true and a coefficient of at least 0.5, below Kp·ε is most of the velocity command",
        );
    }
    let judged = reversal.position_error_part != PositionErrorPart::None;
    if judged && reversal.trigger != Trigger::CommandAcceleration {
        rules.say(
            &["reversal", "position_error_part"],
            at,
            &format!(
                "needs trigger = \"command-acceleration\", {:?} does not ask for it",
                reversal.trigger.word()
            ),
        );
    }
}
