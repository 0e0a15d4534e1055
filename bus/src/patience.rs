//! How long to wait awake before going to sleep: a process that is awake finds what it waits for within 0.3 µs on another processor,
//! and 1.4 µs on the same; to wake one that sleeps takes 2.4 and up to 21 (docs/developers/measurements.md, "Speed in lockstep").

use std::cell::Cell;
use std::time::{Duration, Instant};

use rustix::thread::sched_yield;

/// Waits without a try after failures in a row: two to the power of them, at most this.
const FAILURES_MAX: u32 = 10;

/// Waiting awake, as long as it helps: at each look a process leaves its processor to others. Where another process keeps it for
/// long, one that sleeps has it back sooner; so a wait that fails again and again is hardly tried any more.
#[derive(Debug)]
pub struct Patience {
    limit: Duration,
    failures: Cell<u32>,
    skips: Cell<u32>,
}

impl Patience {
    /// At most so long in one wait; with zero nobody waits awake.
    pub fn new(limit: Duration) -> Patience {
        Patience {
            limit,
            failures: Cell::new(0),
            skips: Cell::new(0),
        }
    }

    /// Looks again and again, within the limit; whether it is there.
    pub fn try_for(&self, is_there: impl Fn() -> bool) -> bool {
        if self.limit.is_zero() {
            return false;
        }
        if let Some(left) = self.skips.get().checked_sub(1) {
            self.skips.set(left);
            return false;
        }
        let began = Instant::now();
        let mut there = is_there();
        while !there && began.elapsed() < self.limit {
            sched_yield();
            there = is_there();
        }
        let failures = match there && began.elapsed() < self.limit {
            true => 0,
            false => (self.failures.get() + 1).min(FAILURES_MAX),
        };
        self.failures.set(failures);
        self.skips.set((1 << failures) - 1);
        there
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tries in so many waits for what never comes.
    fn tries_in_vain(limit: Duration, waits: u32) -> u32 {
        let patience = Patience::new(limit);
        let mut tries = 0;
        for _ in 0..waits {
            let skips = patience.skips.get();
            assert!(!patience.try_for(|| false));
            tries += u32::from(patience.skips.get() > skips);
        }
        tries
    }

    #[test]
    fn what_comes_at_once_is_waited_for_every_time() {
        let patience = Patience::new(Duration::from_secs(60));
        let looks = Cell::new(0);
        for wait in 1..=1000 {
            assert!(patience.try_for(|| looks.replace(looks.get() + 1) % 3 == 2));
            assert_eq!(looks.get(), 3 * wait);
        }
    }

    #[test]
    fn what_never_comes_is_hardly_waited_for() {
        // After each failure twice as many waits go by without a try, up to 1023.
        assert_eq!(tries_in_vain(Duration::from_nanos(1), 2 * 1024), 10 + 1);
        assert_eq!(tries_in_vain(Duration::from_nanos(1), 10 * 1024), 10 + 9);
    }

    #[test]
    fn without_patience_nobody_looks() {
        assert_eq!(tries_in_vain(Duration::ZERO, 100), 0);
    }
}
