//! Smooth motion along the path: the average of a motion that runs ahead of it.
//!
//! A *lead* travels the path as fast as speeds and accelerations allow, as without smoothing. The tool is where the average of the lead's place
//! over the last `τ` lies, a whole number of scans. With `s` the lead's place, its speed and its acceleration are averages too, and its jerk is
//!
//! ```text
//! (a(t) − a(t − τ)) / τ       at most 2·a/τ
//! ```
//!
//! The average is taken along the path, so the tool is on the path exactly; the lead rests for `τ` wherever the tool is to rest, so it does. A
//! vibration of the machine of the period `τ`, or a whole part of it, is not excited by a motion along a straight line: the average over
//! its period is zero. *Sources:* averages as filters of setpoints that limit jerk and notch vibration: Biagiotti, Melchiorri, *FIR filters for
//! online trajectory planning with time- and frequency-domain specifications*, Control Engineering Practice 20, 2012; taking the average along the
//! path instead of for each axis, and the rule below, are our own.
//!
//! **What the lead keeps.** The tool is behind the lead; what holds at a place `p` of the path for speed and acceleration must hold when the *tool*
//! is there. It does if the lead keeps it wherever it is within `V(p)·τ/2` of `p` along the path, where `V(p)` is the highest speed at `p`. For let the
//! lead enter that zone at `t₀` and leave it at `t₁`. At `t₀ + τ` it is no further than at `V(p)` from its start, so the average is at most `p`; at `t₁`
//! it is at least `p`. So when the tool is at `p`, the lead was in the zone all the time over which the average is taken. [`spread`] gives each place
//! of the path the lowest limits of all zones that it lies in. Nothing spreads across a rest.
use std::ops::Range;

use crate::path_part::PathPart;
use crate::path_state::PathState;
use crate::segment::{Acceleration, Segment};

/// Scans that a zone is longer on either side: setpoints are samples, and differences reach over some of them.
const MARGIN_SCANS: f64 = 1.5;
/// A zone may be longer by this share of its half length rather than cut a segment.
const GRAIN: f64 = 0.05;
/// Limits may hold this much further than into the neighbouring block, in mm, so that where that has no length the tool still moves.
const BESIDE_MM: f64 = 1e-6;
/// A long segment is cut into so many pieces where it may be braked on.
const BRAKING_CUTS: u32 = 8;

/// For how long at its highest speed a place's limits hold to either side, in s; 0 without smoothing.
pub(crate) fn reach_s(smoothing_scans: u32, scan_period_s: f64) -> f64 {
    match smoothing_scans {
        0 => 0.0,
        scans => (0.5 * f64::from(scans) + MARGIN_SCANS) * scan_period_s,
    }
}

/// What the tool follows: a motion along the path that keeps speeds and accelerations.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Lead {
    /// Where it is.
    pub state: PathState,
    /// The same, as the length of the path before it, in mm.
    pub along_mm: f64,
}

impl Lead {
    pub(crate) fn at(part: &PathPart, state: &PathState) -> Lead {
        Lead {
            state: *state,
            along_mm: part.length_before_mm(state.element) + state.distance_mm,
        }
    }
}

/// Places of the lead are kept in units of 2⁻³⁶ mm, so that a sum of them has no rounding and does not depend on where it began.
const UNITS_PER_MM: f64 = (1u64 << 36) as f64;

/// Where the lead was in the last scans, and the average of that: of straight lines between the places, so the first and the last count half.
#[derive(Debug, Clone)]
pub(crate) struct Trail {
    scans: u32,
    /// One more than scans, in a ring.
    places: Vec<i64>,
    /// The first of them; the one before it in the ring is now.
    first: usize,
    last_place: i64,
    /// Twice the sum of all but the first and the last, and those once.
    sum: i128,
    /// The same a scan before.
    sum_before: i128,
}

impl Trail {
    /// Allocates all that it needs.
    pub fn new(scans: u32) -> Self {
        Self {
            scans,
            places: vec![0; scans as usize + 1],
            first: 0,
            last_place: 0,
            sum: 0,
            sum_before: 0,
        }
    }

    /// The lead has been at a place for long.
    pub fn rest_at(&mut self, along_mm: f64) {
        let place = units(along_mm);
        self.places.fill(place);
        self.last_place = place;
        self.sum = i128::from(place) * 2 * i128::from(self.scans);
        self.sum_before = self.sum;
    }

