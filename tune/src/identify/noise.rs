//! What encoders and the measurement of the torque make by themselves of what a fit leaves.

use super::Lever;
use super::signals::half;
use crate::recording::Recording;

/// Median of the amount of a normal variable of standard deviation 1.
const MEDIAN: f64 = 0.6745;
/// Slower than this an encoder that counts in steps shows no noise, in mm/s; faster than that, everything that repeats with the travel.
const SPEED_MM_S: [f64; 2] = [0.2, 20.0];

/// Standard deviation of the noise in a residual of the motor equation, in N: of the torque, and of the acceleration times the mass.
pub fn of_motor_n(recordings: &[Recording], lever: &Lever, mass_kg: f64) -> f64 {
    let Some(recording) = recordings.last() else {
        return 0.0;
    };
    let scan_s = recording.scan_s;
    let length = (2 * half(scan_s, lever.smoothing_s) + 1) as f64;
    let force_n = lever.newtons_per_nm * second(recordings, |recording| &recording.torque_nm);
    let place_m = 1e-3 * fourth(recordings, |recording| &recording.motor_mm);
    // Two running means weigh by a triangle; its squares sum to (2n² + 1)/3n³, those of its second difference to 6/n⁴.
    let of_force = force_n * ((2.0 * length * length + 1.0) / (3.0 * length.powi(3))).sqrt();
    let of_acceleration = mass_kg * place_m / (scan_s * scan_s) * 6f64.sqrt() / length.powi(2);
    of_force.hypot(of_acceleration)
}

/// Standard deviation of the noise in a residual of the table equation, in N: of both encoders, times the stiffness.
pub fn of_table_n(recordings: &[Recording], lever: &Lever, stiffness_n_per_um: f64) -> f64 {
    let Some(recording) = recordings.last() else {
        return 0.0;
    };
    let length = (2 * half(recording.scan_s, lever.smoothing_s) + 1) as f64;
    let motor_mm = fourth(recordings, |recording| &recording.motor_mm);
    let scale_mm = fourth(recordings, |recording| &recording.scale_mm);
    let smoothed = ((2.0 * length * length + 1.0) / (3.0 * length.powi(3))).sqrt();
    1e3 * stiffness_n_per_um * motor_mm.hypot(scale_mm) * smoothed
}

/// From second differences while the axis moves slowly.
fn second(recordings: &[Recording], of: impl Fn(&Recording) -> &Vec<f64>) -> f64 {
    median(recordings, of, &[1.0, -2.0, 1.0]) / 6f64.sqrt()
}

/// From fourth differences while the axis moves slowly.
fn fourth(recordings: &[Recording], of: impl Fn(&Recording) -> &Vec<f64>) -> f64 {
    median(recordings, of, &[1.0, -4.0, 6.0, -4.0, 1.0]) / 70f64.sqrt()
}

/// Standard deviation of a weighted sum of neighbours, from the median of its amount.
fn median(recordings: &[Recording], of: impl Fn(&Recording) -> &Vec<f64>, weights: &[f64]) -> f64 {
    let mut all: Vec<f64> = Vec::new();
    for recording in recordings {
        let steps = recording.motor_mm.windows(weights.len());
        for (values, places) in of(recording).windows(weights.len()).zip(steps) {
            let way_mm = places.last().unwrap_or(&0.0) - places.first().unwrap_or(&0.0);
            let speed_mm_s = way_mm.abs() / ((weights.len() - 1) as f64 * recording.scan_s);
            if (SPEED_MM_S[0]..SPEED_MM_S[1]).contains(&speed_mm_s) {
                let sum: f64 = values.iter().zip(weights).map(|(a, b)| a * b).sum();
                all.push(sum.abs());
            }
        }
    }
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0) / MEDIAN
}
