//! The path speed from which a window's braking setpoints bring the tool to rest.
//!
//! While braking, the speed `w` is passed on a segment whose cap is at least `w`; so with `A(w)` the least acceleration that is left at `w` on
//! all those that can be passed meanwhile, braking from `v` takes at most ∫₀ᵛ dw/A(w). Where that is short enough, nothing is to be done.
//!
//! Elsewhere the motions that brake to rest are followed backward from the places where they end: two of them never cross, so where the time
//! of one is used up, and of the next, is the highest speed between, unless a cap is met before.

use std::ops::Range;

use crate::segment::{Acceleration, Segment};

/// Steps of speed in which the time to brake is added up.
const STEPS: usize = 32;
/// Segments that are looked at together.
const GROUP: usize = 64;
/// Of the braking time, kept for what lies between two places of rest.
const MARGIN: f64 = 0.04;
/// The nearest place of rest behind the start of a segment, in mm.
const NEAREST_MM: f64 = 0.001;
/// The way of the braking time at full speed, in spacings of the places of rest.
const SPACINGS: f64 = 256.0;
/// Where braking from the highest speed takes more than this share of the braking time, places of rest are as dense as that speed asks for: a slow
/// place on which little is left may be short, and still take long to rest on.
const DENSE_SHARE: f64 = 0.02;

/// What is left at least on some segments, by the speed.
#[derive(Debug, Clone)]
struct Least {
    /// Of those that can be as fast as a step, where the speed does not matter.
    constant_mm_s2: [f64; STEPS],
    /// Of the others, at each step.
    falling_mm_s2: [f64; STEPS],
}

impl Least {
    const NONE: Self = Self {
        constant_mm_s2: [f64::INFINITY; STEPS],
        falling_mm_s2: [f64::INFINITY; STEPS],
    };

    /// Adds what is left on a segment at each speed.
    fn add(&mut self, segment: &Segment, cap_mm_s: f64, step_mm_s: f64) {
        if segment.acceleration.steepest_per_mm() <= 0.0 {
            return self.add_least(segment, cap_mm_s, step_mm_s);
        }
        let top = (libm::floor(cap_mm_s / step_mm_s) as usize).min(STEPS - 1);
        for (index, least) in self.falling_mm_s2.iter_mut().take(top + 1).enumerate() {
            let speed_mm_s = cap_mm_s.min((index + 1) as f64 * step_mm_s);
            *least = least.min(segment.acceleration.at_mm_s2(speed_mm_s * speed_mm_s));
        }
    }

    /// Adds what is left on a segment at every speed.
    fn add_least(&mut self, segment: &Segment, cap_mm_s: f64, step_mm_s: f64) {
        let top = (libm::floor(cap_mm_s / step_mm_s) as usize).min(STEPS - 1);
        if let Some(least) = self.constant_mm_s2.get_mut(top) {
            let left_mm_s2 = segment.acceleration.at_mm_s2(cap_mm_s * cap_mm_s);
            *least = least.min(left_mm_s2);
        }
    }

    /// The speed from which braking takes no longer; none if it takes less from all.
    fn safe_mm_s(&self, step_mm_s: f64, braking_time_s: f64) -> Option<f64> {
        let mut least_mm_s2 = self.falling_mm_s2;
        let mut least_above = f64::INFINITY;
        let of_steps = least_mm_s2.iter_mut().zip(&self.constant_mm_s2);
        for (least, constant) in of_steps.rev() {
            least_above = least_above.min(*constant);
            *least = least.min(least_above);
        }
        let (mut time_s, mut speed_mm_s) = (0.0, 0.0);
        for least in least_mm_s2 {
            let step_time_s = step_mm_s / least;
            if time_s + step_time_s > braking_time_s {
                return Some(speed_mm_s + (braking_time_s - time_s) * least);
            }
            time_s += step_time_s;
            speed_mm_s += step_mm_s;
        }
        None
    }
}

/// The speed from which braking surely takes no longer, on each group of the first `own` segments; none where it does from no speed.
fn safe_mm_s(
    segments: &[Segment],
    own: usize,
    override_max: f64,
    step_mm_s: f64,
    braking_time_s: f64,
    scan_period_s: f64,
) -> Vec<Option<f64>> {
    let mut safe_mm_s = vec![None; own.div_ceil(GROUP)];
    // Of all that is ahead, from the end on.
    let mut least = Least::NONE;
    let mut falls = false;
    for (index, group) in segments.chunks(GROUP).enumerate().rev() {
        for segment in group.iter().filter(|segment| !segment.is_dwell) {
            falls |= segment.acceleration.steepest_per_mm() > 0.0;
            least.add(segment, segment.cap_mm_s(override_max), step_mm_s);
        }
        if let Some(of_group) = safe_mm_s.get_mut(index) {
            let kept_s = if falls { scan_period_s } else { 0.0 };
            *of_group = least.safe_mm_s(step_mm_s, braking_time_s - kept_s);
        }
    }
    safe_mm_s
}

