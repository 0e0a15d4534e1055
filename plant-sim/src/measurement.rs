//! What a drive measures wrongly: errors of the encoder within a signal period and noise; a torque that comes late, in steps, with noise.

use bytemuck::{Pod, Zeroable};

use crate::script::rng::Rng;

/// Torques kept, the newest first: a delay may be one less than that, in scans.
pub const TORQUES_KEPT: usize = 17;

/// How a drive measures.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measurement {
    /// Amplitude of the encoder's error within a signal period, in m of travel.
    pub period_error_m: f64,
    /// Signal periods per m of travel.
    pub periods_per_m: f64,
    /// Standard deviation of the encoder's noise, in m.
    pub encoder_noise_m: f64,
    /// Scans by which the torque is shown late.
    pub torque_delay_scans: usize,
    /// Steps of the torque, in N·m; 0 for none.
    pub torque_step_nm: f64,
    /// Standard deviation of its noise, in N·m.
    pub torque_noise_nm: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// What the encoder's coupling slips by, in m, and when, in s.
    pub slip_m: f64,
    /// See there.
    pub slip_at_s: f64,
    /// Scan, in s.
    pub scan_s: f64,
}

/// What [`Measurement`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct MeasurementState {
    /// Random numbers taken.
    pub taken: u64,
    /// What the encoder is wrong by now, in m.
    pub encoder_error_m: f64,
    /// Torques of the last scans as they were shown or will be, the newest first, in N·m.
    pub torque_nm: [f64; TORQUES_KEPT],
    /// Time since the beginning, in s.
    pub time_s: f64,
}

impl Measurement {
    /// The encoder is read at a place; what it is wrong by, in m.
    pub fn encoder(&self, state: &mut MeasurementState, place_m: f64) -> f64 {
        let turns = place_m * self.periods_per_m;
        let fraction = turns - libm::floor(turns);
        let within = libm::sin(2.0 * std::f64::consts::PI * fraction);
        state.encoder_error_m =
            self.period_error_m * within + self.encoder_noise_m * self.noise(state);
        if self.slip_m != 0.0 && state.time_s >= self.slip_at_s {
            state.encoder_error_m += self.slip_m;
        }
        state.encoder_error_m
    }

    /// A scan has ended with this torque.
    pub fn torque(&self, state: &mut MeasurementState, torque_nm: f64) {
        let noisy_nm = torque_nm + self.torque_noise_nm * self.noise(state);
        let shown_nm = if self.torque_step_nm > 0.0 {
            self.torque_step_nm * libm::round(noisy_nm / self.torque_step_nm)
        } else {
            noisy_nm
        };
        state.torque_nm.rotate_right(1);
        let [newest, ..] = &mut state.torque_nm;
        *newest = shown_nm;
        state.time_s += self.scan_s;
    }

    /// The torque that is shown, in N·m.
    pub fn shown_nm(&self, state: &MeasurementState) -> f64 {
        let shown = state.torque_nm.get(self.torque_delay_scans);
        shown.copied().unwrap_or(0.0)
    }

    /// A number from a distribution with the mean 0 and the deviation 1: the sum of twelve even ones, less 6.
    fn noise(&self, state: &mut MeasurementState) -> f64 {
        if self.encoder_noise_m == 0.0 && self.torque_noise_nm == 0.0 {
            return 0.0;
        }
        let mut random = Rng::after(self.seed, state.taken);
        state.taken = state.taken.wrapping_add(12);
        (0..12).map(|_| random.between(0.0, 1.0)).sum::<f64>() - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_its_deviation_and_is_the_same_for_a_seed() {
        let measurement = Measurement {
            encoder_noise_m: 1e-8,
            seed: 7,
            ..Measurement::default()
        };
        let run = || {
            let mut state = MeasurementState::default();
            let all = (0..20_000).map(|_| measurement.encoder(&mut state, 0.0));
            all.collect::<Vec<f64>>()
        };
        let all = run();
        assert_eq!(all, run());
        let square: f64 = all.iter().map(|x| x * x).sum::<f64>() / 20_000.0;
        assert!((square.sqrt() - 1e-8).abs() < 2e-10, "{}", square.sqrt());
    }

    #[test]
    fn a_coupling_slips_once_at_its_time() {
        let measurement = Measurement {
            slip_m: 3e-4,
            slip_at_s: 2e-3,
            scan_s: 1e-3,
            ..Measurement::default()
        };
        let mut state = MeasurementState::default();
        let shown = (0..5).map(|_| {
            let error_m = measurement.encoder(&mut state, 0.1);
            measurement.torque(&mut state, 0.0);
            error_m
        });
        assert_eq!(shown.collect::<Vec<_>>(), [0.0, 0.0, 3e-4, 3e-4, 3e-4]);
    }

    #[test]
    fn a_torque_comes_late_and_in_steps() {
        let measurement = Measurement {
            torque_delay_scans: 3,
            torque_step_nm: 0.01,
            ..Measurement::default()
        };
        let mut state = MeasurementState::default();
        let mut shown = Vec::new();
        for torque_nm in [1.004, 2.0, 3.0, 4.0, 5.0] {
            measurement.torque(&mut state, torque_nm);
            shown.push(measurement.shown_nm(&state));
        }
        assert_eq!(shown, [0.0, 0.0, 0.0, 1.0, 2.0]);
    }
}
