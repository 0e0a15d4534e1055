//! From recordings to the model of an axis: linear least squares, a search over three shape parameters around it.
//! Method, equations and bounds: docs/methods/tuning.md.

pub use control::maxwell_slip::ELEMENTS;
use control::maxwell_slip::{Level, MaxwellSlip, SlipElement};

use super::least_squares::{Fit, NormalEquations, golden_section};
use super::recording::Recording;

/// Break distances of the slip elements, in µm: fixed, so that the shares are linear unknowns.
pub const BREAK_UM: [f64; ELEMENTS] = [0.5, 1.5, 4.0, 10.0, 25.0, 60.0];
/// Signals are smoothed by two running means of this length, in s, torque and regressors alike.
const SMOOTHING_S: f64 = 3e-3;
/// One equation each so much time, in s.
const EQUATION_S: f64 = 1e-3;
/// Travel after the first movement until friction has forgotten where it stood, in mm.
const FORGOTTEN_MM: f64 = 0.3;
/// Travel since a reversal within which an equation counts in full, in mm, and what others count.
const REVERSAL_MM: f64 = 0.3;
const SLIDING_WEIGHT: f64 = 0.1;
/// Slowest speed that counts as sliding, in mm/s, and largest acceleration that counts as steady, in mm/s².
const SLIDING_MM_S: f64 = 0.1;
const STEADY_MM_S2: f64 = 50.0;
/// Harmonics of the motor turn among which cogging is looked for.
const COGGING_MAX: u32 = 48;

/// A curve of friction: Coulomb friction by element, and what speed does to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// Coulomb friction of each element, in N.
    pub element_n: [f64; ELEMENTS],
    /// Break-away over Coulomb friction.
    pub static_ratio: f64,
    /// Stribeck velocity, in mm/s.
    pub stribeck_mm_s: f64,
    /// Viscous friction, in N·s/m.
    pub viscous_n_s_per_m: f64,
}

impl Friction {
    /// Coulomb friction, in N.
    pub fn coulomb_n(&self) -> f64 {
        self.element_n.iter().sum()
    }
}

/// The table, where a scale shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table {
    /// Mass, in kg.
    pub mass_kg: f64,
    /// Friction.
    pub friction: Friction,
    /// Stiffness, in N/µm.
    pub stiffness_n_per_um: f64,
    /// Gap, in µm.
    pub gap_um: f64,
    /// What the fit of its equation leaves, in N.
    pub residual_n: f64,
}

/// What was found of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Mass that the motor feels besides the table, in kg at the table; all of it where there is no table.
    pub motor_mass_kg: f64,
    /// Friction of the same.
    pub motor: Friction,
    /// The table.
    pub table: Option<Table>,
    /// Cogging: amplitude in N·m and periods per motor turn.
    pub cogging_nm: f64,
    /// Periods per motor turn.
    pub cogging_per_turn: u32,
    /// What the fit of the torque leaves, in N at the table.
    pub residual_n: f64,
}

impl Found {
    /// Mass in all, in kg.
    pub fn mass_kg(&self) -> f64 {
        self.motor_mass_kg + self.table.map_or(0.0, |t| t.mass_kg)
    }

    /// Coulomb friction in all, in N.
    pub fn coulomb_n(&self) -> f64 {
        self.motor.coulomb_n() + self.table.map_or(0.0, |t| t.friction.coulomb_n())
    }

    /// Viscous friction in all, in N·s/m.
    pub fn viscous_n_s_per_m(&self) -> f64 {
        self.motor.viscous_n_s_per_m + self.table.map_or(0.0, |t| t.friction.viscous_n_s_per_m)
    }

    /// Lost motion: gap and wind-up by friction both ways, in µm.
    pub fn lost_motion_um(&self) -> f64 {
        self.table.map_or(0.0, |t| {
            t.gap_um + 2.0 * t.friction.coulomb_n() / t.stiffness_n_per_um
        })
    }
}

