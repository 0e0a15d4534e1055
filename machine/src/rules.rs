//! The rules of the machine file that relate several keys. What concerns one key alone is at the key.

use bus::cell::{CELL_NAME_LENGTH_MAX, is_cell_name};

use crate::axis::Axis;
use crate::axis_kind::AxisKind;
use crate::machine::Machine;
use crate::manual;
use crate::positioning::RapidProfile;
use crate::settings_file::{From, Rules};

mod axis;
mod fieldbus;
mod gantry;
mod geometry;
mod kinematics;
mod model;
mod processes;
mod reversal;
mod rotary_lines;
mod signals;
mod weight;

pub use geometry::judge as judge_geometry;

/// Checks every rule of the machine file.
pub fn judge(rules: &mut Rules<'_>, machine: &Machine) {
    cell(rules, machine);
    dead_time(rules, machine);
    tools_and_parameters(rules, machine);
    work_offsets(rules, machine);
    minimum_heat(rules, machine);
    manual::judge(rules, &machine.manual);
    if let Some(spindle) = &machine.spindle {
        let (low, high) = (spindle.speed_min_rpm, spindle.speed_max_rpm);
        let path = ["spindle", "speed_max_rpm"];
        rules.at_least(&path, None, high, "rev/min", "speed_min_rpm", low);
    }
    kinematics::judge(rules, machine);
    rotary_lines::judge(rules, machine);
    fieldbus::judge(rules, machine);
    processes::judge(rules, machine);
    signals::judge(rules, machine);
    for (index, axis) in machine.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        if machine.axes.iter().take(index).any(|a| a.name == axis.name) {
            rules.say(
                &["name"],
                at,
                "is there twice: every axis has its own letter",
            );
        }
        axis::judge(rules, machine, axis, at);
        gantry::judge(rules, machine, index, axis, at);
        weight::judge(rules, machine, axis, at);
        reversal::judge(rules, machine, axis, at);
        model::judge(rules, machine, axis, at);
    }
    geometry::judge(rules, machine);
}

fn cell(rules: &mut Rules<'_>, machine: &Machine) {
    let name = &machine.name;
    if !is_cell_name(name) {
        let what = format!(
            "= {name:?}: must be 1 to {CELL_NAME_LENGTH_MAX} lower-case letters, digits or hyphens"
        );
        rules.say(&["name"], None, &what);
    }
    let period_us = machine.scan.period_us;
    if period_us > 250 && !period_us.is_multiple_of(250) {
        let what = format!(
            "= {period_us} µs: above 250 it must be a multiple of 250 µs, the instruments' period"
        );
        rules.say(&["scan", "period_us"], None, &what);
    }
}

/// The setpoints that act after a longer dead time are known when their command is made.
fn dead_time(rules: &mut Rules<'_>, machine: &Machine) {
    let scan = &machine.scan;
    // With a dead time of one scan it is as it always was: the advances of the axes say what they need.
    let needed_scans = f64::from(scan.dead_time_scans) + 1.0;
    let known_scans = machine.look_ahead_s() / machine.scan_period_s();
    if scan.dead_time_scans > 1 && needed_scans > known_scans {
        let what = format!(
            "= {} scans: the setpoints of {needed_scans} scans must be known ahead, and \
             (look_ahead_periods − ½) · interpolation_period_scans = {known_scans} are",
            scan.dead_time_scans
        );
        rules.say(&["scan", "dead_time_scans"], None, &what);
    }
}

/// Tools and parameters are in a file or in the machine file.
fn tools_and_parameters(rules: &mut Rules<'_>, machine: &Machine) {
    let program = &machine.program;
    if !program.tool_table.is_empty() && !program.tools.is_empty() {
        rules.say(
            &["program", "tool_table"],
            None,
            "goes without `tools`: the tools are in a file of their own, or here",
        );
    }
    if !program.parameter_file.is_empty() && !program.parameters.is_empty() {
        rules.say(
            &["program", "parameter_file"],
            None,
            "goes without `parameters`: they are in a file of their own, or here",
        );
    }
}

/// Work offsets lie within the travel of an axis of this machine.
fn work_offsets(rules: &mut Rules<'_>, machine: &Machine) {
    for (letter, value) in &machine.program.work_offset_mm {
        let path = ["program", "work_offset_mm", letter.as_str()];
        if kinematics::judge_work_offset(rules, machine, letter, *value) {
            continue;
        }
        match machine.axes.iter().find(|axis| &axis.name == letter) {
            None => rules.say(&path, None, "names an axis that the machine does not have"),
            Some(axis) if axis.is_follower() => {
                rules.say(&path, None, "names a second motor: offsets are of its axis");
            }
            Some(axis) if !axis.has_letter() => {
                rules.say(
                    &path,
                    None,
                    "names an axis that no program moves: it has no offset",
                );
            }
            Some(axis) => offset_within_travel(rules, &path, axis, *value),
        }
    }
    for (letter, value) in &machine.program.work_offset_deg {
        let path = ["program", "work_offset_deg", letter.as_str()];
        let axis = machine.axes.iter().find(|axis| &axis.name == letter);
        match axis.map(|axis| (axis.kind, axis)) {
            Some((AxisKind::Rotary, _)) if machine.program.work_offset_mm.contains_key(letter) => {
                rules.say(
                    &path,
                    None,
                    "is also in [program.work_offset_mm]: say it once",
                );
            }
            Some((AxisKind::Rotary, axis)) => {
                if !kinematics::judge_arm(rules, machine, &path, letter) {
                    offset_within_travel(rules, &path, axis, *value);
                }
            }
            _ => {
                let what = "names no rotary axis: those of slides are in [program.work_offset_mm]";
                rules.say(&path, None, what);
            }
        }
    }
}

fn offset_within_travel(rules: &mut Rules<'_>, path: &[&str], axis: &Axis, value: f64) {
    let (low, high) = (axis.travel_min_mm, axis.travel_max_mm);
    let unit = match axis.kind {
        AxisKind::Linear => "mm",
        AxisKind::Rotary => "°",
    };
    rules.range(path, None, value, unit, From::AtLeast(low), high);
}

/// Least heat has what it is computed from.
fn minimum_heat(rules: &mut Rules<'_>, machine: &Machine) {
    if machine.positioning.profile != RapidProfile::MinimumHeat {
        return;
    }
    let path = ["positioning", "profile"];
    if machine.kinematics.is_some() {
        let what = "= \"minimum-heat\": the heat of axes behind [kinematics] is not computed; use \"constant-acceleration\"";
        rules.say(&path, None, what);
    }
    for axis in machine.program_axes() {
        if axis.kind == AxisKind::Linear && axis.model.is_none() {
            let what = format!(
                "= \"minimum-heat\": axis {} has no [axis.model]: add its mass_kg (motor, screw and table) and coulomb_n, \
                 or let `quadrant tune` measure them",
                axis.name
            );
            rules.say(&path, None, &what);
        }
    }
}
