//! What speed and the motor's turn do to the torque of an axis that slides at steady speeds.

use super::signals::{SLIDING_MM_S, Shape, Signals, turn};
use crate::least_squares::{NormalEquations, golden_section};

/// Harmonics of the motor turn among which cogging is looked for.
const COGGING_MAX: u32 = 48;

/// Sine and cosine of the cogging at an instant; 0 where the lead is not known.
pub fn cogging(signals: &Signals, i: usize, per_turn: u32, lead_mm: Option<f64>) -> [f64; 2] {
    lead_mm.map_or([0.0; 2], |lead_mm| {
        let angle = turn(signals.motor_mm[i], lead_mm) * f64::from(per_turn);
        [libm::sin(angle), libm::cos(angle)]
    })
}

/// Harmonic of the motor turn that is strongest in the torque at steady speed.
pub fn cogging_period(calm: &Signals, lead_mm: Option<f64>) -> u32 {
    let strength = |n: u32| {
        let mut equations = NormalEquations::new(6);
        for i in calm.equations() {
            let v = calm.motor_m_s[i];
            if v.abs() * 1e3 < SLIDING_MM_S || !calm.is_steady(i) {
                continue;
            }
            let [sine, cosine] = cogging(calm, i, n, lead_mm);
            let row = [v.signum(), v, v.abs(), 1.0, sine, cosine];
            equations.add(&row, calm.force_n[i], 1.0);
        }
        equations.solve(0).residual
    };
    (1..=COGGING_MAX)
        .map(|n| (n, strength(n)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(1, |best| best.0)
}

/// Break-away ratio and Stribeck velocity from sliding at steady speeds: `F(v) = C·sgn(v)·(1 + r·e^−(v/vs)²) + B·v + D·|v|`.
pub fn stribeck(calm: &Signals, cogging_per_turn: u32, lead_mm: Option<f64>) -> Shape {
    let fit = |stribeck_mm_s: f64| {
        let mut equations = NormalEquations::new(7);
        for i in calm.equations() {
            let v = calm.motor_m_s[i];
            if v.abs() * 1e3 < SLIDING_MM_S || !calm.is_steady(i) {
                continue;
            }
            let ratio = 1e3 * v / stribeck_mm_s;
            let [sine, cosine] = cogging(calm, i, cogging_per_turn, lead_mm);
            let row = [
                v.signum(),
                v.signum() * libm::exp(-ratio * ratio),
                v,
                v.abs(),
                1.0,
                sine,
                cosine,
            ];
            // Every speed counts alike, however long it took.
            equations.add(&row, calm.force_n[i], v.abs());
        }
        equations.solve(3)
    };
    // On a logarithm, because it may lie anywhere within two decades.
    let place = golden_section(libm::log(0.3), libm::log(30.0), |log| {
        fit(libm::exp(log)).residual
    });
    let stribeck_mm_s = libm::exp(place);
    let best = fit(stribeck_mm_s).coefficients;
    Shape {
        static_ratio: 1.0
            + if best[0] > 0.0 {
                (best[1] / best[0]).min(2.0)
            } else {
                0.0
            },
        stribeck_mm_s,
    }
}
