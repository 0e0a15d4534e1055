//! The speed map: where along a path how fast it may be travelled and how hard sped up and braked.
//!
//! Limits are judged on setpoints one scan period `Tp` apart. The second difference of setpoints over `Tp²` is the acceleration of
//! the continuous motion averaged under a triangle of half width `Tp` (weight `w(τ) = (1 − |τ|/Tp)/Tp`). So a motion whose
//! continuous acceleration, impulses included, stays within the limit *on that average* stays within it at every scan,
//! wherever the scans fall. Per axis `i`, with tangent `t`, curvature `κ` and path speed `v`:
//!
//! ```text
//! |t_i|·a + |κ_i|·v²                         on lines and arcs
//! v·|Δt_i| · δ(time of crossing)             at a junction where the tangent jumps by Δt
//! ```
//!
//! Where the axes are not the program's (`kinematics`), t and κ are the derivatives of the axes along the path of the tool;
//! their bounds over an element stand for them on the whole of it.
//!
//! How speed and acceleration are shared out between the two is `course`'s business.
//!
//! The map depends on path and limits only. Override scales the feed of its segments (rapids too), never what the axes
//! can bear.
//!
//! # In blocks
//!
//! A path may be longer than what is at hand of it. The map is made in blocks of elements, each when as much of the path is known as has a part
//! in it: the zones that reach into it from both sides (`course`), and what is passed while braking from it. Blocks begin at fixed
//! numbers of elements, so a map that is begun in the middle of the path is the same as one that was begun at its start, to the bit.
//!
//! # No more than so many elements
//!
//! However short its elements are, the motion on a block depends on [`LOOK_AHEAD_ELEMENTS`] ahead of it at most. Where more would have a part in it, the speed is lower, not the
//! knowledge missing:
//!
//! - From every place of a block the tool can rest before the end of the block that is `BRAKING_BLOCKS` behind it (`envelope`).
//! - Where motion along the path is smoothed, no place is so fast that its limits hold further than into the neighbouring block (`smoothing`).
//! - A block takes no less time than reading as many elements does.

use std::collections::VecDeque;
use std::ops::Range;

use crate::braking_limit::limit_by_braking;
use crate::course::{Course, margin_mm};
use crate::geometry::Path;
use crate::limits::MotionLimits;
pub use crate::path_part::BLOCK_ELEMENTS;
use crate::path_part::{Laid, PathPart};
use crate::positioning::{Move, Positioning, Profile, rapids};
use crate::rounding::REACH_ELEMENTS;
pub use crate::segment::MapError;
use crate::segment::Segment;
use crate::smoothing::{self, Placed, Source};

/// The most elements to either side that are looked at for zones that reach into a block: chords of less than a thousandth of the way of a
/// scan are not told from smooth curves.
pub const MARGIN_ELEMENTS: u32 = 4096;
/// The most blocks ahead of one that are passed while braking from it.
const BRAKING_BLOCKS: u32 = 3;
/// The most blocks to either side of one that its limits hold on where motion along the path is smoothed.
const ZONE_BLOCKS: u32 = 1;
/// The most elements ahead of the first one of a window that its motion depends on, as long as it does not leave the block of that element.
pub const LOOK_AHEAD_ELEMENTS: u32 =
    (1 + 2 * BRAKING_BLOCKS + ZONE_BLOCKS) * BLOCK_ELEMENTS + MARGIN_ELEMENTS + REACH_ELEMENTS;
const _: () = assert!(ZONE_BLOCKS * BLOCK_ELEMENTS <= MARGIN_ELEMENTS);

/// What the map must provide for, besides the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSettings {
    /// Highest override that will be asked for; 1 is the programmed feed.
    pub override_max: f64,
    /// Most setpoints a window has for braking to rest.
    pub braking_setpoints_max: u32,
    /// Most elements that are passed in a second, on an average over each block.
    pub elements_per_s_max: f64,
}

impl MapSettings {
    /// The override as it is obeyed.
    pub(crate) fn override_max(&self) -> f64 {
        if self.override_max > 0.0 {
            self.override_max.min(1e3)
        } else {
            1.0
        }
    }
}

/// Elements as they and their neighbours leave them: others may be near enough for the lead to keep their limits here (`smoothing`).
#[derive(Debug, Clone, PartialEq)]
struct LaidBlock {
    end: u32,
    end_mm: f64,
    placed: Vec<Placed>,
    sources: Vec<Source>,
}

