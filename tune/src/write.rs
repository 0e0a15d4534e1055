//! Edits of the machine file that keep everything else as it is.

use machine::settings_file::N_PER_NM;
use machine::{AxisKind, DriveMode, Machine};
use toml_edit::{Array, DocumentMut, Item, Table, Value, table, value};

use super::identify::{BREAK_UM, ELEMENTS, Found, Friction, Table as FoundTable};
use super::laws::{self, Timing};
use super::motions::Limit;

/// Largest increment, as a part of what one scan of acceleration changes the step by.
const ROUNDING_PART: f64 = 0.1;

/// The tables of the axes.
pub(crate) fn axes(document: &mut DocumentMut) -> impl Iterator<Item = &mut Table> {
    document
        .get_mut("axis")
        .and_then(Item::as_array_of_tables_mut)
        .into_iter()
        .flat_map(|axes| axes.iter_mut())
}

/// The table of this path below an axis, made where it is missing.
fn inner<'a>(axis: &'a mut Table, path: &[&str]) -> &'a mut Table {
    let mut here = axis;
    for name in path {
        let item = here.entry(name).or_insert_with(table);
        if let Item::Value(Value::InlineTable(inline)) = item {
            *item = Item::Table(std::mem::take(inline).into_table());
        }
        if !item.is_table() {
            *item = table();
        }
        here = match item {
            Item::Table(table) => table,
            _ => unreachable!("it was just made a table"),
        };
    }
    here
}

/// Programs in machine coordinates that name axes, not tools.
pub fn plain(document: &mut DocumentMut) {
    for key in ["program", "positioning", "kinematics", "interpolation"] {
        document.remove(key);
    }
}

/// The axes without any compensation, under their motor encoders, with feed-forward: as the test motions want them.
pub fn bare(document: &mut DocumentMut, machine: &Machine) {
    plain(document);
    // What rings is to show itself.
    document.remove("path");
    for (axis, known) in axes(document).zip(&machine.axes) {
        axis.remove("jerk_mm_s3");
        let advance_ms = Timing::of(machine, known).advance_ms();
        inner(axis, &["reversal"]).insert("method", value("none"));
        for key in [
            "adaptation",
            "torque_feed_forward",
            "disturbance_observer",
            "model",
            "feedback",
            "dual_feedback_ms",
        ] {
            axis.remove(key);
        }
        let forward = inner(axis, &["feed_forward"]);
        forward.insert("enabled", value(true));
        forward.insert("coefficient", value(1.0));
        forward.insert("advance_ms", value(advance_ms));
    }
}

/// Gains by law for an axis of this mass.
pub fn gains(document: &mut DocumentMut, machine: &Machine, index: usize, mass_kg: f64) {
    let known = machine.axes.get(index);
    if let Some((axis, known)) = axes(document).nth(index).zip(known) {
        let timing = Timing::of(machine, known);
        if timing.drive_mode != DriveMode::Position {
            let gain_per_s = timing.position_gain_per_s();
            inner(axis, &["position_loop"]).insert("gain_per_s", value(gain_per_s));
        }
        let velocity = inner(axis, &["velocity_loop"]);
        velocity.insert(
            "gain_n_s_per_m",
            value(timing.velocity_gain_n_s_per_m(mass_kg)),
        );
        velocity.insert("integral_time_ms", value(timing.integral_time_ms()));
    }
}

/// A part of the velocity loop's gain.
pub fn scale_gain(document: &mut DocumentMut, index: usize, part: f64) {
    if let Some(axis) = axes(document).nth(index) {
        let velocity = inner(axis, &["velocity_loop"]);
        let gain = velocity.get("gain_n_s_per_m").and_then(Item::as_float);
        if let Some(gain) = gain {
            velocity.insert("gain_n_s_per_m", value(part * gain));
        }
    }
}

/// Another acceleration of all axes, where theirs is not lower.
pub fn acceleration(
    document: &mut DocumentMut,
    machine: &Machine,
    limits: &[Limit],
    acceleration_mm_s2: f64,
) {
    let scan_s = machine.scan_period_s();
    for ((axis, known), limit) in axes(document).zip(&machine.axes).zip(limits) {
        let most_mm_s2 = limit.acceleration_mm_s2.unwrap_or(f64::INFINITY);
        let acceleration_mm_s2 = known
            .acceleration_mm_s2
            .min(acceleration_mm_s2)
            .min(most_mm_s2);
        axis.insert("acceleration_mm_s2", value(acceleration_mm_s2));
        // Rounded to increments it must still look smooth.
        let step_nm = acceleration_mm_s2 * scan_s * scan_s * 1e6;
        let increment_nm = known.increment_nm.min(ROUNDING_PART * step_nm);
        axis.insert("increment_nm", value(increment_nm));
    }
}

