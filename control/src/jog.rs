//! Command generation of a jog: to a target, from rest to rest, in whole increments.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

/// Steps towards a target as fast as its limits allow and stops exactly there.
///
/// Each scan takes the largest step `s` within `±a` of the last and `±v` from which braking by `a` per scan ends no
/// farther than the target: `s + (s − a) + (s − 2a) + … ≤ way left`. Ordered to stop, it brakes by `a` per scan.
///
/// Source: our own; a trapezoid of speed in integers (docs/methods/two-controllers.md). Units: increments and scans.
/// Limits below 1 count as 1, so that it always arrives. First call: a step of 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JogProfile {
    /// Largest step of a scan (speed).
    pub step_max: i64,
    /// Largest change of the step from scan to scan (acceleration).
    pub step_change_max: i64,
}

impl JogProfile {
    /// The step of this scan: `step` was the last, `left` is the way to the target, both signed.
    pub fn step(&self, step: i64, left: i64, stop: bool) -> i64 {
        let change = self.step_change_max.max(1);
        let slower = step.signum() * (step.saturating_abs().saturating_sub(change)).max(0);
        // Away from the target it first has to come to rest.
        if stop || left == 0 || (step != 0 && step.signum() != left.signum()) {
            return slower;
        }
        let way = left.saturating_abs();
        let fast = step.saturating_abs();
        let mut low = fast.saturating_sub(change).max(0);
        let mut high = fast
            .saturating_add(change)
            .min(self.step_max.max(1))
            .min(way);
        // Halving between a step that surely can be braked and the largest allowed: at most 63 turns.
        while low < high {
            let middle = high - (high - low) / 2;
            if braking_way(middle, change) <= i128::from(way) {
                low = middle;
            } else {
                high = middle - 1;
            }
        }
        low * left.signum()
    }
}

/// `s + (s − a) + (s − 2a) + …` down to the last above 0.
fn braking_way(step: i64, change: i64) -> i128 {
    let (step, change) = (i128::from(step), i128::from(change));
    let turns = step / change;
    (turns + 1) * step - change * turns * (turns + 1) / 2
}

#[cfg(test)]
#[allow(clippy::panic)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn travel(profile: &JogProfile, target: i64, stop_at: Option<usize>) -> (i64, i64, usize) {
        let (mut at, mut step, mut largest) = (0, 0i64, 0);
        for scan in 0..200_000 {
            let stop = stop_at.is_some_and(|s| scan >= s);
            let next = profile.step(step, target - at, stop);
            assert!(
                (next - step).abs() <= profile.step_change_max,
                "{step} → {next}"
            );
            assert!(next.abs() <= profile.step_max);
            largest = largest.max(next.abs());
            at += next;
            step = next;
            if step == 0 && (at == target || stop) {
                return (at, largest, scan);
            }
        }
        panic!("it never came to rest");
    }

    #[test]
    fn three_millimetres_at_ten_millimetres_per_second_take_as_long_as_the_trapezoid() {
        let profile = JogProfile {
            step_max: 10_000,
            step_change_max: 100,
        };
        let (at, largest, scans) = travel(&profile, 3_000_000, None);
        assert_eq!((at, largest), (3_000_000, 10_000));
        // b/v + v/a = 300 + 100 scans.
        assert!((399..=402).contains(&scans), "{scans}");
    }

    proptest! {
        #[test]
        fn it_ends_exactly_at_any_target_within_its_limits(
            step_max in 1i64..50_000,
            step_change_max in 1i64..5_000,
            target in -3_000_000i64..3_000_000,
        ) {
            // Slow ones would take for ever to get far.
            let target = target.clamp(-1000 * step_max.min(100 * step_change_max), 1000 * step_max.min(100 * step_change_max));
            let profile = JogProfile { step_max, step_change_max };
            if target != 0 {
                prop_assert_eq!(travel(&profile, target, None).0, target);
            }
        }

        #[test]
        fn ordered_to_stop_it_brakes_to_rest_on_the_way(
            target in 1_000_000i64..3_000_000,
            stop_at in 1usize..200,
        ) {
            let profile = JogProfile { step_max: 10_000, step_change_max: 100 };
            let (at, _, scan) = travel(&profile, -target, Some(stop_at));
            prop_assert!(at < 0 && at >= -target);
            prop_assert!(scan <= stop_at + 101);
        }
    }
}
