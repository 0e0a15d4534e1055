//! Motor against table: what the screw is wound up by.

use super::signals::Signals;

/// Motor against table, in µm, without the offset of the two zeros.
pub fn wind_ups(all: &[Signals]) -> Vec<Vec<f64>> {
    let (mut forward, mut back) = ((0.0, 0.0), (0.0, 0.0));
    for signals in all {
        for i in signals.equations() {
            if signals.motor_m_s[i].abs() * 1e3 < 1.0 || !signals.is_steady(i) {
                continue;
            }
            let way = if signals.motor_m_s[i] > 0.0 {
                &mut forward
            } else {
                &mut back
            };
            way.0 += signals.motor_mm[i] - signals.scale_mm[i];
            way.1 += 1.0;
        }
    }
    let mean = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { 0.0 };
    let offset_mm = 0.5 * (mean(forward) + mean(back));
    all.iter()
        .map(|signals| {
            signals
                .motor_mm
                .iter()
                .zip(&signals.scale_mm)
                .map(|(motor, scale)| (motor - scale - offset_mm) * 1e3)
                .collect()
        })
        .collect()
}

/// The same from another zero.
pub fn beside(wind_um: &[Vec<f64>], zero_um: f64) -> Vec<Vec<f64>> {
    let shifted = |list: &Vec<f64>| list.iter().map(|um| um - zero_um).collect();
    wind_um.iter().map(shifted).collect()
}

/// Mean wind-up with its half gap while the axis slides steadily, in µm.
pub fn sliding_um(all: &[Signals], wind_um: &[Vec<f64>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (signals, wind_um) in all.iter().zip(wind_um) {
        for i in signals.equations() {
            let v = signals.motor_m_s[i];
            if v.abs() * 1e3 > 1.0 && signals.is_steady(i) {
                sum += wind_um[i] * v.signum();
                count += 1.0;
            }
        }
    }
    if count > 0.0 {
        (sum / count).max(0.0)
    } else {
        0.0
    }
}

/// What the spring carries of a wind-up beyond the gap, in µm.
fn beyond_gap_um(wind_um: f64, gap_um: f64) -> f64 {
    if wind_um > 0.5 * gap_um {
        wind_um - 0.5 * gap_um
    } else if wind_um < -0.5 * gap_um {
        wind_um + 0.5 * gap_um
    } else {
        0.0
    }
}

/// Wind-up beyond the gap, in µm, and its rate while in contact, in m/s; both smoothed.
pub fn carried(signals: &Signals, wind_um: &[f64], gap_um: f64) -> (Vec<f64>, Vec<f64>) {
    let beyond: Vec<f64> = wind_um.iter().map(|w| beyond_gap_um(*w, gap_um)).collect();
    let rate: Vec<f64> = (0..wind_um.len())
        .map(|i| {
            let (low, high) = (i.saturating_sub(1), (i + 1).min(wind_um.len() - 1));
            if beyond[i] == 0.0 {
                0.0
            } else {
                (wind_um[high] - wind_um[low]) / ((high - low).max(1) as f64 * signals.scan_s)
                    * 1e-6
            }
        })
        .collect();
    (signals.smooth(&beyond), signals.smooth(&rate))
}