/// One recording with what is derived from it, evenly spaced.
struct Signals {
    motor_mm: Vec<f64>,
    scale_mm: Vec<f64>,
    /// Torque as force at the table, smoothed, in N.
    force_n: Vec<f64>,
    motor_m_s: Vec<f64>,
    motor_m_s2: Vec<f64>,
    scale_m_s: Vec<f64>,
    scale_m_s2: Vec<f64>,
    /// Kv times the step of the velocity command at the start of the scan that the torque was read at the end of, smoothed,
    /// in N.
    stair_n: Vec<f64>,
    /// Weight of each equation; 0 where there is none.
    weight: Vec<f64>,
    scan_s: f64,
}

impl Signals {
    fn new(recording: &Recording, newtons_per_nm: f64) -> Signals {
        let scan_s = recording.scan_s;
        let smooth = |values: &[f64]| smooth(values, scan_s);
        let force: Vec<f64> = recording
            .torque_nm
            .iter()
            .map(|torque| torque * newtons_per_nm)
            .collect();
        let rate = |values: &[f64]| -> Vec<f64> {
            let n = values.len();
            (0..n)
                .map(|i| {
                    let (low, high) = (i.saturating_sub(1), (i + 1).min(n - 1));
                    (values[high] - values[low]) / ((high - low).max(1) as f64 * scan_s) * 1e-3
                })
                .collect()
        };
        let rate_of_rate = |values: &[f64]| -> Vec<f64> {
            let n = values.len();
            (0..n)
                .map(|i| {
                    if i == 0 || i + 1 >= n {
                        0.0
                    } else {
                        (values[i + 1] - 2.0 * values[i] + values[i - 1]) / (scan_s * scan_s) * 1e-3
                    }
                })
                .collect()
        };
        let (motor, scale) = (&recording.motor_mm, &recording.scale_mm);
        Signals {
            force_n: smooth(&force),
            motor_m_s: smooth(&rate(motor)),
            motor_m_s2: smooth(&rate_of_rate(motor)),
            scale_m_s: smooth(&rate(scale)),
            scale_m_s2: smooth(&rate_of_rate(scale)),
            stair_n: smooth(&stairs(recording)),
            weight: weights(motor, scan_s),
            motor_mm: motor.clone(),
            scale_mm: scale.clone(),
            scan_s,
        }
    }

    /// Smoothed forces of slip elements of 1 N each along positions, element by element.
    fn slips(&self, positions_mm: &[f64], speeds_m_s: &[f64], shape: &Shape) -> Vec<Vec<f64>> {
        BREAK_UM
            .iter()
            .map(|break_um| {
                let mut one = MaxwellSlip {
                    static_excess: shape.static_ratio - 1.0,
                    stribeck_velocity_mm_s: shape.stribeck_mm_s,
                    ..MaxwellSlip::default()
                };
                one.elements[0] = SlipElement {
                    slip_n: 1.0,
                    break_distance_mm: break_um * 1e-3,
                };
                let mut state = [0.0; ELEMENTS];
                let forces: Vec<f64> = (0..positions_mm.len())
                    .map(|i| {
                        let travel_mm = positions_mm[i] - positions_mm[i.saturating_sub(1)];
                        let speed_mm_s = 1e3 * speeds_m_s[i];
                        one.update(&mut state, travel_mm, speed_mm_s, &Level::TUNED)
                    })
                    .collect();
                smooth(&forces, self.scan_s)
            })
            .collect()
    }

    /// Indices with an equation.
    fn equations(&self) -> impl Iterator<Item = usize> + '_ {
        let step = (EQUATION_S / self.scan_s).round().max(1.0) as usize;
        (0..self.weight.len())
            .step_by(step)
            .filter(|i| self.weight[*i] > 0.0)
    }
}

/// Kv times the last but one step of the velocity command, in N.
fn stairs(recording: &Recording) -> Vec<f64> {
    let command = &recording.velocity_command_mm_s;
    let at = |i: usize, back: usize| command[i.saturating_sub(back)];
    (0..command.len())
        .map(|i| recording.gain_n_s_per_m * (at(i, 1) - at(i, 2)) * 1e-3)
        .collect()
}

/// Two running means of [`SMOOTHING_S`].
fn smooth(values: &[f64], scan_s: f64) -> Vec<f64> {
    let half = (0.5 * SMOOTHING_S / scan_s).round().max(1.0) as usize;
    running_mean(&running_mean(values, half), half)
}

