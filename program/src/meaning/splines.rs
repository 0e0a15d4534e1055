//! The words of splines: G5, G5.1, and G5.2 to G5.3.

use serde::{Deserialize, Serialize};

use super::{AxisVector, Cause, Group, Motion, Refusal, State, Words, refuse};
use crate::flat::Flat;
use crate::letters::AXIS_LETTERS;
use crate::splines::{ControlPoint, Curve, ORDER, POINTS_MAX, Spline};

/// What splines keep from block to block.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Splines {
    /// Behind a G5: the step to the first control point of one that gives none, in the program's axes.
    leaves_mm: Option<Flat>,
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

impl Splines {
    /// Whether there is nothing that another motion would end.
    #[inline]
    pub fn is_idle(&self) -> bool {
        self.leaves_mm.is_none() && self.open.is_none()
    }

    /// The line in which a NURBS begins that has no end.
    pub fn open_since(&self) -> Option<u32> {
        self.open.as_ref().map(|open| open.line)
    }

    /// Refuses what leaves a NURBS open, and forgets what only a spline behind a spline knows.
    pub fn leave(&mut self, words: &Words, motion: Motion) -> Result<(), Refusal> {
        let number = words.code(Group::Motion);
        if !matches!(motion, Motion::Spline(Spline::Cubic)) {
            self.leaves_mm = None;
        }
        let Some(open) = &self.open else {
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

    /// The curve of a block, and the axes of its plane; none for one more control point of a NURBS.
    pub fn curve(
        &mut self,
        state: &State,
        cause: Cause,
        spline: Spline,
    ) -> Result<Option<(Curve, [usize; 2])>, Refusal> {
        let words = cause.words;
        let plane = state.spline_plane(&spline.to_string(), cause)?;
        if spline == Spline::Nurbs {
            self.control_point(state, cause, plane)?;
            return Ok(None);
        }
        if words.first_of("XY").is_none() {
            let found = format!("{spline} without a place");
            return cause.refuse(found, "say where it ends: X, Y");
        }
        let target = state.target(words)?;
        state.feed(&target, cause.offset)?;
        let [start, end] = [state.position, target].map(|place| Flat::of(&place, plane));
        let first = state.pair(cause, ['I', 'J'], plane)?;
        if spline == Spline::Quadratic {
            let Some(first) = first else {
                let right = "I and J: from the start to the control point";
                return cause.refuse("G5.1 without I and J", right);
            };
            return Ok(Some((Curve::quadratic(start, start + first, end), plane)));
        }
        let Some(first) = first.or(self.leaves_mm) else {
            let right = "I and J: from the start to the first control point; only a G5 \
                         behind a G5 goes on without them";
            return cause.refuse("G5 without I and J", right);
        };
        let Some(second) = state.pair(cause, ['P', 'Q'], plane)? else {
            let right = "P and Q: from the end to the second control point";
            return cause.refuse("G5 without P and Q", right);
        };
        self.leaves_mm = Some(-second);
        let curve = Curve::cubic(start, start + first, end + second, end);
        Ok(Some((curve, plane)))
    }

    /// G5.3: the curve along the control points, and the axes of its plane.
    pub fn close(
        &mut self,
        state: &mut State,
        cause: Cause,
    ) -> Result<(Curve, [usize; 2]), Refusal> {
        if let Some(word) = cause.words.first_of(AXIS_LETTERS) {
            let found = format!("{word} in the block of G5.3");
            let right = "the last control point belongs to G5.2, in a block before it";
            return refuse(word.offset, found, right);
        }
        let Some(open) = self.open.take() else {
            let right = "G5.2 and its control points before it";
            return cause.refuse("G5.3 without G5.2", right);
        };
        let plane = state.spline_plane("G5.3", cause)?;
        state.move_by(Motion::None);
        let start = Flat::of(&state.position, plane);
        if open.points.first().is_none_or(|first| first.at_mm != start) {
            let right = "no motion between G5.2 and G5.3: the curve starts where the tool was";
            return cause.refuse("G5.3 behind another motion", right);
        }
        let curve = Curve::nurbs(open.points, open.order);
        Ok((curve.map_err(|wrong| wrong.at(cause.offset))?, plane))
    }

    /// G5.2: one more control point.
    fn control_point(
        &mut self,
        state: &State,
        cause: Cause,
        plane: [usize; 2],
    ) -> Result<(), Refusal> {
        let words = cause.words;
        let [x, y, p, l] = ['X', 'Y', 'P', 'L'].map(|letter| words.value(letter));
        if x.is_some() != y.is_some() {
            let right = "both X and Y of a control point";
            return cause.refuse("a control point of one coordinate", right);
        }
        let first = self.open.is_none();
        let weight = match p {
            Some(p) if p.value > 0.0 => p.value,
            Some(p) => return p.refuse("a weight is above 0"),
            None if x.is_some() => {
                let right = "P: its weight, such as P1";
                return cause.refuse("a control point without P", right);
            }
            None => 1.0,
        };
        let start = Flat::of(&state.position, plane);
        let target = state.target(words)?;
        let open = self.open.get_or_insert_with(|| OpenCurve {
            // Without X and Y, P is the weight of the start.
            points: vec![ControlPoint {
                at_mm: start,
                weight: if x.is_none() { weight } else { 1.0 },
            }],
            order: ORDER,
            line: cause.line,
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
                return cause.refuse("one control point too many", right);
            }
            let at_mm = Flat::of(&target, plane);
            open.points.push(ControlPoint { at_mm, weight });
        } else if !first && p.is_some() {
            let right = "P without X and Y is the weight of the start: in the first block only";
            return cause.refuse("a weight without a control point", right);
        }
        Ok(())
    }
}

impl State {
    /// The axes of splines; refuses other planes and words of other axes.
    fn spline_plane(&self, code: &str, cause: Cause) -> Result<[usize; 2], Refusal> {
        let (plane, _, _) = self.in_force.plane;
        if plane != 17 {
            let found = format!("{code} in G{plane}");
            return cause.refuse(found, "splines lie in the plane XY: G17 before it");
        }
        if let Some(word) = cause.words.first_of("ZABCUVW") {
            let found = format!("{word} in {code}");
            return refuse(word.offset, found, "a spline moves X and Y only");
        }
        self.plane_axes(cause.offset)
    }

    /// A step in the plane that two words give together, in the machine's axes; none if neither is there.
    fn pair(
        &self,
        cause: Cause,
        letters: [char; 2],
        plane: [usize; 2],
    ) -> Result<Option<Flat>, Refusal> {
        let [one, other] = letters;
        match letters.map(|letter| cause.words.value(letter)) {
            [Some(first), Some(second)] => {
                let step = Flat::new(first.value, second.value) * self.in_force.unit_mm();
                let step = step.put_into(AxisVector::zeros(), plane);
                Ok(Some(Flat::of(&self.offsets.turned(step), plane)))
            }
            [None, None] => Ok(None),
            [given, _] => {
                let found = match given {
                    Some(_) => format!("{one} without {other}"),
                    None => format!("{other} without {one}"),
                };
                let right = format!("both {one} and {other}, or neither");
                cause.refuse(found, right)
            }
        }
    }
}
