//! Rules of `[axis.compensation]`, `[[squareness]]` and `[[straightness]]`: tables are whole and level enough for the axes' limits.
//!
//! Setpoints are true places, and the limits of an axis are of them. Its motor moves as they do, less what it is corrected by: by slope ·
//! speed, and slope · acceleration, of the axis that the correction depends on. At a kink its position loop and the part that is fed
//! forward, late by 1/Kp, each add Kp · change of slope · speed at most. All of it is kept so small that it is within the margin that a
//! motor has above its limits anyway.

use crate::axis::Axis;
use crate::axis_kind::AxisKind;
use crate::geometry::{AxisCompensation, GUIDEWAY_ERRORS_MAX};
use crate::machine::Machine;
use crate::rules::fieldbus::wrong_path;
use crate::settings_file::{At, Rules};

/// Largest slope of one table, in µm for each mm; a screw of the lowest grade of ISO 3408-3 (T10) has 0.7 in 300 mm.
const SLOPE_UM_PER_MM_MAX: f64 = 1.0;
/// Share of an axis's speed that its corrections may take.
const SPEED_SHARE_MAX: f64 = 0.01;
/// Share of its acceleration that they may take.
const ACCELERATION_SHARE_MAX: f64 = 0.05;

/// Judges all of it.
pub fn judge(rules: &mut Rules<'_>, machine: &Machine) {
    for (index, axis) in machine.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        if let Some(compensation) = &axis.compensation {
            of_axis(rules, machine, axis, compensation, at);
        }
    }
    squareness(rules, machine);
    straightness(rules, machine);
    if rules.all_kept() {
        limits(rules, machine);
    }
}

fn of_axis(
    rules: &mut Rules<'_>,
    machine: &Machine,
    axis: &Axis,
    of: &AxisCompensation,
    at: At<'_>,
) {
    let refused = if axis.is_follower() {
        Some("is of a second motor: the table of its axis counts for both motors")
    } else if axis.modulo {
        Some("is of an axis that turns without end: its positions repeat in no table")
    } else if machine.kinematics.is_some() {
        Some("goes without [kinematics]: positions there are not those of the program")
    } else {
        None
    };
    if let Some(what) = refused {
        rules.say(&["compensation"], at, what);
        return;
    }
    let path = |key| ["compensation", key];
    let count = of.positions_mm.len();
    let has_lists = count + of.forward_um.len() + of.backward_um.len() > 0;
    if !of.file.is_empty() {
        if let Some(what) = wrong_path(&of.file) {
            rules.say(&path("file"), at, &what);
        }
        if has_lists {
            let what =
                "goes without positions_mm, forward_um and backward_um: the table is there or here";
            rules.say(&path("file"), at, what);
        }
        return;
    }
    if !of.read_from.is_empty() {
        // Keys of the machine file are judged already.
        within(
            rules,
            at,
            &path("positions_mm"),
            (&of.positions_mm, 100_000.0),
            "mm",
        );
        within(
            rules,
            at,
            &path("forward_um"),
            (&of.forward_um, 1000.0),
            "µm",
        );
        within(
            rules,
            at,
            &path("backward_um"),
            (&of.backward_um, 1000.0),
            "µm",
        );
    }
    whole(rules, at, &path("positions_mm"), &of.positions_mm);
    same_length(rules, at, &path("forward_um"), of.forward_um.len(), count);
    if !of.backward_um.is_empty() {
        same_length(rules, at, &path("backward_um"), of.backward_um.len(), count);
    }
    steepness(
        rules,
        at,
        &path("forward_um"),
        (&of.positions_mm, &of.forward_um),
    );
    steepness(
        rules,
        at,
        &path("backward_um"),
        (&of.positions_mm, &of.backward_um),
    );
}

/// Values are within this to either side; NaN is not.
fn within(
    rules: &mut Rules<'_>,
    at: At<'_>,
    path: &[&str],
    (values, most): (&[f64], f64),
    unit: &str,
) {
    let within = |value: &&f64| !(-most..=most).contains(*value);
    if let Some(value) = values.iter().find(within) {
        rules.between(path, at, *value, unit, -most, most);
    }
}

/// Positions are two at least, numbers, and ascend.
fn whole(rules: &mut Rules<'_>, at: At<'_>, path: &[&str], positions_mm: &[f64]) {
    if positions_mm.len() < 2 {
        let what = format!("has {} values: at least 2, or a `file`", positions_mm.len());
        rules.say(path, at, &what);
    }
    let mut pairs = positions_mm.iter().zip(positions_mm.iter().skip(1));
    if let Some((from, to)) =
        pairs.find(|(from, to)| from.partial_cmp(to).is_none_or(|o| !o.is_lt()))
    {
        let what = format!("must ascend: {to} comes after {from}");
        rules.say(path, at, &what);
    }
}

fn same_length(rules: &mut Rules<'_>, at: At<'_>, path: &[&str], found: usize, right: usize) {
    if found != right {
        let what = format!("has {found} values: must be {right}, as many as positions_mm");
        rules.say(path, at, &what);
    }
}

