//! Motion along a path, one scan at a time: the fastest within the speed map, or braking.
//!
//! Inside a scan the motion is followed exactly, phase by phase of constant acceleration: speed up, keep the cap, brake
//! along the envelope. Single rapids may follow a profile of least heat instead (`positioning`). Where a scan ends has no
//! influence on the motion, and the state at the end of a scan is all that the next scan depends on. So two plans that
//! share a state share everything after it, to the bit.
use crate::envelope::{Envelope, EnvelopeKey};
use crate::limits::MotionLimits;
pub use crate::path_state::PathState;
use crate::positioning::Profile;
use crate::segment::Segment;
use crate::speed_map::SpeedMap;

/// Distances below this are none: some ulps of the distance along an element of 10 m. Worth a hundred-thousandth of an
/// increment of 1 nm, and the impulse of stopping that much early is within the rounding allowance of the limits.
const NEGLIGIBLE_MM: f64 = 2e-11;
/// Relative excess of a speed over a cap that is rounding.
const NEGLIGIBLE_EXCESS: f64 = 1e-12;

/// Ends of moves this near in time are reached: some millionths of a scan. The impulse of stopping that much early is within
/// the rounding allowance of the limits.
const ARRIVAL_S: f64 = 1e-9;
/// Longer than any motion takes between two waits: three years, in s.
const FOR_EVER_S: f64 = 1e8;
/// Halvings of a scan until a meeting of two motions is known to the last bits.
const MEETING_STEPS: u32 = 48;

/// When the motion has met the profile, in s: halved between now and `latest_s`, when it surely has.
fn meeting_time_s(latest_s: f64, has_met: impl Fn(f64) -> bool) -> f64 {
    let (mut before_s, mut time_s) = (0.0, latest_s);
    for _ in 0..MEETING_STEPS {
        let middle_s = 0.5 * (before_s + time_s);
        if has_met(middle_s) {
            time_s = middle_s;
        } else {
            before_s = middle_s;
        }
    }
    time_s
}

/// One phase of constant acceleration, at most to the end of its segment.
struct Phase {
    end_speed_mm_s: f64,
    length_mm: f64,
    /// Whether it ends at the end of the segment.
    to_the_end: bool,
}

/// Path, map and state during one scan.
pub(crate) struct Traveller<'a> {
    map: &'a SpeedMap,
    scan_period_s: f64,
    /// Scans that the tool comes after the state.
    smoothing_scans: u32,
    pub state: PathState,
    segment: usize,
    /// The first element that is not begun yet.
    until_element: u32,
    /// It has come to a place that is not mapped yet.
    pub ran_short: bool,
}

impl<'a> Traveller<'a> {
    pub fn new(
        map: &'a SpeedMap,
        limits: &MotionLimits,
        state: PathState,
        until_element: u32,
    ) -> Self {
        Self {
            map,
            scan_period_s: limits.scan_period_s(),
            smoothing_scans: limits.smoothing_scans(),
            state,
            segment: map.segment_at(state.element, state.distance_mm),
            until_element,
            ran_short: false,
        }
    }

    /// Whether it is at the place that it is not to go beyond. The map rests there.
    pub fn is_held_back(&self) -> bool {
        let mut segment = self.map.segment(self.segment);
        let waited = |on: &&Segment| on.is_dwell && on.element == self.state.element;
        if segment.filter(waited).is_some() && self.state.dwell_remaining_scans == 0 {
            segment = self.map.segment(self.segment + 1);
        }
        match segment {
            Some(segment) => segment.element >= self.until_element,
            None => self.map.is_complete() && self.until_element != u32::MAX,
        }
    }

    /// Whether everything is done.
    pub fn is_at_end(&self) -> bool {
        self.map.is_complete() && self.segment >= self.map.segment_end() && self.state.is_at_rest()
    }

