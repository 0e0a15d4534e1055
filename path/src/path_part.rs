//! The part of a path that is at hand: what has been read ahead, and a little of what lies behind.
//!
//! Elements keep the numbers that they have on the whole path, and each knows where it lies on it, so that nothing that is made of
//! them depends on where reading began or on how far it has come.
use std::collections::VecDeque;
use std::sync::Arc;

use crate::geometry::{AxisVector, Element, Feed, Path, Shape};
use crate::kinematics::Kinematics;
use crate::limits::MotionLimits;
use crate::rounding::{self, Junctions, REACH_ELEMENTS};
use crate::segment::MapError;
use crate::sharing::{LaidPiece, PlanLimits, Sharing};

/// Elements of a block.
pub const BLOCK_ELEMENTS: u32 = 1024;
/// Gap between elements that the rounding allowance of the limits covers, in increments.
const GAP_INCREMENTS_MAX: f64 = 0.25;

/// One element with what the axes bear on it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Laid {
    pub element: Element,
    /// Length of all elements before it, in mm.
    pub start_mm: f64,
    pub sharing: Sharing,
    /// Its pieces, where it is rounded; none where it is one.
    pub pieces: Vec<LaidPiece>,
    /// What the axes bear, in mm/s; 0 where nothing moves. The highest of its pieces'.
    pub speed_mm_s: f64,
    /// What is asked for at 100 %, in mm/s; for rapids what the axes bear.
    pub feed_mm_s: f64,
    /// The lower of both at the highest override, in mm/s.
    pub fastest_mm_s: f64,
}

impl Laid {
    /// Cuts a rounded element into pieces, each with what the axes bear on it.
    fn cut(&mut self, limits: &PlanLimits, override_max: f64) {
        self.pieces = LaidPiece::of_rounded(&self.element, &self.sharing, limits);
        let speeds = self.pieces.iter().map(|piece| piece.speed_mm_s);
        self.speed_mm_s = speeds.fold(0.0, f64::max);
        self.fastest_mm_s = self.speed_mm_s.min(self.feed_mm_s * override_max);
    }

    /// Whether something moves on it.
    pub fn moves(&self) -> bool {
        self.element.length_mm > 0.0
    }
}

/// Elements in order of travel, by their numbers on the whole path.
#[derive(Debug, Clone, PartialEq)]
pub struct PathPart {
    laid: VecDeque<Laid>,
    /// Where elements meet that are not rounded yet.
    junctions: Junctions,
    first: u32,
    /// Up to here it is known how elements are rounded.
    pub(crate) ready: u32,
    complete: bool,
    /// Length of the path up to the end of what is at hand, in mm.
    length_mm: f64,
    previous_end: Option<AxisVector>,
    limits: MotionLimits,
    pub(crate) plan_limits: PlanLimits,
    override_max: f64,
}

impl PathPart {
    /// Nothing yet of a path that goes on with the element `first`, of which `start_mm` lie before it. `override_max`: the highest
    /// override that is obeyed.
    pub fn new(limits: &MotionLimits, override_max: f64, first: u32, start_mm: f64) -> Self {
        Self {
            laid: VecDeque::new(),
            junctions: Junctions::new(first, limits.axes().len()),
            first,
            ready: first,
            complete: false,
            length_mm: start_mm,
            previous_end: None,
            plan_limits: PlanLimits::of(limits),
            limits: limits.clone(),
            override_max,
        }
    }

    /// A whole path.
    ///
    /// # Errors
    /// [`MapError`]: nothing in it, or an element that cannot be travelled.
    pub fn whole(path: &Path, limits: &MotionLimits, override_max: f64) -> Result<Self, MapError> {
        if path.elements.is_empty() {
            return Err(MapError::Empty);
        }
        let mut part = Self::new(limits, override_max, 0, 0.0);
        part.laid.reserve(path.elements.len());
        for element in &path.elements {
            part.push(element.clone())?;
        }
        part.complete = true;
        part.round_on();
        Ok(part)
    }

    /// Adds the next element.
    ///
    /// # Errors
    /// [`MapError`]: it cannot be travelled; it is not added then.
    pub fn push(&mut self, element: Element) -> Result<(), MapError> {
        if self.end() == u32::MAX {
            return Err(MapError::TooLong(self.end() as usize));
        }
        check_geometry(&element, self.previous_end, &self.limits)?;
        let moves = !element.is_dwell() && element.length_mm > 0.0;
        let sharing = Sharing::of(&element, &self.limits.setpoints().kinematics);
        let speed_mm_s = if moves {
            sharing.speed_mm_s(&self.plan_limits)
        } else {
            0.0
        };
        if !speed_mm_s.is_finite() {
            return Err(MapError::NoSuchAxis { line: element.line });
        }
        let feed_mm_s = match element.feed {
            Feed::Rapid => speed_mm_s,
            Feed::PathMmS(feed_mm_s) => feed_mm_s,
        };
        self.previous_end = Some(element.end());
        let start_mm = self.length_mm;
        if self.may_round() {
            let before = self.laid.back().map(|laid| &laid.element);
            let settings = &self.limits.setpoints().rounding;
            self.junctions.push(before, &element, start_mm, settings);
        }
        self.length_mm += element.length_mm;
        self.laid.push_back(Laid {
            element,
            start_mm,
            sharing,
            pieces: Vec::new(),
            speed_mm_s,
            feed_mm_s,
            fastest_mm_s: speed_mm_s.min(feed_mm_s * self.override_max),
        });
        Ok(())
    }

