//! Does the model that was found fit? Bounds with their reasons: docs/methods/tuning.md.

use machine::Axis;

use super::identify::Found;

/// Largest residual of the torque, as a part of Coulomb friction.
const TORQUE_RESIDUAL_MAX: f64 = 0.10;
/// Largest residual of what the screw carries, as a part of the table's Coulomb friction.
const TABLE_RESIDUAL_MAX: f64 = 0.15;
/// Residuals below this are rounding, as a part of the rated force.
const NOTHING: f64 = 0.001;
/// Highest lost motion that is still one, in µm.
const LOST_MOTION_UM_MAX: f64 = 200.0;

/// Why the model does not fit; nothing if it does.
pub fn misfit(axis: &Axis, found: &Found) -> Option<String> {
    let rated_n = axis.rated_force_n();
    let (mass_kg, friction_n) = (found.mass_kg(), found.coulomb_n());
    let numbers = [
        mass_kg,
        friction_n,
        found.residual_n,
        found.viscous_n_s_per_m(),
    ];
    if numbers.iter().any(|number| !number.is_finite()) || found.motor_mass_kg <= 0.0 {
        return Some(format!(
            "motor and screw come to {:.0} kg: its torque does not follow its acceleration; look at lead_mm and at the sign \
             of the encoder",
            found.motor_mass_kg
        ));
    }
    if friction_n >= rated_n {
        return Some(format!(
            "friction of {friction_n:.0} N, the motor holds {rated_n:.0} N for good: look at the guideways, or at lead_mm and \
             rated_torque_nm"
        ));
    }
    let most_n = (TORQUE_RESIDUAL_MAX * friction_n).max(NOTHING * rated_n);
    if found.residual_n > most_n {
        return Some(format!(
            "mass {mass_kg:.0} kg and friction {friction_n:.0} N leave {:.0} N of its torque unexplained, more than {most_n:.0} N: \
             something else works on it: a resonance, or friction that changes with place",
            found.residual_n
        ));
    }
    let table = found.table.as_ref()?;
    let lost_um = found.lost_motion_um();
    let in_contact = table.stiffness_n_per_um > 0.0 && table.mass_kg > 0.0;
    if !in_contact || !(0.0..=LOST_MOTION_UM_MAX).contains(&lost_um) {
        return Some(format!(
            "stiffness {:.1} N/µm, table {:.0} kg, lost motion {lost_um:.1} µm of at most {LOST_MOTION_UM_MAX:.0}: the scale does \
             not follow the motor as a table on a screw does; look at its resolution and sign, and at the coupling",
            table.stiffness_n_per_um, table.mass_kg
        ));
    }
    let friction_n = table.friction.coulomb_n();
    let most_n = (TABLE_RESIDUAL_MAX * friction_n).max(NOTHING * rated_n);
    (table.residual_n > most_n).then(|| {
        format!(
            "a table of {:.0} kg with {friction_n:.0} N of friction leaves {:.0} N of what the screw carries unexplained, more \
             than {most_n:.0} N: look at the scale's mounting and at the nut",
            table.mass_kg, table.residual_n
        )
    })
}
