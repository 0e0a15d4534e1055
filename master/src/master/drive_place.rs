//! Where a drive shows its axis to be before it is lost and after it comes back: one that was without power meanwhile and comes back
//! elsewhere is not driven before somebody has looked and said so. What was lost on the bus alone has counted on.

use machine::Axis;

use crate::drives::DriveFeedback;

/// Besides braking, so long a drive that is lost may go on at its speed until it notices, in s. As long as it is only missed it is shown
/// where it would be if it did, and it may have stopped.
const GOES_ON_S: f64 = 0.1;
/// It may brake with this share of the deceleration of a quick stop.
const BRAKES_WITH: f64 = 0.5;
/// Least way that is told, in mm: hands and springs move an axis that is off.
const LEAST_MM: f64 = 0.5;

/// The place of the drive of an axis that nobody homes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct DrivePlace {
    /// How long it may go on at its speed, in s.
    goes_on_s: f64,
    /// The deceleration with which it brakes at least.
    brakes_mm_s2: f64,
    /// How far commands that it may still have got can have moved it from rest, in mm.
    unseen_mm: f64,
    /// As the drive has shown it last; none before the first time.
    seen_mm: Option<f64>,
    /// How far it may have gone by itself since.
    may_go_mm: f64,
    is_lost: bool,
    displaced_mm: Option<f64>,
}

impl DrivePlace {
    /// Of an axis whose drive may be missed for so long before it is lost.
    pub fn new(axis: &Axis, missed_s: f64) -> DrivePlace {
        DrivePlace {
            goes_on_s: GOES_ON_S + 2.0 * missed_s,
            brakes_mm_s2: BRAKES_WITH * axis.quick_stop_mm_s2,
            unseen_mm: axis.acceleration_mm_s2 * missed_s * missed_s,
            ..DrivePlace::default()
        }
    }

    /// Takes what the drive shows.
    pub fn take(&mut self, drive: &DriveFeedback) {
        let was_lost = std::mem::replace(&mut self.is_lost, drive.state.is_lost());
        if self.is_lost {
            return;
        }
        let at_mm = drive.motor_position_mm;
        match self.seen_mm.filter(|_| was_lost) {
            Some(seen_mm) if drive.restarted => {
                let off_mm = at_mm - seen_mm;
                if off_mm.abs() > self.may_go_mm + LEAST_MM {
                    self.displaced_mm = Some(self.displaced_mm.unwrap_or(0.0) + off_mm);
                }
            }
            // It was lost while no master lived: only the one before has seen where it was.
            None if drive.restarted => self.doubt(),
            _ => {}
        }
        self.seen_mm = Some(at_mm);
        let speed_mm_s = drive.velocity_mm_s.abs();
        let braking_mm = speed_mm_s * speed_mm_s / (2.0 * self.brakes_mm_s2);
        self.may_go_mm = self.unseen_mm + braking_mm + speed_mm_s * self.goes_on_s;
    }

    /// How far it came back from where it was lost, in mm; 0 where that was lost with a master, none where it did not.
    pub fn displaced_mm(&self) -> Option<f64> {
        self.displaced_mm
    }

    /// Whether a next master could not know its place: it is lost, or nobody has looked at where it came back.
    pub fn is_unsure(&self) -> bool {
        self.displaced_mm.is_some() || self.is_lost && self.seen_mm.is_some()
    }

    /// The master before this one was not sure of it.
    pub fn doubt(&mut self) {
        self.displaced_mm = Some(0.0);
    }

    /// Somebody has looked: it is where it shows, if it shows anything.
    pub fn confirm(&mut self) {
        if !self.is_lost {
            self.displaced_mm = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drives::DriveState;

    /// Of an axis with 2000 mm/s² and a quick stop of 5000, missed for at most 10 ms: 0.2 mm unseen.
    fn new() -> DrivePlace {
        DrivePlace {
            goes_on_s: 0.12,
            brakes_mm_s2: 2500.0,
            unseen_mm: 0.2,
            ..DrivePlace::default()
        }
    }

    fn shows(state: DriveState, motor_position_mm: f64, velocity_mm_s: f64) -> DriveFeedback {
        DriveFeedback {
            state,
            motor_position_mm,
            velocity_mm_s,
            restarted: state == DriveState::Off,
            ..DriveFeedback::default()
        }
    }

    /// At this place and speed, then lost, then back elsewhere.
    fn after_a_loss(from_mm: f64, velocity_mm_s: f64, to_mm: f64) -> DrivePlace {
        let mut place = new();
        let lost = DriveState::Lost { code: 0 };
        for drive in [
            shows(DriveState::Ready, from_mm, velocity_mm_s),
            shows(lost, from_mm, 0.0),
            shows(lost, 0.0, 0.0),
            shows(DriveState::Off, to_mm, 0.0),
        ] {
            place.take(&drive);
        }
        place
    }

    #[test]
    fn what_stood_and_comes_back_elsewhere_is_displaced_until_it_is_confirmed() {
        let mut place = after_a_loss(10.0, 0.0, 35.0);
        assert_eq!(place.displaced_mm(), Some(25.0));
        assert!(place.is_unsure());
        let lost = shows(DriveState::Lost { code: 0 }, 0.0, 0.0);
        place.take(&lost);
        // Nobody can have seen where it is.
        place.confirm();
        assert_eq!(place.displaced_mm(), Some(25.0));
        place.take(&shows(DriveState::Off, 35.0, 0.0));
        place.confirm();
        assert_eq!(place.displaced_mm(), None);
        assert!(!place.is_unsure());
    }

    #[test]
    fn the_way_of_braking_is_no_displacement_and_more_is() {
        // 100 mm/s: 2 mm of braking at half the deceleration, 12 mm until it is noticed.
        assert_eq!(after_a_loss(10.0, 100.0, 24.6).displaced_mm(), None);
        assert!(after_a_loss(10.0, 100.0, 24.8).displaced_mm().is_some());
        assert_eq!(after_a_loss(10.0, 0.0, 10.6).displaced_mm(), None);
    }

    #[test]
    fn a_drive_that_is_seen_for_the_first_time_may_be_anywhere() {
        let mut place = new();
        place.take(&shows(DriveState::Lost { code: 0 }, 0.0, 0.0));
        assert!(!place.is_unsure());
        let first = DriveFeedback {
            restarted: false,
            ..shows(DriveState::Off, 170.0, 0.0)
        };
        place.take(&first);
        assert_eq!(place.displaced_mm(), None);
    }

    #[test]
    fn a_drive_that_was_without_power_while_no_master_lived_has_to_be_looked_at() {
        let mut place = new();
        // A new master looks at the drives before it is shown who was without power.
        place.take(&shows(DriveState::Ready, 10.0, 0.0));
        assert_eq!(place.displaced_mm(), None);
        place.take(&shows(DriveState::Off, 10.0, 0.0));
        assert_eq!(place.displaced_mm(), Some(0.0));
        place.confirm();
        place.take(&shows(DriveState::Ready, 10.0, 0.0));
        assert!(!place.is_unsure());
    }
}
