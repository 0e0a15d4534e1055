//! Percentiles of a magnitude over a run of any length, in bounded memory.
//!
//! Values are counted in buckets of logarithmic width, as HdrHistogram does (G. Tene, hdrhistogram.org): each octave has 128
//! of equal width, so a bucket is at most 1/128 of its lower edge wide. A percentile is the upper edge of the bucket that the
//! nearest rank falls into, and never above the peak: **too high by at most 0.8 %, never too low**.

/// Buckets of an octave: 2^7.
const SUB_BITS: u32 = 7;
/// Bits of a double's mantissa.
const MANTISSA_BITS: u32 = 52;
/// Everything below 2^LOWEST counts as this: in µm, 0.06 nm.
const LOWEST: i32 = -14;
/// Everything from 2^HIGHEST on counts as this: in µm, 1 m.
const HIGHEST: i32 = 20;
const BUCKETS: usize = ((HIGHEST - LOWEST) as usize) << SUB_BITS;

/// Counts of absolute values: 35 kB.
#[derive(Debug, Clone)]
pub struct Percentiles {
    counts: Vec<u64>,
    count: u64,
    peak: f64,
}

impl Default for Percentiles {
    fn default() -> Self {
        Percentiles {
            counts: vec![0; BUCKETS],
            count: 0,
            peak: 0.0,
        }
    }
}

/// Sign, exponent and the upper bits of the mantissa number the buckets of all doubles in rising order.
fn number(value: f64) -> u64 {
    value.to_bits() >> (MANTISSA_BITS - SUB_BITS)
}

fn lowest() -> u64 {
    number(libm::exp2(f64::from(LOWEST)))
}

impl Percentiles {
    /// Takes the magnitude of a value; one that is not finite is left out.
    pub fn take(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        let magnitude = value.abs();
        let bucket = number(magnitude).saturating_sub(lowest()) as usize;
        if let Some(count) = self.counts.get_mut(bucket.min(BUCKETS - 1)) {
            *count += 1;
        }
        self.count += 1;
        self.peak = self.peak.max(magnitude);
    }

    /// The magnitude that `percent` of the values do not exceed (nearest rank); 0 of nothing.
    pub fn at(&self, percent: f64) -> f64 {
        let rank = libm::ceil(percent.clamp(0.0, 100.0) / 100.0 * self.count as f64).max(1.0);
        let mut below = 0;
        for (bucket, count) in self.counts.iter().enumerate() {
            below += count;
            if below as f64 >= rank {
                let edge = lowest() + bucket as u64 + 1;
                return f64::from_bits(edge << (MANTISSA_BITS - SUB_BITS)).min(self.peak);
            }
        }
        self.peak
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_percentile_is_that_of_the_sorted_values_or_at_most_0_8_percent_above(
            values in proptest::collection::vec((-6.0f64..5.0, any::<bool>()), 1..400),
            percent in 0.0f64..=100.0,
        ) {
            let values: Vec<f64> = values
                .into_iter()
                .map(|(decade, minus)| libm::pow(10.0, decade) * if minus { -1.0 } else { 1.0 })
                .collect();
            let mut percentiles = Percentiles::default();
            values.iter().for_each(|value| percentiles.take(*value));
            let mut sorted: Vec<f64> = values.iter().map(|value| value.abs()).collect();
            sorted.sort_by(f64::total_cmp);
            let rank = (percent / 100.0 * sorted.len() as f64).ceil().max(1.0) as usize;
            let (exact, found) = (sorted[rank - 1], percentiles.at(percent));
            // Below the lowest bucket, 0.06 nm, one number is as good as another.
            prop_assert!(found >= exact && found <= exact * (1.0 + 1.0 / 128.0) + 7e-5, "{found} {exact}");
        }
    }

    #[test]
    fn nothing_zeros_and_what_is_beyond_the_buckets_have_percentiles_too() {
        let mut percentiles = Percentiles::default();
        assert_eq!(percentiles.at(50.0), 0.0);
        percentiles.take(f64::NAN);
        percentiles.take(0.0);
        assert_eq!(percentiles.at(99.0), 0.0);
        percentiles.take(-1e30);
        assert!(percentiles.at(99.0) >= 2f64.powi(HIGHEST));
        assert!(percentiles.at(50.0) < 1e-3);
    }
}