/// A block with the limits that hold there: what is ahead may lower its speeds yet.
#[derive(Debug, Clone, PartialEq)]
struct Block {
    /// The element behind it.
    end: u32,
    /// Where the path is at its end, in mm.
    end_mm: f64,
    segments: Vec<Segment>,
}

/// Speed limits along a path, as far as it is mapped.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedMap {
    settings: MapSettings,
    positioning: Option<Positioning>,
    /// Blocks whose limits do not hold beside them yet where the lead is to keep them.
    laid: VecDeque<LaidBlock>,
    /// Of blocks before them, as far as their limits reach.
    behind: Vec<Source>,
    /// Blocks that are not done.
    blocks: VecDeque<Block>,
    /// The first element of the next block.
    next_block: u32,
    segments: VecDeque<Segment>,
    /// Segments that were let go.
    pub(crate) first_segment: usize,
    moves: Vec<Move>,
    /// Moves that were let go.
    first_move: usize,
    limited_by_window_mm_s: Option<f64>,
    /// The lowest path speed that reading keeps up with, of the blocks where the path would have gone faster.
    pub(crate) limited_by_reading_mm_s: Option<f64>,
    /// Up to here every element has its segments.
    done_to: u32,
    complete: bool,
}

impl SpeedMap {
    /// Maps a whole path; takes time and memory in proportion to its elements.
    pub fn new(
        path: &Path,
        limits: &MotionLimits,
        settings: &MapSettings,
    ) -> Result<Self, MapError> {
        let part = PathPart::whole(path, limits, settings.override_max())?;
        let mut map = Self::empty(settings, None, 0);
        map.extend(&part);
        Ok(map)
    }

    /// A map of nothing yet, for a part of a path that begins with the element `first`. It can be mapped from the first block on that has all of
    /// its margin; single rapids from rest to rest at least heat, where `positioning` is given.
    pub(crate) fn empty(
        settings: &MapSettings,
        positioning: Option<&Positioning>,
        first: u32,
    ) -> Self {
        Self {
            settings: *settings,
            positioning: positioning.copied(),
            laid: VecDeque::new(),
            behind: Vec::new(),
            blocks: VecDeque::new(),
            next_block: first_mapped(first),
            segments: VecDeque::new(),
            first_segment: 0,
            moves: Vec::new(),
            first_move: 0,
            limited_by_window_mm_s: None,
            limited_by_reading_mm_s: None,
            done_to: first_mapped(first),
            complete: false,
        }
    }

    /// Maps what can be mapped now.
    pub(crate) fn extend(&mut self, part: &PathPart) {
        while self.lay_out_block(part) {}
        while self.spread_block(part) {}
        while self.finish_block(part) {}
        self.complete = self.is_laid_out(part) && self.blocks.is_empty();
    }

    /// Whether every block to the end of the path has its limits.
    fn is_laid_out(&self, part: &PathPart) -> bool {
        part.is_complete() && self.next_block >= part.end() && self.laid.is_empty()
    }

    /// Lays out the next block, if all that has a part in it is at hand.
    fn lay_out_block(&mut self, part: &PathPart) -> bool {
        let from = self.next_block;
        let to = from.saturating_add(BLOCK_ELEMENTS).min(part.ready);
        if from >= to || (to - from < BLOCK_ELEMENTS && !part.is_complete()) {
            return false;
        }
        let scan_period_s = part.limits().scan_period_s();
        let Some(range) = with_margins(part, from..to, scan_period_s) else {
            return false;
        };
        let mut course = Course::new(part, range, self.override_max(), self.positioning.is_some());
        course.share_among_junctions();
        let mut segments = course.segments();
        let behind = segments.partition_point(|segment| segment.element < to);
        segments.truncate(behind);
        let before = segments.partition_point(|segment| segment.element < from);
        segments.drain(..before);
        if to - from == BLOCK_ELEMENTS {
            let length_mm = part.length_before_mm(to) - part.length_before_mm(from);
            self.limit_by_reading(length_mm / f64::from(BLOCK_ELEMENTS), &mut segments);
        }
        self.next_block = to;
        if part.limits().smoothing_scans() > 0 {
            self.lay(part, from..to, segments);
        } else {
            self.blocks.push_back(Block {
                end: to,
                end_mm: part.length_before_mm(to),
                segments,
            });
        }
        true
    }

