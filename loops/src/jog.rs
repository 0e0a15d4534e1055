//! Command generation by hand: to a target, from any state of motion, in whole numbers.
use bytemuck::{Pod, Zeroable};

/// Steps towards a target as fast as its limits allow and stops exactly there, from any state of motion.
///
/// A lead takes the largest step `s` of each scan within `±a` of the last and `±v` from which braking by `a` per scan ends no
/// farther than the target: `s + (s − a) + (s − 2a) + … ≤ way left`. The command
/// follows the lead by a share `k` of the way between them: `c ← c + k·(lead − c)`. So its acceleration changes by at most
/// `2·k·a` per scan, which limits the jerk; with `k = 1` it is the lead. Near enough to a lead
/// that has come to rest it arrives; not to one that only turns round, where arriving would add to a change of acceleration.
///
/// Source: our own; a trapezoid of speed in integers and a filter of first order (docs/methods/two-controllers.md). Units: increments and scans.
/// A change below 1 counts as 1. A largest step of 0 brings it to rest where it is; with any other it arrives. First call: a motion at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JogProfile {
    /// Largest step of a scan (speed).
    pub step_max: i64,
    /// Largest change of the lead's step from scan to scan (acceleration).
    pub step_change_max: i64,
    /// Share of the way to the lead that the command makes in a scan, above 0, at most 1.
    pub follows_by: f64,
    /// The command arrives from this far.
    pub arrives_from: i64,
}

/// Where a motion by hand is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct JogMotion {
    /// Position command.
    pub command: i64,
    /// What leads it.
    pub lead: i64,
    /// Change of the lead in the last scan.
    pub lead_step: i64,
}

impl JogMotion {
    /// At rest there.
    pub fn at(position: i64) -> JogMotion {
        JogMotion {
            command: position,
            lead: position,
            lead_step: 0,
        }
    }

    /// Whether nothing moves.
    pub fn rests(&self) -> bool {
        self.lead_step == 0 && self.command == self.lead
    }
}

impl JogProfile {
    /// A profile whose command changes its acceleration by at most so many increments per scan² in a scan, where that is limited.
    pub fn new(step_max: i64, step_change_max: i64, jerk_max: Option<f64>) -> JogProfile {
        // The command's acceleration may change by 2·k·a; rounding takes up to four increments.
        let follows_by = jerk_max.map_or(1.0, |jerk| {
            let left = (jerk - 4.0).max(1.0);
            (left / (2.0 * step_change_max.max(1) as f64)).min(1.0)
        });
        JogProfile::following(step_max, step_change_max, follows_by)
    }

    /// A profile that follows its lead by this share.
    pub fn following(step_max: i64, step_change_max: i64, follows_by: f64) -> JogProfile {
        let acceleration = step_change_max.max(1) as f64;
        let arrives_from = if follows_by < 1.0 {
            libm::floor(follows_by * acceleration / 2.0) as i64
        } else {
            0
        };
        JogProfile {
            step_max,
            step_change_max,
            follows_by,
            arrives_from: arrives_from.min(step_max),
        }
    }

    /// One scan on, towards the target.
    pub fn advance(&self, motion: &JogMotion, target: i64) -> JogMotion {
        let left = target.saturating_sub(motion.lead);
        let lead_step = self.step(motion.lead_step, left);
        let lead = motion.lead.saturating_add(lead_step);
        let way = lead.saturating_sub(motion.command);
        let arrives = self.follows_by >= 1.0
            || (lead_step == 0
                && motion.lead_step == 0
                && way.saturating_abs() <= self.arrives_from.max(1));
        let step = if arrives {
            way
        } else {
            libm::round(way as f64 * self.follows_by) as i64
        };
        // Where a share of the way rounds to nothing, the last of it is still made.
        let step = if step == 0 { way.signum() } else { step };
        JogMotion {
            command: motion.command.saturating_add(step),
            lead,
            lead_step,
        }
    }

    /// Where it comes to rest if it brakes from now on.
    pub fn rests_at(&self, motion: &JogMotion) -> i64 {
        let change = self.step_change_max.max(1);
        let slower = motion
            .lead_step
            .saturating_abs()
            .saturating_sub(change)
            .max(0);
        let way = i64::try_from(braking_way(slower, change)).unwrap_or(i64::MAX);
        let signed = way.saturating_mul(motion.lead_step.signum());
        motion.lead.saturating_add(signed)
    }

    /// The lead's step of this scan: `step` was the last, `left` is the way to the target, both signed.
    fn step(&self, step: i64, left: i64) -> i64 {
        let change = self.step_change_max.max(1);
        let slower = step.signum() * (step.saturating_abs().saturating_sub(change)).max(0);
        // Away from the target it first has to come to rest.
        if left == 0 || (step != 0 && step.signum() != left.signum()) {
            return slower;
        }
        let way = left.saturating_abs();
        let fast = step.saturating_abs();
        let low = fast.saturating_sub(change).max(0);
        let most = fast.saturating_add(change).min(self.step_max.max(0));
        let brakes = fastest(way, change);
        brakes.min(most).min(way).max(low) * left.signum()
    }
}

