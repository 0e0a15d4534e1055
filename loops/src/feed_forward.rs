//! Look-ahead velocity feed-forward from movement commands (docs/methods/overview.md §2, \[Fanuc\] JP 2875646).
use bytemuck::{Pod, Zeroable};

/// Most interpolation periods that can be looked ahead.
pub const LOOK_AHEAD_PERIODS_MAX: usize = 16;
const PERIODS_MAX: usize = LOOK_AHEAD_PERIODS_MAX + 2;

/// What movement commands remember: the position command at the end of the last two interpolation periods, in increments.
/// Their difference is the movement command of the period before the present one (R2 of the source).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PeriodState {
    /// At the end of the period before the present one.
    pub start: i64,
    /// One period earlier.
    pub start_before: i64,
}

impl PeriodState {
    /// Of an axis that was at rest there.
    pub fn at_rest(position: i64) -> PeriodState {
        PeriodState {
            start: position,
            start_before: position,
        }
    }

    /// A period begins; its predecessor ended at `position`.
    pub fn step(&mut self, position: i64) {
        self.start_before = self.start;
        self.start = position;
    }
}

/// Movement commands (increments per interpolation period) around the present scan: index 0 is the previous period (R2
/// of the source), 1 the present one (R1), 2 the next (R0), and so on as far as the window in force reaches.
///
/// A period's command is the sum of its setpoints, so this is all that method 2 needs to know of a window. It is made again
/// each scan: nothing of a replaced future can stay behind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MovementCommands {
    movement: [i64; PERIODS_MAX],
    rest: [bool; PERIODS_MAX],
    /// Periods known, the previous and the present one included.
    pub count: usize,
}

impl MovementCommands {
    /// No motion at all: after a *no window* state, at standstill.
    pub const STANDSTILL: MovementCommands = MovementCommands {
        movement: [0; PERIODS_MAX],
        rest: [true; PERIODS_MAX],
        count: 2,
    };

    /// From the positions at the last two period boundaries and from the setpoints still to come.
    ///
    /// `period_start` is the position command of the last scan before the present period, `period_start_before` the
    /// same one period earlier; `position(i)` is the position command `i` scans from now (negative: already executed in
    /// this period, then `period_start` may be in for it). `scan_in_period` counts from 0.
    pub fn gather(
        period_start_before: i64,
        period_start: i64,
        scan_in_period: u32,
        scans_per_period: u32,
        look_ahead_periods: usize,
        position: impl Fn(i64) -> i64,
    ) -> MovementCommands {
        let mut out = Self::STANDSTILL;
        out.count = look_ahead_periods.min(LOOK_AHEAD_PERIODS_MAX) + 2;
        let length = i64::from(scans_per_period);
        let mut start = period_start_before;
        let mut end = period_start;
        for index in 0..out.count {
            if index > 0 {
                // Last scan of the period `index − 1` periods after the present one.
                let offset = length * index as i64 - 1 - i64::from(scan_in_period);
                start = end;
                end = position(offset);
            }
            let movement = end.saturating_sub(start);
            // A period that comes back to where it began is a dwell only if it also stood there half-way.
            let half = length * index as i64 - 1 - i64::from(scan_in_period) - length / 2;
            let rest = movement == 0 && (half < 0 || position(half) == start);
            if let (Some(m), Some(r)) = (out.movement.get_mut(index), out.rest.get_mut(index)) {
                *m = movement;
                *r = rest;
            }
        }
        out
    }

    /// The movement command at this index, 0 beyond what is known.
    pub fn get(&self, index: usize) -> i64 {
        if index < self.count {
            self.movement.get(index).copied().unwrap_or(0)
        } else {
            0
        }
    }

    /// Whether the axis is at rest all through this period.
    pub fn is_rest(&self, index: usize) -> bool {
        index >= self.count || self.rest.get(index).copied().unwrap_or(true)
    }
}

/// Speed command smoothed over one interpolation period and known ahead, without recursion.
///
/// The source sums `SUM += R1 − R2` (first half of a period) and `SUM += R0 − R1` (second half) and takes
/// `FF = α·SUM/N²`. For contiguous periods that sum is nothing but the linear interpolation between the movement
/// commands at the period centres, which is what this computes: `FF = α·[(N − r)·M_i + r·M_{i+1}]/N²`, with `i` and `r`
/// from the scan's place. The same numbers to the last bit (tested), but no open integrator that keeps a bias (docs/methods/physics.md
/// §4), and zero by itself at standstill. Source: \[Fanuc\], docs/methods/overview.md §2. Units: increments per scan; `advance_scans`
/// takes it that much further ahead. Beyond the last known period it holds that period's value; there is no state, so
/// the first call is like every other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeedForward {
    /// N, scans per interpolation period.
    pub scans_per_period: u32,
    /// α.
    pub coefficient: f64,
    /// Additional look-ahead, in scans, at least 0.
    pub advance_scans: f64,
}