fn running_mean(values: &[f64], half: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(values.len() + 1);
    let mut sum = 0.0;
    sums.push(0.0);
    for value in values {
        sum += value;
        sums.push(sum);
    }
    (0..values.len())
        .map(|i| {
            let (low, high) = (i.saturating_sub(half), (i + half + 1).min(values.len()));
            (sums[high] - sums[low]) / (high - low) as f64
        })
        .collect()
}

/// Weights: none before the axis has travelled far enough, full close behind a reversal.
fn weights(motor_mm: &[f64], scan_s: f64) -> Vec<f64> {
    let (mut travelled_mm, mut since_mm, mut extreme_mm, mut direction) = (0.0, 0.0, 0.0, 0.0);
    let edge = (2.0 * SMOOTHING_S / scan_s).ceil() as usize;
    let n = motor_mm.len();
    (0..n)
        .map(|i| {
            let step_mm = motor_mm[i] - motor_mm[i.saturating_sub(1)];
            travelled_mm += step_mm.abs();
            // A reversal is one that goes on for more than noise.
            if i == 0 || (motor_mm[i] - extreme_mm) * direction > 0.0 {
                extreme_mm = motor_mm[i];
            }
            let back_mm = (motor_mm[i] - extreme_mm).abs();
            if back_mm > 1e-3 {
                direction = if motor_mm[i] > extreme_mm { 1.0 } else { -1.0 };
                extreme_mm = motor_mm[i];
                since_mm = 0.0;
            }
            since_mm += step_mm.abs();
            if travelled_mm < FORGOTTEN_MM || i < edge || i + edge >= n {
                0.0
            } else if since_mm < REVERSAL_MM {
                1.0
            } else {
                SLIDING_WEIGHT
            }
        })
        .collect()
}

/// What speed does to friction.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shape {
    static_ratio: f64,
    stribeck_mm_s: f64,
}

/// The mass that torque and acceleration tell, in kg: `T/p = M·a + F·sgn(v) + B·v`.
pub fn mass_kg(recording: &Recording, newtons_per_nm: f64) -> f64 {
    let signals = Signals::new(recording, newtons_per_nm);
    let mut equations = NormalEquations::new(3);
    for i in signals.equations() {
        let speed_m_s = signals.motor_m_s[i];
        if speed_m_s.abs() > 1e-3 {
            let row = [signals.motor_m_s2[i], speed_m_s.signum(), speed_m_s];
            equations.add(&row, signals.force_n[i], 1.0);
        }
    }
    equations.solve(3).coefficients[0]
}

/// The whole model from the recordings of one axis. `steady` is the one at constant speeds, among the others.
pub fn model(recordings: &[Recording], steady: &Recording, lead_mm: f64) -> Found {
    let newtons_per_nm = 2.0 * core::f64::consts::PI / (lead_mm * 1e-3);
    let calm = Signals::new(steady, newtons_per_nm);
    let cogging_per_turn = cogging_period(&calm, lead_mm);
    let shape = stribeck(&calm, &calm.force_n, cogging_per_turn, lead_mm);
    let mut all: Vec<Signals> = recordings
        .iter()
        .map(|recording| Signals::new(recording, newtons_per_nm))
        .collect();
    all.push(calm);
    let slips: Vec<Vec<Vec<f64>>> = all
        .iter()
        .map(|signals| signals.slips(&signals.motor_mm, &signals.motor_m_s, &shape))
        .collect();
    let has_scale = recordings.iter().any(Recording::has_scale);
    let torque = |gap_um: f64, wind_um: Option<&[Vec<f64>]>| -> Fit {
        torque_fit(&all, &slips, wind_um, gap_um, cogging_per_turn, lead_mm)
    };
    let finish = |fit: &Fit, table: Option<Table>| {
        let c = &fit.coefficients;
        let mut element_n = [0.0; ELEMENTS];
        element_n.copy_from_slice(&c[BEFORE..BEFORE + ELEMENTS]);
        Found {
            motor_mass_kg: c[0],
            motor: Friction {
                element_n,
                static_ratio: shape.static_ratio,
                stribeck_mm_s: shape.stribeck_mm_s,
                viscous_n_s_per_m: c[1],
            },
            table,
            cogging_nm: c[BEFORE + ELEMENTS].hypot(c[BEFORE + ELEMENTS + 1]) / newtons_per_nm,
            cogging_per_turn,
            residual_n: fit.residual,
        }
    };
    if !has_scale {
        return finish(&torque(0.0, None), None);
    }
    let wind_um = wind_ups(&all);
    let widest_um = sliding_wind_up_um(&all, &wind_um);
    let gap_um = golden_section(0.0, 2.0 * widest_um, |gap_um| {
        torque(gap_um, Some(&wind_um)).residual
    });
    let fit = torque(gap_um, Some(&wind_um));
    let table = table_fit(
        &all,
        &wind_um,
        gap_um,
        [fit.coefficients[2], fit.coefficients[3]],
        &shape,
    );
    finish(&fit, Some(table))
}