    /// Lowers the speed on the segments of a block to that at which reading keeps up with elements that are so long on an average.
    fn limit_by_reading(&mut self, element_mm: f64, segments: &mut [Segment]) {
        let read_mm_s = element_mm * self.settings.elements_per_s_max;
        let override_max = self.override_max();
        let is_faster = |of: &&mut Segment| of.cap_mm_s(override_max) > read_mm_s;
        for segment in segments.iter_mut().filter(is_faster) {
            segment.speed_mm_s = read_mm_s;
            let before_mm_s = self.limited_by_reading_mm_s.unwrap_or(f64::INFINITY);
            self.limited_by_reading_mm_s = Some(before_mm_s.min(read_mm_s));
        }
    }

    /// Adds a block whose limits are yet to hold beside it, no further than into the blocks beside it.
    fn lay(&mut self, part: &PathPart, block: Range<u32>, segments: Vec<Segment>) {
        let limits = part.limits();
        let reach_s = smoothing::reach_s(limits.smoothing_scans(), limits.scan_period_s());
        let fastest_mm_s = part.plan_limits.fastest_mm_s();
        let override_max = self.override_max();
        let beside_mm = beside_mm(part, &block);
        let mut placed: Vec<Placed> = Vec::with_capacity(segments.len());
        for segment in segments {
            let of_part = Placed {
                start_mm: part.length_before_mm(segment.element),
                segment: Segment {
                    speed_mm_s: segment.speed_mm_s.min(fastest_mm_s),
                    ..segment
                },
            };
            smoothing::keep_within(of_part, &beside_mm, (reach_s, override_max), &mut placed);
        }
        self.laid.push_back(LaidBlock {
            end: block.end,
            end_mm: part.length_before_mm(block.end),
            sources: smoothing::sources(&placed, reach_s, override_max),
            placed,
        });
    }

    /// Gives the first block that is laid out the limits that hold near it, if all of them are known.
    fn spread_block(&mut self, part: &PathPart) -> bool {
        let Some(block) = self.laid.front() else {
            return false;
        };
        let limits = part.limits();
        let reach_s = smoothing::reach_s(limits.smoothing_scans(), limits.scan_period_s());
        let reach_mm = part.plan_limits.fastest_mm_s() * reach_s;
        let until_mm = block.end_mm + reach_mm;
        let all = part.is_complete() && self.next_block >= part.end();
        let reaches = |of: &LaidBlock| {
            of.end_mm >= until_mm || of.end - block.end >= ZONE_BLOCKS * BLOCK_ELEMENTS
        };
        let count = match self.laid.iter().position(reaches) {
            Some(index) => index + 1,
            None if all => self.laid.len(),
            None => return false,
        };
        let own = self.behind.len()..self.behind.len() + block.sources.len();
        let ahead = self.laid.iter().take(count).flat_map(|of| &of.sources);
        let sources: Vec<&Source> = self.behind.iter().chain(ahead).collect();
        let segments = smoothing::spread(
            &block.placed,
            &sources,
            own.clone(),
            reach_s,
            self.override_max(),
        );
        let (end, end_mm) = (block.end, block.end_mm);
        let first = end.saturating_sub(ZONE_BLOCKS * BLOCK_ELEMENTS);
        let is_over = |of: &&&Source| of.reaches_to_mm() < end_mm || of.last_element() < first;
        let behind = sources.iter().take(own.end).skip_while(is_over);
        self.behind = behind.copied().cloned().collect();
        self.blocks.push_back(Block {
            end,
            end_mm,
            segments,
        });
        self.laid.pop_front();
        true
    }

