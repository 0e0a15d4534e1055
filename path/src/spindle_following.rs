//! Motion along one straight element whose place follows the angle of a spindle, scan by scan, within the limits of the axes.
//!
//! The place that belongs to the angle runs along the line of the element, from before its start: the motion stands until that place
//! is so near that speeding up at the limit meets it at its speed, and is in step from there on. So where the thread lies depends on
//! the angle alone, never on speed or time, and every pass over it begins at the same angle.
//!
//! State and motion are discrete: a place, and the way of the last scan as a speed. `|v(k) − v(k−1)| ≤ A·Tp` holds for every scan,
//! whatever is asked for; so do `0 ≤ v ≤ V` and the stop at the end of the element.
use crate::geometry::Element;
use crate::limits::MotionLimits;

/// Of the acceleration, what meeting the spindle takes; the rest is for what was not foreseen of it.
const MEETING_SHARE: f64 = 0.8;
/// Scans in which a small deviation from the spindle falls to 1/e: corrections of a newly measured angle, and an encoder's counts, ask
/// for little acceleration then.
const CORRECTION_SCANS: f64 = 4.0;
/// This near to the end is the end, in mm: a hundred-thousandth of an increment of 1 nm.
const END_MM: f64 = 1e-11;

/// What a pass may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowingSettings {
    /// Time from one setpoint to the next, in s.
    pub scan_period_s: f64,
    /// Highest acceleration along the element, in mm/s².
    pub acceleration_mm_s2: f64,
    /// Highest speed along it, in mm/s.
    pub speed_mm_s: f64,
    /// Its length, in mm.
    pub length_mm: f64,
}

/// Where it is, and how fast.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FollowingState {
    /// Along the element, in mm.
    pub distance_mm: f64,
    /// Mean speed of the last scan, in mm/s.
    pub speed_mm_s: f64,
}

/// What the spindle asks for at one setpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpindlePlace {
    /// Place along the element that belongs to its angle, in mm; below 0 before the start.
    pub distance_mm: f64,
    /// Speed of that place, in mm/s.
    pub speed_mm_s: f64,
}

impl FollowingState {
    /// Whether it stands.
    pub fn is_at_rest(&self) -> bool {
        self.speed_mm_s == 0.0
    }
}

impl FollowingSettings {
    /// Those of a straight element within the limits of the axes, less what rounding to increments takes.
    pub fn of(element: &Element, limits: &MotionLimits) -> FollowingSettings {
        let tangent = element.tangent(0.0);
        let along = |of_axes: &[f64]| {
            let of_axes = tangent.iter().zip(of_axes);
            let allowed = of_axes.map(|(share, limit)| limit / share.abs());
            allowed.fold(f64::INFINITY, f64::min)
        };
        FollowingSettings {
            scan_period_s: limits.scan_period_s(),
            acceleration_mm_s2: along(&limits.plan_acceleration_mm_s2()),
            speed_mm_s: along(&limits.plan_velocity_mm_s()),
            length_mm: element.length_mm,
        }
    }

    /// Speed change that one scan allows, in mm/s.
    fn step_mm_s(&self) -> f64 {
        self.acceleration_mm_s2 * self.scan_period_s
    }

    /// How far before the spindle's place a motion at rest begins to meet it at this speed, in mm.
    pub fn run_in_mm(&self, speed_mm_s: f64) -> f64 {
        let acceleration = MEETING_SHARE * self.acceleration_mm_s2;
        let linear = acceleration * CORRECTION_SCANS * self.scan_period_s;
        (speed_mm_s * speed_mm_s + linear * linear) / (2.0 * acceleration)
    }

    /// How far before its end a motion at this speed begins to brake, in mm.
    pub fn run_out_mm(&self, speed_mm_s: f64) -> f64 {
        speed_mm_s * speed_mm_s / (2.0 * self.acceleration_mm_s2) + speed_mm_s * self.scan_period_s
    }