    /// The lead was at these places one scan after the other, and has rested at the first of them before if there are too few.
    pub fn follow(&mut self, leads: &[Lead]) {
        let Some(first) = leads.len().checked_sub(self.scans as usize + 1) else {
            self.rest_at(leads.first().map_or(0.0, |lead| lead.along_mm));
            return leads.iter().for_each(|lead| self.push(lead.along_mm));
        };
        let last = leads.get(first..).unwrap_or_default();
        self.rest_at(0.0);
        last.iter().for_each(|lead| self.push(lead.along_mm));
    }

    /// A scan later.
    pub fn push(&mut self, along_mm: f64) {
        if self.scans == 0 {
            return;
        }
        let place = units(along_mm);
        self.sum_before = self.sum;
        let before = self.last_place;
        let Some(first) = self.places.get_mut(self.first) else {
            return;
        };
        let gone = std::mem::replace(first, place);
        self.last_place = place;
        self.first += 1;
        if self.first == self.places.len() {
            self.first = 0;
        }
        // The first counts once and goes, the second counts once now; the last counts twice now, the new one once.
        let [more, less] = [[before, place], [gone, self.first_place()]].map(|ends| {
            let [one, other] = ends.map(i128::from);
            one + other
        });
        self.sum += more - less;
    }

    fn first_place(&self) -> i64 {
        self.places.get(self.first).copied().unwrap_or(0)
    }

    /// Whether the lead has been at one place all the time.
    pub fn is_settled(&self) -> bool {
        // Places never go back.
        self.scans == 0 || self.first_place() == self.last_place
    }

    /// Length of the path before the tool, in mm.
    pub fn average_mm(&self) -> f64 {
        self.mm(self.sum)
    }

    /// Its speed in the last scan, in mm/s.
    pub fn speed_mm_s(&self, scan_period_s: f64) -> f64 {
        self.mm(self.sum - self.sum_before) / scan_period_s
    }

    fn mm(&self, sum: i128) -> f64 {
        let sum = i64::try_from(sum).map_or_else(|_| of_wide(sum), |sum| sum as f64);
        sum / (2.0 * f64::from(self.scans.max(1))) / UNITS_PER_MM
    }
}

/// What narrower numbers do not hold, behind hundreds of metres: the same number, more slowly.
#[cold]
#[inline(never)]
fn of_wide(sum: i128) -> f64 {
    sum as f64
}

/// Rounded down.
fn units(along_mm: f64) -> i64 {
    let units = along_mm * UNITS_PER_MM;
    let cut = units as i64;
    cut.saturating_sub(i64::from(cut as f64 > units))
}

/// A segment where it lies on the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placed {
    pub segment: Segment,
    /// Length of the path before its element, in mm.
    pub start_mm: f64,
}

impl Placed {
    fn begin_mm(&self) -> f64 {
        self.start_mm + self.segment.from_mm
    }

    fn end_mm(&self) -> f64 {
        self.start_mm + self.segment.to_mm
    }

    fn limits(&self, override_max: f64) -> Limits {
        Limits {
            speed_mm_s: self.segment.speed_mm_s,
            feed_mm_s: self.segment.feed_mm_s,
            cap_mm_s: self.segment.cap_mm_s(override_max),
            acceleration: self.segment.acceleration,
        }
    }
}

/// Segments whose zones are taken for one: short ones behind each other, about as fast.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Source {
    /// Of those it was made of.
    segments: std::ops::Range<usize>,
    first: Segment,
    last: Segment,
    begin_mm: f64,
    end_mm: f64,
    /// Half of what its zone is longer than itself.
    reach_mm: f64,
    /// The lowest of all.
    limits: Limits,
}

impl Source {
    fn of(index: usize, placed: &Placed, reach_s: f64, override_max: f64) -> Self {
        Self {
            segments: index..index + 1,
            first: placed.segment,
            last: placed.segment,
            begin_mm: placed.begin_mm(),
            end_mm: placed.end_mm(),
            reach_mm: placed.segment.cap_mm_s(override_max) * reach_s,
            limits: placed.limits(override_max),
        }
    }

