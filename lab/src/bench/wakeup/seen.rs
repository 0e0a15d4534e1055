//! How late scans begin.

use hdrhistogram::Histogram;

use crate::bench::punctuality::late_ns;

/// Longest time that is told from a longer one, in ns.
const LONGEST_NS: u64 = 100_000_000_000;

/// A start of a scan, as it was seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    /// Its number: where the scan is due, in scans.
    pub scan: u64,
    /// When it was seen.
    pub at_ns: u64,
    /// Scans that its clock had left out until then: from there it goes on at another time.
    pub overrun: u64,
}

/// How late they were.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    late_ns: Histogram<u64>,
    /// Scans that were left out.
    pub overrun: u64,
}

impl Default for Seen {
    fn default() -> Self {
        let late_ns = Histogram::new_with_max(LONGEST_NS, 3);
        // Three digits of so many ns always fit.
        let late_ns = late_ns.unwrap_or_else(|_| Histogram::new(3).expect("three digits"));
        Seen {
            late_ns,
            overrun: 0,
        }
    }
}

impl Seen {
    /// Starts whose own clock is not known.
    pub fn of(starts: &[Start], period_ns: u64) -> Seen {
        let mut seen = Seen::default();
        for of_clock in starts.chunk_by(|a, b| a.overrun == b.overrun) {
            let off = |start: &Start| {
                i128::from(start.at_ns) - i128::from(start.scan) * i128::from(period_ns)
            };
            for late_ns in late_ns(of_clock, off) {
                seen.late_ns.saturating_record(late_ns);
            }
        }
        let of = |start: Option<&Start>| start.map_or(0, |start| start.overrun);
        seen.overrun = of(starts.last()) - of(starts.first());
        seen
    }

    /// One more of a loop that knows its clock.
    pub fn take(&mut self, late_ns: u64, overrun: u64) {
        self.late_ns.saturating_record(late_ns);
        self.overrun += overrun;
    }

    /// Takes another round of the same.
    ///
    /// # Errors
    /// Its times do not fit.
    pub fn join(&mut self, other: &Seen) -> anyhow::Result<()> {
        self.late_ns.add(&other.late_ns)?;
        self.overrun += other.overrun;
        Ok(())
    }

    pub fn starts(&self) -> u64 {
        self.late_ns.len()
    }

    /// That share of the starts was no later, in µs.
    pub fn us_at(&self, share: f64) -> f64 {
        self.late_ns.value_at_quantile(share) as f64 * 1e-3
    }

    pub fn words(&self) -> String {
        format!(
            "{:9} {:7.1} {:7.1} {:8.1} {:8.0} {:8}",
            self.starts(),
            self.us_at(0.5),
            self.us_at(0.99),
            self.us_at(0.999),
            self.us_at(1.0),
            self.overrun
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_is_late_behind_the_most_punctual_of_its_clock() {
        let start = |scan: u64, at_ns: u64, overrun: u64| Start {
            scan,
            at_ns,
            overrun,
        };
        let starts = [
            start(0, 5_000, 0),
            start(1, 15_200, 0),
            start(2, 25_000, 0),
            // It has stalled for two scans and goes on from there.
            start(5, 57_000, 2),
            start(6, 67_100, 2),
        ];
        let seen = Seen::of(&starts, 10_000);
        assert_eq!((seen.starts(), seen.overrun), (5, 2));
        let near = |us: f64, right: f64| (us - right).abs() < 0.001;
        assert!(near(seen.us_at(0.5), 0.0), "{}", seen.us_at(0.5));
        assert!(near(seen.us_at(0.8), 0.1), "{}", seen.us_at(0.8));
        assert!(near(seen.us_at(1.0), 0.2), "{}", seen.us_at(1.0));
    }
}
