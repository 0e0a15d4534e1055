//! Rules of `[[rotary_line]]`.

use crate::axis_kind::AxisKind;
use crate::machine::Machine;
use crate::settings_file::Rules;

/// The most rotary axes that control of the tool's centre point takes.
const LINES_MAX: usize = 3;

pub fn judge(rules: &mut Rules<'_>, machine: &Machine) {
    let lines = &machine.rotary_lines;
    if lines.is_empty() {
        return;
    }
    if lines.len() > LINES_MAX {
        let what = format!("is there {} times: at most {LINES_MAX}", lines.len());
        rules.say(&["rotary_line"], None, &what);
    }
    if machine.kinematics.is_some() {
        let what = "goes without [kinematics]: X, Y and Z must be slides of the machine";
        rules.say(&["rotary_line"], None, what);
    }
    let slide = |letter: &str| {
        let mut axes = machine.program_axes().iter();
        axes.any(|axis| axis.name == letter && axis.kind == AxisKind::Linear)
    };
    if let Some(missing) = ["X", "Y", "Z"].into_iter().find(|letter| !slide(letter)) {
        let what = format!("needs slides X, Y and Z: this machine has no {missing}");
        rules.say(&["rotary_line"], None, &what);
    }
    for (index, line) in lines.iter().enumerate() {
        let number = (index + 1).to_string();
        let mut say = |key: &str, what: &str| {
            rules.say(&["rotary_line", &number, key], None, what);
        };
        let axis = machine
            .program_axes()
            .iter()
            .find(|axis| axis.name == line.axis);
        if axis.is_none_or(|axis| axis.kind != AxisKind::Rotary) {
            let what = format!(
                "= {:?}: must name an axis of programs with kind = \"rotary\"",
                line.axis
            );
            say("axis", &what);
        }
        let before = lines.get(..index).unwrap_or_default();
        if before.iter().any(|other| other.axis == line.axis) {
            say("axis", &format!("= {:?}: is there twice", line.axis));
        }
        if line.direction.iter().all(|component| *component == 0.0) {
            say("direction", "= [0, 0, 0]: has no direction");
        }
    }
}