    /// Gives the first block its last limits, if all is laid out that is passed while braking from it.
    fn finish_block(&mut self, part: &PathPart) -> bool {
        let override_max = self.override_max();
        let Some(block) = self.blocks.front() else {
            return false;
        };
        let cap = |segment: &Segment| segment.cap_mm_s(override_max);
        let fastest_mm_s = block.segments.iter().map(cap).fold(0.0, f64::max);
        let braking_time_s =
            f64::from(self.settings.braking_setpoints_max) * part.limits().scan_period_s();
        let (first_end, until_mm) = (block.end, block.end_mm + fastest_mm_s * braking_time_s);
        let reaches = |block: &Block| {
            block.end_mm >= until_mm || block.end - first_end >= BRAKING_BLOCKS * BLOCK_ELEMENTS
        };
        let all = self.is_laid_out(part);
        let count = match self.blocks.iter().position(reaches) {
            Some(index) => index + 1,
            None if all => self.blocks.len(),
            None => return false,
        };
        let ahead = || self.blocks.iter().take(count).flat_map(|of| &of.segments);
        let own = block.segments.len();
        let mut segments: Vec<Segment> = ahead().copied().collect();
        let limit_mm_s = limit_by_braking(
            &mut segments,
            own,
            override_max,
            braking_time_s,
            part.limits().scan_period_s(),
        );
        if let Some(limit_mm_s) = limit_mm_s {
            let before_mm_s = self.limited_by_window_mm_s.unwrap_or(f64::INFINITY);
            self.limited_by_window_mm_s = Some(before_mm_s.min(limit_mm_s));
        }
        if let Some(positioning) = &self.positioning {
            let moves = rapids::assign(
                part,
                positioning,
                override_max,
                &mut segments,
                self.first_move + self.moves.len(),
            );
            let of_block = moves.into_iter().filter(|of| of.element < first_end);
            self.moves.extend(of_block);
        }
        self.segments.extend(segments.into_iter().take(own));
        self.done_to = first_end;
        self.blocks.pop_front();
        true
    }

    /// Lets go of what lies before this element.
    pub(crate) fn forget_before(&mut self, element: u32) {
        let count = self.segments.partition_point(|of| of.element < element);
        self.segments.drain(..count);
        self.first_segment += count;
        let count = self.moves.partition_point(|of| of.element < element);
        self.moves.drain(..count);
        self.first_move += count;
    }

    /// The first element that is needed to go on with the map.
    pub(crate) fn needs_from(&self) -> u32 {
        self.next_block
            .saturating_sub(MARGIN_ELEMENTS + REACH_ELEMENTS)
    }

    /// The lowest path speed above which braking would not fit a window, of the places where the path would have gone faster.
    pub fn speed_limited_by_window_mm_s(&self) -> Option<f64> {
        self.limited_by_window_mm_s
    }

    /// Highest override it provides for.
    pub fn override_max(&self) -> f64 {
        self.settings.override_max()
    }

    /// The rapids at hand that are travelled at least heat, in the order of the path.
    pub fn moves(&self) -> &[Move] {
        &self.moves
    }

    /// The profile that a segment is travelled by, if it is a move of its own.
    pub(crate) fn profile_of(&self, segment: &Segment) -> Option<&Profile> {
        let index = (segment.of_move? as usize).checked_sub(self.first_move)?;
        Some(&self.moves.get(index)?.profile)
    }

    /// How many pieces of constant limits are at hand.
    pub fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// Whether it goes to the end of the path.
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    /// Whether all is there that motion from an element depends on.
    pub(crate) fn is_mapped(&self, element: u32) -> bool {
        self.complete || self.done_to >= rests_by(element)
    }

    /// Where motion that begins on the segment before this border rests at the latest, and the first border that is not on the block of that segment; none
    /// where that is not mapped yet.
    pub(crate) fn horizon(&self, border: usize) -> Option<Horizon> {
        let before = border.saturating_sub(1).max(self.first_segment);
        let last = self.segment(before)?.element;
        if !self.is_mapped(last) {
            return None;
        }
        let first_behind = |element: u32| {
            let behind = self.segments.partition_point(|of| of.element < element);
            self.first_segment + behind
        };
        let rests_at = first_behind(rests_by(last));
        if rests_at == self.segment_end() && self.complete {
            return Some(Horizon {
                rests_at,
                holds_to: rests_at + 1,
                is_end: true,
            });
        }
        let holds_to = first_behind(block_end(last)) + 1;
        // Before the last segment: rounding does not bring the tool beyond it.
        let rests_at = (rests_at - 1).max(holds_to);
        Some(Horizon {
            rests_at,
            holds_to,
            is_end: false,
        })
    }

    /// Index behind the last segment at hand.
    pub(crate) fn segment_end(&self) -> usize {
        self.first_segment + self.segments.len()
    }

    pub(crate) fn segment(&self, index: usize) -> Option<&Segment> {
        self.segments.get(index.checked_sub(self.first_segment)?)
    }

    /// The segment on which the motion from a place goes on: the one that holds the place, the next one at its end.
    /// The one behind the last at the end of the path.
    pub(crate) fn segment_at(&self, element: u32, distance_mm: f64) -> usize {
        let before = |segment: &Segment| {
            segment.element < element
                || (segment.element == element && !segment.is_dwell && segment.to_mm <= distance_mm)
        };
        self.first_segment + self.segments.partition_point(before)
    }
}