    /// One scan of intended motion.
    pub fn go(&mut self, envelope: &mut Envelope) {
        if self.state.waits_for_start || self.is_held_back() {
            return;
        }
        let EnvelopeKey {
            feed_override,
            single_block,
            ..
        } = envelope.key;
        if feed_override <= 0.0 {
            return self.brake();
        }
        if self.state.settling_scans > 0 {
            self.state.settling_scans -= 1;
            return;
        }
        if self.wait(single_block) {
            return;
        }
        self.begin_next();
        let mut left_s = self.scan_period_s;
        self.travel(envelope, &mut left_s);
    }

    /// Time to the end of the path, in s, as fast as [`Traveller::go`] goes but not scan by scan.
    pub fn time_to_end_s(&mut self, envelope: &mut Envelope) -> f64 {
        let mut time_s = 0.0;
        while !(self.is_at_end() || self.ran_short || self.state.waits_for_start) {
            let waits = self.state.dwell_remaining_scans + self.state.settling_scans;
            time_s += f64::from(waits) * self.scan_period_s;
            (self.state.dwell_remaining_scans, self.state.settling_scans) = (0, 0);
            let before = (self.segment, self.state);
            if !self.wait(false) {
                self.begin_next();
                let mut left_s = FOR_EVER_S;
                self.travel(envelope, &mut left_s);
                time_s += FOR_EVER_S - left_s;
            }
            if waits == 0 && before == (self.segment, self.state) {
                break;
            }
        }
        time_s + f64::from(self.smoothing_scans) * self.scan_period_s
    }

    /// Moves on for so long, up to the next wait; what is left of the time then.
    fn travel(&mut self, envelope: &mut Envelope, left_s: &mut f64) {
        let key = envelope.key;
        let single_block = key.single_block;
        // At most four phases on a segment, and each segment once.
        let phases_max = 4 * self.map.segment_end().saturating_sub(self.segment) + 4;
        for _ in 0..phases_max {
            let Some(segment) = self.map.segment(self.segment) else {
                return self.stop_at_the_end();
            };
            if segment.is_dwell {
                return self.arrive_at_dwell(segment);
            }
            // A rapid at an override of 0 brakes as a feed does.
            let share = key.share(segment);
            let of_move = self.map.profile_of(segment).filter(|_| share > 0.0);
            let to_the_end = if let Some(profile) = of_move {
                if !self.follow_move(segment, profile, share, left_s) {
                    return;
                }
                true
            } else {
                let end_squared = envelope.squared_mm2_s2(self.map, self.segment + 1);
                let phase = self.phase(segment, end_squared, segment.cap_mm_s(share));
                if !self.follow(segment, &phase, left_s) {
                    return;
                }
                phase.to_the_end
            };
            if to_the_end {
                self.enter_next();
                if self.is_held_back() {
                    self.stay_at_the_end_of(segment);
                    self.state.speed_mm_s = 0.0;
                    return;
                }
                if single_block && segment.ends_block && self.state.is_at_rest() {
                    self.stay_at_the_end_of(segment);
                    self.state.waits_for_start = true;
                    return;
                }
                if self.smoothing_scans > 0 && self.is_to_settle_behind(segment) {
                    self.stay_at_the_end_of(segment);
                    self.state.settling_scans = self.smoothing_scans;
                    return;
                }
            }
        }
    }

    /// Whether the tool is to rest between this segment, at whose end the state is, and the one that is entered.
    fn is_to_settle_behind(&self, segment: &Segment) -> bool {
        let next = self.map.segment(self.segment);
        self.state.is_at_rest()
            && next.is_some_and(|next| !next.is_dwell && segment.rests_before(next))
    }

    /// At rest at the end of an element, the motion goes on at the start of the next.
    fn begin_next(&mut self) {
        if let Some(segment) = self.map.segment(self.segment)
            && !segment.is_dwell
            && segment.element != self.state.element
        {
            self.state.element = segment.element;
            self.state.distance_mm = segment.from_mm;
        }
    }

