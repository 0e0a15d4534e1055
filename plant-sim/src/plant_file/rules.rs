//! The rules of the plant file, each a line: key, value, unit, range.

use machine::settings_file::{At, Rules, SettingsFileError};

use super::{PlantAxis, PlantFile};
use crate::friction::{ELEMENTS, FrictionParameters};

/// Letters an axis can have, as in the machine file.
const AXIS_LETTERS: &str = "XYZABCUVW";
/// Highest natural frequency times microstep, in rad. Semi-implicit Euler is stable below 2; at 0.2 the frequency is
/// right within 0.2 %.
const PHASE_PER_MICROSTEP_RAD_MAX: f64 = 0.2;
/// Highest damping rate times microstep.
const DECAY_PER_MICROSTEP_MAX: f64 = 0.2;
/// How far the shares may miss 1.
const SHARE_TOLERANCE: f64 = 1e-9;

/// Checks every rule of the plant file.
///
/// # Errors
/// Every rule that is broken, in the order of the file.
pub fn judge(name: &str, text: &str, plant: &PlantFile) -> Result<(), SettingsFileError> {
    let mut rules = Rules::of(name, text);
    rules.between(
        &["microstep_us"],
        None,
        plant.microstep_us,
        "µs",
        1.0,
        250.0,
    );
    let rest_ns = plant.microstep_us * 1e3 - libm::round(plant.microstep_us * 1e3);
    if rest_ns.abs() > 1e-6 {
        rules.say(
            &["microstep_us"],
            None,
            &format!(
                "= {} µs: must be a whole number of nanoseconds",
                plant.microstep_us
            ),
        );
    }
    rules.between(&["ambient_c"], None, plant.ambient_c, "°C", -20.0, 60.0);
    if plant.axes.is_empty() {
        rules.say(&["axis"], None, "is empty: a machine has at least 1 axis");
    }
    for (index, axis) in plant.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        let mut letters = axis.name.chars();
        let single = letters.next().filter(|_| letters.next().is_none());
        if !single.is_some_and(|c| AXIS_LETTERS.contains(c)) {
            rules.say(
                &["name"],
                at,
                &format!("= {:?}: must be one of {AXIS_LETTERS}", axis.name),
            );
        }
        if plant
            .axes
            .iter()
            .take(index)
            .any(|other| other.name == axis.name)
        {
            rules.say(
                &["name"],
                at,
                &format!("= {:?}: another axis has this name", axis.name),
            );
        }
        axis_values(&mut rules, at, axis);
    }
    // Only what is right by itself can be judged against the microstep.
    if rules.all_kept() {
        for (index, axis) in plant.axes.iter().enumerate() {
            microstep(
                &mut rules,
                Some((index, axis.name.as_str())),
                axis,
                plant.microstep_us,
            );
        }
    }
    rules.judge()
}

#[rustfmt::skip] // a table
fn axis_values(rules: &mut Rules, at: At, axis: &PlantAxis) {
    let (motor, screw, table) = (&axis.motor, &axis.screw, &axis.table);
    rules.between(&["start_position_mm"], at, axis.start_position_mm, "mm", -1e5, 1e5);

    rules.between(&["motor", "rated_torque_nm"], at, motor.rated_torque_nm, "N·m", 1e-3, 1e5);
    rules.between(&["motor", "peak_torque_nm"], at, motor.peak_torque_nm, "N·m", 1e-3, 1e6);
    rules.at_least(&["motor", "peak_torque_nm"], at, motor.peak_torque_nm, "N·m", "rated_torque_nm", motor.rated_torque_nm);
    rules.between(&["motor", "inertia_kg_m2"], at, motor.inertia_kg_m2, "kg·m²", 1e-7, 100.0);
    rules.between(&["motor", "current_loop_hz"], at, motor.current_loop_hz, "Hz", 10.0, 1e5);
    rules.between(&["motor", "cogging_torque_nm"], at, motor.cogging_torque_nm, "N·m", 0.0, motor.rated_torque_nm);
    rules.between(&["motor", "cogging_per_turn"], at, motor.cogging_per_turn.into(), "per turn", 1.0, 1000.0);
    rules.between(&["motor", "encoder_counts_per_turn"], at, motor.encoder_counts_per_turn.into(), "counts", 16.0, 4_294_967_295.0);
    rules.between(&["motor", "winding_rise_at_rated_k"], at, motor.winding_rise_at_rated_k, "K", 1.0, 300.0);
    rules.between(&["motor", "winding_time_constant_min"], at, motor.winding_time_constant_min, "min", 0.1, 1000.0);

    let f = &motor.friction;
    rules.between(&["motor", "friction", "coulomb_torque_nm"], at, f.coulomb_torque_nm, "N·m", 1e-6, motor.peak_torque_nm);
    rules.between(&["motor", "friction", "static_torque_nm"], at, f.static_torque_nm, "N·m", 1e-6, motor.peak_torque_nm);
    rules.at_least(&["motor", "friction", "static_torque_nm"], at, f.static_torque_nm, "N·m", "coulomb_torque_nm", f.coulomb_torque_nm);
    rules.between(&["motor", "friction", "viscous_nm_s_per_rad"], at, f.viscous_nm_s_per_rad, "N·m·s/rad", 0.0, 10.0);
    contact(rules, at, "motor", &f.element_share, &f.break_distance_um,
        [f.stribeck_velocity_mm_s, f.presliding_damping_n_s_per_m, f.attraction_ms]);

    rules.between(&["screw", "lead_mm"], at, screw.lead_mm, "mm", 0.1, 1000.0);
    rules.between(&["screw", "stiffness_n_per_m"], at, screw.stiffness_n_per_m, "N/m", 1e4, 1e10);
    rules.between(&["screw", "damping_ratio"], at, screw.damping_ratio, "", 0.0, 1.0);
    rules.between(&["screw", "gap_um"], at, screw.gap_um, "µm", 0.0, 1000.0);

    rules.between(&["table", "mass_kg"], at, table.mass_kg, "kg", 0.1, 1e5);
    let f = &table.friction;
    rules.between(&["table", "friction", "coulomb_n"], at, f.coulomb_n, "N", 1e-3, 1e5);
    rules.between(&["table", "friction", "static_n"], at, f.static_n, "N", 1e-3, 1e5);
    rules.at_least(&["table", "friction", "static_n"], at, f.static_n, "N", "coulomb_n", f.coulomb_n);
    rules.between(&["table", "friction", "viscous_n_s_per_m"], at, f.viscous_n_s_per_m, "N·s/m", 0.0, 1e6);
    contact(rules, at, "table", &f.element_share, &f.break_distance_um,
        [f.stribeck_velocity_mm_s, f.presliding_damping_n_s_per_m, f.attraction_ms]);

    if let Some(scale) = &axis.scale {
        rules.between(&["scale", "resolution_nm"], at, scale.resolution_nm, "nm", 0.01, 1e6);
    }
}

