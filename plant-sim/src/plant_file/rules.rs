//! The rules of the plant file, each a line: key, value, unit, range.

use toml_edit::{Document, Item};

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

/// Line of a byte of the text, from 1.
pub fn line_of(text: &str, byte: usize) -> usize {
    text.get(..byte)
        .map_or(1, |before| before.matches('\n').count() + 1)
}

/// Name of the `[[axis]]` that a byte of the text lies in.
pub fn axis_at(text: &str, byte: usize) -> Option<String> {
    // The text may not be a plant file at all: look for the last name line above, within the axis.
    let end = text
        .get(byte..)?
        .find('\n')
        .map_or(text.len(), |n| byte + n);
    let start = text.get(..end)?.rfind("[[axis]]")?;
    let table = text.get(start..)?;
    let body = table.get("[[axis]]".len()..)?;
    let body = body.get(..body.find("[[axis]]").unwrap_or(body.len()))?;
    let line = body
        .lines()
        .map(str::trim_start)
        .find(|line| line.starts_with("name"))?;
    let name = line.split('"').nth(1)?;
    (name.len() <= 8).then(|| name.to_string())
}

struct Rules<'a> {
    name: &'a str,
    text: &'a str,
    document: Option<Document<String>>,
    broken: Vec<(usize, String)>,
}

/// One axis in the file: its index and name.
type At<'a> = Option<(usize, &'a str)>;

impl Rules<'_> {
    /// Line of a key, found by its path; of the nearest table if the key itself is absent.
    fn line(&self, path: &[&str], axis: At) -> usize {
        let Some(document) = &self.document else {
            return 1;
        };
        let mut item: &Item = document.as_item();
        let mut start = 0;
        if let Some((index, _)) = axis {
            let Some(next) = item.get("axis").and_then(|axes| axes.get(index)) else {
                return 1;
            };
            item = next;
            start = item.span().map_or(start, |span| span.start);
        }
        for key in path {
            let Some(next) = item.get(*key) else { break };
            item = next;
            start = item.span().map_or(start, |span| span.start);
        }
        line_of(self.text, start)
    }

    fn say(&mut self, path: &[&str], axis: At, what: &str) {
        let line = self.line(path, axis);
        let whose = axis.map_or(String::new(), |(_, name)| format!("axis {name} "));
        self.broken.push((
            line,
            format!("{}:{line}: {whose}{} {what}", self.name, path.join(".")),
        ));
    }

    /// `low <= value <= high`; NaN breaks it.
    fn range(&mut self, path: &[&str], axis: At, value: f64, unit: &str, low: f64, high: f64) {
        if !(value >= low && value <= high) {
            let unit = if unit.is_empty() {
                String::new()
            } else {
                format!(" {unit}")
            };
            self.say(
                path,
                axis,
                &format!("= {value}{unit}: must be at least {low} and at most {high}{unit}"),
            );
        }
    }

    /// `low_key <= value` of two keys of one table.
    fn at_least(
        &mut self,
        path: &[&str],
        axis: At,
        value: f64,
        unit: &str,
        low_key: &str,
        low: f64,
    ) {
        if value < low {
            self.say(
                path,
                axis,
                &format!("= {value} {unit}: must be at least {low_key} = {low} {unit}"),
            );
        }
    }
}