/// No more acceleration than is allowed.
pub fn allow(document: &mut DocumentMut, machine: &Machine, limits: &[Limit]) {
    for ((axis, known), limit) in axes(document).zip(&machine.axes).zip(limits) {
        if let Some(most_mm_s2) = limit.acceleration_mm_s2 {
            axis.insert(
                "acceleration_mm_s2",
                value(known.acceleration_mm_s2.min(most_mm_s2)),
            );
        }
    }
}

/// Gaps of these axes' models that are so many times as wide, where they have one.
pub fn scale_gap(document: &mut DocumentMut, names: &[String], times: f64) {
    for axis in axes(document) {
        let name = axis.get("name").and_then(Item::as_str).unwrap_or_default();
        if !names.iter().any(|of| of == name) {
            continue;
        }
        let table = axis.get("model").and_then(|model| model.get("table"));
        let gap_um = table.and_then(|table| table.get("gap_um")?.as_float());
        if let Some(gap_um) = gap_um {
            let why = format!("tune: wind-up without torque, × {times:.2} by test circles");
            let gap_um = digits(times * gap_um, 3);
            Keys::of(axis, &["model", "table"]).set("gap_um", gap_um, &why);
        }
    }
}

/// Sets a value of a table of a document, with where it comes from.
pub(crate) fn set_in(
    document: &mut DocumentMut,
    table: &str,
    key: &str,
    new: impl Into<Value>,
    why: &str,
) {
    Keys::of(document.as_table_mut(), &[table]).set(key, new, why);
}

/// The keys of one table of an axis.
pub(crate) struct Keys<'a>(&'a mut Table);

impl Keys<'_> {
    /// Of the table of this path, made where it is missing.
    pub(crate) fn of<'a>(axis: &'a mut Table, path: &[&str]) -> Keys<'a> {
        Keys(inner(axis, path))
    }

    /// Sets a value and notes behind it where it comes from.
    pub(crate) fn set(&mut self, key: &str, new: impl Into<Value>, why: &str) {
        let mut new = new.into();
        if !why.is_empty() {
            new.decor_mut().set_prefix(" ");
            new.decor_mut().set_suffix(format!("  # {why}"));
        }
        match self.0.get_mut(key) {
            Some(item) => *item = Item::Value(new),
            None => {
                self.0.insert(key, Item::Value(new));
            }
        }
    }
}

/// Rounded to so many significant digits.
pub(crate) fn digits(number: f64, count: i32) -> f64 {
    if number == 0.0 || !number.is_finite() {
        return number;
    }
    let places = count - 1 - libm::floor(libm::log10(number.abs())) as i32;
    // Through text, so that the file shows no more digits than are meant.
    let text = format!("{number:.*}", places.max(0) as usize);
    if places >= 0 {
        text.parse().unwrap_or(number)
    } else {
        let scale = libm::pow(10.0, f64::from(-places));
        libm::round(number / scale) * scale
    }
}

/// Writes gains, model and compensations of one axis, whose drive has this dead time.
pub fn settings(
    document: &mut DocumentMut,
    machine: &Machine,
    index: usize,
    dead_time_scans: f64,
    found: &Found,
    lost_motion_um: Option<f64>,
    method: &str,
) {
    let known = machine.axes.get(index);
    let Some((axis, known)) = axes(document).nth(index).zip(known) else {
        return;
    };
    let of_axis = Timing::of(machine, known);
    let timing = match known.drive_mode {
        DriveMode::Position => of_axis,
        DriveMode::Velocity | DriveMode::Torque => Timing {
            dead_time_scans,
            ..of_axis
        },
    };
    loops(axis, &timing, found.mass_kg(), known.kind);
    feed_forward(axis, &timing);
    reversal(axis, &timing, found, (lost_motion_um, known.kind), method);
    torque(axis, &timing, found, method);
    model(axis, found);
    if known.gravity.is_some() {
        gravity(axis, found);
    }
    let known_table = known.model.and_then(|model| model.table);
    match (&found.table, lost_motion_um, known_table) {
        (Some(found), _, _) => table_model(axis, found, timing.scan_s),
        (None, Some(lost_um), Some(known)) => {
            let wound_um = 2.0 * known.coulomb_n / known.stiffness_n_per_um;
            let gap_um = digits((lost_um - wound_um).max(0.0), 3);
            let why = "lost motion, as reported, less 2·F_table/k";
            Keys::of(axis, &["model", "table"]).set("gap_um", gap_um, why);
        }
        _ => {}
    }
}