    /// Rounds the elements of which all is known that has a part in it.
    pub(crate) fn round_on(&mut self) {
        let to = if self.complete {
            self.end()
        } else {
            let known = self.end().saturating_sub(REACH_ELEMENTS);
            // A block at a time: what is looked at to either side is looked at once for all of it.
            (known - known % BLOCK_ELEMENTS).max(self.ready)
        };
        let from = self.ready;
        self.ready = to;
        let index = |element: u32| element.saturating_sub(self.first) as usize;
        let (begin, end) = (index(from), index(to));
        if !self.may_round() {
            return;
        }
        if let (true, Some(last)) = (self.complete, self.laid.back()) {
            self.junctions.end(&last.element, self.length_mm);
        }
        let may_be_rounded = |laid: &Laid| rounding::is_rounded(&laid.element);
        if !self.laid.range(begin..end).any(may_be_rounded) {
            return self.junctions.forget_before(to);
        }
        let corrections = self
            .junctions
            .corrections(from..to, &self.limits.setpoints().rounding);
        for (laid, correction) in self.laid.range_mut(begin..end).zip(corrections) {
            if let Some(correction) = correction {
                laid.element.rounding = Some(Arc::new(correction));
                laid.cut(&self.plan_limits, self.override_max);
            }
        }
        self.junctions.forget_before(to);
    }

    /// Whether elements may be rounded at all: axes that do not move in straight lines travel the path exactly.
    fn may_round(&self) -> bool {
        self.limits.setpoints().kinematics == Kinematics::Cartesian
    }

    /// Nothing comes after what is at hand.
    pub fn finish(&mut self) {
        self.complete = true;
    }

    /// Whether the end of the path is at hand.
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    /// Number of the first element at hand.
    pub fn first(&self) -> u32 {
        self.first
    }

    /// Number of the element behind the last one at hand.
    pub fn end(&self) -> u32 {
        self.first.saturating_add(self.laid.len() as u32)
    }

    /// An element by its number; none if it is not at hand.
    pub fn get(&self, element: u32) -> Option<&Element> {
        Some(&self.laid(element)?.element)
    }

    pub(crate) fn laid(&self, element: u32) -> Option<&Laid> {
        self.laid.get(element.checked_sub(self.first)? as usize)
    }

    /// The last element at hand.
    pub fn last(&self) -> Option<&Element> {
        self.laid.back().map(|laid| &laid.element)
    }

    /// Length of the path before an element, in mm; of all that is at hand and before it for one that is not there yet.
    pub fn length_before_mm(&self, element: u32) -> f64 {
        self.laid(element)
            .map_or(self.length_mm, |laid| laid.start_mm)
    }

    /// Length of the path up to the end of what is at hand, in mm.
    pub fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// Lets go of the elements before this one.
    pub fn forget_before(&mut self, element: u32) {
        let count = element.saturating_sub(self.first) as usize;
        let count = count.min(self.laid.len());
        self.laid.drain(..count);
        self.first += count as u32;
    }

    /// The limits of the axes.
    pub fn limits(&self) -> &MotionLimits {
        &self.limits
    }
}

fn check_geometry(
    element: &Element,
    previous_end: Option<AxisVector>,
    limits: &MotionLimits,
) -> Result<(), MapError> {
    let line = element.line;
    let feed_is_finite = match element.feed {
        Feed::Rapid => true,
        Feed::PathMmS(feed_mm_s) if feed_mm_s <= 0.0 => {
            return Err(MapError::Feed { line, feed_mm_s });
        }
        Feed::PathMmS(feed_mm_s) => feed_mm_s.is_finite(),
    };
    if !(element.shape.is_finite() && element.length_mm.is_finite() && feed_is_finite) {
        return Err(MapError::NotFinite { line });
    }
    let travels = element.end() - element.start();
    if travels
        .iter()
        .skip(limits.axes().len())
        .any(|mm| *mm != 0.0)
    {
        return Err(MapError::NoSuchAxis { line });
    }
    limits.setpoints().kinematics.check_reach(element)?;
    let own_gap = own_gap(element, &travels);
    let between = previous_end.map_or(own_gap, |end| (element.start() - end).abs());
    for gap in [own_gap, between] {
        let gap = limits.setpoints().kinematics.axes_gap(element, &gap);
        for (gap_mm, axis) in gap.iter().zip(limits.axes()) {
            if *gap_mm > GAP_INCREMENTS_MAX * axis.increment_mm {
                return Err(MapError::Gap {
                    line,
                    gap_mm: gap.norm(),
                });
            }
        }
    }
    Ok(())
}

/// How far an element is from its own stored ends, per axis.
fn own_gap(element: &Element, travels: &AxisVector) -> AxisVector {
    match &element.shape {
        Shape::Arc { .. } => {
            // The circle itself at both ends, not the stored end points that `point` gives there.
            let near = 1e-9 * element.length_mm;
            let inner = |at_mm: f64| element.point(at_mm) - element.tangent(at_mm) * near;
            let start_gap = (inner(near) - element.start()).abs();
            let far_mm = element.length_mm - near;
            let end = element.point(far_mm) + element.tangent(far_mm) * near;
            start_gap.sup(&(end - element.end()).abs())
        }
        _ if element.length_mm <= 0.0 => travels.abs(),
        _ => AxisVector::zeros(),
    }
}
