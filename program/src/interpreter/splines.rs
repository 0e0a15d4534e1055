//! The words of splines: G5, G5.1, and G5.2 to G5.3.

use super::*;
use crate::splines::{ControlPoint, Curve, Place};
use serde::{Deserialize, Serialize};

/// Which spline a block is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Spline {
    /// G5.
    Cubic,
    /// G5.1.
    Quadratic,
    /// G5.2: control points up to G5.3.
    Nurbs,
}

/// What splines keep from block to block.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SplineState {
    /// Behind a G5: the step to the first control point of one that gives none, in the program's axes.
    leaves_mm: Option<Place>,
    /// Between G5.2 and G5.3.
    open: Option<OpenCurve>,
}

/// A NURBS whose control points are still being given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct OpenCurve {
    points: Vec<ControlPoint>,
    order: usize,
    line: u32,
}

/// The order of a NURBS that gives none.
const ORDER: usize = 3;

impl Spline {
    /// The spline of a code, given ten times its number.
    pub fn of_code(number: u32) -> Option<Self> {
        match number {
            50 => Some(Spline::Cubic),
            51 => Some(Spline::Quadratic),
            52 => Some(Spline::Nurbs),
            _ => None,
        }
    }

    /// The letters it makes use of, beside those of the axes.
    pub fn letters(self) -> &'static str {
        match self {
            Spline::Cubic => "IJPQ",
            Spline::Quadratic => "IJ",
            Spline::Nurbs => "PL",
        }
    }

    /// Its code.
    pub fn code(self) -> &'static str {
        match self {
            Spline::Cubic => "G5",
            Spline::Quadratic => "G5.1",
            Spline::Nurbs => "G5.2",
        }
    }
}

impl SplineState {
    /// Whether there is nothing that another motion would end.
    pub fn is_idle(&self) -> bool {
        self.leaves_mm.is_none() && self.open.is_none()
    }

    /// The line in which a NURBS begins that has no end.
    pub fn open_since(&self) -> Option<u32> {
        self.open.as_ref().map(|open| open.line)
    }
}

impl Interpreter {
    /// Refuses what leaves a NURBS open, and forgets what only a spline behind a spline knows.
    pub(super) fn leave_splines(&mut self, words: &Words) -> Result<(), Refusal> {
        let number = words.code(Group::Motion);
        if !matches!(self.motion, Motion::Spline(Spline::Cubic)) {
            self.splines.leaves_mm = None;
        }
        let Some(open) = &self.splines.open else {
            return Ok(());
        };
        let ends = words
            .code(Group::Stop)
            .filter(|(number, _)| matches!(number, 20 | 300));
        let other = number.filter(|(number, _)| !matches!(number, 52 | 53));
        if let Some((_, word)) = other.or(ends) {
            let found = format!(
                "{}{} in the spline that G5.2 began in line {}",
                word.letter, word.value, open.line
            );
            return Err(Refusal::new(
                word.offset,
                found,
                "end the spline with G5.3 before it",
            ));
        }
        Ok(())
    }

    /// The motion of a block of splines.
    pub(super) fn spline(
        &mut self,
        line: u32,
        words: &Words,
        spline: Spline,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let plane = self
            .spline_plane(spline.code(), words, offset)
            .map_err(one)?;
        if spline == Spline::Nurbs {
            return self.control_point(line, words, plane, offset).map_err(one);
        }
        if words.first_of("XY").is_none() {
            let found = format!("{} without a place", spline.code());
            return Err(one(Refusal::new(offset, found, "say where it ends: X, Y")));
        }
        let target = self.target(words).map_err(one)?;
        self.feed(&target, offset).map_err(one)?;
        let [start, end] = [self.position, target].map(|place| in_plane(&place, plane));
        let curve = if spline == Spline::Quadratic {
            let Some(first) = self.pair(words, ['I', 'J'], plane, offset).map_err(one)? else {
                let right = "I and J: from the start to the control point";
                return Err(one(Refusal::new(offset, "G5.1 without I and J", right)));
            };
            Curve::quadratic(start, added(start, first), end)
        } else {
            let first = match self.pair(words, ['I', 'J'], plane, offset).map_err(one)? {
                Some(first) => first,
                None => self.splines.leaves_mm.ok_or_else(|| {
                    let right = "I and J: from the start to the first control point; only a G5 \
                                 behind a G5 goes on without them";
                    one(Refusal::new(offset, "G5 without I and J", right))
                })?,
            };
            let Some(second) = self.pair(words, ['P', 'Q'], plane, offset).map_err(one)? else {
                let right = "P and Q: from the end to the second control point";
                return Err(one(Refusal::new(offset, "G5 without P and Q", right)));
            };
            self.splines.leaves_mm = Some(second.map(|mm| -mm));
            Curve::cubic(start, added(start, first), added(end, second), end)
        };
        self.follow(line, words, &curve, plane, offset)
    }