/// What moves, in words: of a rotary axis its moment of inertia, not the mass of the slide that stands for it.
fn mass_words(kind: AxisKind, mass_kg: f64) -> String {
    match kind {
        AxisKind::Linear => format!("{mass_kg:.0} kg"),
        AxisKind::Rotary => format!("{} kg·m²", digits(mass_kg / (N_PER_NM * N_PER_NM), 4)),
    }
}

/// A force in words: of a rotary axis the torque about it.
fn force_words(kind: AxisKind, force_n: f64) -> String {
    match kind {
        AxisKind::Linear => format!("{force_n:.0} N"),
        AxisKind::Rotary => format!("{} N·m", digits(force_n / N_PER_NM, 4)),
    }
}

fn loops(axis: &mut Table, timing: &Timing, mass_kg: f64, kind: AxisKind) {
    let bandwidth_rad_s = timing.velocity_bandwidth_rad_s();
    let less = if timing.dead_time_scans > 1.0 {
        format!(", less for a dead time of {} scans", timing.dead_time_scans)
    } else {
        String::new()
    };
    // The position loop of a drive that closes it is the drive's own.
    if timing.drive_mode != DriveMode::Position {
        let gain_per_s = digits(timing.position_gain_per_s(), 4);
        let why =
            format!("tune: Kp, a sixth of the velocity loop's {bandwidth_rad_s:.0} rad/s{less}");
        Keys::of(axis, &["position_loop"]).set("gain_per_s", gain_per_s, &why);
    }
    let mut velocity = Keys::of(axis, &["velocity_loop"]);
    let gain = digits(timing.velocity_gain_n_s_per_m(mass_kg), 4);
    let mass = mass_words(kind, mass_kg);
    let why = format!("tune: Kv = {mass} · {bandwidth_rad_s:.0} rad/s");
    velocity.set("gain_n_s_per_m", gain, &why);
    let integral_time_ms = digits(timing.integral_time_ms(), 4);
    let why = format!("tune: Ti, three times 1/({bandwidth_rad_s:.0} rad/s)");
    velocity.set("integral_time_ms", integral_time_ms, &why);
}

fn feed_forward(axis: &mut Table, timing: &Timing) {
    let why = match timing.drive_mode {
        DriveMode::Velocity => format!(
            "tune: {} scans less the drive's period, for torque is fed forward",
            timing.way_scans()
        ),
        DriveMode::Torque => "tune: half a scan, for torque is fed forward".into(),
        DriveMode::Position => "tune: a scan, for torque is fed forward".into(),
    };
    let mut forward = Keys::of(axis, &["feed_forward"]);
    forward.set("enabled", true, "");
    forward.set("coefficient", 1.0, "");
    let advance_ms = digits(timing.advance_with_torque_ms(), 4);
    forward.set("advance_ms", advance_ms, &why);
}

fn reversal(
    axis: &mut Table,
    timing: &Timing,
    found: &Found,
    (lost_motion_um, kind): (Option<f64>, AxisKind),
    method: &str,
) {
    let force = force_words(kind, found.coulomb_n());
    let mut reversal = Keys::of(axis, &["reversal"]);
    let why = "tune: none | backlash | friction-pulse | contact-force";
    reversal.set("method", method, why);
    if found.table.is_some() {
        let lost_um = digits(found.lost_motion_um(), 3);
        reversal.set(
            "backlash_um",
            lost_um,
            "tune: lost motion: gap + 2·F_table/k",
        );
    } else if let Some(lost_um) = lost_motion_um {
        reversal.set("backlash_um", lost_um, "lost motion, as reported");
    }
    reversal.set("shape", "decaying", "");
    let why = format!("tune: 2F/Kv, F = {force}; for method = \"friction-pulse\"");
    reversal.set("pulse_mm_s", digits(timing.pulse_mm_s(found), 3), &why);
    let pulse_ms = digits(timing.integral_time_ms(), 4);
    reversal.set("pulse_ms", pulse_ms, "tune: Ti");
    let why = "tune: mean distance on which friction turns round";
    reversal.set("presliding_um", digits(laws::presliding_um(found), 2), why);
    let why = format!(
        "tune: 1/({:.0} rad/s) + 0.16 ms + {} scans",
        timing.velocity_bandwidth_rad_s(),
        timing.dead_time_scans + 1.0
    );
    reversal.set("lead_ms", digits(timing.lead_ms(), 2), &why);
}