    /// One scan of braking, within the limits and along the path, to rest.
    pub fn brake(&mut self) {
        let mut left_s = self.scan_period_s;
        while self.state.speed_mm_s > 0.0 {
            let Some(segment) = self.map.segment(self.segment) else {
                return self.stop_at_the_end();
            };
            if segment.is_dwell {
                // Arrived without a speed but for rounding. The wait begins when the motion goes on.
                self.state.speed_mm_s = 0.0;
                return;
            }
            let phase = braking(segment, self.state.distance_mm, self.state.speed_mm_s, 0.0);
            if !self.follow(segment, &phase, &mut left_s) {
                return;
            }
            if phase.to_the_end {
                self.enter_next();
                let next = self.map.segment(self.segment);
                if next.is_none_or(|next| next.is_dwell || segment.rests_before(next)) {
                    self.stay_at_the_end_of(segment);
                    self.state.speed_mm_s = 0.0;
                }
            }
        }
    }

    /// Waits a scan if a dwell is not over. Whether the scan is used up.
    fn wait(&mut self, single_block: bool) -> bool {
        let Some(segment) = self.map.segment(self.segment) else {
            return false;
        };
        if !segment.is_dwell || self.state.element != segment.element {
            return false;
        }
        if self.state.dwell_remaining_scans > 0 {
            self.state.dwell_remaining_scans -= 1;
            self.state.waits_for_start =
                self.state.dwell_remaining_scans == 0 && single_block && segment.ends_block;
            return true;
        }
        self.enter_next();
        false
    }

    fn arrive_at_dwell(&mut self, dwell: &Segment) {
        self.state.element = dwell.element;
        self.state.distance_mm = 0.0;
        self.state.speed_mm_s = 0.0;
        // It begins when the tool is there.
        self.state.dwell_remaining_scans = dwell.dwell_scans + self.smoothing_scans;
    }

    /// Puts the state at the start of the next segment; at the end of the path it stays where it is.
    fn enter_next(&mut self) {
        self.segment += 1;
        match self.map.segment(self.segment) {
            Some(next) if !next.is_dwell => {
                self.state.element = next.element;
                self.state.distance_mm = next.from_mm;
            }
            Some(_) => {}
            None => self.stop_at_the_end(),
        }
    }

    /// Nothing more is mapped: the path ends here, or is not known yet.
    fn stop_at_the_end(&mut self) {
        self.ran_short |= !self.map.is_complete();
        self.state.speed_mm_s = 0.0;
    }

    fn stay_at_the_end_of(&mut self, segment: &Segment) {
        self.state.element = segment.element;
        self.state.distance_mm = segment.to_mm;
    }

    /// Moves along a phase for as long as the scan lasts. Whether the phase was finished.
    fn follow(&mut self, segment: &Segment, phase: &Phase, left_s: &mut f64) -> bool {
        let state = &mut self.state;
        // Only a phase that ends there reaches the end, so that a state names one segment.
        let inside_mm = segment.to_mm.next_down();
        let sum_mm_s = state.speed_mm_s + phase.end_speed_mm_s;
        let time_s = if phase.length_mm <= 0.0 {
            0.0
        } else {
            2.0 * phase.length_mm / sum_mm_s
        };
        if time_s <= *left_s {
            *left_s -= time_s;
            state.speed_mm_s = phase.end_speed_mm_s;
            state.distance_mm = if phase.to_the_end {
                segment.to_mm
            } else {
                (state.distance_mm + phase.length_mm).min(inside_mm)
            };
            return true;
        }
        // Standing still under a cap of 0 takes for ever: time_s is infinite, nothing changes.
        let gain_mm_s = (phase.end_speed_mm_s - state.speed_mm_s) / time_s * *left_s;
        let way_mm = (state.speed_mm_s + 0.5 * gain_mm_s) * *left_s;
        state.distance_mm = (state.distance_mm + way_mm).min(inside_mm);
        state.speed_mm_s = (state.speed_mm_s + gain_mm_s).max(0.0);
        *left_s = 0.0;
        false
    }

