//! Gap and stiffness of the screw, and the table behind it: by the torque, or by the wind-up itself.

use super::equations::{Carried, TABLE_COLUMNS, table_fit};
use super::signals::Signals;
use super::wind_up::{self, carried};
use crate::least_squares::{Fit, golden_section};

/// Rounds in which gap and its middle are looked for, one after the other.
const ROUNDS: usize = 2;
/// Part of the wind-up while sliding by which the middle of the gap may be off the middle of sliding.
const OFF_CENTRE: f64 = 0.25;
/// Rounds in which the side of the gap follows from the force, and the force from the side.
const SIDES: usize = 3;
/// Part of the table's Coulomb friction that the force must exceed to change sides against the acceleration: as the controller has it.
const BACK_PART: f64 = 0.5;

/// What was found of screw and table.
pub struct Screw {
    /// Fit of the motor equation.
    pub motor: Fit,
    /// What the screw carries, scan by scan.
    pub carried: Vec<Carried>,
    /// Fit of the table equation, in N.
    pub table: Fit,
    /// Gap, in µm.
    pub gap_um: f64,
}

/// By the torque: the gap with which the motor equation leaves least. The wind-up beyond the gap is what was measured.
pub fn by_torque(
    fit: impl Fn(&[Carried]) -> Fit,
    all: &[Signals],
    rows: &[Vec<[f64; TABLE_COLUMNS]>],
) -> Screw {
    let mut wind_um = wind_up::wind_ups(all);
    let widest_um = wind_up::sliding_um(all, &wind_um);
    let carried_of = |wind_um: &[Vec<f64>], gap_um: f64| -> Vec<Carried> {
        let both = all.iter().zip(wind_um);
        both.map(|(signals, wind_um)| carried(signals, wind_um, gap_um))
            .collect()
    };
    let left = |wind_um: &[Vec<f64>], gap_um: f64| fit(&carried_of(wind_um, gap_um)).residual;
    let mut gap_um = widest_um;
    // Where friction is not the same both ways, the middle of the gap is not the middle of sliding.
    for _ in 0..ROUNDS {
        gap_um = golden_section(0.0, 2.0 * widest_um, |gap_um| left(&wind_um, gap_um));
        let reach_um = OFF_CENTRE * widest_um;
        let centre_um = golden_section(-reach_um, reach_um, |centre_um| {
            left(&wind_up::beside(&wind_um, centre_um), gap_um)
        });
        wind_um = wind_up::beside(&wind_um, centre_um);
    }
    let carried = carried_of(&wind_um, gap_um);
    let motor = fit(&carried);
    let (stiffness, damping) = (motor.coefficients[2], motor.coefficients[3]);
    let table = table_fit(all, rows, |index, i| {
        carried.get(index).map_or(0.0, |(beyond_um, rate_m_s)| {
            stiffness * beyond_um[i] + damping * rate_m_s[i]
        })
    });
    Screw {
        motor,
        carried,
        table,
        gap_um,
    }
}

/// By the wind-up: gap and table with which the model's own wind-up comes closest to the measured one,
/// `w = (b/2)·side + (M2·a2 + B2·v2 + Σ q_i·stop_i(x2) + …)/k`, the side as the controller sees it; then the stiffness k that makes a force of it
/// by the motor equation. Lost motion with hysteresis is met so as well as a gap and a spring can.
pub fn by_wind_up(
    fit: impl Fn(&[Carried]) -> Fit,
    all: &[Signals],
    rows: &[Vec<[f64; TABLE_COLUMNS]>],
) -> Option<Screw> {
    let wind_um = wind_up::wind_ups(all);
    let widest_um = wind_up::sliding_um(all, &wind_um);
    let smoothed_um: Vec<Vec<f64>> = all
        .iter()
        .zip(&wind_um)
        .map(|(signals, um)| signals.smooth(um))
        .collect();
    let without = table_fit(all, rows, |index, i| smoothed_um[index][i]);
    let with_gap = |gap_um: f64| -> Fit {
        let mut table = without.clone();
        for _ in 0..SIDES {
            let sides: Vec<Vec<f64>> = all
                .iter()
                .zip(rows)
                .map(|(signals, rows)| signals.smooth(&sides(rows, &table.coefficients)))
                .collect();
            table = table_fit(all, rows, |index, i| {
                smoothed_um[index][i] - 0.5 * gap_um * sides[index][i]
            });
        }
        table
    };
    let gap_um = golden_section(0.0, 2.0 * widest_um, |gap_um| with_gap(gap_um).residual);
    let mut table = with_gap(gap_um);
    let carried: Vec<Carried> = rows
        .iter()
        .map(|rows| {
            let beyond_um = rows.iter().map(|row| dot(row, &table.coefficients));
            (beyond_um.collect(), vec![0.0; rows.len()])
        })
        .collect();
    let motor = fit(&carried);
    let stiffness = motor.coefficients[2];
    if !(stiffness > 0.0 && stiffness.is_finite()) {
        return None;
    }
    for coefficient in &mut table.coefficients {
        *coefficient *= stiffness;
    }
    table.residual *= stiffness;
    Some(Screw {
        motor,
        carried,
        table,
        gap_um,
    })
}

/// Side of the gap at every scan.
fn sides(rows: &[[f64; TABLE_COLUMNS]], coefficients: &[f64]) -> Vec<f64> {
    let friction = coefficients.iter().skip(2).take(super::ELEMENTS);
    let lasting = BACK_PART * friction.sum::<f64>();
    let mut side = 0.0;
    rows.iter()
        .map(|row| {
            let force = dot(row, coefficients);
            if force * row[0] > 0.0 || force.abs() > lasting {
                side = force.signum();
            }
            side
        })
        .collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