fn torque(axis: &mut Table, timing: &Timing, found: &Found, method: &str) {
    let mut torque = Keys::of(axis, &["torque_feed_forward"]);
    let (friction, why) = match method {
        "friction-pulse" => (false, "the friction pulse makes up for it"),
        _ => (true, ""),
    };
    torque.set("acceleration", true, "");
    torque.set("viscous", true, "");
    torque.set("friction", friction, why);
    if friction {
        let why = "tune: friction is followed while the machine runs";
        Keys::of(axis, &["adaptation"]).set("mode", "on", why);
    } else {
        axis.remove("adaptation");
    }
    let observer_rad_s = timing.observer_rad_s();
    // It compares torque and motion of the same instant; beside a friction pulse it would make up for the same friction again.
    if observer_rad_s > 0.0 && found.torque_late_s == 0.0 && friction {
        let why = if timing.dead_time_scans > 1.0 {
            format!(
                "tune: 200 rad/s, less for a dead time of {} scans",
                timing.dead_time_scans
            )
        } else {
            "tune: where 2.5 scans are at most 0.15 of its time constant".into()
        };
        let observer_rad_s = digits(observer_rad_s, 3);
        Keys::of(axis, &["disturbance_observer"]).set("bandwidth_rad_s", observer_rad_s, &why);
    } else {
        axis.remove("disturbance_observer");
    }
}

fn model(axis: &mut Table, found: &Found) {
    let mut model = Keys::of(axis, &["model"]);
    let mass_kg = digits(found.mass_kg(), 4);
    model.set("mass_kg", mass_kg, "tune: torque over acceleration");
    let force_n = digits(found.coulomb_n(), 4);
    model.set("coulomb_n", force_n, "tune: all of it, at the table");
    let viscous = digits(found.viscous_n_s_per_m(), 4);
    model.set("viscous_n_s_per_m", viscous, "");
    curve(axis, &["model", "friction"], &found.motor);
}

/// The weight of an axis that has one: what the torque is off either way.
fn gravity(axis: &mut Table, found: &Found) {
    let mut gravity = Keys::of(axis, &["gravity"]);
    let force_n = digits(found.whole_structure().constant_n, 4);
    let why = "tune: mean of the torques up and down";
    gravity.set("force_n", force_n, why);
    for key in ["mass_kg", "counterbalance_n"] {
        gravity.0.remove(key);
    }
}

fn table_model(axis: &mut Table, found: &FoundTable, scan_s: f64) {
    let mut table = Keys::of(axis, &["model", "table"]);
    let mass_kg = digits(found.mass_kg, 3);
    table.set("mass_kg", mass_kg, "tune: wind-up over acceleration");
    table.set("coulomb_n", digits(found.friction.coulomb_n(), 4), "");
    // As exactly as that of the whole axis, of which it is a part.
    let viscous = digits(found.friction.viscous_n_s_per_m, 4);
    table.set("viscous_n_s_per_m", viscous, "");
    let stiffness = digits(found.stiffness_n_per_um, 3);
    table.set("stiffness_n_per_um", stiffness, "tune: torque over wind-up");
    let gap_um = digits(found.gap_um, 3);
    table.set("gap_um", gap_um, "tune: wind-up without torque");
    let why = "tune: three scans, at least 2 ms";
    table.set("traversal_ms", laws::traversal_ms(scan_s), why);
    curve(axis, &["model", "table", "friction"], &found.friction);
}

/// The model of an axis as tables of a machine file.
pub fn model_alone(found: &Found) -> String {
    let mut axis = Table::new();
    model(&mut axis, found);
    if let Some(of_table) = &found.table {
        table_model(&mut axis, of_table, 1e-3);
    }
    let mut axes = toml_edit::ArrayOfTables::new();
    axes.push(axis);
    let mut document = DocumentMut::new();
    document.insert("axis", Item::ArrayOfTables(axes));
    document.to_string().replacen("[[axis]]\n", "", 1)
}

/// Writes one friction curve.
fn curve(axis: &mut Table, path: &[&str], friction: &Friction) {
    let array =
        |values: [f64; ELEMENTS]| -> Value { Value::Array(values.into_iter().collect::<Array>()) };
    let mut curve = Keys::of(axis, path);
    let why = "tune: reversals, non-negative least squares";
    curve.set("share", array(laws::shares(friction)), why);
    curve.set("break_um", array(BREAK_UM), "");
    let static_ratio = digits(friction.static_ratio, 3);
    curve.set("static_ratio", static_ratio, "tune: steady speeds");
    curve.set("stribeck_mm_s", digits(friction.stribeck_mm_s, 3), "");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_rotary_axis_moves_is_said_about_the_axis_and_not_as_the_slide_that_stands_for_it() {
        let kg = 2.5 * N_PER_NM * N_PER_NM;
        assert_eq!(mass_words(AxisKind::Rotary, kg), "2.5 kg·m²");
        assert_eq!(mass_words(AxisKind::Linear, 864.4), "864 kg");
        assert_eq!(force_words(AxisKind::Rotary, 10.95 * N_PER_NM), "10.95 N·m");
        assert_eq!(force_words(AxisKind::Linear, 450.6), "451 N");
    }
}