    /// Moves along a rapid at least heat for as long as the scan lasts. Whether its end was reached.
    ///
    /// The profile is a speed for each place. At an override below 1 it is the same motion in slow motion. Whoever is below
    /// that speed (after a hold, or a change of the override) speeds up at the limit until it is met, whoever is above it
    /// brakes at the limit; either way the motion depends on place and speed alone. Nobody is ever faster than the profile
    /// at 100 %, from which everything ahead can be kept.
    fn follow_move(
        &mut self,
        segment: &Segment,
        profile: &Profile,
        feed_override: f64,
        left_s: &mut f64,
    ) -> bool {
        let pace = feed_override.min(1.0);
        let inside_mm = segment.to_mm.next_down();
        // Up to the profile, along it to the end, and once more for rounding.
        for _ in 0..3 {
            let (at_mm, speed_mm_s) = (self.state.distance_mm, self.state.speed_mm_s);
            let acceleration_mm_s2 = segment.least_acceleration_mm_s2();
            let twice_mm_s2 = 2.0 * acceleration_mm_s2;
            let squared = speed_mm_s * speed_mm_s;
            let tolerance = twice_mm_s2 * NEGLIGIBLE_MM + NEGLIGIBLE_EXCESS * squared;
            if segment.to_mm - at_mm <= NEGLIGIBLE_MM {
                self.arrive_at_rest(segment);
                return true;
            }
            let nominal_mm_s = pace * profile.velocity_at_mm_s(at_mm);
            let off = squared - nominal_mm_s * nominal_mm_s;
            if off.abs() <= tolerance {
                let time_s = profile.time_at_s(at_mm) / pace + *left_s;
                let over_s = time_s - profile.travel_time_s / pace;
                if over_s >= -ARRIVAL_S {
                    *left_s = over_s.clamp(0.0, *left_s);
                    self.arrive_at_rest(segment);
                    return true;
                }
                let (distance_mm, velocity_mm_s) = profile.at(time_s * pace);
                // Rounding never takes it back.
                self.state.distance_mm = distance_mm.max(at_mm).min(inside_mm);
                self.state.speed_mm_s = pace * velocity_mm_s;
                *left_s = 0.0;
                return false;
            }
            let toward_mm_s2 = if off < 0.0 {
                acceleration_mm_s2
            } else {
                -acceleration_mm_s2
            };
            // Place and speed after a time at the limit.
            let after = |time_s: f64| {
                (
                    at_mm + (speed_mm_s + 0.5 * toward_mm_s2 * time_s) * time_s,
                    speed_mm_s + toward_mm_s2 * time_s,
                )
            };
            let has_met = |time_s: f64| {
                let (place_mm, speed_mm_s) = after(time_s);
                let nominal_mm_s = pace * profile.velocity_at_mm_s(place_mm);
                (speed_mm_s - nominal_mm_s) * toward_mm_s2 >= 0.0
            };
            let met = has_met(*left_s);
            let time_s = if met {
                meeting_time_s(*left_s, has_met)
            } else {
                *left_s
            };
            let (place_mm, end_mm_s) = after(time_s);
            self.state.distance_mm = place_mm.max(at_mm).min(inside_mm);
            self.state.speed_mm_s = end_mm_s.max(0.0);
            *left_s -= time_s;
            if !met {
                return false;
            }
            // The meeting place is on the profile but for the last bits, which must not decide what comes next.
            self.state.speed_mm_s = pace * profile.velocity_at_mm_s(self.state.distance_mm);
        }
        false
    }

    fn arrive_at_rest(&mut self, segment: &Segment) {
        self.state.distance_mm = segment.to_mm;
        self.state.speed_mm_s = 0.0;
    }

