//! Edits of the machine file that keep everything else as it is.

use machine::{DriveMode, Machine};
use toml_edit::{Array, DocumentMut, Item, Table, Value, table, value};

use super::identify::{BREAK_UM, ELEMENTS, Found, Friction};
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

/// Sets a value and says where it comes from.
fn set(table: &mut Table, key: &str, new: impl Into<Value>, why: &str) {
    let mut new = new.into();
    if !why.is_empty() {
        new.decor_mut().set_prefix(" ");
        new.decor_mut().set_suffix(format!("  # {why}"));
    }
    match table.get_mut(key) {
        Some(item) => *item = Item::Value(new),
        None => {
            table.insert(key, Item::Value(new));
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
    let tuned = "tune:";
    let mass_kg = found.mass_kg();
    set(
        inner(axis, &["position_loop"]),
        "gain_per_s",
        laws::POSITION_GAIN_PER_S,
        &format!("{tuned} Kp, a sixth of the velocity loop's 300 rad/s"),
    );
    let velocity = inner(axis, &["velocity_loop"]);
    set(
        velocity,
        "gain_n_s_per_m",
        digits(laws::velocity_gain_n_s_per_m(mass_kg), 4),
        &format!("{tuned} Kv = {mass_kg:.0} kg · 300 rad/s"),
    );
    set(
        velocity,
        "integral_time_ms",
        laws::INTEGRAL_TIME_MS,
        &format!("{tuned} Ti, three times 1/(300 rad/s)"),
    );
    let known = machine.axes.get(index);
    let drive_mode = known.map_or(DriveMode::Velocity, |known| known.drive_mode);
    let drive_period_s = known.map_or(0.0, |known| f64::from(known.velocity_loop.period_us) * 1e-6);
    let advance_ms = laws::advance_with_torque_ms(scan_s, drive_mode, drive_period_s);
    let advance_words = match drive_mode {
        DriveMode::Velocity => "2.5 scans less the drive's period, for torque is fed forward",
        DriveMode::Torque => "half a scan, for torque is fed forward",
    };
    let forward = inner(axis, &["feed_forward"]);
    set(forward, "enabled", true, "");
    set(forward, "coefficient", 1.0, "");
    set(
        forward,
        "advance_ms",
        digits(advance_ms, 4),
        &format!("{tuned} {advance_words}"),
    );
    let force_n = found.coulomb_n();
    let reversal = inner(axis, &["reversal"]);
    set(
        reversal,
        "method",
        method,
        &format!("{tuned} none | backlash | kick | contact-force"),
    );
    if found.table.is_some() {
        set(
            reversal,
            "backlash_um",
            digits(found.lost_motion_um(), 3),
            &format!("{tuned} lost motion: gap + 2·F_table/k"),
        );
    } else if let Some(lost_um) = lost_motion_um {
        set(reversal, "backlash_um", lost_um, "lost motion, as told");
    }
    set(reversal, "shape", "decaying", "");
    set(
        reversal,
        "kick_mm_s",
        digits(laws::kick_mm_s(found), 3),
        &format!("{tuned} 2F/Kv, F = {force_n:.0} N; for method = \"kick\""),
    );
    set(
        reversal,
        "kick_ms",
        laws::INTEGRAL_TIME_MS,
        &format!("{tuned} Ti"),
    );
    set(
        reversal,
        "presliding_um",
        digits(laws::presliding_um(found), 2),
        &format!("{tuned} mean distance on which friction turns round"),
    );
    set(
        reversal,
        "lead_ms",
        digits(laws::lead_ms(scan_s), 2),
        &format!("{tuned} 1/(300 rad/s) + 0.16 ms + 2 scans"),
    );
    let friction = method != "kick";
    let torque = inner(axis, &["torque_feed_forward"]);
    set(torque, "acceleration", true, "");
    set(torque, "viscous", true, "");
    set(
        torque,
        "friction",
        friction,
        if friction {
            ""
        } else {
            "the kick makes up for it"
        },
    );
    let observer_rad_s = laws::observer_rad_s(scan_s);
    if observer_rad_s > 0.0 {
        set(
            inner(axis, &["disturbance_observer"]),
            "bandwidth_rad_s",
            observer_rad_s,
            &format!("{tuned} where 2.5 scans are at most 0.15 of its time constant"),
        );
    } else {
        axis.remove("disturbance_observer");
    }
    let model = inner(axis, &["model"]);
    set(
        model,
        "mass_kg",
        digits(mass_kg, 4),
        &format!("{tuned} torque over acceleration"),
    );
    set(
        model,
        "coulomb_n",
        digits(force_n, 4),
        &format!("{tuned} all of it, at the table"),
    );
    set(
        model,
        "viscous_n_s_per_m",
        digits(found.viscous_n_s_per_m(), 4),
        "",
    );
    curve(inner(axis, &["model", "friction"]), &found.motor);
    if let Some(found) = &found.table {
        let table = inner(axis, &["model", "table"]);
        set(
            table,
            "mass_kg",
            digits(found.mass_kg, 3),
            &format!("{tuned} wind-up over acceleration"),
        );
        set(
            table,
            "coulomb_n",
            digits(found.friction.coulomb_n(), 4),
            "",
        );
        set(
            table,
            "viscous_n_s_per_m",
            digits(found.friction.viscous_n_s_per_m, 3),
            "",
        );
        set(
            table,
            "stiffness_n_per_um",
            digits(found.stiffness_n_per_um, 3),
            &format!("{tuned} torque over wind-up"),
        );
        set(
            table,
            "gap_um",
            digits(found.gap_um, 3),
            &format!("{tuned} wind-up without torque"),
        );
        set(
            table,
            "crossing_ms",
            laws::crossing_ms(scan_s),
            &format!("{tuned} three scans, at least 2 ms"),
        );
        curve(
            inner(axis, &["model", "table", "friction"]),
            &found.friction,
        );
    } else if let (Some(lost_um), Some(known)) = (
        lost_motion_um,
        machine.axes.get(index).and_then(|a| a.model?.table),
    ) {
        let wound_um = 2.0 * known.coulomb_n / known.stiffness_n_per_um;
        set(
            inner(axis, &["model", "table"]),
            "gap_um",
            digits((lost_um - wound_um).max(0.0), 3),
            "lost motion, as told, less 2·F_table/k",
        );
    }
}

/// Writes one friction curve.
fn curve(table: &mut Table, friction: &Friction) {
    let array =
        |values: [f64; ELEMENTS]| -> Value { Value::Array(values.into_iter().collect::<Array>()) };
    set(
        table,
        "share",
        array(laws::shares(friction)),
        "tune: reversals, non-negative least squares",
    );
    set(table, "break_um", array(BREAK_UM), "");
    set(
        table,
        "static_ratio",
        digits(friction.static_ratio, 3),
        "tune: steady speeds",
    );
    set(
        table,
        "stribeck_mm_s",
        digits(friction.stribeck_mm_s, 3),
        "",
    );
}