/// Segments that are followed as one: as long as a spacing, or one that is longer. What is left on it is left on each of them.
#[derive(Debug, Clone)]
struct Stretch {
    segments: Range<usize>,
    length_mm: f64,
    acceleration: Acceleration,
    /// Where it begins, and the lowest and the highest of all.
    first_cap_mm_s: f64,
    lowest_cap_mm_s: f64,
    highest_cap_mm_s: f64,
    /// The motion rests at its beginning.
    rests_before: bool,
    /// Between places of rest on it.
    spacing_mm: f64,
}

/// How far places of rest on a segment are apart.
fn spacing_mm(segment: &Segment, cap_mm_s: f64, fastest_mm_s: f64, braking_time_s: f64) -> f64 {
    let left_mm_s2 = segment.acceleration.at_mm_s2(cap_mm_s * cap_mm_s);
    let is_dense = cap_mm_s > DENSE_SHARE * braking_time_s * left_mm_s2;
    let speed_mm_s = if is_dense { cap_mm_s } else { fastest_mm_s };
    speed_mm_s * braking_time_s / SPACINGS
}

fn stretches(
    segments: &[Segment],
    override_max: f64,
    fastest_mm_s: f64,
    braking_time_s: f64,
) -> Vec<Stretch> {
    let mut stretches: Vec<Stretch> = Vec::new();
    let mut before: Option<&Segment> = None;
    for (index, segment) in segments.iter().enumerate() {
        let rests = before.is_none_or(|before| before.is_dwell || before.rests_before(segment));
        before = Some(segment);
        if segment.is_dwell {
            continue;
        }
        let length_mm = segment.to_mm - segment.from_mm;
        let cap_mm_s = segment.cap_mm_s(override_max);
        let spacing_mm = spacing_mm(segment, cap_mm_s, fastest_mm_s, braking_time_s);
        let joins = |last: &&mut Stretch| {
            !rests && last.length_mm + length_mm <= last.spacing_mm.min(spacing_mm)
        };
        match stretches.last_mut().filter(joins) {
            Some(last) => {
                last.spacing_mm = last.spacing_mm.min(spacing_mm);
                last.segments.end = index + 1;
                last.length_mm += length_mm;
                last.acceleration = last.acceleration.least_of(&segment.acceleration);
                last.lowest_cap_mm_s = last.lowest_cap_mm_s.min(cap_mm_s);
                last.highest_cap_mm_s = last.highest_cap_mm_s.max(cap_mm_s);
            }
            None => stretches.push(Stretch {
                segments: index..index + 1,
                length_mm,
                acceleration: segment.acceleration,
                first_cap_mm_s: cap_mm_s,
                lowest_cap_mm_s: cap_mm_s,
                highest_cap_mm_s: cap_mm_s,
                rests_before: rests,
                spacing_mm,
            }),
        }
    }
    stretches
}

/// Where a motion began that has braked for the whole time, and its speed there; none where a cap or a rest is met before.
#[derive(Debug, Clone, Copy)]
struct Begin {
    stretch: usize,
    speed_mm_s: Option<f64>,
    /// A cap was met.
    is_over: bool,
}

/// Follows backward the motion that comes to rest on a stretch, so many mm from its beginning.
fn begin_of(stretches: &[Stretch], rest: (usize, f64), braking_time_s: f64) -> Begin {
    let (mut index, mut length_mm) = rest;
    let (mut squared, mut end_mm_s, mut left_s) = (0.0f64, 0.0f64, braking_time_s);
    let nowhere = |stretch, is_over| Begin {
        stretch,
        speed_mm_s: None,
        is_over,
    };
    loop {
        let Some(stretch) = stretches.get(index) else {
            return nowhere(index, false);
        };
        let begin = stretch.acceleration.reached_mm2_s2(squared, length_mm);
        let begin_mm_s = begin.sqrt();
        let time_s = 2.0 * length_mm / (begin_mm_s + end_mm_s);
        if time_s >= left_s {
            let speed_mm_s = end_mm_s + stretch.acceleration.at_mm_s2(begin) * left_s;
            return Begin {
                stretch: index,
                speed_mm_s: Some(speed_mm_s).filter(|of| *of <= stretch.highest_cap_mm_s),
                is_over: false,
            };
        }
        // It is this fast where it begins, and nowhere on it slower than at its end.
        let is_over = begin_mm_s > stretch.first_cap_mm_s || end_mm_s > stretch.lowest_cap_mm_s;
        let Some(before) = index
            .checked_sub(1)
            .filter(|_| !is_over && !stretch.rests_before)
        else {
            return nowhere(index, is_over);
        };
        (squared, end_mm_s) = (begin, begin_mm_s);
        (left_s, index) = (left_s - time_s, before);
        length_mm = stretches.get(before).map_or(0.0, |of| of.length_mm);
    }
}