    /// What to do now on a segment: brake down to the cap or the envelope, follow the envelope, speed up, or keep the cap.
    ///
    /// Each way the acceleration is one that is left at the highest speed of the phase, and the same wherever on it a scan ends: the
    /// envelope's for braking; for speeding up, what is left at the speed that the end of the segment is reached at if nothing ends it before.
    fn phase(&self, segment: &Segment, end_squared: f64, cap_mm_s: f64) -> Phase {
        let (at_mm, speed_mm_s) = (self.state.distance_mm, self.state.speed_mm_s);
        let left_mm = segment.to_mm - at_mm;
        let squared = speed_mm_s * speed_mm_s;
        let highest = segment.highest_mm2_s2(end_squared, cap_mm_s);
        let twice_mm_s2 = 2.0 * segment.acceleration.at_mm_s2(highest);
        let reached = segment.acceleration.reached_mm2_s2(squared, left_mm);
        let twice_up_mm_s2 = 2.0 * segment.acceleration.at_mm_s2(reached.min(highest));
        let end_mm_s = end_squared.sqrt();
        let tolerance = twice_mm_s2 * NEGLIGIBLE_MM + NEGLIGIBLE_EXCESS * squared;
        if left_mm <= NEGLIGIBLE_MM {
            return Phase {
                end_speed_mm_s: if squared > end_squared + 2.0 * tolerance {
                    speed_mm_s
                } else {
                    speed_mm_s.min(end_mm_s)
                },
                length_mm: 0.0,
                to_the_end: true,
            };
        }
        if speed_mm_s > cap_mm_s * (1.0 + NEGLIGIBLE_EXCESS) {
            return braking(segment, at_mm, speed_mm_s, cap_mm_s);
        }
        let allowed = end_squared + twice_mm_s2 * left_mm;
        if squared > allowed + tolerance {
            return braking(segment, at_mm, speed_mm_s, 0.0);
        }
        if squared >= allowed - tolerance {
            return Phase {
                end_speed_mm_s: end_mm_s,
                length_mm: left_mm,
                to_the_end: true,
            };
        }
        if speed_mm_s >= cap_mm_s {
            let until_braking_mm = (allowed - squared) / twice_mm_s2;
            let to_the_end = until_braking_mm >= left_mm;
            return Phase {
                end_speed_mm_s: speed_mm_s,
                length_mm: until_braking_mm.min(left_mm),
                to_the_end,
            };
        }
        let to_cap_mm = (cap_mm_s * cap_mm_s - squared) / twice_up_mm_s2;
        let to_braking_mm = (allowed - squared) / (twice_up_mm_s2 + twice_mm_s2);
        let length_mm = to_cap_mm.min(to_braking_mm).min(left_mm);
        Phase {
            end_speed_mm_s: if length_mm == to_cap_mm {
                cap_mm_s
            } else {
                (squared + twice_up_mm_s2 * length_mm).sqrt()
            },
            length_mm,
            to_the_end: length_mm >= left_mm,
        }
    }
}

/// Braking on a segment down to a speed, or to its end.
fn braking(segment: &Segment, at_mm: f64, speed_mm_s: f64, down_to_mm_s: f64) -> Phase {
    let left_mm = (segment.to_mm - at_mm).max(0.0);
    let squared = speed_mm_s * speed_mm_s;
    let twice_mm_s2 = 2.0 * segment.acceleration.at_mm_s2(squared);
    let needed_mm = (squared - down_to_mm_s * down_to_mm_s) / twice_mm_s2;
    if needed_mm <= left_mm {
        Phase {
            end_speed_mm_s: down_to_mm_s,
            length_mm: needed_mm,
            to_the_end: false,
        }
    } else {
        Phase {
            end_speed_mm_s: (squared - twice_mm_s2 * left_mm).max(0.0).sqrt(),
            length_mm: left_mm,
            to_the_end: true,
        }
    }
}
