//! How evenly scans follow each other, as somebody who waits at the scan's signal sees it.
//!
//! What is measured is the time between two wakings of this observer by the signal that the master rings at the start of each
//! scan: the period of the scan with this process's own waking-up in it. The observer looks for a part of the time only.

use std::time::{Duration, Instant};

use bus::signal_page::Signal;
use hdrhistogram::Histogram;
use remote::state::TimingState;

use super::state::rounded;

/// Waits at the scan's signal for `budget` and takes the periods between its rings, in ns.
pub fn listen(signal: &Signal, budget: Duration, mut take: impl FnMut(u64)) {
    let started = Instant::now();
    let mut last: Option<(Instant, u32)> = None;
    while started.elapsed() < budget {
        let seen = signal.count();
        signal.wait(seen, budget);
        let (now, count) = (Instant::now(), signal.count());
        if count == seen {
            continue;
        }
        // Exactly one ring since the last waking: the time between is one period.
        if let Some((then, before)) = last
            && count == before.wrapping_add(1)
        {
            let period = now.duration_since(then).as_nanos();
            take(u64::try_from(period).unwrap_or(u64::MAX));
        }
        last = Some((now, count));
    }
}

/// Upper ends of the bars, as distance from the scan period in µs; the last bar has none.
pub const BARS_US: [f64; 7] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];

/// Periods that were seen.
#[derive(Debug)]
pub struct Timing {
    histogram: Option<Histogram<u64>>,
    period_us: f64,
    /// Periods in each bar of [`BARS_US`], and beyond.
    bars: [u64; BARS_US.len() + 1],
}

impl Timing {
    /// Of a cell with this scan period.
    pub fn new(period_us: f64) -> Self {
        Timing {
            histogram: Histogram::new_with_bounds(1, 60_000_000_000, 3).ok(),
            period_us,
            bars: [0; BARS_US.len() + 1],
        }
    }

    /// Takes one period, in ns.
    pub fn take(&mut self, period_ns: u64) {
        if let Some(histogram) = &mut self.histogram {
            histogram.saturating_record(period_ns);
        }
        let off_us = (period_ns as f64 * 1e-3 - self.period_us).abs();
        let bar = BARS_US.iter().position(|end_us| off_us <= *end_us);
        if let Some(count) = self.bars.get_mut(bar.unwrap_or(BARS_US.len())) {
            *count += 1;
        }
    }

    /// What was seen; none before the first period.
    pub fn state(&self) -> Option<TimingState> {
        let histogram = self.histogram.as_ref().filter(|h| !h.is_empty())?;
        let us = |ns: u64| rounded(ns as f64 * 1e-3, 1);
        Some(TimingState {
            periods: histogram.len(),
            p50_us: us(histogram.value_at_quantile(0.5)),
            p99_us: us(histogram.value_at_quantile(0.99)),
            max_us: us(histogram.max()),
            bars: self.bars.to_vec(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_and_bars_are_of_the_periods_that_were_seen() {
        let mut timing = Timing::new(1000.0);
        assert_eq!(timing.state(), None);
        (0..990).for_each(|_| timing.take(1_002_000));
        (0..10).for_each(|_| timing.take(1_350_000));
        let summary = timing.state().expect("periods");
        assert_eq!(summary.periods, 1000);
        assert!((summary.p50_us - 1002.0).abs() < 2.0, "{summary:?}");
        assert!((summary.p99_us - 1002.0).abs() < 2.0, "{summary:?}");
        assert!((summary.max_us - 1350.0).abs() < 2.0, "{summary:?}");
        assert_eq!(summary.bars, [990, 0, 0, 0, 0, 0, 10, 0]);
    }
}
