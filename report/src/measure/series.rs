//! Peak, rms, and series that are thinned out without losing their peaks.

/// Peak and root mean square of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Statistics {
    /// Largest absolute value.
    pub peak: f64,
    sum_of_squares: f64,
    count: u64,
}

impl Statistics {
    /// Takes a value; one that is not finite is left out.
    pub fn take(&mut self, value: f64) {
        if value.is_finite() {
            self.peak = self.peak.max(value.abs());
            self.sum_of_squares += value * value;
            self.count += 1;
        }
    }

    /// Root mean square; 0 of nothing.
    pub fn rms(&self) -> f64 {
        if self.count == 0 {
            0.0
        } else {
            (self.sum_of_squares / self.count as f64).sqrt()
        }
    }
}

/// Bins that a series may have.
const BINS_MAX: usize = 2048;

/// Lowest and highest value per bin of time; bins grow as the series does.
#[derive(Debug, Clone, PartialEq)]
pub struct MinMaxSeries {
    bin_scans: u64,
    first_scan: Option<u64>,
    bins: Vec<Option<(f64, f64)>>,
}

impl Default for MinMaxSeries {
    fn default() -> Self {
        MinMaxSeries {
            bin_scans: 1,
            first_scan: None,
            bins: Vec::new(),
        }
    }
}

impl MinMaxSeries {
    /// Takes the value of one scan; scans come in order.
    pub fn take(&mut self, scan: u64, value: f64) {
        if !value.is_finite() {
            return;
        }
        let first = *self.first_scan.get_or_insert(scan);
        let since = scan.saturating_sub(first);
        while since / self.bin_scans >= BINS_MAX as u64 {
            self.bins = self
                .bins
                .chunks(2)
                .map(|pair| pair.iter().flatten().copied().reduce(join))
                .collect();
            self.bin_scans = self.bin_scans.saturating_mul(2);
        }
        let bin = (since / self.bin_scans) as usize;
        if bin >= self.bins.len() {
            self.bins.resize(bin + 1, None);
        }
        if let Some(place) = self.bins.get_mut(bin) {
            *place = Some(place.map_or((value, value), |there| join(there, (value, value))));
        }
    }

    /// (scan at the middle of the bin, lowest, highest).
    pub fn bins(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        let first = self.first_scan.unwrap_or(0) as f64;
        self.bins
            .iter()
            .enumerate()
            .filter_map(move |(index, bin)| {
                let middle = first + (index as f64 + 0.5) * self.bin_scans as f64;
                bin.map(|(low, high)| (middle, low, high))
            })
    }
}

fn join(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0.min(b.0), a.1.max(b.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_of_one_scan_survives_any_thinning() {
        let mut series = MinMaxSeries::default();
        for scan in 0..1_000_000u64 {
            series.take(scan + 5, if scan == 654_321 { 9.0 } else { 0.5 });
        }
        let bins: Vec<_> = series.bins().collect();
        assert!(bins.len() <= BINS_MAX);
        let peaks: Vec<_> = bins.iter().filter(|bin| bin.2 == 9.0).collect();
        assert_eq!(peaks.len(), 1);
        assert!((peaks[0].0 - 654_326.0).abs() <= 512.0);
    }

    #[test]
    fn rms_and_peak_of_a_sine_are_its_own_and_nan_is_left_out() {
        let mut statistics = Statistics::default();
        for index in 0..36_000 {
            statistics.take(3.0 * libm::sin(f64::from(index).to_radians() / 100.0));
        }
        statistics.take(f64::NAN);
        assert!((statistics.peak - 3.0).abs() < 1e-9);
        assert!((statistics.rms() - 3.0 / 2f64.sqrt()).abs() < 1e-9);
    }
}