    /// One scan in step. What is not a number asks for rest.
    pub fn follow(&self, state: &mut FollowingState, spindle: &SpindlePlace) {
        let scan_s = self.scan_period_s;
        let off_mm = spindle.distance_mm - spindle.speed_mm_s * scan_s - state.distance_mm;
        let wanted_mm_s = spindle.speed_mm_s + self.approach_mm_s(off_mm);
        self.go(state, wanted_mm_s);
    }

    /// One scan at a speed of its own, up to the end.
    pub fn go(&self, state: &mut FollowingState, wanted_mm_s: f64) {
        let step_mm_s = self.step_mm_s();
        let before_mm_s = state.speed_mm_s;
        let wanted_mm_s = if wanted_mm_s.is_finite() {
            wanted_mm_s
        } else {
            0.0
        };
        let within_mm_s = wanted_mm_s
            .min(self.speed_mm_s)
            .clamp(before_mm_s - step_mm_s, before_mm_s + step_mm_s)
            .max(0.0);
        let left_mm = self.length_mm - state.distance_mm;
        state.speed_mm_s = within_mm_s.min(self.speed_that_stops_mm_s(left_mm));
        let there_mm = state.distance_mm + state.speed_mm_s * self.scan_period_s;
        state.distance_mm = if self.length_mm - there_mm <= END_MM {
            self.length_mm
        } else {
            there_mm
        };
    }

    /// One scan of braking.
    pub fn brake(&self, state: &mut FollowingState) {
        self.go(state, 0.0);
    }

    /// Whether it stands at the end.
    pub fn is_done(&self, state: &FollowingState) -> bool {
        state.is_at_rest() && state.distance_mm >= self.length_mm
    }

    /// Speed relative to the spindle's place at which a deviation is made up for: in proportion to a small one, and along the
    /// parabola of a constant acceleration for a large one; both meet with one slope.
    fn approach_mm_s(&self, off_mm: f64) -> f64 {
        let acceleration = MEETING_SHARE * self.acceleration_mm_s2;
        let time_s = CORRECTION_SCANS * self.scan_period_s;
        let linear_mm = acceleration * time_s * time_s;
        let speed_mm_s = if off_mm.abs() <= linear_mm {
            off_mm.abs() / time_s
        } else {
            let linear_mm_s = acceleration * time_s;
            (2.0 * acceleration * off_mm.abs() - linear_mm_s * linear_mm_s).sqrt()
        };
        speed_mm_s.copysign(off_mm)
    }

