//! The course of an axis that is moved by hand: one owner steps it, and every reader knows what comes next.
use bytemuck::{Pod, Zeroable};

use crate::jog::{JogMotion, JogProfile};

/// Parts of an increment that a course is counted in. So the axes of a line keep to it however slowly one of them goes.
pub const FINE: i64 = 1 << 16;
/// Scans that can be looked ahead: 2 ms of scans of 31.25 µs, and as much again for the difference around them.
pub const AHEAD_SCANS_MAX: u32 = 128;
/// Scans before the present one that are known.
const BEHIND: i64 = 2;
const POSITIONS: usize = AHEAD_SCANS_MAX as usize + BEHIND as usize + 1;

/// A place in increments, in the parts that courses are counted in.
pub fn fine(increments: i64) -> i64 {
    increments.saturating_mul(FINE)
}

/// The increment next to a place of a course.
fn increment(place: i64) -> i64 {
    place.saturating_add(FINE / 2).div_euclid(FINE)
}

/// What limits a course, and where it is to end.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Aim {
    /// Where it is to end.
    pub goal: i64,
    /// Largest step of a scan.
    pub step_max: i64,
}

/// A motion by hand, and what it is to do next.
///
/// ```text
/// each scan:   changes_in ← changes_in − 1;  at 0 the aim is the next one
///              motion ← one step of the profile towards the aim
/// ```
///
/// A change takes effect some scans after it is known, so that what looks ahead on the course (friction, mass, gap, feed-forward) is
/// never late. From the same course everybody makes the same steps; a reader that has missed scans has missed nothing.
///
/// Source: our own (docs/methods/two-controllers.md). Units: 1/65536 of an increment ([`FINE`]) and scans. The command is a whole
/// increment wherever it is shown, and exactly the goal at rest.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct HandCourse {
    /// Where it was in the last scan.
    pub motion: JogMotion,
    /// What the command moved in that scan.
    pub step: i64,
    /// What it does.
    pub aim: Aim,
    /// What it is to do next.
    pub next: Aim,
    /// Largest change of the lead's step from scan to scan.
    pub step_change_max: i64,
    /// Share of the way to the lead that the command makes in a scan.
    pub follows_by: f64,
    /// Scans until the next aim takes effect, 1 in the coming one; 0 without one.
    pub changes_in: u32,
    /// Kept zero.
    pub reserved: u32,
}

impl HandCourse {
    /// At rest at a place in increments, where it is to stay.
    pub fn at(place: i64) -> HandCourse {
        let place = fine(place);
        HandCourse {
            motion: JogMotion::at(place),
            aim: Aim {
                goal: place,
                step_max: 1,
            },
            follows_by: 1.0,
            ..HandCourse::default()
        }
    }

    /// From now on within these limits of acceleration and jerk; at rest only.
    pub fn limit(&mut self, profile: &JogProfile) {
        self.step_change_max = profile.step_change_max;
        self.follows_by = profile.follows_by;
    }

    /// Changes its aim in so many scans, at least one.
    pub fn change(&mut self, next: Aim, scans: u32) {
        self.next = next;
        self.changes_in = scans.max(1);
    }

    fn profile(&self) -> JogProfile {
        JogProfile::following(self.aim.step_max, self.step_change_max, self.follows_by)
    }

    /// One scan on.
    #[must_use]
    pub fn advanced(&self) -> HandCourse {
        let mut course = *self;
        course.changes_in = self.changes_in.saturating_sub(1);
        if self.changes_in == 1 {
            course.aim = self.next;
        }
        course.motion = course.profile().advance(&self.motion, course.aim.goal);
        course.step = course.motion.command.saturating_sub(self.motion.command);
        course
    }

    /// Position command of the last scan, in increments.
    pub fn place(&self) -> i64 {
        increment(self.motion.command)
    }

