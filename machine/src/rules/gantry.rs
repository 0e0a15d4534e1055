//! Rules of `[axis.gantry]`: a second motor has a leader, and can follow all that its leader does.

use crate::axis::{Axis, Changeover, is_letter};
use crate::gantry::{Gantry, SECOND_MOTOR};
use crate::homing::HomingMethod;
use crate::machine::Machine;
use crate::settings_file::{At, Rules};

pub fn judge(rules: &mut Rules<'_>, machine: &Machine, index: usize, axis: &Axis, at: At<'_>) {
    let Some(gantry) = &axis.gantry else {
        let letter = axis.name.strip_suffix(SECOND_MOTOR);
        if let Some(letter) = letter.filter(|letter| is_letter(letter) && *letter != "P") {
            let what = format!(
                "= {:?}: is the name of a second motor, which needs [axis.gantry] with leader = {letter:?} and skew_max_mm",
                axis.name
            );
            rules.say(&["name"], at, &what);
        }
        let mut before = machine.axes.iter().take(index);
        if axis.has_letter() && !before.all(Axis::has_letter) {
            let what = "must come before the second motors and the axes without a letter: those that programs name are first";
            rules.say(&["name"], at, what);
        }
        return;
    };
    let leader = machine.axes.iter().find(|of| of.name == gantry.leader);
    let Some(leader) = leader.filter(|of| of.has_letter()) else {
        let axes = machine.axes.iter().filter(|of| of.has_letter());
        let names: Vec<&str> = axes.map(|of| of.name.as_str()).collect();
        let what = format!(
            "= {:?}: must name an axis of this machine with a motor of its own: {}",
            gantry.leader,
            names.join(" ")
        );
        rules.say(&["gantry", "leader"], at, &what);
        return;
    };
    name(rules, axis, gantry, at);
    same(rules, axis, leader, at);
    rest(rules, machine, axis, leader, at);
}

/// A second motor has the letter of its axis.
fn name(rules: &mut Rules<'_>, axis: &Axis, gantry: &Gantry, at: At<'_>) {
    let right = format!("{}{SECOND_MOTOR}", gantry.leader);
    if axis.name != right {
        let what = format!(
            "= {:?}: must be {right:?}, for it is the second motor of {}",
            axis.name, gantry.leader
        );
        rules.say(&["name"], at, &what);
    }
}

/// What setpoints are made by, and how the motors brake, is the same of both.
fn same(rules: &mut Rules<'_>, axis: &Axis, leader: &Axis, at: At<'_>) {
    if (axis.kind, axis.modulo) != (leader.kind, leader.modulo) {
        let what = format!(
            "must be as of axis {}, whose second motor it is",
            leader.name
        );
        rules.say(&["kind"], at, &what);
    }
    let unit = axis.kind.unit();
    #[rustfmt::skip] // a table
    let pairs = [
        ("increment_nm", axis.increment_nm, leader.increment_nm, String::new()),
        ("travel_min_mm", axis.travel_min_mm, leader.travel_min_mm, unit.into()),
        ("travel_max_mm", axis.travel_max_mm, leader.travel_max_mm, unit.into()),
        ("rapid_mm_s", axis.rapid_mm_s, leader.rapid_mm_s, format!("{unit}/s")),
        ("acceleration_mm_s2", axis.acceleration_mm_s2, leader.acceleration_mm_s2, format!("{unit}/s²")),
        ("jerk_mm_s3", axis.jerk_mm_s3.unwrap_or(0.0), leader.jerk_mm_s3.unwrap_or(0.0), format!("{unit}/s³")),
        ("quick_stop_mm_s2", axis.quick_stop_mm_s2, leader.quick_stop_mm_s2, format!("{unit}/s²")),
    ];
    for (key, own, of_leader, unit) in pairs {
        if own != of_leader {
            let what = match (own == 0.0, of_leader == 0.0) {
                (true, _) if key == "jerk_mm_s3" => {
                    format!(
                        "is missing: must be {of_leader} {unit}, as of axis {}",
                        leader.name
                    )
                }
                (_, true) if key == "jerk_mm_s3" => {
                    format!(
                        "= {own} {unit}: must not be there, for axis {} has none",
                        leader.name
                    )
                }
                _ => format!(
                    "= {own} {unit}: must be {of_leader} {unit}, as of axis {}, whose second motor it is",
                    leader.name
                ),
            };
            rules.say(&[key], at, &what);
        }
    }
}

/// What does not go with a gantry.
fn rest(rules: &mut Rules<'_>, machine: &Machine, axis: &Axis, leader: &Axis, at: At<'_>) {
    for of in [axis, leader] {
        if of.changeover != Changeover::SettledDeviation {
            let what = format!(
                "needs changeover = \"settled-deviation\" for axis {}: both motors begin a jog in the same scan",
                of.name
            );
            rules.say(&["gantry"], at, &what);
        }
    }
    homing(rules, axis, leader, at);
    if machine.kinematics.is_some() {
        let what = "goes without [kinematics]: the axes of a gantry are those of the program";
        rules.say(&["gantry"], at, what);
    }
}

/// Both motors know their places from the start, or are homed together, each by a switch or an index of its own.
fn homing(rules: &mut Rules<'_>, axis: &Axis, leader: &Axis, at: At<'_>) {
    let (own, of_leader) = match (&axis.homing, &leader.homing) {
        (None, None) => return,
        (Some(own), Some(of_leader)) => (own, of_leader),
        (None, Some(_)) => {
            let what = format!(
                "is missing: axis {} is homed, and its second motor with it, by a switch or an index of its own",
                leader.name
            );
            return rules.say(&["homing"], at, &what);
        }
        (Some(_), None) => {
            let what = format!(
                "must not be there: axis {} has an absolute encoder, and its second motor needs one too",
                leader.name
            );
            return rules.say(&["homing"], at, &what);
        }
    };
    if own.method != of_leader.method || own.method == HomingMethod::Drive {
        let what = format!(
            "must be switch, switch-index or index, and the same as of axis {}",
            leader.name
        );
        rules.say(&["homing", "method"], at, &what);
    }
    let ways = [own, of_leader].map(|homing| {
        let speeds = (homing.search_mm_s, homing.latch_mm_s);
        (homing.direction, speeds, homing.search_distance_mm)
    });
    if ways[0] != ways[1] {
        let what = format!(
            "must have the direction, search_mm_s, latch_mm_s and search_distance_mm of axis {}: both motors move together",
            leader.name
        );
        rules.say(&["homing"], at, &what);
    }
}
