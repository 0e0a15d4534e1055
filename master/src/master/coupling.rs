//! Rigid tapping: the spindle follows an axis, as if a gear joined them.
//!
//! The axis leads, because it cannot be as fast as the spindle is strong: windows, braking tails, holds and the return to the path are
//! motions of the axis like any other, and the tap goes with each of them. The relation is latched as angle and place, so that it
//! outlives every process.

use machine::{SPINDLE_RAMP_SHARE, Spindle};

/// What the follower is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coupling {
    gain_per_s: f64,
    limit_turns: f64,
    ramp_turns_s2: f64,
}

/// The gear, as it is latched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gear {
    /// Index of the axis.
    pub axis: usize,
    /// Travel for one turn, below 0 where they run against each other, in mm.
    pub mm_per_turn: f64,
    /// Angle that belongs to [`place_mm`](Gear::place_mm), in turns.
    pub turns: f64,
    /// A place of the axis, in mm.
    pub place_mm: f64,
}

/// What the follower asks of the spindle for one scan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Followed {
    /// Speed, in rev/min.
    pub rpm: f64,
    /// What the spindle lags behind the axis, in turns.
    pub lag_turns: f64,
    /// The lag is beyond its limit, or no number.
    pub lost: bool,
}

impl Coupling {
    /// Of a machine with this spindle.
    pub fn new(spindle: Option<&Spindle>) -> Coupling {
        Coupling {
            gain_per_s: spindle.map_or(0.0, |spindle| spindle.follow_gain_per_s),
            limit_turns: spindle.map_or(0.0, |spindle| spindle.follow_limit_deg / 360.0),
            ramp_turns_s2: spindle.map_or(0.0, |spindle| spindle.ramp_rpm_s / 60.0),
        }
    }

    /// The speed that keeps the spindle in step: the axis's own, and what makes up for the lag.
    ///
    /// `n = v/p + K·(θ₀ + (z − z₀)/p − θ)`, with the measured place z and angle θ at the end of a scan, and the speed v of the axis in
    /// the next one. Not a number counts as lost.
    pub fn follow(&self, gear: &Gear, place_mm: f64, velocity_mm_s: f64, turns: f64) -> Followed {
        let wanted = gear.turns + (place_mm - gear.place_mm) / gear.mm_per_turn;
        let lag_turns = wanted - turns;
        let rpm = 60.0 * (velocity_mm_s / gear.mm_per_turn + self.gain_per_s * lag_turns);
        let within = lag_turns.abs() <= self.limit_turns && rpm.is_finite();
        Followed {
            rpm: if rpm.is_finite() { rpm } else { 0.0 },
            lag_turns: if lag_turns.is_finite() {
                lag_turns
            } else {
                0.0
            },
            lost: !within,
        }
    }

    /// The deceleration at which the axis may be braked, in mm/s²: the spindle can do it too.
    pub fn deceleration_mm_s2(&self, gear: &Gear) -> f64 {
        SPINDLE_RAMP_SHARE * self.ramp_turns_s2 * gear.mm_per_turn.abs()
    }
}

impl Gear {
    /// Whether an axis of a machine can lead with it.
    pub fn is_sound(&self, axes: usize) -> bool {
        let values = [self.mm_per_turn, self.turns, self.place_mm];
        self.axis < axes && self.mm_per_turn != 0.0 && values.iter().all(|value| value.is_finite())
    }
}

/// The place that the spindle follows, in mm: the commanded one as long as the measured one is as near as it always is while lost
/// motion and friction turn round, and no farther from the measured one than that in any case.
pub(super) fn followed_place_mm(commanded_mm: f64, measured_mm: f64, near_mm: f64) -> f64 {
    measured_mm + (commanded_mm - measured_mm).clamp(-near_mm, near_mm)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coupling() -> Coupling {
        Coupling::new(Some(&Spindle {
            ramp_rpm_s: 1200.0,
            follow_gain_per_s: 40.0,
            follow_limit_deg: 36.0,
            ..Spindle::default()
        }))
    }

    #[test]
    fn the_commanded_place_counts_as_long_as_the_axis_is_near_it() {
        assert_eq!(followed_place_mm(5.0, 5.01, 0.02), 5.0);
        assert_eq!(followed_place_mm(5.0, 6.0, 0.25), 5.75);
        assert_eq!(followed_place_mm(5.0, 4.0, 0.25), 4.25);
    }

    const GEAR: Gear = Gear {
        axis: 0,
        mm_per_turn: -1.5,
        turns: 7.0,
        place_mm: -2.0,
    };

    #[test]
    fn in_step_it_turns_as_fast_as_the_axis_moves_and_a_lag_is_made_up_for() {
        let coupling = coupling();
        let followed = coupling.follow(&GEAR, -5.0, -15.0, 9.0);
        assert_eq!((followed.rpm, followed.lag_turns), (600.0, 0.0));
        let behind = coupling.follow(&GEAR, -5.0, -15.0, 8.95);
        assert!((behind.rpm - 720.0).abs() < 1e-9, "{behind:?}");
        assert!((behind.lag_turns - 0.05).abs() < 1e-12 && !behind.lost);
        assert!(coupling.follow(&GEAR, -5.0, 0.0, 9.11).lost);
        assert!((coupling.deceleration_mm_s2(&GEAR) - 0.75 * 20.0 * 1.5).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_number_is_lost_and_turns_nothing() {
        let nan = coupling().follow(&GEAR, f64::NAN, 0.0, 9.0);
        assert_eq!((nan.rpm, nan.lag_turns, nan.lost), (0.0, 0.0, true));
        for wrong in [0.0, f64::NAN] {
            let gear = Gear {
                mm_per_turn: wrong,
                ..GEAR
            };
            assert!(!gear.is_sound(3));
        }
        assert!(GEAR.is_sound(1) && !GEAR.is_sound(0));
    }
}
