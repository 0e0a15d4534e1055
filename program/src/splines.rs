//! Splines in the plane XY: the curves of G5 (cubic), G5.1 (quadratic) and G5.2/G5.3 (NURBS), and the arcs that follow them.
//!
//! A curve is a rational B-spline over the knots 0 … 0, 1, 2, …, m … m, open at both ends (L. Piegl, W. Tiller, *The NURBS
//! Book*, 1997, §2.2 and §4.1), as LinuxCNC 2.9 takes it ("G-Codes", G5 to G5.3): G5 and G5.1 are its cases with four and
//! three points of weight 1, which makes them Bézier curves. Points and tangents come from de Boor's algorithm.
//!
//! The arcs are biarcs (K. Bolton, *Biarc curves*, Computer-Aided Design 7(2), 1975) with equal tangent lengths at both ends:
//! two arcs that meet with one tangent and keep the curve's points and tangents at their ends. They start as four to each
//! control point over equal steps of the parameter, the construction of LinuxCNC's controller; where they leave the curve
//! by more than [`TOLERANCE_MM`], the step is halved.

use path::geometry::{AxisVector, Element, Shape};
use serde::{Deserialize, Serialize};

use crate::codes::g_codes;
use crate::flat::Flat;
use crate::refusal::{Refusal, wrong};

#[cfg(test)]
mod tests;

/// How far the arcs may lie beside the curve.
pub const TOLERANCE_MM: f64 = 0.0005;

/// The most control points of one curve.
pub const POINTS_MAX: usize = 2_000;

/// The highest order (L) of a curve: one more than its degree.
pub const ORDER_MAX: usize = 10;

/// The farthest control point from the machine's zero: 10 km.
const FARTHEST_MM: f64 = 1e7;

/// How many parts of one curve are tried, beyond a few for each of its steps.
const TRIES_MAX: usize = 20_000;

/// The same for each step.
const TRIES_PER_STEP: usize = 4;

/// Biarcs to each control point before steps are halved.
const STEPS_PER_POINT: usize = 4;

/// How often a step is halved before what is left is a line.
const HALVINGS_MAX: u32 = 10;

/// Places within a step at which the distance from the curve is measured: in between `1 / PROBES`.
const PROBES: u32 = 8;

/// An arc bent by less than this from its chord is a line: 0.1 nm.
const STRAIGHT_MM: f64 = 1e-7;

/// The most that one arc turns by.
const SWEEP_MAX_RAD: f64 = std::f64::consts::FRAC_PI_2;

g_codes! {
    /// Which spline a block is of.
    pub enum Spline {
        /// G5.
        Cubic = 50,
        /// G5.1.
        Quadratic = 51,
        /// G5.2: control points up to G5.3.
        Nurbs = 52,
    }
}

/// The order of a NURBS that gives none.
pub const ORDER: usize = 3;

impl Spline {
    /// The letters it makes use of, beside those of the axes.
    pub fn letters(self) -> &'static str {
        match self {
            Spline::Cubic => "IJPQ",
            Spline::Quadratic => "IJ",
            Spline::Nurbs => "PL",
        }
    }
}

/// A control point of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ControlPoint {
    /// Where it is, in machine coordinates.
    pub at_mm: Flat,
    /// Its weight, above 0.
    pub weight: f64,
}

/// A curve of the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    points: Vec<ControlPoint>,
    order: usize,
}

/// One piece of what follows a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Piece {
    Line {
        from: Flat,
        to: Flat,
    },
    Arc {
        from: Flat,
        to: Flat,
        centre: Flat,
        sweep_rad: f64,
    },
}

/// A place on a curve, with the direction in which it is passed.
#[derive(Debug, Clone, Copy)]
struct Passed {
    at: Flat,
    along: Flat,
}

impl Curve {
    /// G5: from `start` towards `first`, to `end` from `second`.
    pub fn cubic(start: Flat, first: Flat, second: Flat, end: Flat) -> Self {
        Self::of_weight_1(&[start, first, second, end])
    }

    /// G5.1: from `start` towards `control` and from there to `end`.
    pub fn quadratic(start: Flat, control: Flat, end: Flat) -> Self {
        Self::of_weight_1(&[start, control, end])
    }

    fn of_weight_1(places: &[Flat]) -> Self {
        let points = places
            .iter()
            .map(|&at_mm| ControlPoint { at_mm, weight: 1.0 })
            .collect();
        Self {
            points,
            order: places.len(),
        }
    }