/// Length of the path that motion is planned ahead from a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Horizon {
    /// The border at which it rests at the latest.
    pub rests_at: usize,
    /// The border behind the last one that this holds for.
    pub holds_to: usize,
    /// It is the end of the path.
    pub is_end: bool,
}

/// The element behind the block of this one.
fn block_end(element: u32) -> u32 {
    (element / BLOCK_ELEMENTS + 1).saturating_mul(BLOCK_ELEMENTS)
}

/// The element before which the tool can rest from every place on this one.
fn rests_by(element: u32) -> u32 {
    block_end(element).saturating_add(BRAKING_BLOCKS * BLOCK_ELEMENTS)
}

/// From where to where limits of a block may hold, in mm along the path: to the far ends of the blocks beside it. Infinite where the path ends before.
fn beside_mm(part: &PathPart, block: &Range<u32>) -> Range<f64> {
    let reach = ZONE_BLOCKS * BLOCK_ELEMENTS;
    let begin = block.start.checked_sub(reach);
    let end = block.end.saturating_add(reach);
    let is_behind_all = part.is_complete() && end >= part.end();
    Range {
        start: begin.map_or(f64::NEG_INFINITY, |of| part.length_before_mm(of)),
        end: if is_behind_all {
            f64::INFINITY
        } else {
            part.length_before_mm(end)
        },
    }
}

/// The first element that can be mapped where elements from `first` on are at hand.
pub fn first_mapped(first: u32) -> u32 {
    if first == 0 {
        return 0;
    }
    let with_margin = first.saturating_add(MARGIN_ELEMENTS + REACH_ELEMENTS);
    with_margin
        .checked_next_multiple_of(BLOCK_ELEMENTS)
        .unwrap_or(u32::MAX)
}

/// Elements with all those beside them whose zones may reach them; none if not all of these are at hand yet.
fn with_margins(part: &PathPart, block: Range<u32>, scan_period_s: f64) -> Option<Range<u32>> {
    let fastest = |element: u32| part.laid(element).map_or(0.0, |laid| laid.fastest_mm_s);
    let mut margin = Margin {
        fastest_mm_s: block.clone().map(fastest).fold(0.0, f64::max),
        way_mm: 0.0,
        scan_period_s,
    };
    let mut to = block.end;
    // Where blocks beside this one end is to be known.
    let is_end = part.is_complete() && part.end() == part.ready;
    let known = block.end.saturating_add(ZONE_BLOCKS * BLOCK_ELEMENTS);
    if part.limits().smoothing_scans() > 0 && part.ready < known && !is_end {
        return None;
    }
    while to - block.end < MARGIN_ELEMENTS && !(to == part.end() && part.is_complete()) {
        to += 1;
        if to > part.ready {
            return None;
        }
        if margin.is_enough_with(part.laid(to - 1)?) {
            break;
        }
    }
    margin.way_mm = 0.0;
    let mut from = block.start;
    while from > part.first() && block.start - from < MARGIN_ELEMENTS {
        from -= 1;
        if margin.is_enough_with(part.laid(from)?) {
            break;
        }
    }
    Some(from..to)
}

/// Elements beside a block, counted up until their zones reach it no more.
struct Margin {
    fastest_mm_s: f64,
    way_mm: f64,
    scan_period_s: f64,
}