    /// The highest speed of the next scan from which braking at the limit, scan by scan, ends no farther than this.
    ///
    /// With m + 1 scans until rest, `left = Tp·((m + 1)·v − A·Tp·m(m + 1)/2)`; m is the one for which v lies between m and m + 1
    /// steps of the speed.
    fn speed_that_stops_mm_s(&self, left_mm: f64) -> f64 {
        if left_mm <= END_MM {
            return 0.0;
        }
        let unit_mm = self.step_mm_s() * self.scan_period_s;
        let scans = libm::floor(0.5 * ((1.0 + 8.0 * left_mm / unit_mm).sqrt() - 1.0));
        let steps = 0.5 * scans * (scans + 1.0);
        (left_mm / self.scan_period_s + self.step_mm_s() * steps) / (scans + 1.0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SETTINGS: FollowingSettings = FollowingSettings {
        scan_period_s: 1e-3,
        acceleration_mm_s2: 2000.0,
        speed_mm_s: 100.0,
        length_mm: 20.0,
    };

    /// The places of a pass after a spindle that turns evenly, which the motion first sees so far before the start.
    fn pass(settings: &FollowingSettings, before_mm: f64, speed_mm_s: f64) -> Vec<(f64, f64)> {
        let mut state = FollowingState::default();
        let mut places = Vec::new();
        for scan in 1..100_000 {
            let spindle = SpindlePlace {
                distance_mm: speed_mm_s * settings.scan_period_s * f64::from(scan) - before_mm,
                speed_mm_s,
            };
            settings.follow(&mut state, &spindle);
            places.push((state.distance_mm, spindle.distance_mm));
            if settings.is_done(&state) {
                return places;
            }
        }
        panic!("it never ends");
    }

    #[test]
    fn it_stands_until_it_can_meet_the_spindle_and_is_then_in_step_to_the_run_out() {
        let speed_mm_s = 25.0;
        let places = pass(&SETTINGS, 5.0, speed_mm_s);
        let run_in_mm = SETTINGS.run_in_mm(speed_mm_s);
        assert!((run_in_mm - 0.209).abs() < 1e-3, "{run_in_mm}");
        let begins = places.iter().find(|(at, _)| *at > 0.0).unwrap();
        // It is seen to move up to two scans later.
        assert!((begins.1 + run_in_mm).abs() < 0.05, "{begins:?}");
        let run_out_mm = SETTINGS.run_out_mm(speed_mm_s);
        // The last millionth of the way is met exponentially.
        let inside = |at: f64| at > 3.0 * run_in_mm + 0.5 && at < 20.0 - run_out_mm;
        let off = places.iter().filter(|(at, _)| inside(*at));
        let worst = off.map(|(at, spindle)| (at - spindle).abs());
        assert!(worst.fold(0.0, f64::max) < 1e-6);
        assert_eq!(places.last().unwrap().0, 20.0);
    }

    #[test]
    fn passes_at_any_speed_lie_on_the_same_line() {
        for speed_mm_s in [0.5, 5.0, 25.0, 60.0] {
            for (at, spindle) in pass(&SETTINGS, 7.0, speed_mm_s) {
                if (10.0..18.0).contains(&at) {
                    assert!((at - spindle).abs() < 1e-6, "{speed_mm_s}: {at} {spindle}");
                }
            }
        }
    }

    #[test]
    fn what_is_no_number_brings_it_to_rest() {
        let mut state = FollowingState {
            distance_mm: 3.0,
            speed_mm_s: 20.0,
        };
        let nan = SpindlePlace {
            distance_mm: f64::NAN,
            speed_mm_s: 10.0,
        };
        for _ in 0..20 {
            SETTINGS.follow(&mut state, &nan);
        }
        assert!(state.is_at_rest() && state.distance_mm < 3.3, "{state:?}");
    }

    proptest! {
        /// Whatever the spindle does, also jumps: acceleration, speed and both ends are kept, and braking stops anywhere.
        #[test]
        fn no_spindle_makes_it_break_a_limit(
            asked in prop::collection::vec((-30.0..60.0f64, -150.0..150.0f64), 1..400),
            acceleration_mm_s2 in 50.0..5000.0f64,
        ) {
            let settings = FollowingSettings { acceleration_mm_s2, ..SETTINGS };
            let most_mm_s = acceleration_mm_s2 * 1e-3 * (1.0 + 1e-9) + 1e-7;
            let mut state = FollowingState::default();
            let judge = |before: &FollowingState, state: &FollowingState| {
                let way_mm = state.distance_mm - before.distance_mm;
                prop_assert!((way_mm / 1e-3 - state.speed_mm_s).abs() < 1e-6);
                prop_assert!((state.speed_mm_s - before.speed_mm_s).abs() <= most_mm_s, "{before:?} {state:?}");
                prop_assert!((0.0..=100.0).contains(&state.speed_mm_s));
                prop_assert!((0.0..=20.0).contains(&state.distance_mm));
                Ok(())
            };
            for (distance_mm, speed_mm_s) in asked {
                let before = state;
                settings.follow(&mut state, &SpindlePlace { distance_mm, speed_mm_s });
                judge(&before, &state)?;
                let mut braking = state;
                for _ in 0..2100 {
                    let before = braking;
                    settings.brake(&mut braking);
                    judge(&before, &braking)?;
                }
                prop_assert!(braking.is_at_rest());
            }
        }

        /// A motion of its own goes to the end and stands there.
        #[test]
        fn it_ends_at_the_end(speed_mm_s in 0.1..200.0f64, length_mm in 0.0001..30.0f64) {
            let settings = FollowingSettings { length_mm, ..SETTINGS };
            let mut state = FollowingState::default();
            let scans = (0..400_000).find(|_| {
                settings.go(&mut state, speed_mm_s);
                settings.is_done(&state)
            });
            prop_assert!(scans.is_some(), "{state:?}");
            prop_assert_eq!(state.distance_mm, length_mm);
        }
    }
}
