//! `[axis.simple]`: an axis by the few numbers that people know of theirs. The full tables follow from it.

use std::f64::consts::TAU;

use machine::settings_file::{At, Rules};
use machine::transmission;
use toml::{Table, Value, toml};

use crate::plant_file::keys::{PlantAxis, PlantSimple};

/// Break-away friction over Coulomb friction where the file has none.
const STATIC_RATIO: f64 = 1.3;
/// Peak torque over the continuous one where the file has none.
const PEAK_RATIO: f64 = 3.0;
/// Share of friction that is at the motor: bearings, nut and seals. About as on the reference machine (docs/methods/physics.md §3).
const MOTOR_SHARE: f64 = 0.5;

/// Lead for which the typical ways of friction at the motor are.
const TYPICAL_LEAD_MM: f64 = 10.0;
/// What of friction at the motor belongs to an angle of it.
const OF_MOTOR_ANGLES: [&str; 2] = ["stribeck_velocity_mm_s", "break_distance_um"];

/// Gives every axis with a simple table the full ones.
pub fn complete(file: &mut Table) {
    let axes = file.get_mut("axis").and_then(Value::as_array_mut);
    for axis in axes.into_iter().flatten().filter_map(Value::as_table_mut) {
        for name in ["simple", "screw"] {
            if let Some(inner) = axis.get_mut(name).and_then(Value::as_table_mut) {
                transmission::complete(inner);
            }
        }
        if let Some(full) = axis.get("simple").and_then(Value::as_table).and_then(full) {
            for (name, table) in full {
                axis.entry(name).or_insert(table);
            }
        }
    }
}

/// Motor, screw and table of a simple one; none if a key is missing in it.
fn full(simple: &Table) -> Option<Table> {
    let given = |key: &str| simple.get(key).and_then(transmission::number);
    let or = |key: &str, otherwise: f64| given(key).unwrap_or(otherwise);
    let rated_nm = given("rated_torque_nm")?;
    let (lead_mm, coulomb_n) = (given("lead_mm")?, given("coulomb_n")?);
    let static_n = or("static_n", STATIC_RATIO * coulomb_n);
    let viscous_n_s_per_m = or("viscous_n_s_per_m", 0.0);
    let radius_m = lead_mm * 1e-3 / TAU;
    let at_motor_nm = |force_n: f64| MOTOR_SHARE * force_n * radius_m;
    let at_table_n = |force_n: f64| (1.0 - MOTOR_SHARE) * force_n;
    let peak_nm = or("peak_torque_nm", PEAK_RATIO * rated_nm);
    let mut full = typical();
    let stiffness_n_per_m = or("stiffness_n_per_um", 120.0) * 1e6;
    let viscous_nm_s = at_motor_nm(viscous_n_s_per_m) * radius_m;
    for (path, value) in [
        ("motor.rated_torque_nm", rated_nm),
        ("motor.peak_torque_nm", peak_nm),
        ("motor.inertia_kg_m2", given("rotor_inertia_kg_m2")?),
        ("motor.friction.coulomb_torque_nm", at_motor_nm(coulomb_n)),
        ("motor.friction.static_torque_nm", at_motor_nm(static_n)),
        ("motor.friction.viscous_nm_s_per_rad", viscous_nm_s),
        ("screw.lead_mm", lead_mm),
        ("screw.stiffness_n_per_m", stiffness_n_per_m),
        ("screw.gap_um", or("gap_um", 0.0)),
        ("table.mass_kg", given("mass_kg")?),
        ("table.friction.coulomb_n", at_table_n(coulomb_n)),
        ("table.friction.static_n", at_table_n(static_n)),
        (
            "table.friction.viscous_n_s_per_m",
            at_table_n(viscous_n_s_per_m),
        ),
    ] {
        set(&mut full, path, value);
    }
    at_motor_angles(&mut full, lead_mm);
    Some(full)
}

/// What is typical of machines of this size (docs/methods/physics.md §3).
fn typical() -> Table {
    toml! {
        [motor]
        current_loop_hz = 1000.0
        cogging_torque_nm = 0.0
        cogging_per_turn = 12
        encoder_counts_per_turn = 1_048_576
        winding_rise_at_rated_k = 100.0
        winding_time_constant_min = 40.0

        [motor.friction]
        stribeck_velocity_mm_s = 3.0
        element_share = [0.35, 0.30, 0.20, 0.15]
        break_distance_um = [0.5, 2.0, 6.0, 20.0]
        presliding_damping_n_s_per_m = 1.5e4
        attraction_ms = 1.0

        [screw]
        damping_ratio = 0.08

        [table.friction]
        stribeck_velocity_mm_s = 3.0
        element_share = [0.35, 0.30, 0.20, 0.15]
        break_distance_um = [1.0, 4.0, 12.0, 40.0]
        presliding_damping_n_s_per_m = 6.0e3
        attraction_ms = 1.0
    }
}

/// Friction of the motor lets go after angles of it, which are other ways of the axis with another lead.
fn at_motor_angles(full: &mut Table, lead_mm: f64) {
    let times = lead_mm / TYPICAL_LEAD_MM;
    let friction = full
        .get_mut("motor")
        .and_then(|motor| motor.get_mut("friction"));
    let Some(friction) = friction.and_then(Value::as_table_mut) else {
        return;
    };
    for key in OF_MOTOR_ANGLES {
        match friction.get_mut(key) {
            Some(Value::Array(list)) => list.iter_mut().for_each(|one| multiply(one, times)),
            Some(one) => multiply(one, times),
            None => {}
        }
    }
}

fn multiply(value: &mut Value, times: f64) {
    if let Value::Float(one) = value {
        *one *= times;
    }
}

/// Sets the key at the end of this path, whose tables are there.
fn set(full: &mut Table, path: &str, value: f64) {
    let (tables, key) = path.rsplit_once('.').unwrap_or(("", path));
    let mut names = tables.split('.');
    let table = names.try_fold(full, |table, name| table.get_mut(name)?.as_table_mut());
    if let Some(table) = table {
        table.insert(key.into(), Value::Float(value));
    }
}

/// An axis is described once, and its break-away friction is not below the other.
pub fn judge(rules: &mut Rules<'_>, at: At<'_>, axis: &PlantAxis, simple: &PlantSimple) {
    let static_n = simple.static_n.unwrap_or(simple.coulomb_n);
    let path = ["simple", "static_n"];
    rules.at_least(&path, at, static_n, "N", "coulomb_n", simple.coulomb_n);
    let peak_nm = simple.peak_torque_nm.unwrap_or(simple.rated_torque_nm);
    let (path, rated_nm) = (["simple", "peak_torque_nm"], simple.rated_torque_nm);
    rules.at_least(&path, at, peak_nm, "N·m", "rated_torque_nm", rated_nm);
    for name in ["motor", "screw", "table"] {
        if rules.has(at, &[name]) {
            rules.say(
                &[name],
                at,
                "goes without `simple`: one of them describes the axis",
            );
        }
    }
    if let Some(of) = &simple.transmission {
        transmission::judge(rules, at, &["simple"], of, axis.kind);
    }
}
