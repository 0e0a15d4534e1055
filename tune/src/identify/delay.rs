//! A torque that is shown late: by how much, from torque and acceleration.

use super::Lever;
use super::signals::Signals;
use crate::least_squares::NormalEquations;
use crate::recording::Recording;

/// Longest delay that is looked for, in s.
const DELAY_S_MAX: f64 = 5e-3;
/// A delay counts if it leaves less than this part of what is left without one.
const BETTER: f64 = 0.9;

/// Scans by which the torque of these recordings is shown late: the number with which mass, friction and a constant force leave least of it
/// while the axis slides. 0 where that is not clearly better than none.
pub fn scans(recordings: &[Recording], lever: &Lever) -> usize {
    let Some(scan_s) = recordings.first().map(|recording| recording.scan_s) else {
        return 0;
    };
    let most = (DELAY_S_MAX / scan_s).floor() as usize;
    let left: Vec<f64> = (0..=most)
        .map(|scans| left_n(recordings, scans, lever))
        .collect();
    let best = (0..=most).min_by(|a, b| left[*a].total_cmp(&left[*b]));
    best.filter(|best| left[*best] < BETTER * left[0])
        .unwrap_or(0)
}

/// What is left of the force with this delay, root mean square, in N.
fn left_n(recordings: &[Recording], scans: usize, lever: &Lever) -> f64 {
    let mut equations = NormalEquations::new(6);
    for recording in recordings {
        let signals = Signals::new(&recording.with_torque_late(scans), lever);
        for i in signals.equations() {
            let v = signals.motor_m_s[i];
            if v.abs() > 1e-3 {
                let row = [
                    signals.motor_m_s2[i],
                    v,
                    v.signum(),
                    -signals.stair_n[i],
                    1.0,
                    v.abs(),
                ];
                equations.add(&row, signals.force_n[i], 1.0);
            }
        }
    }
    equations.solve(4).residual
}
