//! Can anything be done with the model that was found, and what does it not explain? Bounds with their reasons: docs/methods/tuning.md.

use super::identify::Found;
use super::laws;

/// Part of the torque, as a norm, that the model must not leave unexplained: above, torque and motion do not belong together.
const UNEXPLAINED_MAX: f64 = 0.5;
/// Highest lost motion that is still one, in µm.
const LOST_MOTION_UM_MAX: f64 = 200.0;
/// What is smaller than this part of Coulomb friction is not worth a word.
const WORTH: f64 = 0.05;
/// The same for what the table equation leaves, as a part of the table's Coulomb friction.
const WORTH_TABLE: f64 = 0.15;
/// The same for viscous friction by direction, as a part of viscous friction.
const WORTH_VISCOUS: f64 = 0.1;

/// Why nothing can be set with this; nothing if something can. `rated_n` is the force of the rated torque, where it is known.
pub fn refusal(rated_n: Option<f64>, found: &Found) -> Option<String> {
    let friction_n = found.coulomb_n();
    let numbers = [
        found.mass_kg(),
        friction_n,
        found.residual_n,
        found.unexplained,
        found.viscous_n_s_per_m(),
    ];
    if numbers.iter().any(|number| !number.is_finite()) || found.motor_mass_kg <= 0.0 {
        return Some(format!(
            "motor and screw come to {:.0} kg: its torque does not follow its acceleration; look at lead_mm and at the sign \
             of the encoder",
            found.motor_mass_kg
        ));
    }
    if found.unexplained > UNEXPLAINED_MAX {
        return Some(format!(
            "mass {:.0} kg and friction {friction_n:.0} N leave {:.0} % of its torque unexplained: torque and motion do not belong \
             together; look at lead_mm, at the unit of the torque, and at what else moves the axis",
            found.mass_kg(),
            100.0 * found.unexplained
        ));
    }
    if let Some(rated_n) = rated_n.filter(|rated_n| friction_n >= *rated_n) {
        return Some(format!(
            "friction of {friction_n:.0} N, the motor holds {rated_n:.0} N for good: look at the guideways, or at lead_mm and \
             rated_torque_nm"
        ));
    }
    let lost_um = found.lost_motion_um();
    let table = found.table.as_ref()?;
    (!(0.0..=LOST_MOTION_UM_MAX).contains(&lost_um)).then(|| {
        format!(
            "stiffness {:.1} N/µm, table {:.0} kg, lost motion {lost_um:.1} µm of at most {LOST_MOTION_UM_MAX:.0}: the scale does \
             not follow the motor as a table on a screw does; look at its resolution and sign, and at the coupling",
            table.stiffness_n_per_um, table.mass_kg
        )
    })
}

/// What was found beside the model, and what the model leaves unexplained, with what it may cost; a line each.
pub fn remarks(found: &Found) -> Vec<String> {
    let mut lines = Vec::new();
    let friction_n = found.coulomb_n();
    let worth_n = WORTH * friction_n;
    let um = |force_n: f64| laws::deviation_um(force_n, found.mass_kg());
    let structure = found.whole_structure();
    if found.torque_late_s > 0.0 {
        lines.push(format!(
            "its torque is shown {:.2} ms late: brought into step here; nothing that needs the torque at once is set (no \
             disturbance observer)",
            found.torque_late_s * 1e3
        ));
    }
    if structure.constant_n.abs() > worth_n {
        lines.push(format!(
            "Coulomb friction is {:.1} N forward and {:.1} N back, or {:+.1} N always act on it: a weight is said in [axis.gravity] and fed \
             forward; the integrator carries what is not, and where the gap is crossed early and late for it, about {:.1} µm",
            friction_n + structure.constant_n,
            friction_n - structure.constant_n,
            structure.constant_n,
            um(structure.constant_n.abs())
        ));
    }
    let viscous = found.viscous_n_s_per_m();
    if structure.viscous_n_s_per_m.abs() > WORTH_VISCOUS * viscous {
        lines.push(format!(
            "viscous friction is {:.0} N·s/m forward and {:.0} back: the mean is set",
            viscous + structure.viscous_n_s_per_m,
            viscous - structure.viscous_n_s_per_m
        ));
    }
    for (force_n, what) in [
        (structure.by_turn_n(), "with each turn of the motor"),
        (structure.by_travel_n(), "over the travel that was tested"),
    ] {
        if force_n > worth_n {
            lines.push(format!(
                "friction changes by ±{force_n:.1} N {what}: the mean is set; at a reversal about {:.1} µm",
                um(force_n)
            ));
        }
    }
    if found.beyond_noise_n() > worth_n {
        lines.push(format!(
            "{:.1} N of its torque ({:.0} % of Coulomb friction) are unexplained, noise makes {:.1} N: a resonance, a cut, or friction \
             of another law; at a reversal about {:.1} µm",
            found.residual_n,
            100.0 * found.residual_n / friction_n,
            found.noise_n,
            um(found.beyond_noise_n())
        ));
    }
    lines.extend(of_table(found));
    lines
}

/// What is to be said of the table.
fn of_table(found: &Found) -> Option<String> {
    if let Some(why) = found.no_table {
        return Some(format!(
            "its scale shows no table on a screw ({why}): it is tuned as if it had none; lost motion is not known"
        ));
    }
    let table = found.table?;
    let beyond_n = (table.residual_n.powi(2) - table.noise_n.powi(2))
        .max(0.0)
        .sqrt();
    (beyond_n > WORTH_TABLE * table.friction.coulomb_n()).then(|| {
        format!(
            "{:.1} N of what the screw carries are unexplained, noise makes {:.1} N: lost motion with hysteresis, a mass that \
             swings on the table, or a cut; at a reversal about {:.1} µm",
            table.residual_n,
            table.noise_n,
            beyond_n / table.stiffness_n_per_um
        )
    })
}
