//! A low pass that shifts nothing in time: for signals that are known as a whole.

use core::f64::consts::{PI, SQRT_2};

/// Time constants of the corner frequency that a signal is prolonged by at either end.
const PROLONGED: f64 = 6.0;

/// Second-order Butterworth low pass, run forwards and then backwards over a signal.
///
/// `|Q(f)| = 1/(1 + (tan πfT / tan πf_cT)⁴)`, no phase: 1 at rest, ½ at the corner `f_c`, never above 1. The signal is prolonged at its
/// ends by the values there. Source: Butterworth by the bilinear transform (Oppenheim, Schafer: Discrete-Time Signal Processing, §7);
/// forwards and backwards: Kormylo, Jain (1974), "Two-pass recursive digital filter with zero phase shift", IEEE Trans. ASSP 22(5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZeroPhase {
    feed: f64,
    back: [f64; 2],
    prolonged: usize,
}

impl ZeroPhase {
    /// With this corner at this sample time; a corner beyond 0.45 of the sample rate is taken as that.
    pub fn new(corner_hz: f64, sample_s: f64) -> ZeroPhase {
        let corner = (corner_hz * sample_s).clamp(1e-6, 0.45);
        let c = libm::tan(PI * corner);
        let scale = 1.0 + SQRT_2 * c + c * c;
        ZeroPhase {
            feed: c * c / scale,
            back: [
                2.0 * (c * c - 1.0) / scale,
                (1.0 - SQRT_2 * c + c * c) / scale,
            ],
            prolonged: libm::ceil(PROLONGED / (2.0 * PI * corner)) as usize,
        }
    }

    /// Filters the whole signal.
    pub fn filter(&self, signal: &mut [f64]) {
        let (Some(&first), Some(&last)) = (signal.first(), signal.last()) else {
            return;
        };
        let mut long = vec![first; self.prolonged];
        long.extend_from_slice(signal);
        long.resize(signal.len() + 2 * self.prolonged, last);
        self.pass(long.iter_mut());
        self.pass(long.iter_mut().rev());
        for (to, from) in signal.iter_mut().zip(long.iter().skip(self.prolonged)) {
            *to = *from;
        }
    }

    /// One pass, beginning as if the first value had always been.
    fn pass<'a>(&self, mut signal: impl Iterator<Item = &'a mut f64>) {
        let Some(first) = signal.next() else { return };
        let (mut x, mut y) = ([*first; 2], [*first; 2]);
        for value in signal {
            let now = self.feed * (*value + 2.0 * x[0] + x[1])
                - self.back[0] * y[0]
                - self.back[1] * y[1];
            x = [*value, x[0]];
            y = [now, y[0]];
            *value = now;
        }
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sine(hz: f64, phase: f64) -> Vec<f64> {
        (0..4000)
            .map(|i| libm::sin(2.0 * PI * hz * f64::from(i) * 1e-3 + phase))
            .collect()
    }

    proptest! {
        #[test]
        fn a_sine_keeps_its_phase_and_has_the_height_of_the_formula(hz in 1.0..300.0f64, corner in 20.0..200.0f64, phase in 0.0..6.0f64) {
            let whole = sine(hz, phase);
            let mut filtered = whole.clone();
            ZeroPhase::new(corner, 1e-3).filter(&mut filtered);
            let ratio = libm::tan(PI * hz * 1e-3) / libm::tan(PI * corner * 1e-3);
            let height = 1.0 / (1.0 + libm::pow(ratio, 4.0));
            for (was, is) in whole.iter().zip(&filtered).take(3000).skip(1000) {
                prop_assert!((height * was - is).abs() < 1e-6, "{was} {is} {height}");
            }
        }

        #[test]
        fn a_signal_backwards_gives_the_same_backwards(values in proptest::collection::vec(-1.0..1.0f64, 1..400)) {
            let filter = ZeroPhase::new(80.0, 1e-3);
            let mut forwards = values.clone();
            filter.filter(&mut forwards);
            let mut backwards: Vec<f64> = values.into_iter().rev().collect();
            filter.filter(&mut backwards);
            for (one, other) in forwards.iter().zip(backwards.iter().rev()) {
                // What is left of the ends behind six time constants.
                prop_assert!((one - other).abs() < 2e-2, "{one} {other}");
            }
        }
    }

    #[test]
    fn a_constant_passes_as_it_is_and_nothing_is_nothing() {
        let mut constant = vec![0.7; 50];
        ZeroPhase::new(50.0, 1e-3).filter(&mut constant);
        assert!(constant.iter().all(|value| (value - 0.7).abs() < 1e-12));
        ZeroPhase::new(50.0, 1e-3).filter(&mut []);
    }
}
