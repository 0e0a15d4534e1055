//! The two equations of an axis, row by row: for the fit, and for the force that it predicts.

use super::shape::cogging;
use super::signals::{Shape, Signals};
use super::wind_up::carried;
use super::{ELEMENTS, Lever};
use crate::least_squares::{Fit, NormalEquations};

/// Columns before the slip elements: mass, viscous friction, stiffness, damping, stairs.
pub const BEFORE: usize = 5;
/// Columns behind them, which may be negative: constant force, viscous friction by direction, cogging (2), friction by place (4).
pub const BEHIND: usize = 8;
/// All of them.
pub const COLUMNS: usize = BEFORE + ELEMENTS + BEHIND;

/// What the motor equation takes from everywhere.
pub struct MotorEquation<'a> {
    /// All recordings of an axis.
    pub all: &'a [Signals],
    /// Slip elements along each.
    pub slips: &'a [Vec<Vec<f64>>],
    /// Wind-up along each, where there is a scale.
    pub wind_um: Option<&'a [Vec<f64>]>,
    /// Gap, in µm.
    pub gap_um: f64,
    /// Harmonic of the cogging.
    pub cogging_per_turn: u32,
    /// Lever of the axis.
    pub lever: &'a Lever,
}

impl MotorEquation<'_> {
    /// `T/p = M1·a1 + B1·v1 + k·u + c·u' − γ·Kv·Δvc + Σ s_i·stop_i(x1) + c + D·|v1| + cogging + place`; without a scale there is no `k·u + c·u'`.
    pub fn fit(&self) -> Fit {
        let mut equations = NormalEquations::new(COLUMNS);
        self.rows(|signals, i, row| equations.add(row, signals.force_n[i], signals.weight[i]));
        equations.solve(BEFORE + ELEMENTS)
    }

    /// Every equation: its recording, its instant, its row.
    pub fn rows(&self, mut take: impl FnMut(&Signals, usize, &[f64])) {
        let mut row = vec![0.0; COLUMNS];
        for (index, (signals, slips)) in self.all.iter().zip(self.slips).enumerate() {
            let wind_um = self.wind_um.and_then(|all| all.get(index));
            let carried = wind_um.map(|wind| carried(signals, wind, self.gap_um));
            for i in signals.equations() {
                row[0] = signals.motor_m_s2[i];
                row[1] = signals.motor_m_s[i];
                if let Some((beyond, rate)) = &carried {
                    (row[2], row[3]) = (beyond[i], rate[i]);
                }
                row[4] = -signals.stair_n[i];
                for (place, slip) in row[BEFORE..].iter_mut().zip(slips) {
                    *place = slip[i];
                }
                let behind = &mut row[BEFORE + ELEMENTS..];
                behind[0] = 1.0;
                behind[1] = signals.motor_m_s[i].abs();
                let lead_mm = self.lever.lead_mm;
                let waves = cogging(signals, i, self.cogging_per_turn, lead_mm);
                behind[2..4].copy_from_slice(&waves);
                behind[4..8].copy_from_slice(&signals.by_place(i, slips, lead_mm));
                take(signals, i, &row);
            }
        }
    }
}

/// Columns of the table equation: mass, viscous friction, slip elements; constant force, viscous friction by direction, friction by place.
const TABLE_COLUMNS: usize = 2 + ELEMENTS + 6;

/// Table equation: `k·u + c·u' = M2·a2 + B2·v2 + Σ q_i·stop_i(x2) + c + D·|v2| + place`.
pub fn table_fit(
    all: &[Signals],
    wind_um: &[Vec<f64>],
    gap_um: f64,
    [stiffness_n_per_um, damping_n_s_per_m]: [f64; 2],
    shape: &Shape,
    lever: &Lever,
) -> Fit {
    let mut equations = NormalEquations::new(TABLE_COLUMNS);
    let mut row = vec![0.0; TABLE_COLUMNS];
    for (signals, wind) in all.iter().zip(wind_um) {
        let slips = signals.slips(&signals.scale_mm, &signals.scale_m_s, shape);
        let (beyond, rate) = carried(signals, wind, gap_um);
        for i in signals.equations() {
            row[0] = signals.scale_m_s2[i];
            row[1] = signals.scale_m_s[i];
            for (place, slip) in row[2..].iter_mut().zip(&slips) {
                *place = slip[i];
            }
            row[2 + ELEMENTS] = 1.0;
            row[3 + ELEMENTS] = signals.scale_m_s[i].abs();
            row[4 + ELEMENTS..].copy_from_slice(&signals.by_place(i, &slips, lever.lead_mm));
            let carried_n = stiffness_n_per_um * beyond[i] + damping_n_s_per_m * rate[i];
            equations.add(&row, carried_n, signals.weight[i]);
        }
    }
    equations.solve(2 + ELEMENTS)
}
