//! The rules of the plant file that relate several keys. What concerns one key alone is at the key.

use machine::settings_file::{At, Rules};
use machine::transmission;

use crate::friction::{ELEMENTS, FrictionParameters};
use crate::plant_file::keys::{
    PlantAxis, PlantFile, PlantInput, PlantMeasuredFriction, PlantProbe,
};
use crate::plant_file::simple;
use crate::sliding_curve::SIDE_ROWS_MAX;

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
        if let Some(of) = &axis.simple {
            simple::judge(rules, at, axis, of);
        }
        bridge(rules, at, plant, axis);
        if let Some(of) = &axis.screw.transmission {
            transmission::judge(rules, at, &["screw"], of, axis.kind);
        }
        motor(rules, at, axis);
        let friction = &axis.table.friction;
        let (path, coulomb_n) = (["table", "friction", "static_n"], friction.coulomb_n);
        rules.at_least(&path, at, friction.static_n, "N", "coulomb_n", coulomb_n);
        shares(rules, at, "motor", &axis.motor.friction.element_share);
        shares(rules, at, "table", &friction.element_share);
        if let Some(measured) = &axis.measured_friction {
            measured_friction(rules, at, measured);
        }
        pitch_error(rules, at, axis);
        cross_talk(rules, at, plant, axis);
        if let Some(drive) = axis.drive_homing {
            if drive.speed_mm_s == 0.0 {
                let path = ["drive_homing", "speed_mm_s"];
                rules.say(&path, at, "= 0 mm/s: must not be 0");
            }
            if axis.encoder.is_none() {
                let what = "needs [axis.encoder]: an absolute encoder has nothing to home";
                rules.say(&["drive_homing"], at, what);
            }
        }
    }
    if let Some(probe) = &plant.probe {
        bodies(rules, probe);
    }
    for (index, input) in plant.inputs.iter().enumerate() {
        input_line(rules, index, input);
    }
    // Only what is right by itself can be judged against the microstep.
    if rules.all_kept() {
        plant
            .axes
            .iter()
            .for_each(|axis| microstep(rules, plant, axis));
    }
}

/// A bridge joins a second motor to its axis.
fn bridge(rules: &mut Rules<'_>, at: At<'_>, plant: &PlantFile, axis: &PlantAxis) {
    if axis.bridge.is_some() && plant.bridged(axis).is_none() {
        let what = format!(
            "needs the name of a second motor, such as \"X2\" with another axis \"X\": {:?} is none, or its axis is not there",
            axis.name
        );
        rules.say(&["bridge"], at, &what);
    }
}

/// A curve can be made of the rows.
fn measured_friction(rules: &mut Rules<'_>, at: At<'_>, measured: &PlantMeasuredFriction) {
    let (speeds, forces) = (&measured.speed_mm_s, &measured.force_n);
    let mut say = |key: &str, what: &str| rules.say(&["measured_friction", key], at, what);
    if !speeds.is_sorted_by(|a, b| a < b) || speeds.contains(&0.0) {
        say(
            "speed_mm_s",
            &format!("= {speeds:?} mm/s: must rise, and none must be 0"),
        );
    }
    for (direction, sign) in [("positive", 1.0), ("negative", -1.0)] {
        let rows = speeds.iter().filter(|speed| *speed * sign > 0.0).count();
        if !(1..=SIDE_ROWS_MAX).contains(&rows) {
            let what = format!(
                "has {rows} speeds in {direction} direction: must be at least 1 and at most {SIDE_ROWS_MAX}"
            );
            say("speed_mm_s", &what);
        }
    }
    if forces.len() != speeds.len() {
        let what = format!(
            "has {} values: must have {}, one for each of speed_mm_s",
            forces.len(),
            speeds.len()
        );
        say("force_n", &what);
    }
    let mut rows = speeds.iter().zip(forces);
    if let Some((speed, force)) = rows.find(|(speed, force)| *speed * *force <= 0.0) {
        let what = format!("= {force} N at {speed} mm/s: friction must have the sign of the speed");
        say("force_n", &what);
    }
}

/// A table of a screw's errors is whole.
fn pitch_error(rules: &mut Rules<'_>, at: At<'_>, axis: &PlantAxis) {
    let Some(of) = &axis.pitch_error else {
        return;
    };
    let (places, errors) = (&of.positions_mm, &of.error_um);
    if places.len() != errors.len() {
        let what = format!(
            "has {} values: must have {}, one for each of positions_mm",
            errors.len(),
            places.len()
        );
        rules.say(&["pitch_error", "error_um"], at, &what);
    }
    let mut pairs = places.iter().zip(places.iter().skip(1));
    if let Some((from, to)) = pairs.find(|(from, to)| from >= to) {
        let what = format!("must ascend: {to} comes after {from}");
        rules.say(&["pitch_error", "positions_mm"], at, &what);
    }
}

