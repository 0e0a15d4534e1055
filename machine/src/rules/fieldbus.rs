//! Rules of `[bus]` and `[axis.drive]`: every axis has a drive, every drive a place of its own.

use std::path::{Component, Path};

use bus::sample::DIGITAL_INPUTS;

use crate::fieldbus::{AxisDrive, Fieldbus};
use crate::machine::Machine;
use crate::settings_file::Rules;

/// Stands for a terminal where axes have their names.
const TERMINAL: &str = "";
/// Stands for the spindle.
const SPINDLE: &str = "spindle";
/// Most slaves of a segment.
const SLAVES_MAX: usize = bus::drive_page::SLAVES_MAX;

/// An input of the machine is one of one drive.
fn judge_inputs(rules: &mut Rules<'_>, machine: &Machine) {
    let mut taken: Vec<(u32, &str)> = Vec::new();
    for (index, axis) in machine.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        for (_, number) in axis.drive.iter().flat_map(AxisDrive::inputs) {
            let of = taken.iter().find(|(taken, _)| *taken == number);
            let what = match of {
                Some((_, other)) => format!(
                    "makes an input of this drive digital input {number}, which is one of axis {other}: choose another first_input"
                ),
                None if number as usize >= DIGITAL_INPUTS => format!(
                    "makes an input of this drive digital input {number}: the last one is {}",
                    DIGITAL_INPUTS - 1
                ),
                None => {
                    taken.push((number, &axis.name));
                    continue;
                }
            };
            rules.say(&["drive", "first_input"], at, &what);
            break;
        }
    }
}

/// A device that has a place, as messages name it.
fn whose(name: &str) -> String {
    match name {
        TERMINAL => "a [[bus.terminal]]".into(),
        SPINDLE => "[bus.spindle]".into(),
        axis => format!("axis {axis}"),
    }
}

/// What is wrong with the path of a file that lies below the folder of the machine file.
pub fn wrong_path(file: &str) -> Option<String> {
    let parts = Path::new(file).components();
    let mut below = parts.map(|part| matches!(part, Component::Normal(_)));
    let good = !file.is_empty() && below.all(|normal| normal);
    (!good).then(|| format!("= {file:?}: must be a path below the folder of this file"))
}

/// A device that a table below `[bus]` describes has a file and a place of its own.
fn judge_device<'a>(
    rules: &mut Rules<'_>,
    table: &[&str],
    (file, slave): (&str, u32),
    name: &'a str,
    taken: &mut Vec<(usize, &'a str)>,
) {
    let mut say = |key: &'static str, what: &str| rules.say(&[table, &[key]].concat(), None, what);
    if let Some(what) = wrong_path(file) {
        say("file", &what);
    }
    let place = slave as usize;
    if let Some((_, other)) = taken.iter().find(|(taken, _)| *taken == place) {
        say(
            "slave",
            &format!("= {place}: is the place of {}", whose(other)),
        );
    }
    taken.push((place, name));
}

/// Terminals, and the drive of a spindle that there is.
fn judge_devices(
    rules: &mut Rules<'_>,
    machine: &Machine,
    bus: &Fieldbus,
    taken: &mut Vec<(usize, &str)>,
) {
    for (index, of) in bus.terminals.iter().enumerate() {
        let number = (index + 1).to_string();
        let table = ["bus", "terminal", &number];
        judge_device(rules, &table, (&of.file, of.slave), TERMINAL, taken);
    }
    let Some(of) = &bus.spindle else {
        return;
    };
    let table = ["bus", "spindle"];
    judge_device(rules, &table, (&of.file, of.slave), SPINDLE, taken);
    if machine.spindle.is_none() {
        let what = "goes with [spindle] alone: write its speeds there, [spindle] speed_max_rpm = …";
        rules.say(&["bus", "spindle", "file"], None, what);
    }
}

