//! What an axis must not leave while its loop is closed.
use path::travel::Travel;

/// Guards of one axis, judged each scan; written so that a value that is not a number breaks them.
///
/// Source: docs/developers/architecture.md. Units: mm and mm/s, increments for positions. No state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisGuards {
    /// The travel, in increments.
    pub travel: Travel<i64>,
    /// How far the feedback may be beyond the travel, in increments: a command that ends exactly there overshoots a little.
    pub travel_margin: i64,
    /// Following error, in mm.
    pub following_error_mm: f64,
    /// Speed command, in mm/s.
    pub speed_mm_s: f64,
}

/// Which guard was broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Broken {
    /// Command or axis beyond the travel.
    Travel,
    /// Following error too large.
    FollowingError,
    /// Speed command too high.
    Speed,
    /// Not a number, or infinite.
    NotFinite,
}

impl AxisGuards {
    /// Judges positions in increments, of an axis whose command may be anywhere in `reach`.
    pub fn positions(&self, reach: Travel<i64>, command: i64, feedback: i64) -> Option<Broken> {
        if reach.holds(command) {
            self.feedback(command, feedback)
        } else {
            Some(Broken::Travel)
        }
    }

    /// The same of a motion by hand, whose command was at `before`. It counts from where the motor stands, and so is off the
    /// positions of the machine by what the axis was not in position.
    pub fn by_hand(&self, before: i64, command: i64, feedback: i64) -> Option<Broken> {
        let reach = self.travel.widened(self.travel_margin).from_place(before);
        self.positions(reach, command, feedback)
    }

    /// Judges the feedback alone, in increments, of an axis that is commanded to be at `command`.
    pub fn feedback(&self, command: i64, feedback: i64) -> Option<Broken> {
        let reach = self.travel.from_place(command);
        let reach = reach.widened(self.travel_margin);
        (!reach.holds(feedback)).then_some(Broken::Travel)
    }

    /// Judges the following error.
    pub fn following_error(&self, error_mm: f64) -> Option<Broken> {
        if !error_mm.is_finite() {
            Some(Broken::NotFinite)
        } else if error_mm.abs() <= self.following_error_mm {
            None
        } else {
            Some(Broken::FollowingError)
        }
    }

    /// Judges the speed command.
    pub fn speed(&self, speed_mm_s: f64) -> Option<Broken> {
        if !speed_mm_s.is_finite() {
            Some(Broken::NotFinite)
        } else if speed_mm_s.abs() <= self.speed_mm_s {
            None
        } else {
            Some(Broken::Speed)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GUARDS: AxisGuards = AxisGuards {
        travel: Travel {
            min: -100,
            max: 200,
        },
        travel_margin: 5,
        following_error_mm: 2.0,
        speed_mm_s: 250.0,
    };

    /// Of an axis that was commanded to be at `before`.
    fn positions(before: i64, command: i64, feedback: i64) -> Option<Broken> {
        GUARDS.positions(GUARDS.travel.from_place(before), command, feedback)
    }

    #[test]
    fn the_command_may_reach_the_travel_and_the_feedback_pass_it_by_the_margin() {
        assert_eq!(positions(0, 200, 205), None);
        assert_eq!(positions(0, -100, -105), None);
        for (command, feedback) in [
            (201, 200),
            (-101, 0),
            (0, 206),
            (0, -106),
            (i64::MIN, 0),
            (0, i64::MAX),
        ] {
            assert_eq!(positions(0, command, feedback), Some(Broken::Travel));
        }
    }

    #[test]
    fn an_axis_that_is_outside_may_be_there_and_come_back_and_not_go_farther_out() {
        assert_eq!(positions(300, 300, 302), None);
        assert_eq!(positions(300, 280, 281), None);
        assert_eq!(positions(-150, -149, -150), None);
        for (before, command, feedback) in [
            (300, 301, 300),
            (300, 300, 306),
            (-150, -151, -150),
            (300, -101, 0),
        ] {
            let broken = positions(before, command, feedback);
            assert_eq!(broken, Some(Broken::Travel));
        }
    }

    #[test]
    fn by_hand_an_axis_may_be_beyond_the_travel_by_the_margin_and_no_farther_scan_by_scan() {
        assert_eq!(GUARDS.by_hand(0, -105, -110), None);
        assert_eq!(GUARDS.by_hand(300, 300, 305), None);
        assert_eq!(GUARDS.by_hand(-150, -140, -145), None);
        for (before, command, feedback) in [
            (0, -106, -106),
            (-106, -107, -107),
            (-105, -105, -111),
            (300, 301, 301),
        ] {
            let broken = GUARDS.by_hand(before, command, feedback);
            assert_eq!(broken, Some(Broken::Travel));
        }
    }

    #[test]
    fn error_and_speed_break_beyond_their_limit_and_when_not_finite() {
        assert_eq!(GUARDS.following_error(-2.0), None);
        assert_eq!(GUARDS.following_error(2.001), Some(Broken::FollowingError));
        assert_eq!(GUARDS.following_error(f64::NAN), Some(Broken::NotFinite));
        assert_eq!(GUARDS.speed(250.0), None);
        assert_eq!(GUARDS.speed(-250.1), Some(Broken::Speed));
        assert_eq!(GUARDS.speed(f64::INFINITY), Some(Broken::NotFinite));
    }
}