/// Every rule that the plant breaks, in the order of the file.
pub fn broken(name: &str, text: &str, plant: &PlantFile) -> Vec<String> {
    let mut rules = Rules {
        name,
        text,
        document: Document::parse(text.to_string()).ok(),
        broken: Vec::new(),
    };
    rules.range(
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
    rules.range(&["ambient_c"], None, plant.ambient_c, "°C", -20.0, 60.0);
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
    if rules.broken.is_empty() {
        for (index, axis) in plant.axes.iter().enumerate() {
            microstep(
                &mut rules,
                Some((index, axis.name.as_str())),
                axis,
                plant.microstep_us,
            );
        }
    }
    rules.broken.sort_by_key(|(line, _)| *line);
    rules.broken.into_iter().map(|(_, text)| text).collect()
}

#[rustfmt::skip] // a table
fn axis_values(rules: &mut Rules, at: At, axis: &PlantAxis) {
    let (motor, screw, table) = (&axis.motor, &axis.screw, &axis.table);
    rules.range(&["start_position_mm"], at, axis.start_position_mm, "mm", -1e5, 1e5);

    rules.range(&["motor", "rated_torque_nm"], at, motor.rated_torque_nm, "N·m", 1e-3, 1e5);
    rules.range(&["motor", "peak_torque_nm"], at, motor.peak_torque_nm, "N·m", 1e-3, 1e6);
    rules.at_least(&["motor", "peak_torque_nm"], at, motor.peak_torque_nm, "N·m", "rated_torque_nm", motor.rated_torque_nm);
    rules.range(&["motor", "inertia_kg_m2"], at, motor.inertia_kg_m2, "kg·m²", 1e-7, 100.0);
    rules.range(&["motor", "current_loop_hz"], at, motor.current_loop_hz, "Hz", 10.0, 1e5);
    rules.range(&["motor", "cogging_torque_nm"], at, motor.cogging_torque_nm, "N·m", 0.0, motor.rated_torque_nm);
    rules.range(&["motor", "cogging_per_turn"], at, motor.cogging_per_turn.into(), "per turn", 1.0, 1000.0);
    rules.range(&["motor", "encoder_counts_per_turn"], at, motor.encoder_counts_per_turn.into(), "counts", 16.0, 4_294_967_295.0);
    rules.range(&["motor", "winding_rise_at_rated_k"], at, motor.winding_rise_at_rated_k, "K", 1.0, 300.0);
    rules.range(&["motor", "winding_time_constant_min"], at, motor.winding_time_constant_min, "min", 0.1, 1000.0);

    let f = &motor.friction;
    rules.range(&["motor", "friction", "coulomb_torque_nm"], at, f.coulomb_torque_nm, "N·m", 1e-6, motor.peak_torque_nm);
    rules.range(&["motor", "friction", "static_torque_nm"], at, f.static_torque_nm, "N·m", 1e-6, motor.peak_torque_nm);
    rules.at_least(&["motor", "friction", "static_torque_nm"], at, f.static_torque_nm, "N·m", "coulomb_torque_nm", f.coulomb_torque_nm);
    rules.range(&["motor", "friction", "viscous_nm_s_per_rad"], at, f.viscous_nm_s_per_rad, "N·m·s/rad", 0.0, 10.0);
    contact(rules, at, "motor", &f.element_share, &f.break_distance_um,
        [f.stribeck_velocity_mm_s, f.presliding_damping_n_s_per_m, f.attraction_ms]);

    rules.range(&["screw", "lead_mm"], at, screw.lead_mm, "mm", 0.1, 1000.0);
    rules.range(&["screw", "stiffness_n_per_m"], at, screw.stiffness_n_per_m, "N/m", 1e4, 1e10);
    rules.range(&["screw", "damping_ratio"], at, screw.damping_ratio, "", 0.0, 1.0);
    rules.range(&["screw", "gap_um"], at, screw.gap_um, "µm", 0.0, 1000.0);

    rules.range(&["table", "mass_kg"], at, table.mass_kg, "kg", 0.1, 1e5);
    let f = &table.friction;
    rules.range(&["table", "friction", "coulomb_n"], at, f.coulomb_n, "N", 1e-3, 1e5);
    rules.range(&["table", "friction", "static_n"], at, f.static_n, "N", 1e-3, 1e5);
    rules.at_least(&["table", "friction", "static_n"], at, f.static_n, "N", "coulomb_n", f.coulomb_n);
    rules.range(&["table", "friction", "viscous_n_s_per_m"], at, f.viscous_n_s_per_m, "N·s/m", 0.0, 1e6);
    contact(rules, at, "table", &f.element_share, &f.break_distance_um,
        [f.stribeck_velocity_mm_s, f.presliding_damping_n_s_per_m, f.attraction_ms]);

    if let Some(scale) = &axis.scale {
        rules.range(&["scale", "resolution_nm"], at, scale.resolution_nm, "nm", 0.01, 1e6);
    }
}

#[rustfmt::skip] // a table
fn contact(rules: &mut Rules, at: At, side: &str, share: &[f64; ELEMENTS], distance_um: &[f64; ELEMENTS],
    [stribeck_velocity_mm_s, presliding_damping_n_s_per_m, attraction_ms]: [f64; 3]) {
    rules.range(&[side, "friction", "stribeck_velocity_mm_s"], at, stribeck_velocity_mm_s, "mm/s", 1e-3, 1e3);
    rules.range(&[side, "friction", "presliding_damping_n_s_per_m"], at, presliding_damping_n_s_per_m, "N·s/m", 0.0, 1e7);
    rules.range(&[side, "friction", "attraction_ms"], at, attraction_ms, "ms", 0.01, 100.0);
    for value in share {
        rules.range(&[side, "friction", "element_share"], at, *value, "", 0.0, 1.0);
    }
    for value in distance_um {
        rules.range(&[side, "friction", "break_distance_um"], at, *value, "µm", 1e-3, 1e4);
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
            let line = rules.line(&["microstep_us"], None);
            let whose = at.map_or("", |(_, name)| name);
            rules.broken.push((
                line,
                format!(
                    "{}:{line}: microstep_us = {microstep_us} µs: too long for the {side} of axis {whose} \
                     ({spring_n_per_m:.3e} N/m and {damper_n_s_per_m:.3e} N·s/m on {mass_kg:.4} kg): \
                     must be at most {fits_us:.3} µs",
                    rules.name
                ),
            ));
        }
    }
}
