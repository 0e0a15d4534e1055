//! What equations are made of: signals of one recording, smoothed alike, and how much each instant counts.

use loops::maxwell_slip::{Level, MaxwellSlip, SlipElement};

use super::{BREAK_UM, ELEMENTS, Lever};
use crate::recording::Recording;

/// Signals are smoothed by two running means of this length, in s, torque and regressors alike.
pub const SMOOTHING_S: f64 = 3e-3;
/// One equation each so much time, in s.
const EQUATION_S: f64 = 1e-3;
/// Travel after the first movement until friction has forgotten where it stood, in mm.
const FORGOTTEN_MM: f64 = 0.3;
/// Travel since a reversal within which an equation counts in full, in mm, and what others count.
pub const REVERSAL_MM: f64 = 0.3;
const SLIDING_WEIGHT: f64 = 0.1;
/// Slowest speed that counts as sliding, in mm/s, and largest acceleration that counts as steady, in mm/s².
pub const SLIDING_MM_S: f64 = 0.1;
const STEADY_MM_S2: f64 = 50.0;
/// Element whose force says which way friction acts: it turns round over 4 µm.
const WAY: usize = 2;

/// One recording with what is derived from it, evenly spaced.
pub struct Signals {
    /// Motor encoder, in mm.
    pub motor_mm: Vec<f64>,
    /// Scale, in mm.
    pub scale_mm: Vec<f64>,
    /// Torque as force at the table, smoothed, in N.
    pub force_n: Vec<f64>,
    /// Speed of the motor, smoothed, in m/s.
    pub motor_m_s: Vec<f64>,
    /// Its acceleration.
    pub motor_m_s2: Vec<f64>,
    /// Its direction, −1 to 1, smoothed.
    pub direction: Vec<f64>,
    /// Speed of the table, smoothed, in m/s.
    pub scale_m_s: Vec<f64>,
    /// Its acceleration.
    pub scale_m_s2: Vec<f64>,
    /// Kv times the step of the velocity command at the start of the scan that the torque was read at the end of, smoothed,
    /// in N.
    pub stair_n: Vec<f64>,
    /// Weight of each equation; 0 where there is none.
    pub weight: Vec<f64>,
    /// Scan period, in s.
    pub scan_s: f64,
    /// Middle of the travel, and half of it, in mm.
    pub travel_mm: (f64, f64),
    smoothing_s: f64,
}

/// What speed does to friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Break-away over Coulomb friction.
    pub static_ratio: f64,
    /// Stribeck velocity, in mm/s.
    pub stribeck_mm_s: f64,
}

impl Signals {
    /// Of a recording, with forces by this lever.
    pub fn new(recording: &Recording, lever: &Lever) -> Signals {
        let scan_s = recording.scan_s;
        let smoothing_s = lever.smoothing_s;
        let smooth = |values: &[f64]| smooth(values, scan_s, smoothing_s);
        let force: Vec<f64> = recording
            .torque_nm
            .iter()
            .map(|torque| torque * lever.newtons_per_nm)
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
        let motor_m_s = smooth(&rate(motor));
        let direction: Vec<f64> = motor_m_s.iter().map(|v| v.signum()).collect();
        let low = motor.iter().copied().fold(f64::INFINITY, f64::min);
        let high = motor.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Signals {
            force_n: smooth(&force),
            direction: smooth(&direction),
            motor_m_s,
            motor_m_s2: smooth(&rate_of_rate(motor)),
            scale_m_s: smooth(&rate(scale)),
            scale_m_s2: smooth(&rate_of_rate(scale)),
            stair_n: smooth(&stairs(recording)),
            weight: weights(motor, scan_s, smoothing_s),
            motor_mm: motor.clone(),
            scale_mm: scale.clone(),
            scan_s,
            travel_mm: (0.5 * (low + high), (0.5 * (high - low)).max(1e-3)),
            smoothing_s,
        }
    }