#[rustfmt::skip] // a table
fn contact(rules: &mut Rules, at: At, side: &str, share: &[f64; ELEMENTS], distance_um: &[f64; ELEMENTS],
    [stribeck_velocity_mm_s, presliding_damping_n_s_per_m, attraction_ms]: [f64; 3]) {
    rules.between(&[side, "friction", "stribeck_velocity_mm_s"], at, stribeck_velocity_mm_s, "mm/s", 1e-3, 1e3);
    rules.between(&[side, "friction", "presliding_damping_n_s_per_m"], at, presliding_damping_n_s_per_m, "N·s/m", 0.0, 1e7);
    rules.between(&[side, "friction", "attraction_ms"], at, attraction_ms, "ms", 0.01, 100.0);
    for value in share {
        rules.between(&[side, "friction", "element_share"], at, *value, "", 0.0, 1.0);
    }
    for value in distance_um {
        rules.between(&[side, "friction", "break_distance_um"], at, *value, "µm", 1e-3, 1e4);
    }
    let sum: f64 = share.iter().sum();
    let fits = (sum - 1.0).abs() <= SHARE_TOLERANCE;
    if !fits {
        rules.say(&[side, "friction", "element_share"], at, &format!("= {share:?}: the sum must be 1, not {sum}"));
    }
}

/// Stiffness of all elements while they stick, in N/m.
fn presliding_stiffness_n_per_m(friction: &FrictionParameters) -> f64 {
    friction
        .share
        .iter()
        .zip(&friction.break_distance_m)
        .map(|(share, distance_m)| share * friction.coulomb_n / distance_m)
        .sum()
}

/// Whether the microstep resolves the stiffest vibration and the fastest decay of each mass, by the bound of one
/// mass on all its springs: `h·sqrt(k/m)` and `h·c/m`.
fn microstep(rules: &mut Rules, at: At, axis: &PlantAxis, microstep_us: f64) {
    let m = axis.mechanics();
    let step_s = microstep_us * 1e-6;
    for (side, mass_kg, friction) in [
        ("motor", m.motor_mass_kg, &m.motor_friction),
        ("table", m.table_mass_kg, &m.table_friction),
    ] {
        let spring_n_per_m = m.stiffness_n_per_m + presliding_stiffness_n_per_m(friction);
        let damper_n_s_per_m = m.damping_n_s_per_m
            + friction.presliding_damping_n_s_per_m
            + friction.viscous_n_s_per_m;
        let phase_rad = step_s * (spring_n_per_m / mass_kg).sqrt();
        let decay = step_s * damper_n_s_per_m / mass_kg;
        let fits_us = microstep_us
            * (PHASE_PER_MICROSTEP_RAD_MAX / phase_rad).min(DECAY_PER_MICROSTEP_MAX / decay);
        let fits = phase_rad <= PHASE_PER_MICROSTEP_RAD_MAX && decay <= DECAY_PER_MICROSTEP_MAX;
        if !fits {
            let whose = at.map_or("", |(_, name)| name);
            rules.say(
                &["microstep_us"],
                None,
                &format!(
                    "= {microstep_us} µs: too long for the {side} of axis {whose} \
                     ({spring_n_per_m:.3e} N/m and {damper_n_s_per_m:.3e} N·s/m on {mass_kg:.4} kg): \
                     must be at most {fits_us:.3} µs"
                ),
            );
        }
    }
}