impl FeedForward {
    /// The speed command, in increments per scan.
    pub fn increments_per_scan(&self, movement: &MovementCommands, scan_in_period: u32) -> f64 {
        let n = f64::from(self.scans_per_period);
        // The source changes over after C = N/2 (rounded down): there FF is exactly the present period's command.
        let half = f64::from(self.scans_per_period / 2);
        let place = f64::from(scan_in_period) + self.advance_scans + n - half;
        let index = libm::floor(place / n);
        let remainder = place - index * n;
        // NaN and negative places (settings that no machine file can have) fall on the previous period.
        let index = index as usize;
        let last = movement.count.saturating_sub(1);
        let here = movement.get(index.min(last)) as f64;
        let next = movement.get((index + 1).min(last)) as f64;
        self.coefficient * ((n - remainder) * here + remainder * next) / (n * n)
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The source's own recursion, word for word.
    struct Recursive {
        r: [i64; 3],
        sum: i64,
        c: i64,
    }

    impl Recursive {
        fn period(&mut self, next: i64) {
            self.r = [next, self.r[0], self.r[1]];
            self.c = 0;
        }
        fn scan(&mut self, n: i64, alpha: f64) -> f64 {
            let [r0, r1, r2] = self.r;
            self.sum += if 2 * self.c <= n { r1 - r2 } else { r0 - r1 };
            self.c += 1;
            alpha * self.sum as f64 / (n * n) as f64
        }
    }

    fn equal_to_the_recursion(n: u32, alpha: f64, movements: &[i64]) {
        let mut recursive = Recursive {
            r: [0; 3],
            sum: 0,
            c: 0,
        };
        let forward = FeedForward {
            scans_per_period: n,
            coefficient: alpha,
            advance_scans: 0.0,
        };
        // Standstill before and after, as at the start and end of every motion.
        let at = |i: i64| {
            usize::try_from(i)
                .ok()
                .and_then(|i| movements.get(i))
                .copied()
                .unwrap_or(0)
        };
        let boundary: Vec<i64> = (0..movements.len() as i64 + 6)
            .scan(0, |p, i| {
                let before = *p;
                *p += at(i - 2);
                Some(before)
            })
            .collect();
        for period in 1..boundary.len() - 3 {
            recursive.period(at(period as i64 - 1));
            for c in 0..n {
                let position = |offset: i64| {
                    let scan = i64::from(c) + offset + 1;
                    let (whole, part) = (scan.div_euclid(n.into()), scan.rem_euclid(n.into()));
                    let here = boundary[(period as i64 + whole) as usize];
                    let next = boundary[(period as i64 + whole + 1) as usize];
                    here + (next - here) * part / i64::from(n)
                };
                let movement = MovementCommands::gather(
                    boundary[period - 1],
                    boundary[period],
                    c,
                    n,
                    1,
                    position,
                );
                let expected = recursive.scan(n.into(), alpha);
                let found = forward.increments_per_scan(&movement, c);
                assert_eq!(
                    found.to_bits(),
                    (expected + 0.0).to_bits(),
                    "N {n} period {period} C {c}: {found} and {expected}"
                );
            }
        }
        assert_eq!(recursive.sum, 0);
    }

    #[test]
    fn the_interpolation_is_the_sources_sum_increment_for_increment() {
        equal_to_the_recursion(
            8,
            1.0,
            &[100, 250, 400, 400, 390, 100, -50, -300, -300, -10],
        );
        equal_to_the_recursion(5, 1.0, &[7, 11, 13, -5, 1]);
        equal_to_the_recursion(2, 0.75, &[7, 11, 13, -5, 1]);
    }

    proptest! {
        #[test]
        fn it_is_so_for_any_contiguous_sequence(n in 2u32..33, alpha in 0.0f64..1.5,
                movements in proptest::collection::vec(-4_000_000i64..4_000_000, 1..20)) {
            equal_to_the_recursion(n, alpha, &movements);
        }
    }

    #[test]
    fn it_is_zero_at_standstill_and_holds_the_last_known_period_beyond_it() {
        let forward = FeedForward {
            scans_per_period: 8,
            coefficient: 1.0,
            advance_scans: 100.0,
        };
        assert_eq!(
            forward.increments_per_scan(&MovementCommands::STANDSTILL, 3),
            0.0
        );
        let steady = MovementCommands::gather(-80, 0, 3, 8, 2, |i| 10 * (i + 4));
        assert_eq!(forward.increments_per_scan(&steady, 3), 10.0);
    }

    #[test]
    fn an_advance_of_a_whole_period_is_the_feed_forward_of_the_next_period() {
        let path = |i: i64| i * i * i - 40 * i;
        let make = |advance_scans| FeedForward {
            scans_per_period: 8,
            coefficient: 1.0,
            advance_scans,
        };
        let here = MovementCommands::gather(path(-9), path(-1), 0, 8, 4, path);
        let later = MovementCommands::gather(path(-1), path(7), 0, 8, 4, |i| path(i + 8));
        assert_eq!(
            make(8.0).increments_per_scan(&here, 0),
            make(0.0).increments_per_scan(&later, 0)
        );
    }
}