    /// Where it is to end as far as is known, in increments.
    pub fn target(&self) -> i64 {
        let aim = if self.changes_in > 0 {
            &self.next
        } else {
            &self.aim
        };
        increment(aim.goal)
    }

    /// Whether it has ended: it rests at its goal, and nothing is to change.
    pub fn rests(&self) -> bool {
        let there = self.motion.command == self.aim.goal && self.motion.rests();
        there && self.changes_in == 0
    }

    /// Begins to brake in so many scans: the place where it rests then is its aim.
    pub fn stop(&mut self, scans: u32) {
        let mut then = *self;
        for _ in 1..scans.clamp(1, AHEAD_SCANS_MAX) {
            then = then.advanced();
        }
        let goal = then.profile().rests_at(&then.motion);
        let aim = Aim { goal, ..then.aim };
        self.change(aim, scans);
    }
}

/// Where a course is in this scan, in the two before and in those to come, in increments, so that a model can look ahead on it as it
/// does on a program's setpoints.
///
/// Made again each scan. Further ahead than it was made for, it is taken to stay; further back too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HandCommands {
    /// From [`BEHIND`] scans before this one on.
    positions: [i64; POSITIONS],
    last: usize,
}

impl HandCommands {
    /// Of a course as it was in the scan before.
    pub fn new(course: &HandCourse, ahead_scans: u32) -> HandCommands {
        let ahead_scans = ahead_scans.min(AHEAD_SCANS_MAX);
        let mut commands = HandCommands {
            positions: [course.place(); POSITIONS],
            last: BEHIND as usize + ahead_scans as usize,
        };
        let [before, known @ ..] = &mut commands.positions;
        *before = increment(course.motion.command.saturating_sub(course.step));
        let mut course = *course;
        for position in known.iter_mut().skip(1).take(ahead_scans as usize + 1) {
            course = course.advanced();
            *position = course.place();
        }
        commands
    }

    /// Scans that it is known ahead.
    pub fn ahead_scans(&self) -> i64 {
        self.last as i64 - BEHIND
    }

