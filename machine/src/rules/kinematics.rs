//! Rules of `[kinematics]`, and of what goes with it.

use crate::axis_kind::AxisKind;
use crate::interpolation::StraightLines;
use crate::kinematics::Kinematics;
use crate::machine::Machine;
use crate::settings_file::{From, Rules};

/// Largest angle of an arm from X, in degrees.
const ARM_ANGLE_MAX_DEG: f64 = 85.0;

pub fn judge(rules: &mut Rules<'_>, machine: &Machine) {
    let Some(kinematics) = &machine.kinematics else {
        return;
    };
    if machine.interpolation.straight_lines == StraightLines::MasterAxis {
        let what = "= \"master-axis\": must be \"rounded\" with [kinematics], where the axes do not move in straight lines";
        rules.say(&["interpolation", "straight_lines"], None, what);
    }
    let slide = (
        "slide_axis",
        &kinematics.slide_axis,
        AxisKind::Linear,
        "linear",
    );
    let arm = ("arm_axis", &kinematics.arm_axis, AxisKind::Rotary, "rotary");
    for (key, letter, kind, right) in [slide, arm] {
        let named = machine.axes.iter().find(|axis| &axis.name == letter);
        if named.is_none_or(|axis| axis.kind != kind) {
            let what =
                format!("= {letter:?}: must name an axis of this machine with kind = {right:?}");
            rules.say(&["kinematics", key], None, &what);
        }
    }
    if machine.axes.iter().any(|axis| axis.name == "Y") {
        let what = "= \"pivot-y\": the arm is in the place of Y, so the machine has no axis Y";
        rules.say(&["kinematics", "type"], None, what);
    }
    arm_range(rules, machine, kinematics);
}

/// The angles of the arm lie within the travel of its axis.
fn arm_range(rules: &mut Rules<'_>, machine: &Machine, kinematics: &Kinematics) {
    let arm = machine.axes.iter().find(|a| a.name == kinematics.arm_axis);
    let (low, high) = arm.map_or((-ARM_ANGLE_MAX_DEG, ARM_ANGLE_MAX_DEG), |arm| {
        (
            arm.travel_min_mm.max(-ARM_ANGLE_MAX_DEG),
            arm.travel_max_mm.min(ARM_ANGLE_MAX_DEG),
        )
    });
    let (min_deg, max_deg) = (kinematics.arm_min_deg, kinematics.arm_max_deg);
    rules.between(
        &["kinematics", "arm_min_deg"],
        None,
        min_deg,
        "°",
        low,
        high,
    );
    let path = ["kinematics", "arm_max_deg"];
    rules.range(&path, None, max_deg, "°", From::Above(min_deg), high);
}

/// Refuses a work offset of the arm's axis, which programs do not name. Whether it was that.
pub fn judge_arm(rules: &mut Rules<'_>, machine: &Machine, path: &[&str], letter: &str) -> bool {
    let kinematics = machine.kinematics.as_ref();
    let is_arm = kinematics.is_some_and(|kinematics| letter == kinematics.arm_axis);
    if is_arm {
        let what = "names the arm, which is in the place of Y: name Y";
        rules.say(path, None, what);
    }
    is_arm
}

/// Judges the work offsets of Y, which no axis has, and of the arm's axis, which programs do not name. Whether it was one of
/// them.
pub fn judge_work_offset(
    rules: &mut Rules<'_>,
    machine: &Machine,
    letter: &str,
    value: f64,
) -> bool {
    let Some(kinematics) = &machine.kinematics else {
        return false;
    };
    let path = ["program", "work_offset_mm", letter];
    if judge_arm(rules, machine, &path, letter) {
        return true;
    }
    if letter == "Y" {
        let reach_mm = kinematics.arm_length_mm;
        rules.between(&path, None, value, "mm", -reach_mm, reach_mm);
    } else {
        return false;
    }
    true
}
