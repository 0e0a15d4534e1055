//! The rules of the plant file that relate several keys. What concerns one key alone is at the key.

use machine::settings_file::{At, Rules};

use crate::friction::{ELEMENTS, FrictionParameters};
use crate::plant_file::keys::{PlantAxis, PlantFile, PlantInput, PlantProbe};

/// Highest natural frequency times microstep, in rad. Semi-implicit Euler is stable below 2; at 0.2 the frequency is
/// right within 0.2 %.
const PHASE_PER_MICROSTEP_RAD_MAX: f64 = 0.2;
/// Highest damping rate times microstep.
const DECAY_PER_MICROSTEP_MAX: f64 = 0.2;
/// How far the shares may miss 1.
const SHARE_TOLERANCE: f64 = 1e-9;

/// Checks every rule of the plant file.
pub fn judge(rules: &mut Rules<'_>, plant: &PlantFile) {
    let step_us = plant.microstep_us;
    let rest_ns = step_us * 1e3 - libm::round(step_us * 1e3);
    if rest_ns.abs() > 1e-6 {
        let what = format!("= {step_us} µs: must be a whole number of nanoseconds");
        rules.say(&["microstep_us"], None, &what);
    }
    for (index, axis) in plant.axes.iter().enumerate() {
        let at = Some((index, axis.name.as_str()));
        if plant.axes.iter().take(index).any(|a| a.name == axis.name) {
            let what = format!("= {:?}: another axis has this name", axis.name);
            rules.say(&["name"], at, &what);
        }
        motor(rules, at, axis);
        let friction = &axis.table.friction;
        let path = ["table", "friction", "static_n"];
        rules.at_least(
            &path,
            at,
            friction.static_n,
            "N",
            "coulomb_n",
            friction.coulomb_n,
        );
        shares(rules, at, "motor", &axis.motor.friction.element_share);
        shares(rules, at, "table", &friction.element_share);
    }
    if let Some(probe) = &plant.probe {
        bodies(rules, probe);
    }
    for (index, input) in plant.inputs.iter().enumerate() {
        input_line(rules, index, input);
    }
    // Only what is right by itself can be judged against the microstep.
    if rules.all_kept() {
        for (index, axis) in plant.axes.iter().enumerate() {
            microstep(rules, Some((index, axis.name.as_str())), axis, step_us);
        }
    }
}

/// Every body has a surface.
fn bodies(rules: &mut Rules<'_>, probe: &PlantProbe) {
    for (index, plane) in probe.planes.iter().enumerate() {
        if plane.normal == [0.0; 3] {
            let what = format!("of plane {}: a direction, such as [0, 0, 1]", index + 1);
            rules.say(&["probe", "plane"], None, &what);
        }
    }
    for (index, of_box) in probe.boxes.iter().enumerate() {
        let mut sides = of_box.low_mm.iter().zip(&of_box.high_mm);
        if sides.any(|(low, high)| low >= high) {
            let what = format!("{}: each of high_mm must be above low_mm", index + 1);
            rules.say(&["probe", "box"], None, &what);
        }
    }
    for (key, cylinders) in [("cylinder", &probe.cylinders), ("bore", &probe.bores)] {
        for (index, cylinder) in cylinders.iter().enumerate() {
            if cylinder.from_mm == cylinder.to_mm {
                let what = format!("{}: its two ends are one", index + 1);
                rules.say(&["probe", key], None, &what);
            }
        }
    }
}

fn input_line(rules: &mut Rules<'_>, index: usize, input: &PlantInput) {
    let line = index + 1;
    if input.digital.is_some() == input.analog.is_some() {
        let what = format!("{line}: one of digital and analog");
        rules.say(&["input"], None, &what);
    }
    if input.digital.is_some() && input.value != 0.0 && input.value != 1.0 {
        let what = format!(
            "{line}: value = {}: a digital input shows 0 or 1",
            input.value
        );
        rules.say(&["input"], None, &what);
    }
}

#[rustfmt::skip] // a table
fn motor(rules: &mut Rules<'_>, at: At<'_>, axis: &PlantAxis) {
    let (motor, f) = (&axis.motor, &axis.motor.friction);
    rules.at_least(&["motor", "peak_torque_nm"], at, motor.peak_torque_nm, "N·m", "rated_torque_nm", motor.rated_torque_nm);
    rules.between(&["motor", "cogging_torque_nm"], at, motor.cogging_torque_nm, "N·m", 0.0, motor.rated_torque_nm);
    rules.between(&["motor", "friction", "coulomb_torque_nm"], at, f.coulomb_torque_nm, "N·m", 1e-6, motor.peak_torque_nm);
    rules.between(&["motor", "friction", "static_torque_nm"], at, f.static_torque_nm, "N·m", 1e-6, motor.peak_torque_nm);
    rules.at_least(&["motor", "friction", "static_torque_nm"], at, f.static_torque_nm, "N·m", "coulomb_torque_nm", f.coulomb_torque_nm);
}

/// The elements share the whole friction.
fn shares(rules: &mut Rules<'_>, at: At<'_>, side: &str, share: &[f64; ELEMENTS]) {
    let sum: f64 = share.iter().sum();
    let fits = (sum - 1.0).abs() <= SHARE_TOLERANCE;
    if !fits {
        let what = format!("= {share:?}: the sum must be 1, not {sum}");
        rules.say(&[side, "friction", "element_share"], at, &what);
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
fn microstep(rules: &mut Rules<'_>, at: At<'_>, axis: &PlantAxis, microstep_us: f64) {
    let step_s = microstep_us * 1e-6;
    let m = axis.mechanics(step_s);
    for (side, mass_kg, friction) in [
        ("motor", m.motor_mass_kg, &m.motor_friction),
        ("table", m.table_mass_kg, &m.table_friction),
    ] {
        let spring_n_per_m = m.stiffness_n_per_m + presliding_stiffness_n_per_m(friction);
        let slips = axis
            .screw
            .hysteresis_n
            .iter()
            .zip(&axis.screw.hysteresis_um);
        let spring_n_per_m = slips.fold(spring_n_per_m, |sum, (n, um)| sum + n / (um * 1e-6));
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