    /// Takes the next in, if it is near and alike.
    fn takes(&mut self, next: &Source) -> bool {
        let unlike = (self.reach_mm - next.reach_mm).abs();
        let grain_mm = GRAIN * self.reach_mm.min(next.reach_mm);
        if rests_between(&self.last, &next.first)
            || next.end_mm - self.begin_mm > grain_mm
            || unlike > grain_mm
        {
            return false;
        }
        self.segments.end = next.segments.end;
        self.last = next.last;
        self.end_mm = next.end_mm;
        self.reach_mm = self.reach_mm.max(next.reach_mm);
        self.limits = self.limits.least_of(&next.limits);
        true
    }

    /// The last element that it was made of.
    pub fn last_element(&self) -> u32 {
        self.last.element
    }

    /// Up to where it may have a part in what holds, in mm along the path.
    pub fn reaches_to_mm(&self) -> f64 {
        self.end_mm + self.reach_mm
    }
}

/// Adds a segment to `kept`, no faster anywhere than that its zone lies within this stretch of the path: near its ends in pieces, each as fast as its far end.
pub(crate) fn keep_within(
    placed: Placed,
    beside_mm: &Range<f64>,
    (reach_s, override_max): (f64, f64),
    kept: &mut Vec<Placed>,
) {
    let mut left = placed;
    let behind_mm = |from_mm: f64| (from_mm - beside_mm.start).max(BESIDE_MM);
    let ahead_mm = |to_mm: f64| (beside_mm.end - to_mm).max(BESIDE_MM);
    let zone_mm = placed.segment.cap_mm_s(override_max) * reach_s;
    loop {
        let (from_mm, to_mm) = (left.begin_mm(), left.end_mm());
        let mut cut_mm = to_mm;
        if behind_mm(from_mm) < zone_mm {
            cut_mm = cut_mm.min(from_mm + behind_mm(from_mm));
        }
        if ahead_mm(to_mm) < zone_mm {
            let half_mm = 0.5 * ahead_mm(from_mm);
            cut_mm = cut_mm.min((from_mm + half_mm).max(beside_mm.end - zone_mm));
        }
        let on_element_mm = cut_mm - left.start_mm;
        let is_inside = left.segment.from_mm < on_element_mm && on_element_mm < left.segment.to_mm;
        let end_mm = if is_inside { cut_mm } else { to_mm };
        let room_mm = behind_mm(from_mm).min(ahead_mm(end_mm));
        let mut piece = left;
        if room_mm < zone_mm {
            piece.segment.speed_mm_s = piece.segment.speed_mm_s.min(room_mm / reach_s);
        }
        if !is_inside {
            kept.push(piece);
            return;
        }
        piece.segment.to_mm = on_element_mm;
        piece.segment.ends_block = false;
        left.segment.from_mm = on_element_mm;
        left.segment.rests_at_start = false;
        kept.push(piece);
    }
}

/// The segments as sources of limits. Which are taken together depends on where these begin.
pub(crate) fn sources(placed: &[Placed], reach_s: f64, override_max: f64) -> Vec<Source> {
    let mut sources: Vec<Source> = Vec::new();
    for (index, placed) in placed.iter().enumerate() {
        let source = Source::of(index, placed, reach_s, override_max);
        let last = sources.last_mut();
        if !last.is_some_and(|last| last.takes(&source)) {
            sources.push(source);
        }
    }
    sources
}

/// What holds on a stretch of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Limits {
    speed_mm_s: f64,
    feed_mm_s: f64,
    /// The lower of both at the highest override, in mm/s.
    cap_mm_s: f64,
    /// Holds up to that speed.
    acceleration: Acceleration,
}

impl Limits {
    const NONE: Limits = Limits {
        speed_mm_s: f64::INFINITY,
        feed_mm_s: f64::INFINITY,
        cap_mm_s: f64::INFINITY,
        acceleration: Acceleration::NONE,
    };

    fn least_of(&self, other: &Limits) -> Limits {
        if *self == Limits::NONE || self == other {
            return *other;
        }
        if *other == Limits::NONE {
            return *self;
        }
        let cap_mm_s = self.cap_mm_s.min(other.cap_mm_s);
        Limits {
            speed_mm_s: self.speed_mm_s.min(other.speed_mm_s),
            feed_mm_s: self.feed_mm_s.min(other.feed_mm_s),
            cap_mm_s,
            acceleration: self.acceleration.least_up_to(&other.acceleration, cap_mm_s),
        }
    }