/// Only another axis of the file disturbs, and each once.
fn cross_talk(rules: &mut Rules<'_>, at: At<'_>, plant: &PlantFile, axis: &PlantAxis) {
    for (index, talk) in axis.cross_talk.iter().enumerate() {
        let others = plant.axes.iter().filter(|other| other.name != axis.name);
        let mut before = axis.cross_talk.iter().take(index);
        if others.filter(|other| other.name == talk.from).count() == 0 {
            let what = format!(
                "{}: from = {:?}: must be another axis of this file",
                index + 1,
                talk.from
            );
            rules.say(&["cross_talk"], at, &what);
        } else if before.any(|other| other.from == talk.from) {
            let what = format!("{}: from = {:?} is there already", index + 1, talk.from);
            rules.say(&["cross_talk"], at, &what);
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
        let sum = libm::round(sum * 1e6) / 1e6;
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

/// A mass of an axis with its springs and dampers.
struct Swinging {
    name: &'static str,
    mass_kg: f64,
    spring_n_per_m: f64,
    damper_n_s_per_m: f64,
}

impl Swinging {
    /// One that rings at a frequency and damping by itself.
    fn ringing(name: &'static str, mass_kg: f64, frequency_hz: f64, damping_ratio: f64) -> Self {
        let rate_rad_s = 2.0 * std::f64::consts::PI * frequency_hz;
        Swinging {
            name,
            mass_kg,
            spring_n_per_m: mass_kg * rate_rad_s * rate_rad_s,
            damper_n_s_per_m: 2.0 * damping_ratio * mass_kg * rate_rad_s,
        }
    }

    /// Whether a microstep resolves its vibration and its decay.
    fn is_resolved(&self, step_s: f64) -> bool {
        let (phase_rad, decay) = self.in_a_step(step_s);
        phase_rad <= PHASE_PER_MICROSTEP_RAD_MAX && decay <= DECAY_PER_MICROSTEP_MAX
    }

    /// Phase of its vibration and decay within a microstep, by the bound of one mass on all its springs: `h·sqrt(k/m)` and `h·c/m`.
    fn in_a_step(&self, step_s: f64) -> (f64, f64) {
        let phase_rad = step_s * (self.spring_n_per_m / self.mass_kg).sqrt();
        (phase_rad, step_s * self.damper_n_s_per_m / self.mass_kg)
    }
}

impl PlantFile {
    /// Whether the microstep resolves every vibration and decay, as a file's must.
    pub fn microstep_fits(&self) -> bool {
        let step_s = self.microstep_us * 1e-6;
        let mut all = self
            .axes
            .iter()
            .flat_map(|axis| swinging(self, axis, step_s));
        all.all(|mass| mass.is_resolved(step_s))
    }
}

/// All masses of an axis. What swings together with another one is stiffer by both springs, and on a frame the table is lighter.
fn swinging(plant: &PlantFile, axis: &PlantAxis, step_s: f64) -> Vec<Swinging> {
    let m = axis.mechanics(step_s);
    let hysteresis = &axis.screw.hysteresis_um;
    let slips = axis.screw.hysteresis_n.iter().zip(hysteresis);
    let screw_n_per_m = slips.fold(m.stiffness_n_per_m, |sum, (n, um)| sum + n / (um * 1e-6));
    let contact = |name, mass_kg, friction: &FrictionParameters| Swinging {
        name,
        mass_kg,
        spring_n_per_m: screw_n_per_m + presliding_stiffness_n_per_m(friction),
        damper_n_s_per_m: m.damping_n_s_per_m
            + friction.presliding_damping_n_s_per_m
            + friction.viscous_n_s_per_m,
    };
    let mut table = contact("table", m.table_mass_kg, &m.table_friction);
    let mut motor = contact("motor", m.motor_mass_kg, &m.motor_friction);
    if let Some(brake) = axis.holding_brake(step_s) {
        motor.spring_n_per_m += brake.stiffness_n_per_m();
        motor.damper_n_s_per_m += brake.damping_n_s_per_m();
    }
    let mut all = vec![motor];
    let joins = |other: &&PlantAxis| {
        let first = plant.bridged(other);
        other.name == axis.name || first.is_some_and(|first| first.name == axis.name)
    };
    let bridge = plant
        .axes
        .iter()
        .filter(joins)
        .find_map(|other| other.bridge);
    if let Some(of) = bridge {
        let stiffness_n_per_m = of.stiffness_n_per_um * 1e6;
        table.spring_n_per_m += stiffness_n_per_m;
        table.damper_n_s_per_m +=
            2.0 * of.damping_ratio * (stiffness_n_per_m * table.mass_kg).sqrt();
    }
    if let Some(of) = &axis.attached_mass {
        let name = "attached mass";
        let attached = Swinging::ringing(name, of.mass_kg, of.frequency_hz, of.damping_ratio);
        table.spring_n_per_m += attached.spring_n_per_m;
        table.damper_n_s_per_m += attached.damper_n_s_per_m;
        all.push(attached);
    }
    if let Some(of) = &axis.frame {
        table.mass_kg *= of.mass_kg / (of.mass_kg + table.mass_kg);
        let (mass_kg, hz) = (of.mass_kg, of.frequency_hz);
        all.push(Swinging::ringing("frame", mass_kg, hz, of.damping_ratio));
    }
    all.push(table);
    all
}

/// Whether the microstep resolves the stiffest vibration and the fastest decay of each mass.
fn microstep(rules: &mut Rules<'_>, plant: &PlantFile, axis: &PlantAxis) {
    let microstep_us = plant.microstep_us;
    let step_s = microstep_us * 1e-6;
    for mass in swinging(plant, axis, step_s) {
        if mass.is_resolved(step_s) {
            continue;
        }
        let (phase_rad, decay) = mass.in_a_step(step_s);
        let fits_us = microstep_us
            * (PHASE_PER_MICROSTEP_RAD_MAX / phase_rad).min(DECAY_PER_MICROSTEP_MAX / decay);
        let what = format!(
            "= {microstep_us} µs: too long for the {} of axis {} \
    ({:.3e} N/m and {:.3e} N·s/m on {:.4} kg): must be at most {fits_us:.3} µs",
            mass.name, axis.name, mass.spring_n_per_m, mass.damper_n_s_per_m, mass.mass_kg
        );
        rules.say(&["microstep_us"], None, &what);
    }
}
