//! Motion that spares what rings: `vibration_hz`, and the limits of jerk that it needs.

use core::f64::consts::PI;

use machine::Machine;
use toml_edit::DocumentMut;

use super::identify::Found;
use super::ringing::Ringing;
use super::write::{Keys, axes, digits};

/// Ringing from this amplitude on, in µm, is worth what sparing it costs: programs that take some percent longer.
pub const WORTH_UM: f64 = 2.0;
/// Highest jerk, as a multiple of the acceleration in a second: changes of acceleration take a tenth of a second.
const JERK_PER_S: f64 = 20.0;
/// Part of the peak force that a step of the jerk may ask for.
const FORCE_SHARE: f64 = 0.25;
/// Part of the jerk that rounding to increments may look like.
const ROUNDING_SHARE: f64 = 1.0 / 16.0;
/// A third difference of rounded setpoints is off by up to so many increments.
const ROUNDING_INCREMENTS: f64 = 8.0;

/// The oscillation that is spared, if one is worth it: the largest of any axis. One frequency is all that an average along the path spares,
/// with its multiples.
pub fn worst(all: &[Vec<Ringing>]) -> Option<Ringing> {
    let worth = all
        .iter()
        .flatten()
        .filter(|of| of.amplitude_um >= WORTH_UM);
    worth
        .max_by(|a, b| a.amplitude_um.total_cmp(&b.amplitude_um))
        .copied()
}

/// Sets `vibration_hz`, and where no lower limit is set, `jerk_mm_s3` and increments to match.
///
/// The jerk is the lower of 20 times the acceleration in a second and what the drive follows: the model winds the screw up by the force on the table
/// over the stiffness, so a step of the jerk `J` from one scan `T` to the next asks the motor for the force `M1·J/(ω²·T)`, a quarter of its
/// peak at most.
pub fn spare(document: &mut DocumentMut, machine: &Machine, found: &[Found], spared: Ringing) {
    let scan_s = machine.scan_period_s();
    let vibration_hz = digits(spared.frequency_hz, 3);
    let why = "tune: what rings most after strokes";
    Keys::of(document.as_table_mut(), &["path"]).set("vibration_hz", vibration_hz, why);
    let stiffness_per_s2 = (2.0 * PI * spared.frequency_hz).powi(2);
    for ((axis, known), found) in axes(document).zip(&machine.axes).zip(found) {
        let peak_n = known.motor.peak_torque_nm * super::newtons_per_nm(known.lead_mm);
        let by_force_m_s3 =
            FORCE_SHARE * peak_n * stiffness_per_s2 * scan_s / found.motor_mass_kg.max(1e-3);
        let by_law_mm_s3 = (JERK_PER_S * known.acceleration_mm_s2).min(1e3 * by_force_m_s3);
        let jerk_mm_s3 = known.jerk_mm_s3.unwrap_or(f64::INFINITY).min(by_law_mm_s3);
        let mut keys = Keys::of(axis, &[]);
        let why = "tune: 20 times the acceleration in a second, or what the drive follows";
        keys.set("jerk_mm_s3", digits(jerk_mm_s3, 3), why);
        let finest_nm = 1e6 * ROUNDING_SHARE * jerk_mm_s3 * scan_s.powi(3) / ROUNDING_INCREMENTS;
        if finest_nm < known.increment_nm {
            let why = "tune: rounding is to look like little jerk";
            keys.set("increment_nm", digits(finest_nm, 1), why);
        }
    }
}