    /// Whether these are lower in anything than others.
    fn lowers(&self, others: &Limits) -> bool {
        let squared = others.cap_mm_s * others.cap_mm_s;
        self.speed_mm_s < others.speed_mm_s
            || self.feed_mm_s < others.feed_mm_s
            || [0.0, 0.5, 1.0].iter().any(|share| {
                let [own, of_others] =
                    [self, others].map(|of| of.acceleration.at_mm_s2(share * squared));
                own < of_others
            })
    }
}

/// Limits of stretches one behind the other, lowered for ranges of them.
struct Lowered {
    /// A tree: the children of `n` are `2n` and `2n + 1`, the stretches its leaves. What is in a node holds for all below it.
    nodes: Vec<Limits>,
    count: usize,
}

impl Lowered {
    fn new(count: usize) -> Self {
        Self {
            nodes: vec![Limits::NONE; 2 * count],
            count,
        }
    }

    fn lower_at(&mut self, node: usize, limits: &Limits) {
        if let Some(of_node) = self.nodes.get_mut(node) {
            *of_node = of_node.least_of(limits);
        }
    }

    fn lower(&mut self, range: std::ops::Range<usize>, limits: &Limits) {
        let (mut from, mut to) = (range.start + self.count, range.end + self.count);
        while from < to {
            if from % 2 == 1 {
                self.lower_at(from, limits);
                from += 1;
            }
            if to % 2 == 1 {
                to -= 1;
                self.lower_at(to, limits);
            }
            (from, to) = (from / 2, to / 2);
        }
    }

    fn leaves(mut self) -> Vec<Limits> {
        for node in 1..self.count {
            if let Some(limits) = self.nodes.get(node).copied() {
                self.lower_at(2 * node, &limits);
                self.lower_at(2 * node + 1, &limits);
            }
        }
        self.nodes.split_off(self.count)
    }
}

/// A stretch of one of the segments, on the path.
struct Cell {
    of: usize,
    from_mm: f64,
    to_mm: f64,
}

/// The segments `placed` with the lowest limits of all zones that they lie in, cut where those change. `own` of the sources are theirs; those to either
/// side must be given as far as their zones reach, or the path begins and ends there.
pub(crate) fn spread(
    placed: &[Placed],
    sources: &[&Source],
    own: std::ops::Range<usize>,
    reach_s: f64,
    override_max: f64,
) -> Vec<Segment> {
    let mut segments = Vec::with_capacity(2 * placed.len());
    let mut from = 0;
    while from < sources.len() {
        let rests = |pair: &[&Source]| match pair {
            [before, after] => rests_between(&before.last, &after.first),
            _ => true,
        };
        let run = sources.get(from..).unwrap_or_default();
        let length = run.windows(2).take_while(|pair| !rests(pair)).count() + 1;
        let until = (from + length).min(sources.len());
        let own_of_run = sources.get(own.start.max(from)..own.end.min(until));
        if let Some([first, .., last] | [first @ last]) = own_of_run {
            let run = Run {
                sources: sources.get(from..until).unwrap_or_default(),
                own: placed
                    .get(first.segments.start..last.segments.end)
                    .unwrap_or_default(),
                reach_s,
                override_max,
            };
            run.spread(&mut segments);
        }
        from = until;
    }
    segments
}

fn rests_between(before: &Segment, after: &Segment) -> bool {
    before.is_dwell || after.is_dwell || before.rests_before(after)
}

/// [`slice::partition_point`] where it is near one that is known.
fn partition_near<T>(mut at: usize, all: &[T], is_before: impl Fn(&T) -> bool) -> usize {
    while all.get(at).is_some_and(&is_before) {
        at += 1;
    }
    while all.get(at.wrapping_sub(1)).is_some_and(|of| !is_before(of)) {
        at -= 1;
    }
    at
}

/// Segments with no rest between them.
struct Run<'a> {
    sources: &'a [&'a Source],
    own: &'a [Placed],
    reach_s: f64,
    override_max: f64,
}