fn steepness(
    rules: &mut Rules<'_>,
    at: At<'_>,
    path: &[&str],
    (positions_mm, errors_um): (&[f64], &[f64]),
) {
    let points: Vec<(f64, f64)> = positions_mm
        .iter()
        .copied()
        .zip(errors_um.iter().copied())
        .collect();
    let mut pairs = points.windows(2).filter_map(|pair| match pair {
        [from, to] => Some((from.0, to.0, (to.1 - from.1) / (to.0 - from.0))),
        _ => None,
    });
    let steep = pairs.find(|(from_mm, to_mm, slope)| {
        to_mm > from_mm && slope.abs() > SLOPE_UM_PER_MM_MAX || slope.is_nan()
    });
    if let Some((from_mm, to_mm, slope)) = steep {
        let what = format!(
            "rises by {slope:.3} µm/mm from {from_mm} to {to_mm} mm: at most {SLOPE_UM_PER_MM_MAX} µm/mm either way"
        );
        rules.say(path, at, &what);
    }
}

fn squareness(rules: &mut Rules<'_>, machine: &Machine) {
    at_most(rules, "squareness", machine.squareness.len());
    for (index, square) in machine.squareness.iter().enumerate() {
        let number = (index + 1).to_string();
        pair(
            rules,
            machine,
            ("squareness", &number),
            (&square.of, &square.to),
        );
        let same = |other: &&crate::geometry::Squareness| {
            let pair = (&other.of, &other.to);
            pair == (&square.of, &square.to) || pair == (&square.to, &square.of)
        };
        if machine.squareness.iter().take(index).find(same).is_some() {
            let what = format!(
                "is of {} and {} again: their angle is one number",
                square.of, square.to
            );
            rules.say(&["squareness", &number, "to"], None, &what);
        }
    }
}

fn straightness(rules: &mut Rules<'_>, machine: &Machine) {
    at_most(rules, "straightness", machine.straightness.len());
    for (index, straight) in machine.straightness.iter().enumerate() {
        let number = (index + 1).to_string();
        pair(
            rules,
            machine,
            ("straightness", &number),
            (&straight.of, &straight.to),
        );
        let path = |key| ["straightness", number.as_str(), key];
        whole(rules, None, &path("positions_mm"), &straight.positions_mm);
        let (found, right) = (straight.error_um.len(), straight.positions_mm.len());
        same_length(rules, None, &path("error_um"), found, right);
        let points = (
            straight.positions_mm.as_slice(),
            straight.error_um.as_slice(),
        );
        steepness(rules, None, &path("error_um"), points);
        let mut before = machine.straightness.iter().take(index);
        if before.any(|other| (&other.of, &other.to) == (&straight.of, &straight.to)) {
            let what = format!("is of {} towards {} again", straight.of, straight.to);
            rules.say(&path("to"), None, &what);
        }
    }
}

fn at_most(rules: &mut Rules<'_>, key: &str, count: usize) {
    if count > GUIDEWAY_ERRORS_MAX {
        let what = format!("is there {count} times: at most {GUIDEWAY_ERRORS_MAX}");
        rules.say(&[key], None, &what);
    }
}

/// Two slides of this machine, each with a motor of its own.
fn pair(
    rules: &mut Rules<'_>,
    machine: &Machine,
    (list, number): (&str, &str),
    (of, to): (&str, &str),
) {
    if machine.kinematics.is_some() {
        let what = "goes without [kinematics]: positions there are not those of the program";
        rules.say(&[list, number], None, what);
        return;
    }
    let slides = || {
        machine
            .axes
            .iter()
            .filter(|axis| axis.kind == AxisKind::Linear && !axis.is_follower())
    };
    for (key, name) in [("of", of), ("to", to)] {
        if !slides().any(|axis| axis.name == name) {
            let names: Vec<&str> = slides().map(|axis| axis.name.as_str()).collect();
            let what = format!(
                "= {name:?}: must name a slide of this machine: {}",
                names.join(" ")
            );
            rules.say(&[list, number, key], None, &what);
        }
    }
    if of == to {
        let what = format!("= {to:?}: must be another axis than `of`");
        rules.say(&[list, number, "to"], None, &what);
    }
}

/// All corrections of an axis together leave it within its limits.
fn limits(rules: &mut Rules<'_>, machine: &Machine) {
    let terms = machine.geometry();
    for (index, axis) in machine.axes.iter().enumerate() {
        let (mut speed_mm_s, mut acceleration_mm_s2) = (0.0, 0.0);
        for term in terms.iter().filter(|term| term.of == index) {
            let Some(from) = machine.axes.get(term.from) else {
                continue;
            };
            let steep = term.errors.steepness();
            speed_mm_s += steep.slope * from.rapid_mm_s;
            let kink_mm_s2 = 2.0 * axis.position_loop.gain_per_s * steep.kink * from.rapid_mm_s;
            acceleration_mm_s2 += steep.slope * from.acceleration_mm_s2 + kink_mm_s2;
        }
        let unit = axis.kind.unit();
        let most_mm_s = SPEED_SHARE_MAX * axis.rapid_mm_s;
        let most_mm_s2 = ACCELERATION_SHARE_MAX * axis.acceleration_mm_s2;
        let at = Some((index, axis.name.as_str()));
        let mut say = |what: String| rules.say(&[], at, &what);
        if speed_mm_s > most_mm_s {
            say(format!(
                "is corrected at up to {speed_mm_s:.2} {unit}/s (compensation, squareness and straightness together): at most 1 % of its \
                 highest speed, {most_mm_s:.2} {unit}/s"
            ));
        }
        if acceleration_mm_s2 > most_mm_s2 {
            say(format!(
                "is corrected with up to {acceleration_mm_s2:.1} {unit}/s² (compensation, squareness and straightness together): at most \
                 5 % of its acceleration, {most_mm_s2:.1} {unit}/s²"
            ));
        }
    }
}