/// The places of rest on a stretch that are looked at, in mm from its beginning, in order: the end of a short one; on a long one twice as far each,
/// but no farther than the spacing.
fn rests(stretch: &Stretch) -> impl Iterator<Item = f64> + use<> {
    let (length_mm, spacing_mm) = (stretch.length_mm, stretch.spacing_mm);
    let nearest_mm = if length_mm <= spacing_mm {
        length_mm
    } else {
        NEAREST_MM.min(spacing_mm)
    };
    let first_mm = (length_mm > 0.0).then_some(nearest_mm.min(length_mm));
    std::iter::successors(first_mm, move |at_mm| {
        let next_mm = (2.0 * at_mm).min(at_mm + spacing_mm).min(length_mm);
        (next_mm > *at_mm).then_some(next_mm)
    })
}

/// The highest speed of each of the first `own` segments from which braking takes no longer, where that is known; infinite elsewhere.
fn limits_mm_s(stretches: &[Stretch], own: Range<usize>, braking_time_s: f64) -> Vec<f64> {
    let mut limits_mm_s = vec![f64::INFINITY; own.end];
    let first = stretches.partition_point(|of| of.segments.end <= own.start);
    let mut last = Begin {
        stretch: first,
        speed_mm_s: None,
        is_over: false,
    };
    for (index, stretch) in stretches.iter().enumerate().skip(first) {
        for length_mm in rests(stretch) {
            let begin = begin_of(stretches, (index, length_mm), braking_time_s);
            let of_both = [last, begin].into_iter().filter_map(|of| of.speed_mm_s);
            let limit_mm_s = of_both.fold(f64::INFINITY, f64::min);
            let (from, to) = (
                last.stretch.min(begin.stretch),
                last.stretch.max(begin.stretch),
            );
            let between = stretches.get(from..=to).unwrap_or(&[]);
            if let (Some(from), Some(to)) = (between.first(), between.last()) {
                let (from, to) = (
                    from.segments.start.min(own.end),
                    to.segments.end.min(own.end),
                );
                let of_segments = limits_mm_s.get_mut(from..to).unwrap_or(&mut []);
                of_segments
                    .iter_mut()
                    .for_each(|of| *of = of.min(limit_mm_s));
            }
            last = begin;
            // From here on it is the same to the end of the stretch.
            if begin.stretch == index && (begin.speed_mm_s.is_some() || begin.is_over) {
                break;
            }
        }
        let passed = stretches.get(last.stretch);
        if passed.is_some_and(|of| of.segments.start >= own.end) {
            break;
        }
    }
    limits_mm_s
}