    /// G5.2 to G5.3: along its control points, the first of them the start.
    pub fn nurbs(points: Vec<ControlPoint>, order: usize) -> Result<Self, Refusal> {
        let count = points.len();
        let found = format!("a spline of {count} control points");
        if !(3..=ORDER_MAX).contains(&order) {
            let right = format!("L from 3 to {ORDER_MAX}");
            return wrong(format!("a spline of order L{order}"), right);
        }
        if count < order {
            let right =
                format!("at least as many as its order: L is {order}, the start counts as one");
            return wrong(found, right);
        }
        if count > POINTS_MAX {
            return wrong(found, format!("at most {POINTS_MAX}: split the curve"));
        }
        let weightless = |point: &&ControlPoint| point.weight.is_nan() || point.weight <= 0.0;
        if let Some(point) = points.iter().find(weightless) {
            let found = format!("a control point of weight P{}", point.weight);
            return wrong(found, "a weight is above 0");
        }
        Ok(Self { points, order })
    }

    /// Where it ends.
    pub fn end(&self) -> Flat {
        self.points
            .last()
            .map_or(Flat::default(), |point| point.at_mm)
    }

    /// The lines and arcs that follow it from `from`, whose components in `plane` are its start.
    pub fn shapes(&self, from: &AxisVector, plane: [usize; 2]) -> Result<Vec<Shape>, Refusal> {
        let placed = |place: Flat| place.put_into(*from, plane);
        let pieces = self.pieces()?;
        let mut here = *from;
        let mut shapes = Vec::with_capacity(pieces.len());
        for piece in pieces {
            let shape = match piece {
                Piece::Line { to, .. } => Shape::Line {
                    from: here,
                    to: placed(to),
                },
                Piece::Arc {
                    to,
                    centre,
                    sweep_rad,
                    ..
                } => Element::arc_shape(here, placed(to), placed(centre), plane, sweep_rad),
            };
            here = shape.end();
            shapes.push(shape);
        }
        Ok(shapes)
    }

    /// The lines and arcs that follow it.
    fn pieces(&self) -> Result<Vec<Piece>, Refusal> {
        let steps = STEPS_PER_POINT * self.points.len();
        let parameter = |step: usize| self.last_parameter() * step as f64 / steps as f64;
        let far = |mm: f64| mm.is_nan() || mm.abs() > FARTHEST_MM;
        let is_far = |point: &&ControlPoint| far(point.at_mm.u) || far(point.at_mm.v);
        if let Some(point) = self.points.iter().find(is_far) {
            let Flat { u: x, v: y } = point.at_mm;
            let right = format!("control points lie within {FARTHEST_MM} mm");
            return wrong(format!("a control point at {x} mm, {y} mm"), right);
        }
        let mut pieces = Vec::new();
        let mut tries = TRIES_MAX + TRIES_PER_STEP * steps;
        for step in 0..steps {
            let ends = [parameter(step), parameter(step + 1)];
            self.follow(ends, HALVINGS_MAX, &mut tries, &mut pieces);
        }
        if tries == 0 {
            let right = format!("no more than {} arcs follow it: split it", TRIES_MAX);
            return wrong("a spline that bends too often", right);
        }
        Ok(pieces)
    }

    /// Follows it from one parameter to another.
    fn follow(
        &self,
        parameters: [f64; 2],
        halvings: u32,
        tries: &mut usize,
        pieces: &mut Vec<Piece>,
    ) {
        *tries = tries.saturating_sub(1);
        if *tries == 0 {
            return;
        }
        let [start, end] = parameters;
        let [from, to] = [self.passed(start, end), self.passed(end, start)];
        // Control points in one place hold the curve there.
        if from.at == to.at && self.at(f64::midpoint(start, end)).0 == from.at {
            return;
        }
        if let Some(pair) =
            biarc(&from, &to).filter(|pair| self.deviation_mm(parameters, pair) <= TOLERANCE_MM)
        {
            pieces.extend(pair);
        } else if halvings == 0 {
            if from.at != to.at {
                pieces.push(Piece::Line {
                    from: from.at,
                    to: to.at,
                });
            }
        } else {
            let middle = f64::midpoint(start, end);
            self.follow([start, middle], halvings - 1, tries, pieces);
            self.follow([middle, end], halvings - 1, tries, pieces);
        }
    }

    /// How far from it two pieces lie at most, between two of its parameters.
    fn deviation_mm(&self, [start, end]: [f64; 2], pair: &[Piece; 2]) -> f64 {
        (1..PROBES)
            .map(|probe| {
                let parameter = start + (end - start) * f64::from(probe) / f64::from(PROBES);
                let (place, _) = self.at(parameter);
                pair.iter()
                    .map(|piece| piece.distance_mm(place))
                    .fold(f64::INFINITY, f64::min)
            })
            .fold(0.0, f64::max)
    }

    /// The parameter of its end; its start is at 0.
    fn last_parameter(&self) -> f64 {
        (self.points.len() + 1).saturating_sub(self.order) as f64
    }

    /// A knot, counted from 0.
    fn knot(&self, index: usize) -> f64 {
        let inner = (index + 1).saturating_sub(self.order) as f64;
        inner.min(self.last_parameter())
    }

