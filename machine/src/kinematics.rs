//! The machine file's word on how the axes carry the tool.

use serde::Deserialize;

use super::{AxisKind, Machine, StraightLines};
use crate::settings_file::{From, Rules};

/// Largest angle of an arm from X, in degrees: at 85° the arm turns 11 times as fast for the same Y as at 0, and the slide's
/// correction bends 1500 times as much.
const ARM_ANGLE_MAX_DEG: f64 = 85.0;

/// How the axes carry the tool (docs/methods/pivot-axis.md).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kinematics {
    /// Which machine it is.
    #[serde(rename = "type")]
    pub kind: KinematicsKind,
    /// The slide that takes back what the rotation does to X.
    #[serde(default = "x")]
    pub slide_axis: String,
    /// The rotary axis of the arm.
    #[serde(default = "b")]
    pub arm_axis: String,
    /// Length L of the arm, from its axis to the tool, in mm.
    pub arm_length_mm: f64,
    /// Lowest angle of the arm, in degrees; 0 along X.
    pub arm_min_deg: f64,
    /// Highest angle.
    pub arm_max_deg: f64,
    /// What the slide carries.
    pub carries: Carries,
}

/// Kinds of kinematics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum KinematicsKind {
    /// A swing arm about an axis parallel to Z stands in for Y.
    PivotY,
}

/// What the slide under X carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Carries {
    /// The arm.
    Arm,
    /// The work; X counts the motion of the slide.
    Work,
}

fn x() -> String {
    "X".into()
}

fn b() -> String {
    "B".into()
}

impl Kinematics {
    /// Index of the slide among the machine's axes.
    pub fn slide_index(&self, machine: &Machine) -> Option<usize> {
        machine.axes.iter().position(|a| a.name == self.slide_axis)
    }

    /// Index of the arm's axis among the machine's axes.
    pub fn arm_index(&self, machine: &Machine) -> Option<usize> {
        machine.axes.iter().position(|a| a.name == self.arm_axis)
    }
}

/// Checks `[interpolation]` and `[kinematics]`.
pub(super) fn judge(rules: &mut Rules, machine: &Machine) {
    let Some(kinematics) = &machine.kinematics else {
        return;
    };
    if machine.interpolation.straight_lines == StraightLines::MasterAxis {
        rules.say(
            &["interpolation", "straight_lines"],
            None,
            "= \"master-axis\": must be \"rounded\" with [kinematics], where the axes do not move in straight lines",
        );
    }
    for (key, letter, kind, right) in [
        (
            "slide_axis",
            &kinematics.slide_axis,
            AxisKind::Linear,
            "linear",
        ),
        ("arm_axis", &kinematics.arm_axis, AxisKind::Rotary, "rotary"),
    ] {
        let named = machine.axes.iter().find(|axis| &axis.name == letter);
        if named.is_none_or(|axis| axis.kind != kind) {
            rules.say(
                &["kinematics", key],
                None,
                &format!("= {letter:?}: must name an axis of this machine with kind = {right:?}"),
            );
        }
    }
    if machine.axes.iter().any(|axis| axis.name == "Y") {
        rules.say(
            &["kinematics", "type"],
            None,
            "= \"pivot-y\": the arm stands in for Y, so the machine has no axis Y",
        );
    }
    let path = |key| ["kinematics", key];
    rules.range(
        &path("arm_length_mm"),
        None,
        kinematics.arm_length_mm,
        "mm",
        From::AtLeast(1.0),
        10_000.0,
    );
    let arm = machine.axes.iter().find(|a| a.name == kinematics.arm_axis);
    let (low, high) = arm.map_or((-ARM_ANGLE_MAX_DEG, ARM_ANGLE_MAX_DEG), |arm| {
        (
            arm.travel_min_mm.max(-ARM_ANGLE_MAX_DEG),
            arm.travel_max_mm.min(ARM_ANGLE_MAX_DEG),
        )
    });
    rules.range(
        &path("arm_min_deg"),
        None,
        kinematics.arm_min_deg,
        "°",
        From::AtLeast(low),
        high,
    );
    rules.range(
        &path("arm_max_deg"),
        None,
        kinematics.arm_max_deg,
        "°",
        From::Above(kinematics.arm_min_deg),
        high,
    );
}

/// Judges the work offsets of Y, which no axis has, and of the arm's axis, which programs do not name. Whether it was one of
/// them.
pub(super) fn judge_work_offset(
    rules: &mut Rules,
    machine: &Machine,
    letter: &str,
    value: f64,
) -> bool {
    let Some(kinematics) = &machine.kinematics else {
        return false;
    };
    let path = ["program", "work_offset_mm", letter];
    if letter == kinematics.arm_axis {
        rules.say(&path, None, "names the arm, which stands in for Y: name Y");
    } else if letter == "Y" {
        let reach_mm = kinematics.arm_length_mm;
        rules.between(&path, None, value, "mm", -reach_mm, reach_mm);
    } else {
        return false;
    }
    true
}