    /// G5.3: the curve along the control points.
    pub(super) fn close_spline(
        &mut self,
        line: u32,
        words: &Words,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        if let Some(word) = words.first_of(AXIS_LETTERS) {
            let found = format!("{}{} in the block of G5.3", word.letter, word.value);
            let right = "the last control point belongs to G5.2, in a block before it";
            return Err(one(Refusal::new(word.offset, found, right)));
        }
        let Some(open) = self.splines.open.take() else {
            let right = "G5.2 and its control points before it";
            return Err(one(Refusal::new(offset, "G5.3 without G5.2", right)));
        };
        let plane = self.spline_plane("G5.3", words, offset).map_err(one)?;
        self.motion = Motion::None;
        let start = in_plane(&self.position, plane);
        if open.points.first().is_none_or(|first| first.at_mm != start) {
            let right = "no motion between G5.2 and G5.3: the curve starts where the tool was";
            return Err(one(Refusal::new(
                offset,
                "G5.3 behind another motion",
                right,
            )));
        }
        let curve = Curve::nurbs(open.points, open.order)
            .map_err(|(found, right)| one(Refusal::new(offset, found, right)))?;
        self.follow(line, words, &curve, plane, offset)
    }

    /// G5.2: one more control point.
    fn control_point(
        &mut self,
        line: u32,
        words: &Words,
        plane: [usize; 2],
        offset: usize,
    ) -> Result<(), Refusal> {
        let [x, y, p, l] = ['X', 'Y', 'P', 'L'].map(|letter| words.value(letter));
        if x.is_some() != y.is_some() {
            let right = "both X and Y of a control point";
            return Err(Refusal::new(
                offset,
                "a control point of one coordinate",
                right,
            ));
        }
        let first = self.splines.open.is_none();
        let weight = match p {
            Some(p) if p.value > 0.0 => p.value,
            Some(p) => {
                let found = format!("P{}", p.value);
                return Err(Refusal::new(p.offset, found, "a weight is above 0"));
            }
            None if x.is_some() => {
                let right = "P: its weight, such as P1";
                return Err(Refusal::new(offset, "a control point without P", right));
            }
            None => 1.0,
        };
        let start = in_plane(&self.position, plane);
        let target = self.target(words)?;
        let open = self.splines.open.get_or_insert_with(|| OpenCurve {
            // Without X and Y, P is the weight of the start.
            points: vec![ControlPoint {
                at_mm: start,
                weight: if x.is_none() { weight } else { 1.0 },
            }],
            order: ORDER,
            line,
        });
        if let Some(l) = l {
            if l.value < ORDER as f64 || l.value.fract() != 0.0 {
                let right = format!("an order is a whole number from {ORDER}");
                return Err(Refusal::new(l.offset, format!("L{}", l.value), right));
            }
            open.order = l.value as usize;
        }
        if x.is_some() {
            if open.points.len() >= crate::splines::POINTS_MAX {
                let right = format!("at most {}: split the curve", crate::splines::POINTS_MAX);
                return Err(Refusal::new(offset, "one control point too many", right));
            }
            let at_mm = in_plane(&target, plane);
            open.points.push(ControlPoint { at_mm, weight });
        } else if !first && p.is_some() {
            let right = "P without X and Y is the weight of the start: in the first block only";
            return Err(Refusal::new(
                offset,
                "a weight without a control point",
                right,
            ));
        }
        Ok(())
    }

    /// The axes of splines; refuses other planes and words of other axes.
    fn spline_plane(
        &self,
        code: &str,
        words: &Words,
        offset: usize,
    ) -> Result<[usize; 2], Refusal> {
        if self.plane.0 != 17 {
            let found = format!("{code} in G{}", self.plane.0);
            return Err(Refusal::new(
                offset,
                found,
                "splines lie in the plane XY: G17 before it",
            ));
        }
        if let Some(word) = words.first_of("ZABCUVW") {
            let found = format!("{}{} in {code}", word.letter, word.value);
            return Err(Refusal::new(
                word.offset,
                found,
                "a spline moves X and Y only",
            ));
        }
        self.plane_axes(offset)
    }

    /// A step in the plane that two words give together, in the machine's axes; none if neither is there.
    fn pair(
        &self,
        words: &Words,
        letters: [char; 2],
        plane: [usize; 2],
        offset: usize,
    ) -> Result<Option<Place>, Refusal> {
        match letters.map(|letter| words.value(letter)) {
            [Some(first), Some(second)] => {
                let mut step = AxisVector::zeros();
                for (axis, word) in plane.iter().zip([first, second]) {
                    if let Some(component) = step.get_mut(*axis) {
                        *component = word.value * self.unit_mm();
                    }
                }
                Ok(Some(in_plane(&self.turned(step), plane)))
            }
            [None, None] => Ok(None),
            [given, _] => {
                let (there, missing) = if given.is_some() {
                    (letters[0], letters[1])
                } else {
                    (letters[1], letters[0])
                };
                let found = format!("{there} without {missing}");
                let right = format!("both {} and {}, or neither", letters[0], letters[1]);
                Err(Refusal::new(offset, found, right))
            }
        }
    }

    /// Goes along a curve.
    fn follow(
        &mut self,
        line: u32,
        words: &Words,
        curve: &Curve,
        plane: [usize; 2],
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let mut end = self.position;
        for (axis, mm) in plane.iter().zip(curve.end()) {
            if let Some(component) = end.get_mut(*axis) {
                *component = mm;
            }
        }
        let shapes = curve
            .shapes(&self.position, plane)
            .map_err(|(found, right)| one(Refusal::new(offset, found, right)))?;
        let feed = self.feed_along(words, &shapes, &end, offset).map_err(one)?;
        self.go(line, words, shapes, feed, offset)
    }
}

fn in_plane(place: &AxisVector, plane: [usize; 2]) -> Place {
    plane.map(|axis| place.get(axis).copied().unwrap_or(0.0))
}

fn added(place: Place, step: Place) -> Place {
    [place[0] + step[0], place[1] + step[1]]
}
