//! Open-loop simulation: the recorded force drives the model from the first recorded instant on; nothing corrects it.

use loops::maxwell_slip::{Level, MaxwellSlip, SlipElement};

use crate::identify::{BREAK_UM, Found, Lever};
use crate::recording::Recording;

/// Steps of the simulation in one of the recording.
const STEPS: usize = 20;

/// How far a simulation is off what was measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Off {
    /// Root mean square of the difference, in mm or mm/s.
    pub rms: f64,
    /// Norm of the difference over the norm of what was measured.
    pub relative: f64,
    /// 1 less the norm of the difference over that of what was measured less its mean.
    pub fit: f64,
}

/// What a simulation gave.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Simulated {
    /// Of the position.
    pub position: Off,
    /// Of the speed.
    pub velocity: Off,
}

impl Off {
    fn of(simulated: &[f64], measured: &[f64]) -> Off {
        let count = measured.len().max(1) as f64;
        let mean = measured.iter().sum::<f64>() / count;
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            let pairs = simulated.iter().zip(measured);
            pairs.map(|(a, b)| of(*a, *b).powi(2)).sum::<f64>()
        };
        let off = sum(&|a, b| a - b);
        let whole = sum(&|_, b| b).max(f64::MIN_POSITIVE);
        let around = sum(&|_, b| b - mean).max(f64::MIN_POSITIVE);
        Off {
            rms: (off / count).sqrt(),
            relative: (off / whole).sqrt(),
            fit: 1.0 - (off / around).sqrt(),
        }
    }
}

/// Simulates a recording: `M·v' = F − friction(x, v) − B·v − D·|v| − c`, semi-implicit, 20 steps for each of the recording.
pub fn run(found: &Found, recording: &Recording, lever: &Lever) -> Simulated {
    let late = (found.torque_late_s / recording.scan_s).round() as usize;
    let recording = recording.with_torque_late(late);
    let step_s = recording.scan_s / STEPS as f64;
    let structure = found.whole_structure();
    let (mass_kg, viscous) = (found.mass_kg(), found.viscous_n_s_per_m());
    let mut slip = MaxwellSlip {
        static_excess: found.motor.static_ratio - 1.0,
        stribeck_velocity_mm_s: found.motor.stribeck_mm_s,
        ..MaxwellSlip::default()
    };
    let table_n = found
        .table
        .map_or([0.0; 6], |table| table.friction.element_n);
    let both = found.motor.element_n.iter().zip(table_n);
    for ((element, (motor_n, table_n)), um) in slip.elements.iter_mut().zip(both).zip(BREAK_UM) {
        *element = SlipElement {
            slip_n: motor_n + table_n,
            break_distance_mm: um * 1e-3,
        };
    }
    let measured_mm_s = rate_mm_s(&recording);
    let first = |values: &[f64]| values.first().copied().unwrap_or(0.0);
    let (mut place_mm, mut speed_m_s) = (first(&recording.motor_mm), 1e-3 * first(&measured_mm_s));
    let mut springs = [0.0; 6];
    let (mut places_mm, mut speeds_mm_s) = (Vec::new(), Vec::new());
    for torque_nm in &recording.torque_nm {
        places_mm.push(place_mm);
        speeds_mm_s.push(speed_m_s * 1e3);
        let force_n = torque_nm * lever.newtons_per_nm - structure.constant_n;
        for _ in 0..STEPS {
            let travel_mm = speed_m_s * step_s * 1e3;
            let friction_n = slip.update(&mut springs, travel_mm, speed_m_s * 1e3, &Level::TUNED);
            place_mm += travel_mm;
            let free_n = force_n - friction_n - structure.viscous_n_s_per_m * speed_m_s.abs();
            // Viscous friction of the new speed, so that no step is too long for it.
            speed_m_s = (mass_kg * speed_m_s + step_s * free_n) / (mass_kg + step_s * viscous);
        }
    }
    Simulated {
        position: Off::of(&places_mm, &recording.motor_mm),
        velocity: Off::of(&speeds_mm_s, &measured_mm_s),
    }
}

/// Speed by central differences, in mm/s.
fn rate_mm_s(recording: &Recording) -> Vec<f64> {
    let places = &recording.motor_mm;
    let last = places.len().saturating_sub(1);
    (0..places.len())
        .map(|i| {
            let (low, high) = (i.saturating_sub(1), (i + 1).min(last));
            (places[high] - places[low]) / ((high - low).max(1) as f64 * recording.scan_s)
        })
        .collect()
}