/// Harmonic of the motor turn that is strongest in the torque at steady speed.
fn cogging_period(calm: &Signals, lead_mm: f64) -> u32 {
    let strength = |n: u32| {
        let mut equations = NormalEquations::new(5);
        for i in calm.equations() {
            let v = calm.motor_m_s[i];
            if v.abs() * 1e3 < SLIDING_MM_S || !is_steady(calm, i) {
                continue;
            }
            let angle = turn(calm.motor_mm[i], lead_mm) * f64::from(n);
            let row = [v.signum(), v, 1.0, libm::sin(angle), libm::cos(angle)];
            equations.add(&row, calm.force_n[i], 1.0);
        }
        equations.solve(0).residual
    };
    (1..=COGGING_MAX)
        .map(|n| (n, strength(n)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(1, |best| best.0)
}

/// Sliding without acceleration, far from a reversal.
fn is_steady(signals: &Signals, i: usize) -> bool {
    signals.weight[i] < 1.0 && signals.motor_m_s2[i].abs() * 1e3 < STEADY_MM_S2
}

fn turn(position_mm: f64, lead_mm: f64) -> f64 {
    2.0 * core::f64::consts::PI * libm::fmod(position_mm / lead_mm, 1.0)
}

/// Break-away ratio and Stribeck velocity from sliding at steady speeds: `F(v) = C·sgn(v)·(1 + r·e^−(v/vs)²) + B·v`.
fn stribeck(calm: &Signals, force_n: &[f64], cogging_per_turn: u32, lead_mm: f64) -> Shape {
    let fit = |stribeck_mm_s: f64| {
        let mut equations = NormalEquations::new(6);
        for i in calm.equations() {
            let v = calm.motor_m_s[i];
            if v.abs() * 1e3 < SLIDING_MM_S || !is_steady(calm, i) {
                continue;
            }
            let ratio = 1e3 * v / stribeck_mm_s;
            let angle = turn(calm.motor_mm[i], lead_mm) * f64::from(cogging_per_turn);
            let row = [
                v.signum(),
                v.signum() * libm::exp(-ratio * ratio),
                v,
                1.0,
                libm::sin(angle),
                libm::cos(angle),
            ];
            // Every speed counts alike, however long it took.
            equations.add(&row, force_n[i], v.abs());
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

/// Motor against table, in µm, without the offset of the two zeros.
fn wind_ups(all: &[Signals]) -> Vec<Vec<f64>> {
    let (mut forward, mut back) = ((0.0, 0.0), (0.0, 0.0));
    for signals in all {
        for i in signals.equations() {
            if signals.motor_m_s[i].abs() * 1e3 < 1.0 || !is_steady(signals, i) {
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

/// Mean wind-up with its half gap while the axis slides steadily, in µm.
fn sliding_wind_up_um(all: &[Signals], wind_um: &[Vec<f64>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (signals, wind_um) in all.iter().zip(wind_um) {
        for i in signals.equations() {
            let v = signals.motor_m_s[i];
            if v.abs() * 1e3 > 1.0 && is_steady(signals, i) {
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

/// Columns before the slip elements: mass, viscous friction, stiffness, damping, stairs.
const BEFORE: usize = 5;

/// Wind-up beyond the gap, in µm, and its rate while in contact, in m/s; both smoothed.
fn carried(signals: &Signals, wind_um: &[f64], gap_um: f64) -> (Vec<f64>, Vec<f64>) {
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
    (
        smooth(&beyond, signals.scan_s),
        smooth(&rate, signals.scan_s),
    )
}

/// Motor equation: `T/p = M1·a1 + B1·v1 + k·u + c·u' − γ·Kv·Δvc + Σ s_i·stop_i(x1) + cogging`; without a scale there is no `k·u + c·u'`.
fn torque_fit(
    all: &[Signals],
    slips: &[Vec<Vec<f64>>],
    wind_um: Option<&[Vec<f64>]>,
    gap_um: f64,
    cogging_per_turn: u32,
    lead_mm: f64,
) -> Fit {
    let columns = BEFORE + ELEMENTS + 3;
    let mut equations = NormalEquations::new(columns);
    let mut row = vec![0.0; columns];
    for (index, (signals, slips)) in all.iter().zip(slips).enumerate() {
        let carried = wind_um
            .and_then(|all| all.get(index))
            .map(|wind| carried(signals, wind, gap_um));
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
            let angle = turn(signals.motor_mm[i], lead_mm) * f64::from(cogging_per_turn);
            row[BEFORE + ELEMENTS] = libm::sin(angle);
            row[BEFORE + ELEMENTS + 1] = libm::cos(angle);
            row[BEFORE + ELEMENTS + 2] = 1.0;
            equations.add(&row, signals.force_n[i], signals.weight[i]);
        }
    }
    equations.solve(BEFORE + ELEMENTS)
}

/// Table equation: `k·u + c·u' = M2·a2 + B2·v2 + Σ q_i·stop_i(x2)`.
fn table_fit(
    all: &[Signals],
    wind_um: &[Vec<f64>],
    gap_um: f64,
    [stiffness_n_per_um, damping_n_s_per_m]: [f64; 2],
    shape: &Shape,
) -> Table {
    let columns = 2 + ELEMENTS;
    let mut equations = NormalEquations::new(columns);
    let mut row = vec![0.0; columns];
    for (signals, wind) in all.iter().zip(wind_um) {
        let slips = signals.slips(&signals.scale_mm, &signals.scale_m_s, shape);
        let (beyond, rate) = carried(signals, wind, gap_um);
        for i in signals.equations() {
            row[0] = signals.scale_m_s2[i];
            row[1] = signals.scale_m_s[i];
            for (place, slip) in row[2..].iter_mut().zip(&slips) {
                *place = slip[i];
            }
            let carried_n = stiffness_n_per_um * beyond[i] + damping_n_s_per_m * rate[i];
            equations.add(&row, carried_n, signals.weight[i]);
        }
    }
    let fit = equations.solve(columns);
    let c = &fit.coefficients;
    let mut element_n = [0.0; ELEMENTS];
    element_n.copy_from_slice(&c[2..]);
    Table {
        mass_kg: c[0],
        friction: Friction {
            element_n,
            static_ratio: shape.static_ratio,
            stribeck_mm_s: shape.stribeck_mm_s,
            viscous_n_s_per_m: c[1],
        },
        stiffness_n_per_um,
        gap_um,
        residual_n: fit.residual,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCAN_S: f64 = 1e-3;
    const LEAD_MM: f64 = 10.0;

    /// Slip elements of these Coulomb forces along a position, without Stribeck effect.
    fn friction_n(element_n: [f64; ELEMENTS], positions_mm: &[f64]) -> Vec<f64> {
        let mut slip = MaxwellSlip {
            stribeck_velocity_mm_s: 1.0,
            ..MaxwellSlip::default()
        };
        for ((place, slip_n), um) in slip.elements.iter_mut().zip(element_n).zip(BREAK_UM) {
            *place = SlipElement {
                slip_n,
                break_distance_mm: um * 1e-3,
            };
        }
        let mut state = [0.0; ELEMENTS];
        let mut before = positions_mm[0];
        positions_mm
            .iter()
            .map(|position| {
                let force = slip.update(&mut state, position - before, 0.0, &Level::TUNED);
                before = *position;
                force
            })
            .collect()
    }

    fn rate(values: &[f64]) -> Vec<f64> {
        let at = |i: usize| values[i.min(values.len() - 1)];
        (0..values.len())
            .map(|i| (at(i + 1) - at(i.saturating_sub(1))) / (2.0 * SCAN_S) * 1e-3)
            .collect()
    }

    /// A table of 100 kg behind 120 N/µm and a gap of 5 µm, a motor of 700 kg: driven so that the table goes along a sine.
    fn recording(amplitude_mm: f64, period_s: f64, scale: bool) -> Recording {
        let table_mm: Vec<f64> = (0..12_000)
            .map(|i| {
                let turns = f64::from(i) * SCAN_S / period_s;
                amplitude_mm * libm::sin(2.0 * core::f64::consts::PI * turns)
            })
            .collect();
        let newton = |mass_kg: f64, viscous: f64, positions_mm: &[f64], friction_n: &[f64]| {
            let speed = rate(positions_mm);
            let at = |i: usize| positions_mm[i.min(positions_mm.len() - 1)];
            let acceleration: Vec<f64> = (0..positions_mm.len())
                .map(|i| {
                    (at(i + 1) - 2.0 * at(i) + at(i.saturating_sub(1))) / SCAN_S / SCAN_S * 1e-3
                })
                .collect();
            (0..positions_mm.len())
                .map(|i| mass_kg * acceleration[i] + viscous * speed[i] + friction_n[i])
                .collect::<Vec<f64>>()
        };
        let slow = friction_n([40.0, 60.0, 60.0, 40.0, 0.0, 0.0], &table_mm);
        let contact_n = newton(100.0, 1000.0, &table_mm, &slow);
        let motor_mm: Vec<f64> = table_mm
            .iter()
            .zip(&contact_n)
            .map(|(x, n)| x + (n / 120.0 + 2.5 * n.signum()) * 1e-3)
            .collect();
        let fast = friction_n([100.0, 80.0, 50.0, 20.0, 0.0, 0.0], &motor_mm);
        let own_n = newton(700.0, 1500.0, &motor_mm, &fast);
        let lever = 2.0 * core::f64::consts::PI / (LEAD_MM * 1e-3);
        Recording {
            scan_s: SCAN_S,
            torque_nm: own_n
                .iter()
                .zip(&contact_n)
                .map(|(own, contact)| (own + contact) / lever)
                .collect(),
            velocity_command_mm_s: vec![0.0; motor_mm.len()],
            scale_mm: if scale { table_mm } else { motor_mm.clone() },
            motor_mm,
            gain_n_s_per_m: 0.0,
        }
    }

    fn found(scale: bool) -> Found {
        let runs: Vec<Recording> = [(0.5, 1.7), (5.0, 0.9), (20.0, 0.6)]
            .into_iter()
            .map(|(amplitude_mm, period_s)| recording(amplitude_mm, period_s, scale))
            .collect();
        model(&runs, &recording(15.0, 11.0, scale), LEAD_MM)
    }

    fn near(what: &str, value: f64, right: f64, percent: f64) {
        let off = (value / right - 1.0).abs() * 100.0;
        assert!(off <= percent, "{what} {value}, really {right}");
    }

    #[test]
    fn a_machine_that_is_as_the_model_says_is_found_again() {
        let found = found(true);
        let table = found.table.expect("a table");
        near("mass", found.mass_kg(), 800.0, 2.0);
        near("friction", found.coulomb_n(), 450.0, 3.0);
        near("viscous", found.viscous_n_s_per_m(), 2500.0, 5.0);
        near("table mass", table.mass_kg, 100.0, 10.0);
        near("table friction", table.friction.coulomb_n(), 200.0, 10.0);
        near("stiffness", table.stiffness_n_per_um, 120.0, 10.0);
        near("gap", table.gap_um, 5.0, 6.0);
        near(
            "lost motion",
            found.lost_motion_um(),
            5.0 + 400.0 / 120.0,
            3.0,
        );
    }

    #[test]
    fn without_a_scale_the_sums_are_found_and_no_table() {
        let found = found(false);
        assert!(found.table.is_none());
        near("mass", found.mass_kg(), 800.0, 3.0);
        near("friction", found.coulomb_n(), 450.0, 5.0);
    }
}
