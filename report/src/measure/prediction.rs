//! What a prediction of the feedback position gains and what noise it adds (docs/methods/prediction.md).

use std::collections::VecDeque;

use bus::sample::AxisFeedback;
use machine::{Axis, PREDICTION_M_MIN, PositionFeedback, Prediction};

use super::series::Statistics;

/// Samples kept: the widest horizon, the sample it is counted from, and two before it for its differences.
const KEPT: usize = (1.0 / PREDICTION_M_MIN) as usize + 4;

/// Judges the predictions of one axis by what its feedback was afterwards.
///
/// With x the feedback position as the position loop sampled it and h = 1/m scans: what x was h scans later, between samples
/// by a straight line, less x itself (the error of an old sample) and less `x + Δx/m` (the error that is left). The noise is
/// that of the added term, from its second difference d², in which motion hardly shows: `rms(d²)/√10`, which is the rms of
/// the added term itself where the noise of x has no correlation (its third difference has 20 times its variance, its
/// first one twice).
#[derive(Debug, Clone)]
pub struct PredictionMeter {
    settings: Prediction,
    position_gain_per_s: f64,
    increment_um: f64,
    feedback: PositionFeedback,
    /// The last samples in increments, newest last, while they were contiguous.
    kept: VecDeque<i64>,
    last_scan: u64,
    /// Error of the sample as it is, in µm.
    pub unpredicted_um: Statistics,
    /// Error of the prediction, in µm.
    pub predicted_um: Statistics,
    second_difference_um: Statistics,
}

impl PredictionMeter {
    /// For an axis that predicts; none for one that does not.
    pub fn of(axis: &Axis) -> Option<PredictionMeter> {
        axis.prediction.map(|settings| PredictionMeter {
            settings,
            position_gain_per_s: axis.position_loop.gain_per_s,
            increment_um: axis.increment_mm() * 1e3,
            feedback: axis.feedback,
            kept: VecDeque::with_capacity(KEPT),
            last_scan: 0,
            unpredicted_um: Statistics::default(),
            predicted_um: Statistics::default(),
            second_difference_um: Statistics::default(),
        })
    }

    /// Divisor of the first difference.
    pub fn m(&self) -> f64 {
        self.settings.m
    }

    /// Noise that the prediction adds to the position, rms, in µm.
    pub fn added_noise_um(&self) -> f64 {
        self.second_difference_um.rms() / libm::sqrt(10.0)
    }

    /// The same at the velocity command, in mm/s.
    pub fn added_noise_mm_s(&self) -> f64 {
        self.added_noise_um() * 1e-3 * self.position_gain_per_s
    }

    /// Takes the feedback of one scan with the drives on.
    pub fn take(&mut self, scan: u64, feedback: &AxisFeedback) {
        let position = match self.feedback {
            PositionFeedback::Motor => feedback.motor_position,
            PositionFeedback::Scale => feedback.scale_position,
        };
        if scan != self.last_scan + 1 {
            self.kept.clear();
        }
        self.last_scan = scan;
        if self.kept.len() == KEPT {
            self.kept.pop_front();
        }
        self.kept.push_back(position);
        self.judge();
    }

    /// Difference of two kept samples in µm; `back` counts from the newest.
    fn between_um(&self, from_back: usize, to_back: usize) -> Option<f64> {
        let at = |back: usize| self.kept.get(self.kept.len().checked_sub(back + 1)?);
        let difference = at(to_back)?.saturating_sub(*at(from_back)?);
        Some(difference as f64 * self.increment_um)
    }

    fn judge(&mut self) {
        let horizon = 1.0 / self.settings.m;
        let whole = libm::floor(horizon);
        let part = horizon - whole;
        // The newest sample is the upper one of the two around the instant that was predicted.
        let base = whole as usize + 1;
        let added_um = |back: usize| Some(self.between_um(back + 1, back)? / self.settings.m);
        let judged = (|| {
            let low_um = self.between_um(base, 1)?;
            let high_um = self.between_um(base, 0)?;
            let moved_um = low_um + part * (high_um - low_um);
            let added = added_um(base)?;
            Some((moved_um, moved_um - added))
        })();
        let second_um = (|| Some(added_um(0)? - 2.0 * added_um(1)? + added_um(2)?))();
        if let Some((without_um, with_um)) = judged {
            self.unpredicted_um.take(without_um);
            self.predicted_um.take(with_um);
        }
        if let Some(second_um) = second_um {
            self.second_difference_um.take(second_um);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::machine_text;
    use machine::Machine;
    use rand_xoshiro::SplitMix64;
    use rand_xoshiro::rand_core::{Rng, SeedableRng};

    fn meter(m: f64) -> PredictionMeter {
        let text = machine_text(&["X"]) + &format!("prediction = {{ m = {m:?} }}\n");
        let machine = Machine::parse("test machine", &text).unwrap();
        PredictionMeter::of(&machine.axes[0]).unwrap()
    }

    fn run(meter: &mut PredictionMeter, position_nm: impl Fn(u64) -> i64) {
        for scan in 1..2000 {
            let feedback = AxisFeedback {
                motor_position: position_nm(scan),
                ..AxisFeedback::default()
            };
            meter.take(scan, &feedback);
        }
    }

    #[test]
    fn at_constant_speed_the_old_sample_is_off_by_the_way_of_its_age_and_the_prediction_by_nothing()
    {
        for m in [0.2, 0.4, 1.0, 2.0] {
            let mut meter = meter(m);
            run(&mut meter, |scan| 50_000 * scan as i64);
            assert!((meter.unpredicted_um.rms() - 50.0 / m).abs() < 1e-9, "{m}");
            assert!(meter.predicted_um.peak < 1e-9, "{m}");
            assert!(meter.added_noise_um() < 1e-9, "{m}");
        }
    }

    #[test]
    fn noise_without_correlation_is_measured_as_the_rms_of_the_added_term() {
        let mut meter = meter(0.5);
        let noise_nm =
            |scan: u64| (SplitMix64::seed_from_u64(scan).next_u64() % 2001) as i64 - 1000;
        run(&mut meter, |scan| 30_000 * scan as i64 + noise_nm(scan));
        // ±1 µm evenly: σ = 0.577 µm; of Δx/m: √2·σ·2.
        let expected_um = 2.0 / 3f64.sqrt() * 2f64.sqrt();
        let found_um = meter.added_noise_um();
        assert!((found_um / expected_um - 1.0).abs() < 0.05, "{found_um}");
        assert!((meter.added_noise_mm_s() - found_um * 0.05).abs() < 1e-12);
    }

    #[test]
    fn samples_with_a_gap_between_them_are_not_compared() {
        let mut meter = meter(1.0);
        let feedback = |position| AxisFeedback {
            motor_position: position,
            ..AxisFeedback::default()
        };
        for scan in [1, 2, 3, 50, 51, 52] {
            meter.take(scan, &feedback(if scan < 50 { 0 } else { 1_000_000 }));
        }
        assert_eq!(meter.unpredicted_um.peak, 0.0);
    }
}