impl Run<'_> {
    fn spread(&self, segments: &mut Vec<Segment>) {
        if let ([Placed { segment, .. }], [_]) = (self.own, self.sources) {
            return segments.push(*segment);
        }
        let cells = self.cells();
        let mut lowered = Lowered::new(cells.len());
        let (mut first, mut end) = (0, 0);
        for of in self.sources {
            let (begins_mm, ends_mm) = (of.begin_mm - of.reach_mm, of.end_mm + of.reach_mm);
            first = partition_near(first, &cells, |cell| cell.to_mm <= begins_mm);
            end = partition_near(end, &cells, |cell| cell.from_mm < ends_mm);
            lowered.lower(first..end.max(first), &of.limits);
        }
        for (cell, limits) in cells.iter().zip(lowered.leaves()) {
            let Some(Placed { segment, start_mm }) = self.own.get(cell.of) else {
                continue;
            };
            let begins = cell.from_mm <= start_mm + segment.from_mm;
            let ends = cell.to_mm >= start_mm + segment.to_mm;
            let from_mm = match segments.last() {
                Some(last) if !begins => last.to_mm,
                _ => segment.from_mm,
            };
            let to_mm = if ends {
                segment.to_mm
            } else {
                cell.to_mm - start_mm
            };
            segments.push(Segment {
                from_mm,
                to_mm,
                speed_mm_s: limits.speed_mm_s,
                feed_mm_s: limits.feed_mm_s,
                acceleration: limits.acceleration,
                ends_block: segment.ends_block && ends,
                rests_at_start: segment.rests_at_start && begins,
                ..*segment
            });
        }
    }

    /// Its own segments, cut where the zones of others begin and end on them.
    fn cells(&self) -> Vec<Cell> {
        let own = self.own;
        let mut cuts_mm: Vec<f64> = Vec::new();
        let lowers = |of: &Source, on: &Placed| of.limits.lowers(&on.limits(self.override_max));
        let (mut first, mut last) = (0, 0);
        for of in self.sources {
            let grain_mm = GRAIN * of.reach_mm;
            let begins_mm = of.begin_mm - of.reach_mm;
            first = partition_near(first, own, |on| on.end_mm() <= begins_mm);
            let on = own.get(first);
            let cuts = |on: &&Placed| {
                begins_mm - on.begin_mm() > grain_mm && begins_mm < on.end_mm() && lowers(of, on)
            };
            cuts_mm.extend(on.filter(cuts).map(|_| begins_mm));
            let ends_mm = of.end_mm + of.reach_mm;
            last = partition_near(last, own, |on| on.end_mm() < ends_mm);
            let on = own.get(last);
            let cuts = |on: &&Placed| {
                on.end_mm() - ends_mm > grain_mm && ends_mm > on.begin_mm() && lowers(of, on)
            };
            cuts_mm.extend(on.filter(cuts).map(|_| ends_mm));
        }
        for on in own {
            cuts_mm.extend(self.braking_cuts_mm(on));
        }
        cuts_mm.sort_by(f64::total_cmp);
        let mut cuts_mm = cuts_mm.into_iter().peekable();
        let mut cells = Vec::with_capacity(own.len());
        for (of, on) in own.iter().enumerate() {
            let (mut from_mm, end_mm) = (on.begin_mm(), on.end_mm());
            while let Some(cut_mm) = cuts_mm.next_if(|cut_mm| *cut_mm < end_mm) {
                // As places on the element they must differ too.
                let is_inside = cut_mm - on.start_mm > (from_mm - on.start_mm)
                    && cut_mm - on.start_mm < on.segment.to_mm;
                if cut_mm > from_mm && is_inside {
                    cells.push(Cell {
                        of,
                        from_mm,
                        to_mm: cut_mm,
                    });
                    from_mm = cut_mm;
                }
            }
            cells.push(Cell {
                of,
                from_mm,
                to_mm: end_mm,
            });
        }
        cells
    }

    /// Where a long segment is cut so that what can be braked from within a window, which is less and less towards a slow place behind it, does
    /// not limit all of it: where some shares of its speed could be braked from to rest at its end.
    fn braking_cuts_mm(&self, on: &Placed) -> impl Iterator<Item = f64> {
        let to_mm = on.end_mm();
        let cap_mm_s = on.segment.cap_mm_s(self.override_max);
        let twice_mm_s2 = 2.0 * on.segment.acceleration.at_mm_s2(0.0);
        let shortest_mm = cap_mm_s * self.reach_s;
        let from_mm = on.begin_mm();
        (1..BRAKING_CUTS)
            .map(move |cut| {
                let speed_mm_s = cap_mm_s * f64::from(cut) / f64::from(BRAKING_CUTS);
                to_mm - speed_mm_s * speed_mm_s / twice_mm_s2
            })
            .filter(move |cut_mm| to_mm - from_mm > shortest_mm && *cut_mm > from_mm)
    }
}
