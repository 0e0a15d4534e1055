//! The two equations of an axis, row by row: for the fit, and for the force that it predicts.

use super::shape::cogging;
use super::signals::{Shape, Signals};
use super::{ELEMENTS, Lever};
use crate::least_squares::{Fit, NormalEquations};

/// Columns before the slip elements: mass, viscous friction, stiffness, damping, stairs.
pub const BEFORE: usize = 5;
/// Columns behind them, which may be negative: constant force, viscous friction and break-away by
/// direction, cogging (2), friction by place (4).
pub const BEHIND: usize = 9;
/// All of them.
pub const COLUMNS: usize = BEFORE + ELEMENTS + BEHIND;

/// What the screw is wound up by beyond the gap, in µm, and its rate, in m/s, scan by scan.
pub type Carried = (Vec<f64>, Vec<f64>);

/// What the motor equation takes from everywhere.
#[derive(Clone, Copy)]
pub struct MotorEquation<'a> {
    /// All recordings of an axis.
    pub all: &'a [Signals],
    /// Slip elements along each.
    pub slips: &'a [Vec<Vec<f64>>],
    /// What the screw carries along each, where there is a scale.
    pub carried: Option<&'a [Carried]>,
    /// What speed does to friction.
    pub shape: &'a Shape,
    /// Harmonic of the cogging.
    pub cogging_per_turn: u32,
    /// Lever of the axis.
    pub lever: &'a Lever,
}

impl MotorEquation<'_> {
    /// `T/p = M1·a1 + B1·v1 + k·u + c·u' − γ·Kv·Δvc + Σ s_i·stop_i(x1) + c + d·e^−(v1/vs)² + D·|v1| + cogging + place`; without a scale there is no `k·u + c·u'`.
    pub fn fit(&self) -> Fit {
        let mut equations = NormalEquations::new(COLUMNS);
        self.rows(|signals, i, row| equations.add(row, signals.force_n[i], signals.weight[i]));
        equations.solve(BEFORE + ELEMENTS)
    }

    /// Every equation: its recording, its instant, its row.
    pub fn rows(&self, mut take: impl FnMut(&Signals, usize, &[f64])) {
        let mut row = vec![0.0; COLUMNS];
        for (index, (signals, slips)) in self.all.iter().zip(self.slips).enumerate() {
            let carried = self.carried.and_then(|all| all.get(index));
            for i in signals.equations() {
                row[0] = signals.motor_m_s2[i];
                row[1] = signals.motor_m_s[i];
                if let Some((beyond, rate)) = carried {
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
                behind[8] = signals.rise(signals.motor_m_s[i], self.shape);
                behind[4..8].copy_from_slice(&signals.by_place(i, slips, lead_mm));
                take(signals, i, &row);
            }
        }
    }
}

/// Columns of the table equation that may not be negative: mass, viscous friction, slip elements.
pub const TABLE_BOUND: usize = 2 + ELEMENTS;
/// All of them: constant force, viscous friction by direction, friction by place (4), break-away by direction.
pub const TABLE_COLUMNS: usize = TABLE_BOUND + 7;

/// Right side of the table equation at every scan of a recording: `M2·a2 + B2·v2 + Σ q_i·stop_i(x2) + c + d·e^−(v2/vs)² + D·|v2| + place`.
pub fn table_rows(signals: &Signals, shape: &Shape, lever: &Lever) -> Vec<[f64; TABLE_COLUMNS]> {
    let slips = signals.slips(&signals.scale_mm, &signals.scale_m_s, shape);
    (0..signals.weight.len())
        .map(|i| {
            let mut row = [0.0; TABLE_COLUMNS];
            row[0] = signals.scale_m_s2[i];
            row[1] = signals.scale_m_s[i];
            for (place, slip) in row[2..].iter_mut().zip(&slips) {
                *place = slip[i];
            }
            row[TABLE_BOUND] = 1.0;
            row[TABLE_BOUND + 1] = signals.scale_m_s[i].abs();
            let by_place = signals.by_place(i, &slips, lever.lead_mm);
            row[TABLE_BOUND + 2..TABLE_BOUND + 6].copy_from_slice(&by_place);
            row[TABLE_BOUND + 6] = signals.rise(signals.scale_m_s[i], shape);
            row
        })
        .collect()
}

/// The table equation for what the screw carries in each recording, scan by scan.
pub fn table_fit(
    all: &[Signals],
    rows: &[Vec<[f64; TABLE_COLUMNS]>],
    carries: impl Fn(usize, usize) -> f64,
) -> Fit {
    let mut equations = NormalEquations::new(TABLE_COLUMNS);
    for (index, (signals, rows)) in all.iter().zip(rows).enumerate() {
        for i in signals.equations() {
            equations.add(&rows[i], carries(index, i), signals.weight[i]);
        }
    }
    equations.solve(TABLE_BOUND)
}
