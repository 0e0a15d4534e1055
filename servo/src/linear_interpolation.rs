//! The source's even splitting of an interpolation period over its scans, as a selectable historical mode.
/// Where a period begins and ends, in increments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PeriodEnds {
    /// Position command of the last scan before the period.
    pub before: i64,
    /// Position command of its last scan.
    pub last: i64,
}

impl PeriodEnds {
    /// Position command of scan `scan_in_period`, from 0: `before + (MCMD·(c + 1)) div N`.
    ///
    /// Integers throughout: the remainder of the division is carried by the product, so each scan is within an increment
    /// of the straight line and the last one is on the period's end exactly. Source: \[Fanuc\], docs/methods/overview.md §2 (DDA).
    pub fn split(&self, scan_in_period: u32, scans_per_period: u32) -> i64 {
        let movement = i128::from(self.last) - i128::from(self.before);
        let part = movement * (i128::from(scan_in_period) + 1);
        let split = part.div_euclid(i128::from(scans_per_period.max(1)));
        i64::try_from(i128::from(self.before) + split).unwrap_or(self.last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scan_is_within_an_increment_of_the_line_and_the_last_one_on_its_end() {
        for n in [2, 5, 8, 32] {
            for (before, last) in [(0, 1000), (7, -13), (-5, -5), (3, 4), (-1, 6_000_000_000)] {
                let ends = PeriodEnds { before, last };
                let steps: Vec<i64> = (0..n).map(|c| ends.split(c, n)).collect();
                assert_eq!(steps.last(), Some(&last));
                for (c, position) in (1i64..).zip(&steps) {
                    let line = before as f64 + (last - before) as f64 * c as f64 / f64::from(n);
                    assert!((*position as f64 - line).abs() < 1.0, "{n} {c} {ends:?}");
                }
            }
        }
    }

    #[test]
    fn positions_at_the_ends_of_the_scale_neither_overflow_nor_leave_the_period() {
        let ends = PeriodEnds {
            before: i64::MIN,
            last: i64::MAX,
        };
        assert_eq!(ends.split(7, 8), i64::MAX);
        assert!((ends.split(3, 8)).abs() <= 1);
    }
}