    /// The position command so many scans from this one.
    pub fn at(&self, ahead: i64) -> i64 {
        let index = usize::try_from(ahead.saturating_add(BEHIND)).unwrap_or(0);
        let position = self.positions.get(index.min(self.last));
        position.copied().unwrap_or(0)
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const STEP_MAX: i64 = 10_000 * FINE;

    fn course(jerk_max: Option<f64>) -> HandCourse {
        let jerk_max = jerk_max.map(|jerk| jerk * FINE as f64);
        let mut course = HandCourse::at(0);
        course.limit(&JogProfile::new(STEP_MAX, 100 * FINE, jerk_max));
        course
    }

    fn aim(increments: i64) -> Aim {
        Aim {
            goal: fine(increments),
            step_max: STEP_MAX,
        }
    }

    #[test]
    fn what_it_shows_ahead_is_what_it_then_does() {
        let mut course = course(Some(14.0));
        let mut done = vec![0, 0];
        let mut shown: Vec<HandCommands> = Vec::new();
        for scan in 0..3_000 {
            match scan {
                5 => course.change(aim(3_000_000), 21),
                300 => course.change(aim(-20), 21),
                322 => course.stop(21),
                _ => {}
            }
            let commands = HandCommands::new(&course, 20);
            let [before, last] = [-2, -1].map(|ahead| commands.at(ahead));
            assert_eq!([before, last], [done[scan], done[scan + 1]]);
            course = course.advanced();
            assert_eq!(commands.at(0), course.place());
            for (ahead, earlier) in shown.iter().rev().take(20).enumerate() {
                assert_eq!(earlier.at(ahead as i64 + 1), course.place(), "scan {scan}");
            }
            shown.push(commands);
            done.push(course.place());
        }
        assert!(course.rests());
    }

    #[test]
    fn near_a_lead_that_only_turns_round_it_keeps_its_limit_of_jerk() {
        let jerk_max = 88.15;
        let mut course = course(Some(jerk_max));
        let mut before = [0.0; 2];
        for (goal, step, scans) in [
            (-185_698, 532, 298),
            (241_985, 4_546, 52),
            (0, 1, 24),
            (0, 100, 23),
            (50_480, 13, 9),
        ] {
            let step_max = step * FINE;
            course.change(
                Aim {
                    goal: fine(goal),
                    step_max,
                },
                6,
            );
            for _ in 0..scans {
                course = course.advanced();
                let step = course.step as f64 / FINE as f64;
                let change = step - before[0];
                assert!(
                    (change - before[1]).abs() <= jerk_max,
                    "{step} {change} {before:?}"
                );
                before = [step, change];
            }
        }
    }

    #[test]
    fn further_than_can_be_known_is_not_asked_for() {
        let commands = HandCommands::new(&course(None), u32::MAX);
        assert_eq!(commands.ahead_scans(), i64::from(AHEAD_SCANS_MAX));
        assert_eq!(commands.at(i64::MAX), commands.at(commands.ahead_scans()));
        assert_eq!(commands.at(i64::MIN), commands.at(-2));
    }

    proptest! {
        /// Any aims, at any time, and stops between them.
        #[test]
        fn it_ends_exactly_at_its_last_aim_within_its_limits_from_any_state_of_motion(
            aims in prop::collection::vec((-400_000i64..400_000, 1i64..10_000, 1usize..300, prop::bool::weighted(0.2)), 1..12),
            jerk_max in prop::option::of(5.0..2_000.0f64),
        ) {
            let mut course = course(jerk_max);
            let mut before = [0i64; 3];
            let mut step_max = FINE;
            for (goal, step, scans, stops) in aims {
                if stops {
                    course.stop(6);
                } else {
                    course.change(Aim { goal: fine(goal), step_max: step * FINE }, 6);
                    step_max = step_max.max(step * FINE);
                }
                for _ in 0..scans.max(6) {
                    course = course.advanced();
                    let now = [course.step, course.step - before[0], course.step - before[0] - before[1]];
                    let arrives = if course.follows_by < 1.0 { 50 * FINE } else { 0 };
                    prop_assert!(now[0].abs() <= step_max + FINE);
                    prop_assert!(now[1].abs() <= 100 * FINE + arrives, "{:?}", now);
                    if let Some(jerk) = jerk_max {
                        prop_assert!(now[2].abs() as f64 <= (jerk + 1.0) * FINE as f64, "{:?} {}", now, jerk);
                    }
                    before = now;
                }
            }
            for _ in 0..500_000 {
                if course.rests() {
                    break;
                }
                course = course.advanced();
            }
            prop_assert!(course.rests());
            prop_assert_eq!(course.place(), course.target());
        }

        /// The axes of a line, each with its share of the limits.
        #[test]
        fn courses_with_limits_in_proportion_are_one_straight_line(
            way in 1_000i64..20_000_000,
            share in 0.001f64..1.0,
            stop_at in prop::option::of(10usize..600),
        ) {
            let other = libm::round(way as f64 * share) as i64;
            let share = other as f64 / way as f64;
            let mut line = [1.0, share].map(|of| {
                let limit = |most: f64| libm::round(most * of * FINE as f64) as i64;
                let mut course = HandCourse::at(0);
                course.limit(&JogProfile::following(1, limit(100.0), 0.2));
                let goal = if of == 1.0 { way } else { other };
                course.change(Aim { goal: fine(goal), step_max: limit(10_000.0) }, 6);
                course
            });
            for scan in 0..20_000 {
                if stop_at == Some(scan) {
                    line.iter_mut().for_each(|course| course.stop(6));
                }
                line = line.map(|course| course.advanced());
                let [long, short] = line.map(|course| course.place() as f64);
                prop_assert!((short - long * share).abs() <= 1.5, "scan {} {} {}", scan, short, long * share);
            }
            prop_assert!(line.iter().all(HandCourse::rests));
        }
    }
}