    /// The same smoothing for another signal of this recording.
    pub fn smooth(&self, values: &[f64]) -> Vec<f64> {
        smooth(values, self.scan_s, self.smoothing_s)
    }

    /// Smoothed forces of slip elements of 1 N each along positions, element by element.
    pub fn slips(&self, positions_mm: &[f64], speeds_m_s: &[f64], shape: &Shape) -> Vec<Vec<f64>> {
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
                self.smooth(&forces)
            })
            .collect()
    }

    /// Indices with an equation.
    pub fn equations(&self) -> impl Iterator<Item = usize> + '_ {
        let step = (EQUATION_S / self.scan_s).round().max(1.0) as usize;
        (0..self.weight.len())
            .step_by(step)
            .filter(|i| self.weight[*i] > 0.0)
    }

    /// Sliding without acceleration, far from a reversal.
    pub fn is_steady(&self, i: usize) -> bool {
        self.weight[i] < 1.0 && self.motor_m_s2[i].abs() * 1e3 < STEADY_MM_S2
    }

    /// How much of the rise to break-away friction there is at the speed of an instant, by the same Stribeck curve; 0 where there is no rise.
    pub fn rise(&self, speed_m_s: f64, shape: &Shape) -> f64 {
        if shape.static_ratio <= 1.0 {
            return 0.0;
        }
        let ratio = 1e3 * speed_m_s / shape.stribeck_mm_s;
        libm::exp(-ratio * ratio)
    }

    /// What friction may do by place, as factors of columns: sine and cosine of the turn, place in the travel and its square. `way` is the force of
    /// slip elements of 1 N.
    pub fn by_place(&self, i: usize, slips: &[Vec<f64>], lead_mm: Option<f64>) -> [f64; 4] {
        let way = slips.get(WAY).map_or(0.0, |slip| slip[i]);
        let at = (self.motor_mm[i] - self.travel_mm.0) / self.travel_mm.1;
        let (sine, cosine) = lead_mm.map_or((0.0, 0.0), |lead_mm| {
            let angle = turn(self.motor_mm[i], lead_mm);
            (libm::sin(angle), libm::cos(angle))
        });
        [
            way * sine,
            way * cosine,
            way * at,
            way * (at * at - 1.0 / 3.0),
        ]
    }
}

/// Gives all recordings of an axis the same travel, that of the widest, by which friction by place is told.
pub fn share_travel(all: &mut [Signals]) {
    let widest = all.iter().map(|signals| signals.travel_mm);
    let widest = widest.max_by(|a, b| a.1.total_cmp(&b.1));
    for signals in all {
        signals.travel_mm = widest.unwrap_or(signals.travel_mm);
    }
}

/// Angle of the motor, in rad.
pub fn turn(position_mm: f64, lead_mm: f64) -> f64 {
    2.0 * core::f64::consts::PI * libm::fmod(position_mm / lead_mm, 1.0)
}

/// Kv times the last but one step of the velocity command, in N.
fn stairs(recording: &Recording) -> Vec<f64> {
    let command = &recording.velocity_command_mm_s;
    let at = |i: usize, back: usize| command[i.saturating_sub(back)];
    (0..command.len())
        .map(|i| recording.gain_n_s_per_m * (at(i, 1) - at(i, 2)) * 1e-3)
        .collect()
}

/// Half the length of a running mean, in samples.
pub fn half(scan_s: f64, smoothing_s: f64) -> usize {
    (0.5 * smoothing_s / scan_s).round().max(1.0) as usize
}

/// Two running means of this length.
pub fn smooth(values: &[f64], scan_s: f64, smoothing_s: f64) -> Vec<f64> {
    let half = half(scan_s, smoothing_s);
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
fn weights(motor_mm: &[f64], scan_s: f64, smoothing_s: f64) -> Vec<f64> {
    let (mut travelled_mm, mut since_mm, mut extreme_mm, mut direction) = (0.0, 0.0, 0.0, 0.0);
    let edge = (2.0 * smoothing_s / scan_s).ceil() as usize;
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
