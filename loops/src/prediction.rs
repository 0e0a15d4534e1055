//! First-difference prediction of a sampled value (docs/methods/prediction.md, \[Fanuc-S\]).
/// Makes up for the age of a sample: `x̂ = x + Δx/m`, Δx the change since the sample before.
///
/// 1/m is the age in sample periods; the value is right where the speed was constant. What it costs: noise of Δx is
/// added, of white noise σ in x altogether `σ·sqrt((1 + 1/m)² + 1/m²)`. An acceleration a leaves an error of `a·h·(h +
/// Tp)/2`, h = Tp/m. Source: \[Fanuc-S\], docs/methods/overview.md §5. Units: those of x. Limits: m of 0 or below, or not a number,
/// switches it off. First call: with no sample before, hand over Δx = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Divisor of the first difference.
    pub m: f64,
}

impl Prediction {
    /// No prediction.
    pub const OFF: Prediction = Prediction { m: 0.0 };

    /// How far ahead the value is, in sample periods; 0 where it is off.
    pub fn horizon_scans(&self) -> f64 {
        if self.m > 0.0 { 1.0 / self.m } else { 0.0 }
    }

    /// What is added to the sample.
    pub fn added(&self, difference: f64) -> f64 {
        if self.m > 0.0 {
            difference / self.m
        } else {
            0.0
        }
    }

    /// What the command adds in the same time, so that command and feedback are compared at one instant.
    ///
    /// `command(i)` is the command i scans from now; between two scans it is taken as a straight line.
    pub fn command_ahead(&self, command: impl Fn(i64) -> i64) -> f64 {
        let horizon = self.horizon_scans();
        if horizon == 0.0 {
            return 0.0;
        }
        let whole = libm::floor(horizon);
        let part = horizon - whole;
        let now = command(0);
        let from = command(whole as i64).saturating_sub(now) as f64;
        let to = command(whole as i64 + 1).saturating_sub(now) as f64;
        from + part * (to - from)
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use rand_xoshiro::SplitMix64;
    use rand_xoshiro::rand_core::{Rng, SeedableRng};

    #[test]
    fn at_constant_speed_it_is_exact_and_under_acceleration_off_by_its_formula() {
        for m in [0.2, 0.4, 1.0, 3.0] {
            let prediction = Prediction { m };
            let h = prediction.horizon_scans();
            let steady = |t: f64| 3.0 + 7.0 * t;
            let x = steady(5.0) + prediction.added(steady(5.0) - steady(4.0));
            assert!((x - steady(5.0 + h)).abs() < 1e-12);
            let (a, curved) = (2.0, |t: f64| t * t);
            let x = curved(5.0) + prediction.added(curved(5.0) - curved(4.0));
            let error = curved(5.0 + h) - x;
            assert!(
                (error - a * h * (h + 1.0) / 2.0).abs() < 1e-9,
                "{m}: {error}"
            );
        }
    }

    #[test]
    fn noise_grows_as_stated() {
        // Noise without correlation, from a fixed sequence.
        let mut rng = SplitMix64::seed_from_u64(7);
        let mut noise = || f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5;
        let samples: Vec<f64> = (0..20_000).map(|_| noise()).collect();
        let rms = |v: &[f64]| (v.iter().map(|x| x * x).sum::<f64>() / v.len() as f64).sqrt();
        for m in [0.4, 1.0, 4.0] {
            let prediction = Prediction { m };
            let predicted: Vec<f64> = samples
                .windows(2)
                .map(|pair| pair[1] + prediction.added(pair[1] - pair[0]))
                .collect();
            let h = 1.0 / m;
            let expected = ((1.0 + h) * (1.0 + h) + h * h).sqrt();
            let found = rms(&predicted) / rms(&samples);
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{m}: {found} and {expected}"
            );
        }
    }

    #[test]
    fn switched_off_it_adds_nothing() {
        for m in [0.0, -1.0, f64::NAN] {
            let off = Prediction { m };
            assert_eq!((off.added(9.0), off.horizon_scans()), (0.0, 0.0));
            assert_eq!(off.command_ahead(|i| i * 100), 0.0);
        }
    }

    #[test]
    fn the_command_is_looked_up_as_far_ahead_as_the_feedback_is_predicted() {
        let command = |i: i64| 100 * i + 10 * i * i;
        assert_eq!(Prediction { m: 1.0 }.command_ahead(command), 110.0);
        assert!(
            (Prediction { m: 0.4 }.command_ahead(command) - (240.0 + 390.0) / 2.0).abs() < 1e-9
        );
    }
}