impl Margin {
    fn is_enough_with(&mut self, laid: &Laid) -> bool {
        self.fastest_mm_s = self.fastest_mm_s.max(laid.fastest_mm_s);
        self.way_mm += laid.element.length_mm;
        laid.moves() && self.way_mm > margin_mm(self.fastest_mm_s, self.scan_period_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AxisVector, Element, Feed};
    use crate::limits::AxisLimits;

    const FEED: Feed = Feed::PathMmS(1000.0);
    const SETTINGS: MapSettings = MapSettings {
        override_max: 1.0,
        braking_setpoints_max: 100_000,
        elements_per_s_max: f64::INFINITY,
    };

    fn limits() -> MotionLimits {
        let slide = AxisLimits {
            velocity_mm_s: 300.0,
            acceleration_mm_s2: 2000.0,
            jerk_mm_s3: f64::INFINITY,
            increment_mm: 1e-9,
        };
        MotionLimits::new(&[slide; 2], 1e-3).unwrap()
    }

    fn at(x: f64, y: f64) -> AxisVector {
        let mut vector = AxisVector::zeros();
        vector[0] = x;
        vector[1] = y;
        vector
    }

    fn map(elements: Vec<Element>) -> Result<SpeedMap, MapError> {
        SpeedMap::new(&Path { elements }, &limits(), &SETTINGS)
    }

    #[test]
    fn an_arc_leaves_of_the_acceleration_what_the_speed_on_it_does_not_take() {
        let turn_rad = std::f64::consts::TAU;
        let mut map = map(vec![Element::arc(
            1,
            at(10.0, 0.0),
            at(10.0, 0.0),
            at(0.0, 0.0),
            [0, 1],
            turn_rad,
            FEED,
        )])
        .unwrap();
        let segments = map.segments.make_contiguous();
        assert!(segments.len() > 1, "one piece for all of it");
        for segment in segments {
            assert!((segment.speed_mm_s - 137.84).abs() < 0.01, "{segment:?}");
            for share in [0.0f64, 0.2, 0.5, 0.75, 0.9, 1.0] {
                let squared = share * segment.speed_mm_s * segment.speed_mm_s;
                let across = squared / 10.0;
                let left = segment.acceleration.at_mm_s2(squared);
                let bearable = (2000.0 * 2000.0 - across * across).sqrt();
                assert!(left <= bearable && left > 0.8 * bearable, "{share}: {left}");
            }
        }
    }

    #[test]
    fn a_diagonal_is_faster_than_its_axes() {
        let map = map(vec![Element::line(1, at(0.0, 0.0), at(30.0, 30.0), FEED)]).unwrap();
        let segment = map.segments[0];
        assert!((segment.speed_mm_s - 300.0 * 2f64.sqrt()).abs() < 0.01);
        assert!((segment.least_acceleration_mm_s2() - 2000.0 * 2f64.sqrt()).abs() < 0.1);
    }

    #[test]
    fn a_square_corner_is_crossed_at_its_share_and_a_line_through_points_at_full_speed() {
        let corner = [at(0.0, 0.0), at(30.0, 0.0), at(30.0, 30.0)];
        let straight = [at(0.0, 0.0), at(30.0, 0.0), at(60.0, 0.0)];
        let slowest = |points: [AxisVector; 3]| {
            let [a, b, c] = points;
            let map = map(vec![
                Element::line(1, a, b, FEED),
                Element::line(2, b, c, FEED),
            ])
            .unwrap();
            let speeds = map.segments.iter().map(|segment| segment.speed_mm_s);
            speeds.fold(f64::INFINITY, f64::min)
        };
        // One scan sees ρ·v/Tp of a unit kink and may see 70 % of 2000 mm/s².
        assert!((slowest(corner) - 0.7 * 2000.0 * 1e-3 * 0.9375).abs() < 1e-4);
        assert!((slowest(straight) - 300.0).abs() < 1e-3);
    }

    #[test]
    fn what_cannot_be_travelled_is_refused_with_its_line() {
        let line = |from, to, feed| Element::line(7, from, to, feed);
        let (a, b) = (at(0.0, 0.0), at(5.0, 0.0));
        let mut third = b;
        third[2] = 1.0;
        assert_eq!(map(vec![]), Err(MapError::Empty));
        let off_the_circle = Element::arc(
            7,
            b,
            at(0.0, 5.1),
            a,
            [0, 1],
            std::f64::consts::FRAC_PI_2,
            FEED,
        );
        assert!(matches!(
            map(vec![off_the_circle]),
            Err(MapError::Gap { line: 7, .. })
        ));
        let broken = vec![line(a, b, FEED), line(at(5.0, 1e-3), a, FEED)];
        assert!(matches!(map(broken), Err(MapError::Gap { line: 7, .. })));
        assert_eq!(
            map(vec![line(a, third, FEED)]),
            Err(MapError::NoSuchAxis { line: 7 })
        );
        let no_feed = Feed::PathMmS(0.0);
        assert!(matches!(
            map(vec![line(a, b, no_feed)]),
            Err(MapError::Feed { line: 7, .. })
        ));
        for feed in [Feed::PathMmS(f64::NAN), Feed::PathMmS(f64::INFINITY)] {
            assert_eq!(
                map(vec![line(a, b, feed)]),
                Err(MapError::NotFinite { line: 7 })
            );
        }
    }
}