    /// Where it is at a parameter, and its derivative there (de Boor's algorithm on the homogeneous points).
    fn at(&self, parameter: f64) -> (Flat, Flat) {
        let degree = self.order - 1;
        let last = self.last_parameter();
        let spans = last as usize;
        let span = (parameter.max(0.0) as usize).min(spans.saturating_sub(1));
        let mut work = [[0.0; 3]; ORDER_MAX];
        for (value, point) in work.iter_mut().zip(self.points.iter().skip(span)) {
            let Flat { u, v } = point.at_mm;
            *value = [u * point.weight, v * point.weight, point.weight];
        }
        let mut slope = [0.0; 3];
        for round in 1..=degree {
            for index in (round..=degree).rev() {
                let left = self.knot(span + index);
                let right = self.knot(span + index + self.order - round);
                let share = (parameter - left) / (right - left);
                let [before, here] = [work[index - 1], work[index]];
                if round == degree {
                    slope = combined(before, here, |before, here| {
                        (here - before) * degree as f64 / (right - left)
                    });
                }
                work[index] = combined(before, here, |before, here| {
                    before + (here - before) * share
                });
            }
        }
        let [x, y, weight] = work[degree];
        let place = Flat::new(x / weight, y / weight);
        let along = Flat::new(
            (slope[0] - place.u * slope[2]) / weight,
            (slope[1] - place.v * slope[2]) / weight,
        );
        (place, along)
    }

    /// A place on it and the direction in which it is passed there, seen from the side of another parameter: where control
    /// points coincide, it has no derivative.
    fn passed(&self, parameter: f64, other: f64) -> Passed {
        let (at, derivative) = self.at(parameter);
        let (across, _) = self.at(other);
        let scale_mm = (across - at).length();
        let near = parameter + (other - parameter) * 1e-3;
        let along = if derivative.length() * (other - parameter).abs() > 1e-6 * scale_mm {
            derivative
        } else if other > parameter {
            self.at(near).0 - at
        } else {
            at - self.at(near).0
        };
        Passed {
            at,
            along: unit(along),
        }
    }
}

impl Piece {
    /// How far a place is from it or from what continues it.
    fn distance_mm(&self, place: Flat) -> f64 {
        match *self {
            Piece::Line { from, to } => unit(to - from).cross(place - from).abs(),
            Piece::Arc { from, centre, .. } => {
                ((place - centre).length() - (from - centre).length()).abs()
            }
        }
    }
}

/// Two arcs from one place to another that keep the directions there and meet with one direction; none if they would turn
/// far round.
fn biarc(from: &Passed, to: &Passed) -> Option<[Piece; 2]> {
    // The tangent length β at both ends: (2·t₀·t₁ − 2)·β² + 2·v·(t₀ + t₁)·β + v·v = 0, v from the end to the start.
    let back = from.at - to.at;
    let square = 2.0 * (from.along.dot(to.along) - 1.0);
    let linear = 2.0 * (back.dot(from.along) + back.dot(to.along));
    let constant = back.dot(back);
    let root = (linear * linear - 4.0 * square * constant).sqrt();
    let tangent_mm = 2.0 * constant / (root - linear);
    let corner = |passed: &Passed, way: f64| passed.at + passed.along * (way * tangent_mm);
    let [first, second] = [corner(from, 1.0), corner(to, -1.0)];
    let midpoint = |of: fn(Flat) -> f64| f64::midpoint(of(first), of(second));
    let at = Flat::new(midpoint(|of| of.u), midpoint(|of| of.v));
    let along = unit(second - at);
    let pair = [arc_from(from, at)?, arc_from(&Passed { at, along }, to.at)?];
    tangent_mm.is_finite().then_some(pair)
}

/// The arc that leaves a place in its direction and leads to another.
fn arc_from(start: &Passed, to: Flat) -> Option<Piece> {
    let chord = to - start.at;
    let (beside, ahead) = (start.along.cross(chord), start.along.dot(chord));
    let sweep_rad = 2.0 * libm::atan2(beside, ahead);
    let chord_mm = chord.length();
    // Also refuses what is not a number.
    if !(chord_mm > 0.0 && sweep_rad.abs() <= SWEEP_MAX_RAD) {
        return None;
    }
    let from = start.at;
    if chord_mm * sweep_rad.abs() / 8.0 < STRAIGHT_MM {
        return Some(Piece::Line { from, to });
    }
    // Positive: the centre lies to the left.
    let radius_mm = chord_mm * chord_mm / (2.0 * beside);
    let centre = from + start.along.left() * radius_mm;
    Some(Piece::Arc {
        from,
        to,
        centre,
        sweep_rad,
    })
}

fn combined(before: [f64; 3], here: [f64; 3], how: impl Fn(f64, f64) -> f64) -> [f64; 3] {
    [0, 1, 2].map(|index| how(before[index], here[index]))
}

fn unit(of: Flat) -> Flat {
    let length = of.length();
    if length > 0.0 {
        Flat::new(of.u / length, of.v / length)
    } else {
        of
    }
}