/// `s + (s − a) + (s − 2a) + …` down to the last above 0.
fn braking_way(step: i64, change: i64) -> i128 {
    let (step, change) = (i128::from(step), i128::from(change));
    let turns = step / change;
    (turns + 1) * step - change * turns * (turns + 1) / 2
}

/// The largest step whose braking way is no longer than `way`: `n` whole changes `a`, and of the rest of the way as much as `n + 1`
/// steps share.
fn fastest(way: i64, change: i64) -> i64 {
    let (left, a) = (i128::from(way), i128::from(change));
    let whole = |n: i128| a * n * (n + 1) / 2;
    let root = libm::sqrt(1.0 + 8.0 * way as f64 / change as f64);
    let mut n = i128::from(libm::floor((root - 1.0) / 2.0) as i64);
    // The root is off by less than one.
    n += i128::from(whole(n + 1) <= left);
    n -= i128::from(n > 0 && whole(n) > left);
    let share = (left - whole(n)) / (n + 1);
    i64::try_from(n * a + share.clamp(0, a - 1)).unwrap_or(i64::MAX)
}

#[cfg(test)]
#[allow(clippy::panic)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Position at rest, the largest step, change of step, and change of that; scans.
    fn travel(
        profile: &JogProfile,
        mut target: i64,
        stop_at: Option<usize>,
    ) -> (i64, [i64; 3], usize) {
        let mut motion = JogMotion::at(0);
        let mut before = [0i64; 3];
        let mut largest = [0i64; 3];
        for scan in 0..400_000 {
            if stop_at == Some(scan) {
                target = profile.rests_at(&motion);
            }
            let next = profile.advance(&motion, target);
            let step = next.command - motion.command;
            let now = [step, step - before[0], step - before[0] - before[1]];
            for (largest, now) in largest.iter_mut().zip(now) {
                *largest = (*largest).max(now.abs());
            }
            (before, motion) = (now, next);
            if motion.rests() && motion.command == target {
                return (motion.command, largest, scan);
            }
        }
        panic!("it never came to rest");
    }

    #[test]
    fn three_millimetres_at_ten_millimetres_per_second_take_as_long_as_the_trapezoid() {
        let profile = JogProfile::new(10_000, 100, None);
        let (at, [step, change, _], scans) = travel(&profile, 3_000_000, None);
        assert_eq!((at, step, change), (3_000_000, 10_000, 100));
        // b/v + v/a = 300 + 100 scans.
        assert!((399..=402).contains(&scans), "{scans}");
    }

    #[test]
    fn with_a_limit_of_jerk_it_takes_a_little_longer() {
        // 2·a/j = 20 scans of delay.
        let profile = JogProfile::new(10_000, 1_000, Some(104.0));
        let (at, [_, _, jerk], scans) = travel(&profile, 3_000_000, None);
        assert_eq!(at, 3_000_000);
        assert!((40..=104).contains(&jerk), "{jerk}");
        assert!((310..=600).contains(&scans), "{scans}");
    }

    proptest! {
        #[test]
        fn the_fastest_step_can_be_braked_and_the_next_one_cannot(
            way in 1i64..i64::MAX,
            short in 1i64..1_000_000,
            change in 1i64..1_000_000_000,
        ) {
            for way in [way, short] {
                let step = fastest(way, change);
                prop_assert!(braking_way(step, change) <= i128::from(way));
                prop_assert!(braking_way(step + 1, change) > i128::from(way));
            }
        }

        #[test]
        fn it_ends_exactly_at_any_target_within_its_limits(
            step_max in 1i64..50_000,
            step_change_max in 1i64..5_000,
            jerk_max in prop::option::of(5.0..2_000.0f64),
            target in -3_000_000i64..3_000_000,
        ) {
            // Slow ones would take for ever to get far.
            let target = target.clamp(-1000 * step_max.min(100 * step_change_max), 1000 * step_max.min(100 * step_change_max));
            let profile = JogProfile::new(step_max, step_change_max, jerk_max);
            if target != 0 {
                let (at, [step, change, jerk], _) = travel(&profile, target, None);
                prop_assert_eq!(at, target);
                prop_assert!(step <= step_max + 2);
                // Rounding, and arriving.
                let rounding = if jerk_max.is_some() { 4 + profile.arrives_from } else { 0 };
                prop_assert!(change <= step_change_max + rounding, "{} {}", change, step_change_max);
                if let Some(jerk_max) = jerk_max {
                    prop_assert!(jerk as f64 <= jerk_max.max(5.0) + 1.0, "{} {}", jerk, jerk_max);
                }
            }
        }

        #[test]
        fn told_to_rest_where_it_can_it_brakes_all_the_way_there(
            target in 1_000_000i64..3_000_000,
            stop_at in 1usize..200,
        ) {
            let profile = JogProfile::new(10_000, 100, None);
            let (at, _, scan) = travel(&profile, -target, Some(stop_at));
            prop_assert!(at < 0 && at >= -target);
            prop_assert!(scan <= stop_at + 101);
        }
    }
}
