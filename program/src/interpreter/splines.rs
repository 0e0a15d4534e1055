//! The words of splines: G5, G5.1, and G5.2 to G5.3.

use super::*;
use crate::flat::Flat;
use crate::splines::{ControlPoint, Curve, ORDER, OpenCurve, POINTS_MAX};

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
            let line = open.line;
            let found = format!("{word} in the spline that G5.2 began in line {line}");
            return refuse(word.offset, found, "end the spline with G5.3 before it");
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
        let plane = self.spline_plane(&spline.to_string(), words, offset)?;
        if spline == Spline::Nurbs {
            return Ok(self.control_point(line, words, plane, offset)?);
        }
        if words.first_of("XY").is_none() {
            let found = format!("{spline} without a place");
            return refuse(offset, found, "say where it ends: X, Y");
        }
        let target = self.target(words)?;
        self.feed(&target, offset)?;
        let [start, end] = [self.position, target].map(|place| Flat::of(&place, plane));
        let curve = if spline == Spline::Quadratic {
            let Some(first) = self.pair(words, ['I', 'J'], plane, offset)? else {
                let right = "I and J: from the start to the control point";
                return refuse(offset, "G5.1 without I and J", right);
            };
            Curve::quadratic(start, start + first, end)
        } else {
            let first = match self.pair(words, ['I', 'J'], plane, offset)? {
                Some(first) => first,
                None => self.splines.leaves_mm.ok_or_else(|| {
                    let right = "I and J: from the start to the first control point; only a G5 \
                                 behind a G5 goes on without them";
                    Refusal::new(offset, "G5 without I and J", right)
                })?,
            };
            let Some(second) = self.pair(words, ['P', 'Q'], plane, offset)? else {
                let right = "P and Q: from the end to the second control point";
                return refuse(offset, "G5 without P and Q", right);
            };
            self.splines.leaves_mm = Some(-second);
            Curve::cubic(start, start + first, end + second, end)
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
        if let Some(word) = words.first_of(AXIS_LETTERS) {
            let found = format!("{word} in the block of G5.3");
            let right = "the last control point belongs to G5.2, in a block before it";
            return refuse(word.offset, found, right);
        }
        let Some(open) = self.splines.open.take() else {
            let right = "G5.2 and its control points before it";
            return refuse(offset, "G5.3 without G5.2", right);
        };
        let plane = self.spline_plane("G5.3", words, offset)?;
        self.motion = Motion::None;
        let start = Flat::of(&self.position, plane);
        if open.points.first().is_none_or(|first| first.at_mm != start) {
            let right = "no motion between G5.2 and G5.3: the curve starts where the tool was";
            return refuse(offset, "G5.3 behind another motion", right);
        }
        let curve = Curve::nurbs(open.points, open.order).map_err(|wrong| wrong.at(offset))?;
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
            return refuse(offset, "a control point of one coordinate", right);
        }
        let first = self.splines.open.is_none();
        let weight = match p {
            Some(p) if p.value > 0.0 => p.value,
            Some(p) => return p.refuse("a weight is above 0"),
            None if x.is_some() => {
                let right = "P: its weight, such as P1";
                return refuse(offset, "a control point without P", right);
            }
            None => 1.0,
        };
        let start = Flat::of(&self.position, plane);
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
                return l.refuse(format!("an order is a whole number from {ORDER}"));
            }
            open.order = l.value as usize;
        }
        if x.is_some() {
            if open.points.len() >= POINTS_MAX {
                let right = format!("at most {POINTS_MAX}: split the curve");
                return refuse(offset, "one control point too many", right);
            }
            let at_mm = Flat::of(&target, plane);
            open.points.push(ControlPoint { at_mm, weight });
        } else if !first && p.is_some() {
            let right = "P without X and Y is the weight of the start: in the first block only";
            return refuse(offset, "a weight without a control point", right);
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
        if self.modes.plane.0 != 17 {
            let found = format!("{code} in G{}", self.modes.plane.0);
            return refuse(offset, found, "splines lie in the plane XY: G17 before it");
        }
        if let Some(word) = words.first_of("ZABCUVW") {
            let found = format!("{word} in {code}");
            return refuse(word.offset, found, "a spline moves X and Y only");
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
    ) -> Result<Option<Flat>, Refusal> {
        let [one, other] = letters;
        match letters.map(|letter| words.value(letter)) {
            [Some(first), Some(second)] => {
                let step = Flat::new(first.value, second.value) * self.unit_mm();
                let step = step.put_into(AxisVector::zeros(), plane);
                Ok(Some(Flat::of(&self.turned(step), plane)))
            }
            [None, None] => Ok(None),
            [given, _] => {
                let found = match given {
                    Some(_) => format!("{one} without {other}"),
                    None => format!("{other} without {one}"),
                };
                let right = format!("both {one} and {other}, or neither");
                refuse(offset, found, right)
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
        let end = curve.end().put_into(self.position, plane);
        let shapes = curve
            .shapes(&self.position, plane)
            .map_err(|wrong| wrong.at(offset))?;
        let feed = self.feed_along(words, &shapes, &end, offset)?;
        self.go(line, words, shapes, feed, offset)
    }
}
