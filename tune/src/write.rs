//! Edits of the machine file that keep everything else as it is.

use machine::{Axis, DriveMode, Machine};
use toml_edit::{Array, DocumentMut, Item, Table, Value, table, value};

use super::identify::{BREAK_UM, ELEMENTS, Found, Friction, Table as FoundTable};
use super::laws;

/// Largest increment, as a part of what one scan of acceleration changes the step by.
const ROUNDING_PART: f64 = 0.1;

/// The tables of the axes.
fn axes(document: &mut DocumentMut) -> impl Iterator<Item = &mut Table> {
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
    let advance_ms = laws::advance_ms(machine.scan_period_s());
    for axis in axes(document) {
        inner(axis, &["reversal"]).insert("method", value("none"));
        for key in [
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
pub fn gains(document: &mut DocumentMut, index: usize, mass_kg: f64) {
    if let Some(axis) = axes(document).nth(index) {
        inner(axis, &["position_loop"]).insert("gain_per_s", value(laws::POSITION_GAIN_PER_S));
        let velocity = inner(axis, &["velocity_loop"]);
        velocity.insert(
            "gain_n_s_per_m",
            value(laws::velocity_gain_n_s_per_m(mass_kg)),
        );
        velocity.insert("integral_time_ms", value(laws::INTEGRAL_TIME_MS));
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
pub fn acceleration(document: &mut DocumentMut, machine: &Machine, acceleration_mm_s2: f64) {
    let scan_s = machine.scan_period_s();
    for (axis, known) in axes(document).zip(&machine.axes) {
        let acceleration_mm_s2 = known.acceleration_mm_s2.min(acceleration_mm_s2);
        axis.insert("acceleration_mm_s2", value(acceleration_mm_s2));
        // Rounded to increments it must still look smooth.
        let step_nm = acceleration_mm_s2 * scan_s * scan_s * 1e6;
        let increment_nm = known.increment_nm.min(ROUNDING_PART * step_nm);
        axis.insert("increment_nm", value(increment_nm));
    }
}

/// The keys of one table of an axis.
struct Keys<'a>(&'a mut Table);

impl Keys<'_> {
    /// Of the table of this path, made where it is missing.
    fn of<'a>(axis: &'a mut Table, path: &[&str]) -> Keys<'a> {
        Keys(inner(axis, path))
    }

    /// Sets a value and notes behind it where it comes from.
    fn set(&mut self, key: &str, new: impl Into<Value>, why: &str) {
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
fn digits(number: f64, count: i32) -> f64 {
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

/// Writes gains, model and compensations of one axis.
pub fn settings(
    document: &mut DocumentMut,
    machine: &Machine,
    index: usize,
    found: &Found,
    lost_motion_um: Option<f64>,
    method: &str,
) {
    let scan_s = machine.scan_period_s();
    let Some(axis) = axes(document).nth(index) else {
        return;
    };
    let known = machine.axes.get(index);
    loops(axis, found.mass_kg());
    feed_forward(axis, known, scan_s);
    reversal(axis, found, scan_s, lost_motion_um, method);
    let mut torque = Keys::of(axis, &["torque_feed_forward"]);
    let (friction, why) = match method {
        "friction-pulse" => (false, "the friction pulse makes up for it"),
        _ => (true, ""),
    };
    torque.set("acceleration", true, "");
    torque.set("viscous", true, "");
    torque.set("friction", friction, why);
    let observer_rad_s = laws::observer_rad_s(scan_s);
    if observer_rad_s > 0.0 {
        let why = "tune: where 2.5 scans are at most 0.15 of its time constant";
        Keys::of(axis, &["disturbance_observer"]).set("bandwidth_rad_s", observer_rad_s, why);
    } else {
        axis.remove("disturbance_observer");
    }
    model(axis, found);
    let known_table = known.and_then(|known| known.model?.table);
    match (&found.table, lost_motion_um, known_table) {
        (Some(found), _, _) => table_model(axis, found, scan_s),
        (None, Some(lost_um), Some(known)) => {
            let wound_um = 2.0 * known.coulomb_n / known.stiffness_n_per_um;
            let gap_um = digits((lost_um - wound_um).max(0.0), 3);
            let why = "lost motion, as told, less 2·F_table/k";
            Keys::of(axis, &["model", "table"]).set("gap_um", gap_um, why);
        }
        _ => {}
    }
}

fn loops(axis: &mut Table, mass_kg: f64) {
    Keys::of(axis, &["position_loop"]).set(
        "gain_per_s",
        laws::POSITION_GAIN_PER_S,
        "tune: Kp, a sixth of the velocity loop's 300 rad/s",
    );
    let mut velocity = Keys::of(axis, &["velocity_loop"]);
    let gain = digits(laws::velocity_gain_n_s_per_m(mass_kg), 4);
    let why = format!("tune: Kv = {mass_kg:.0} kg · 300 rad/s");
    velocity.set("gain_n_s_per_m", gain, &why);
    let why = "tune: Ti, three times 1/(300 rad/s)";
    velocity.set("integral_time_ms", laws::INTEGRAL_TIME_MS, why);
}

fn feed_forward(axis: &mut Table, known: Option<&Axis>, scan_s: f64) {
    let drive_mode = known.map_or(DriveMode::Velocity, |known| known.drive_mode);
    let drive_period_s = known.map_or(0.0, |known| f64::from(known.velocity_loop.period_us) * 1e-6);
    let advance_ms = laws::advance_with_torque_ms(scan_s, drive_mode, drive_period_s);
    let why = match drive_mode {
        DriveMode::Velocity => "tune: 2.5 scans less the drive's period, for torque is fed forward",
        DriveMode::Torque => "tune: half a scan, for torque is fed forward",
    };
    let mut forward = Keys::of(axis, &["feed_forward"]);
    forward.set("enabled", true, "");
    forward.set("coefficient", 1.0, "");
    forward.set("advance_ms", digits(advance_ms, 4), why);
}

fn reversal(
    axis: &mut Table,
    found: &Found,
    scan_s: f64,
    lost_motion_um: Option<f64>,
    method: &str,
) {
    let force_n = found.coulomb_n();
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
        reversal.set("backlash_um", lost_um, "lost motion, as told");
    }
    reversal.set("shape", "decaying", "");
    let why = format!("tune: 2F/Kv, F = {force_n:.0} N; for method = \"friction-pulse\"");
    reversal.set("pulse_mm_s", digits(laws::pulse_mm_s(found), 3), &why);
    reversal.set("pulse_ms", laws::INTEGRAL_TIME_MS, "tune: Ti");
    let why = "tune: mean distance on which friction turns round";
    reversal.set("presliding_um", digits(laws::presliding_um(found), 2), why);
    let why = "tune: 1/(300 rad/s) + 0.16 ms + 2 scans";
    reversal.set("lead_ms", digits(laws::lead_ms(scan_s), 2), why);
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

fn table_model(axis: &mut Table, found: &FoundTable, scan_s: f64) {
    let mut table = Keys::of(axis, &["model", "table"]);
    let mass_kg = digits(found.mass_kg, 3);
    table.set("mass_kg", mass_kg, "tune: wind-up over acceleration");
    table.set("coulomb_n", digits(found.friction.coulomb_n(), 4), "");
    let viscous = digits(found.friction.viscous_n_s_per_m, 3);
    table.set("viscous_n_s_per_m", viscous, "");
    let stiffness = digits(found.stiffness_n_per_um, 3);
    table.set("stiffness_n_per_um", stiffness, "tune: torque over wind-up");
    let gap_um = digits(found.gap_um, 3);
    table.set("gap_um", gap_um, "tune: wind-up without torque");
    let why = "tune: three scans, at least 2 ms";
    table.set("traversal_ms", laws::traversal_ms(scan_s), why);
    curve(axis, &["model", "table", "friction"], &found.friction);
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