/// Every axis has a drive, or an axis of one, where there is a bus; the places of those drives on the cable.
fn judge_axes<'a>(rules: &mut Rules<'_>, machine: &'a Machine) -> Vec<(usize, &'a str)> {
    let mut taken: Vec<(usize, &str)> = Vec::new();
    let mut drives: Vec<(usize, &AxisDrive, &str)> = Vec::new();
    for (index, axis) in machine.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        let Some(drive) = &axis.drive else {
            if machine.bus.is_some() {
                let what = "is missing: with [bus] every axis names its drive: [axis.drive] file = \"drives/NAME.toml\"";
                rules.say(&["drive"], at, what);
            }
            continue;
        };
        if machine.bus.is_none() {
            let what = "goes with [bus] alone: name the interface there, or take this table out to simulate the drive";
            rules.say(&["drive"], at, what);
            continue;
        }
        if let Some(what) = wrong_path(&drive.file) {
            rules.say(&["drive", "file"], at, &what);
        }
        if axis.homing.is_some() && (drive.zero_mm != 0.0 || drive.encoder_turns.is_some()) {
            let what = "goes with an absolute encoder alone: an axis with [axis.homing] has its place by homing.position_mm";
            let key = if drive.zero_mm != 0.0 {
                "zero_mm"
            } else {
                "encoder_turns"
            };
            rules.say(&["drive", key], at, what);
        }
        if drive.probe_edge.is_some() && machine.functions.probe.is_none() {
            let what = "needs the signal of the contact as well: [functions] probe = \"NAME\"";
            rules.say(&["drive", "probe_edge"], at, what);
        }
        let slave = machine.slave_of(index);
        let mut others = drives.iter().filter(|(place, ..)| *place == slave);
        if let Some((.., other)) = others.clone().find(|(_, of, _)| of.axis == drive.axis) {
            let what = format!(
                "= {slave}: is the place of axis {other}: where one drive has several axes, [axis.drive] axis = 2 is its second one"
            );
            rules.say(&["drive", "slave"], at, &what);
        } else if let Some((.., other)) = others.find(|(_, of, _)| of.file != drive.file) {
            let what = format!("must be the one of axis {other}, which is of the same drive");
            rules.say(&["drive", "file"], at, &what);
        }
        if !taken.iter().any(|(taken, _)| *taken == slave) {
            taken.push((slave, &axis.name));
        }
        drives.push((slave, drive, &axis.name));
    }
    taken
}

pub fn judge(rules: &mut Rules<'_>, machine: &Machine) {
    judge_inputs(rules, machine);
    let mut taken = judge_axes(rules, machine);
    let Some(bus) = &machine.bus else {
        return;
    };
    if bus.interface.is_empty() || bus.interface.len() > 15 || bus.interface.contains(['/', ' ']) {
        let what = format!(
            "= {:?}: must be the name of a network interface, such as enp3s0",
            bus.interface
        );
        rules.say(&["bus", "interface"], None, &what);
    }
    judge_devices(rules, machine, bus, &mut taken);
    for other in &bus.other_slaves {
        let place = *other as usize;
        if let Some((_, of)) = taken.iter().find(|(taken, _)| *taken == place) {
            let what = format!("names {other}, which is the place of {}", whose(of));
            rules.say(&["bus", "other_slaves"], None, &what);
        }
        taken.push((place, "?"));
    }
    taken.sort_unstable();
    let places: Vec<usize> = taken.iter().map(|(place, _)| *place).collect();
    if places.iter().any(|place| *place >= SLAVES_MAX) {
        let what = format!(
            "names a place beyond {}: a segment has at most {SLAVES_MAX} slaves",
            SLAVES_MAX - 1
        );
        rules.say(&["bus", "other_slaves"], None, &what);
    } else if let Some(gap) = (0..places.len()).find(|place| places.get(*place) != Some(place))
        && places.windows(2).all(|pair| pair.first() != pair.last())
    {
        let what = format!(
            "leaves place {gap} on the cable open: it is that of an axis ([axis.drive] slave), of a terminal ([[bus.terminal]]), of the spindle ([bus.spindle]), or of another device (other_slaves)"
        );
        rules.say(&["bus", "other_slaves"], None, &what);
    }
}