/// Limits the speed of the first `own` of these segments to that from which braking to rest takes `braking_time_s`; the lowest of these
/// limits, none where none is needed.
///
/// The tool brakes with what is left at the beginning of each scan and segment. Followed backward, it is segment by segment; the sum over
/// speeds knows of none, so there, where what is left depends on the speed, a scan is kept.
pub(crate) fn limit_by_braking(
    segments: &mut [Segment],
    own: usize,
    override_max: f64,
    braking_time_s: f64,
    scan_period_s: f64,
) -> Option<f64> {
    let caps = segments.iter().map(|of| of.cap_mm_s(override_max));
    let fastest_mm_s = caps.fold(0.0, f64::max);
    if fastest_mm_s <= 0.0 {
        return None;
    }
    let step_mm_s = fastest_mm_s / STEPS as f64;
    let mut least = Least::NONE;
    for segment in segments.iter().filter(|segment| !segment.is_dwell) {
        least.add_least(segment, segment.cap_mm_s(override_max), step_mm_s);
    }
    least.safe_mm_s(step_mm_s, braking_time_s - scan_period_s)?;
    let safe = safe_mm_s(
        segments,
        own,
        override_max,
        step_mm_s,
        braking_time_s,
        scan_period_s,
    );
    let first = safe.iter().position(Option::is_some)? * GROUP;
    let shorter_s = braking_time_s * (1.0 - MARGIN);
    let stretches = stretches(segments, override_max, fastest_mm_s, braking_time_s);
    let limits_mm_s = limits_mm_s(&stretches, first..own, shorter_s);
    let mut lowest_mm_s: Option<f64> = None;
    for (index, (segment, limit_mm_s)) in segments.iter_mut().zip(limits_mm_s).enumerate() {
        let Some(safe_mm_s) = safe.get(index / GROUP).copied().flatten() else {
            continue;
        };
        let limit_mm_s = safe_mm_s.max(limit_mm_s);
        if limit_mm_s < segment.cap_mm_s(override_max) {
            segment.speed_mm_s = limit_mm_s;
            lowest_mm_s = Some(lowest_mm_s.map_or(limit_mm_s, |lowest| lowest.min(limit_mm_s)));
        }
    }
    lowest_mm_s
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SCAN_S: f64 = 1e-3;

    fn segment(from_mm: f64, of: &(f64, f64, f64, f64)) -> Segment {
        let (length_mm, bearable, share, speed_mm_s) = *of;
        // The higher the share, the less is left at the segment's own speed.
        let left = |at_mm_s: f64| bearable * (1.0 - share * (at_mm_s / speed_mm_s).powi(2));
        Segment {
            from_mm,
            to_mm: from_mm + length_mm,
            speed_mm_s,
            feed_mm_s: speed_mm_s,
            acceleration: Acceleration::below(speed_mm_s, left),
            ..Segment::default()
        }
    }

    /// Lowers each speed to what can be braked from before what comes next.
    fn keep_what_is_ahead(segments: &mut [Segment]) {
        let mut ahead = 0.0f64;
        for segment in segments.iter_mut().rev() {
            let highest = segment.highest_mm2_s2(ahead, segment.speed_mm_s);
            segment.speed_mm_s = highest.sqrt();
            ahead = highest;
        }
    }

    /// Time to brake to rest from a place on a segment, as fast as is left.
    fn braking_s(segments: &[Segment], index: usize, share: f64, mut squared: f64) -> f64 {
        let mut time_s = 0.0;
        let mut share_left = share;
        for segment in segments.iter().skip(index) {
            let length_mm = (segment.to_mm - segment.from_mm) * share_left;
            share_left = 1.0;
            // As the tool goes: scan by scan, and not beyond the segment.
            let mut left_mm = length_mm;
            while left_mm > 0.0 {
                let speed_mm_s = squared.sqrt();
                let acceleration = segment.acceleration.at_mm_s2(squared);
                let after_mm_s = speed_mm_s - acceleration * SCAN_S;
                let way_mm = 0.5 * (speed_mm_s + after_mm_s) * SCAN_S;
                if after_mm_s > 0.0 && way_mm < left_mm {
                    (squared, left_mm) = (after_mm_s * after_mm_s, left_mm - way_mm);
                    time_s += SCAN_S;
                    continue;
                }
                let end = squared - 2.0 * acceleration * left_mm;
                if end <= 0.0 {
                    return time_s + speed_mm_s / acceleration;
                }
                time_s += 2.0 * left_mm / (speed_mm_s + end.sqrt());
                squared = end;
                break;
            }
        }
        time_s
    }

    proptest! {
        #[test]
        fn from_every_place_braking_takes_no_longer_than_it_may(
            of in prop::collection::vec((0.001..3.0f64, 200.0..5000.0f64, 0.0..0.95f64, 5.0..200.0f64), 2..300),
            straight_mm in 0.01..50.0f64,
            braking_time_s in 0.005..0.25f64,
            share in 0.0..1.0f64,
        ) {
            let mut segments = vec![segment(0.0, &(straight_mm, 1000.0, 0.0, 200.0))];
            for of in &of {
                let from_mm = segments.last().unwrap().to_mm;
                segments.push(segment(from_mm, of));
            }
            keep_what_is_ahead(&mut segments);
            let own = segments.len();
            limit_by_braking(&mut segments, own, 1.0, braking_time_s, SCAN_S);
            for (index, segment) in segments.iter().enumerate() {
                let ahead = segments.get(index + 1).map_or(0.0, |next| next.speed_mm_s);
                let length_mm = (segment.to_mm - segment.from_mm) * share;
                let highest = segment.acceleration.reached_mm2_s2(ahead * ahead, length_mm);
                let squared = highest.min(segment.speed_mm_s * segment.speed_mm_s);
                let time_s = braking_s(&segments, index, share, squared);
                // Windows keep a row for what lies between the places of rest.
                prop_assert!(
                    time_s <= braking_time_s + 0.5 * SCAN_S,
                    "segment {index} of {own}: {time_s} of {braking_time_s} s"
                );
            }
        }
    }
}
