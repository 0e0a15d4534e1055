//! The position commands of a jog around the present scan.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use crate::jog::{JogMotion, JogProfile};

/// Scans that can be looked ahead: 2 ms of scans of 31.25 µs, and as much again for the difference around them.
pub const AHEAD_SCANS_MAX: u32 = 128;
/// Scans before the present one that are known.
const BEHIND: i64 = 2;
const POSITIONS: usize = AHEAD_SCANS_MAX as usize + BEHIND as usize + 1;

/// When a jog begins to move and to stop, in scans from now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JogTimes {
    /// 0: in this scan it moves.
    pub starts_in: u32,
    /// [`u32::MAX`]: it is not ordered to.
    pub stops_in: u32,
}

/// Where a jog is to be in this scan, in the two before and in those to come, so that a model can look ahead on it as it does
/// on a program's setpoints.
///
/// Made again each scan from the motion that is remembered; it makes `ahead_scans + 1` steps of the profile. Further ahead than it was
/// made for, it is taken to stay; further back too. Units: increments and scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JogCourse {
    /// From [`BEHIND`] scans before this one on.
    positions: [i64; POSITIONS],
    last: usize,
    now: JogMotion,
}

impl JogCourse {
    /// Of a motion as it was in the scan before, in which its command made the step `step`.
    pub fn new(
        profile: &JogProfile,
        (before, step): (&JogMotion, i64),
        target: i64,
        when: JogTimes,
        ahead_scans: u32,
    ) -> JogCourse {
        let ahead_scans = ahead_scans.min(AHEAD_SCANS_MAX);
        let mut course = JogCourse {
            positions: [before.command; POSITIONS],
            last: BEHIND as usize + ahead_scans as usize,
            now: *before,
        };
        let [first, known @ ..] = &mut course.positions;
        *first = before.command.saturating_sub(step);
        let mut motion = *before;
        let ahead = known.iter_mut().skip(1);
        for (scan, position) in (0..=ahead_scans).zip(ahead) {
            if scan >= when.starts_in {
                motion = profile.advance(&motion, target, scan >= when.stops_in);
            }
            if scan == 0 {
                course.now = motion;
            }
            *position = motion.command;
        }
        course
    }

    /// The motion in this scan.
    pub fn now(&self) -> JogMotion {
        self.now
    }

    /// Scans that it is known ahead.
    pub fn ahead_scans(&self) -> i64 {
        self.last as i64 - BEHIND
    }

    /// The position command so many scans from this one.
    pub fn at(&self, ahead: i64) -> i64 {
        let index = usize::try_from(ahead.saturating_add(BEHIND)).unwrap_or(0);
        let position = self.positions.get(index.min(self.last));
        position.copied().unwrap_or(self.now.command)
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    const MOVING: JogTimes = JogTimes {
        starts_in: 0,
        stops_in: u32::MAX,
    };
    const TARGET: i64 = 3_000_000;

    #[test]
    fn it_is_what_the_jog_then_does_and_what_it_has_done() {
        let profile = JogProfile::new(10_000, 100, Some(14.0));
        let mut motion = JogMotion::at(0);
        let mut done = vec![0, 0];
        for _ in 0..400 {
            let step = done[done.len() - 1] - done[done.len() - 2];
            let course = JogCourse::new(&profile, (&motion, step), TARGET, MOVING, 20);
            assert_eq!(course.at(-1), done[done.len() - 1]);
            assert_eq!(course.at(-2), done[done.len() - 2]);
            motion = course.now();
            done.push(motion.command);
            let mut later = motion;
            for ahead in 1..=20 {
                later = profile.advance(&later, TARGET, false);
                assert_eq!(course.at(ahead), later.command);
            }
            assert_eq!(course.at(21), later.command, "not known");
        }
    }

    #[test]
    fn it_begins_and_stops_when_it_is_to() {
        let profile = JogProfile::new(10_000, 100, None);
        let when = JogTimes {
            starts_in: 4,
            stops_in: 8,
        };
        let rest = JogMotion::at(50);
        let course = JogCourse::new(&profile, (&rest, 0), TARGET, when, 40);
        let positions: Vec<i64> = (-2..14).map(|ahead| course.at(ahead) - 50).collect();
        let moved = [100, 300, 600, 1000, 1300, 1500, 1600, 1600, 1600, 1600];
        assert_eq!(positions[..6], [0; 6]);
        assert_eq!(positions[6..], moved);
    }

    #[test]
    fn further_than_can_be_known_is_not_asked_for() {
        let profile = JogProfile::new(10_000, 100, None);
        let rest = JogMotion::at(0);
        let course = JogCourse::new(&profile, (&rest, 0), TARGET, MOVING, u32::MAX);
        assert_eq!(course.ahead_scans(), i64::from(AHEAD_SCANS_MAX));
        assert_eq!(course.at(i64::MAX), course.at(course.ahead_scans()));
        assert_eq!(course.at(i64::MIN), course.at(-2));
    }
}
