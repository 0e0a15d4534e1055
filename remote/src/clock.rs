//! How old what came over the link is, without a clock that somebody sets.
//!
//! Each host has a clock that only runs on (`CLOCK_BOOTTIME`: it counts while a notebook sleeps); the two have nothing in common.
//! A round trip bounds their difference: the remote asks at `r0`, the server answers with its clock `s`, the answer is there at `r1`.
//! The server read its clock between the two, so its clock minus the remote's is between `s − r1` and `s − r0`, however
//! differently the two ways took. What the server made at `t` is then, at the remote's `now`, between
//! `now + s − r1 − t` and `now + s − r0 − t` old: the bounds lie one round trip apart, and it is the upper one that is shown.
//!
//! A bound that was measured some time ago gets wider by 200 ppm since.

use std::collections::VecDeque;

/// Rates of two quartz clocks differ by less: 100 ppm each.
const DRIFT: f64 = 200e-6;
/// Round trips that are kept.
const KEPT: usize = 16;

/// Microseconds of a clock that only runs on, also while the PC sleeps. Two hosts' have nothing in common.
pub fn now_us() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
    let seconds = u64::try_from(now.tv_sec).unwrap_or(0);
    seconds * 1_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0) / 1000
}

/// One question for the server's clock, answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoundTrip {
    /// The remote's clock when it asked.
    pub asked_us: u64,
    /// The server's clock.
    pub server_us: u64,
    /// The remote's clock when the answer was there.
    pub answered_us: u64,
}

impl RoundTrip {
    /// How long it took.
    pub fn duration_us(&self) -> u64 {
        self.answered_us.saturating_sub(self.asked_us)
    }
}

/// Bounds of an age, in s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Age {
    /// It is at least so old.
    pub min_s: f64,
    /// It is at most so old.
    pub max_s: f64,
}

/// What is known of the difference between the two clocks.
#[derive(Debug, Default)]
pub struct Clocks {
    trips: VecDeque<RoundTrip>,
}

impl Clocks {
    /// Takes an answer. One that was there before it was asked for says nothing.
    pub fn take(&mut self, trip: RoundTrip) {
        if trip.answered_us < trip.asked_us {
            return;
        }
        if self.trips.len() == KEPT {
            self.trips.pop_front();
        }
        self.trips.push_back(trip);
    }

    /// Forgets all: another server, another clock.
    pub fn clear(&mut self) {
        self.trips.clear();
    }

    /// The last round trip, in s.
    pub fn round_trip_s(&self) -> Option<f64> {
        let last = self.trips.back()?;
        Some(last.duration_us() as f64 * 1e-6)
    }

    /// Age at the remote's `now_us` of what the server made at its `made_us`; none before the first answer. Each round trip
    /// gives bounds that hold; the narrowest that all of them leave are taken.
    pub fn age(&self, made_us: u64, now_us: u64) -> Option<Age> {
        let difference_us = |later: u64, earlier: u64| later as f64 - earlier as f64;
        let mut age: Option<Age> = None;
        for trip in &self.trips {
            let since_answer_us = difference_us(now_us, trip.answered_us).max(0.0);
            let drift_us = DRIFT * since_answer_us;
            // Small differences first: clocks may stand anywhere in 64 bits, and a float has 53.
            let at_server_us = difference_us(trip.server_us, made_us);
            let min_s = (at_server_us + difference_us(now_us, trip.answered_us) - drift_us) * 1e-6;
            let max_s = (at_server_us + difference_us(now_us, trip.asked_us) + drift_us) * 1e-6;
            age = Some(age.map_or(Age { min_s, max_s }, |before| Age {
                min_s: before.min_s.max(min_s),
                max_s: before.max_s.min(max_s),
            }));
        }
        // Nothing arrives before it was made.
        age.map(|age| Age {
            min_s: age.min_s.max(0.0),
            max_s: age.max_s.max(0.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn without_an_answer_no_age_is_claimed() {
        assert_eq!(Clocks::default().age(5, 10), None);
    }

    #[test]
    fn an_age_grows_with_the_remotes_clock_while_nothing_comes() {
        let mut clocks = Clocks::default();
        clocks.take(RoundTrip {
            asked_us: 1_000_000,
            server_us: 77_000_000,
            answered_us: 1_100_000,
        });
        let young = clocks.age(77_000_000, 1_100_000).expect("an age");
        assert!((young.min_s - 0.0).abs() < 1e-9, "{young:?}");
        assert!((young.max_s - 0.1).abs() < 1e-9, "{young:?}");
        let old = clocks.age(77_000_000, 11_100_000).expect("an age");
        assert!((old.max_s - 10.1).abs() < 0.003, "{old:?}");
        assert!(old.min_s > 9.99, "{old:?}");
    }

    proptest! {
        /// Whatever the clocks' offset and rates and however lopsided the ways: the true age lies between the bounds.
        #[test]
        fn the_true_age_lies_between_the_bounds(
            offset_us in 0u64..1 << 52,
            rate_ppm in -100i64..=100,
            trips in prop::collection::vec((0u64..60_000_000, 0u64..2_000_000, 0u64..2_000_000), 1..20),
            made_us in 0u64..60_000_000,
            age_us in 0u64..5_000_000,
        ) {
            // True time in µs; the remote's clock starts at 0 and is exact, the server's is off by offset and rate.
            let server = |true_us: u64| {
                let drift = true_us as i64 * rate_ppm / 1_000_000;
                (offset_us as i64 + true_us as i64 + drift + 10_000) as u64
            };
            let now_us = made_us + age_us;
            let mut clocks = Clocks::default();
            for (asked_us, there_us, back_us) in trips {
                let answered_us = asked_us + there_us + back_us;
                if answered_us <= now_us {
                    clocks.take(RoundTrip { asked_us, server_us: server(asked_us + there_us), answered_us });
                }
            }
            if let Some(age) = clocks.age(server(made_us), now_us) {
                let true_s = age_us as f64 * 1e-6;
                // Something was made up to 60 s from the round trip: the drift between is not the remote's to know.
                let slack_s = 60.0 * 1e-4 + 1e-5;
                prop_assert!(age.min_s <= true_s + slack_s, "{age:?} {true_s}");
                prop_assert!(age.max_s >= true_s - slack_s, "{age:?} {true_s}");
            }
        }
    }
}
