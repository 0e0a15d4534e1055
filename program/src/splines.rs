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

/// A point of the plane, in mm.
pub type Place = [f64; 2];

/// A control point of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ControlPoint {
    /// Where it is, in machine coordinates.
    pub at_mm: Place,
    /// Its weight, above 0.
    pub weight: f64,
}

/// A curve of the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    points: Vec<ControlPoint>,
    order: usize,
}

/// What is wrong with a curve, and what would be right.
pub type CurveRefusal = (String, String);

/// One piece of what follows a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Piece {
    Line {
        from: Place,
        to: Place,
    },
    Arc {
        from: Place,
        to: Place,
        centre: Place,
        sweep_rad: f64,
    },
}

/// A place on a curve, with the direction in which it is passed.
#[derive(Debug, Clone, Copy)]
struct Passed {
    at: Place,
    along: Place,
}

impl Curve {
    /// G5: from `start` towards `first`, to `end` from `second`.
    pub fn cubic(start: Place, first: Place, second: Place, end: Place) -> Self {
        Self::of_weight_1(&[start, first, second, end])
    }

    /// G5.1: from `start` towards `control` and from there to `end`.
    pub fn quadratic(start: Place, control: Place, end: Place) -> Self {
        Self::of_weight_1(&[start, control, end])
    }

    fn of_weight_1(places: &[Place]) -> Self {
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
    pub fn nurbs(points: Vec<ControlPoint>, order: usize) -> Result<Self, CurveRefusal> {
        let refuse = |found: String, right: String| Err((found, right));
        if !(3..=ORDER_MAX).contains(&order) {
            return refuse(
                format!("a spline of order L{order}"),
                format!("L from 3 to {ORDER_MAX}"),
            );
        }
        if points.len() < order {
            return refuse(
                format!("a spline of {} control points", points.len()),
                format!("at least as many as its order: L is {order}, the start counts as one"),
            );
        }
        if points.len() > POINTS_MAX {
            return refuse(
                format!("a spline of {} control points", points.len()),
                format!("at most {POINTS_MAX}: split the curve"),
            );
        }
        if let Some(point) = points
            .iter()
            .find(|point| point.weight.is_nan() || point.weight <= 0.0)
        {
            return refuse(
                format!("a control point of weight P{}", point.weight),
                "a weight is above 0".into(),
            );
        }
        Ok(Self { points, order })
    }

    /// Where it ends.
    pub fn end(&self) -> Place {
        self.points.last().map_or([0.0; 2], |point| point.at_mm)
    }

    /// The lines and arcs that follow it from `from`, whose components in `plane` are its start.
    pub fn shapes(&self, from: &AxisVector, plane: [usize; 2]) -> Result<Vec<Shape>, CurveRefusal> {
        let placed = |place: Place| {
            let mut vector = *from;
            for (axis, mm) in plane.iter().zip(place) {
                if let Some(component) = vector.get_mut(*axis) {
                    *component = mm;
                }
            }
            vector
        };
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
    fn pieces(&self) -> Result<Vec<Piece>, CurveRefusal> {
        let steps = STEPS_PER_POINT * self.points.len();
        let parameter = |step: usize| self.last_parameter() * step as f64 / steps as f64;
        let far = |mm: &f64| mm.is_nan() || mm.abs() > FARTHEST_MM;
        if let Some(point) = self.points.iter().find(|point| point.at_mm.iter().any(far)) {
            let [x, y] = point.at_mm;
            return Err((
                format!("a control point at {x} mm, {y} mm"),
                format!("control points lie within {FARTHEST_MM} mm"),
            ));
        }
        let mut pieces = Vec::new();
        let mut tries = TRIES_MAX + TRIES_PER_STEP * steps;
        for step in 0..steps {
            let ends = [parameter(step), parameter(step + 1)];
            self.follow(ends, HALVINGS_MAX, &mut tries, &mut pieces);
        }
        if tries == 0 {
            return Err((
                "a spline that bends too often".into(),
                format!("no more than {} arcs follow it: split it", TRIES_MAX),
            ));
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
    fn at(&self, parameter: f64) -> (Place, Place) {
        let degree = self.order - 1;
        let last = self.last_parameter();
        let spans = last as usize;
        let span = (parameter.max(0.0) as usize).min(spans.saturating_sub(1));
        let mut work = [[0.0; 3]; ORDER_MAX];
        for (value, point) in work.iter_mut().zip(self.points.iter().skip(span)) {
            let [x, y] = point.at_mm;
            *value = [x * point.weight, y * point.weight, point.weight];
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
        let place = [x / weight, y / weight];
        let along = [
            (slope[0] - place[0] * slope[2]) / weight,
            (slope[1] - place[1] * slope[2]) / weight,
        ];
        (place, along)
    }

    /// A place on it and the direction in which it is passed there, seen from the side of another parameter: where control
    /// points coincide, it has no derivative.
    fn passed(&self, parameter: f64, other: f64) -> Passed {
        let (at, derivative) = self.at(parameter);
        let (across, _) = self.at(other);
        let scale_mm = length(difference(across, at));
        let near = parameter + (other - parameter) * 1e-3;
        let along = if length(derivative) * (other - parameter).abs() > 1e-6 * scale_mm {
            derivative
        } else if other > parameter {
            difference(self.at(near).0, at)
        } else {
            difference(at, self.at(near).0)
        };
        Passed {
            at,
            along: unit(along),
        }
    }
}

impl Piece {
    /// How far a place is from it or from what continues it.
    fn distance_mm(&self, place: Place) -> f64 {
        match *self {
            Piece::Line { from, to } => {
                cross(unit(difference(to, from)), difference(place, from)).abs()
            }
            Piece::Arc { from, centre, .. } => {
                (length(difference(place, centre)) - length(difference(from, centre))).abs()
            }
        }
    }
}

/// Two arcs from one place to another that keep the directions there and meet with one direction; none if they would turn
/// far round.
fn biarc(from: &Passed, to: &Passed) -> Option<[Piece; 2]> {
    // The tangent length β at both ends: (2·t₀·t₁ − 2)·β² + 2·v·(t₀ + t₁)·β + v·v = 0, v from the end to the start.
    let back = difference(from.at, to.at);
    let square = 2.0 * (dot(from.along, to.along) - 1.0);
    let linear = 2.0 * (dot(back, from.along) + dot(back, to.along));
    let constant = dot(back, back);
    let root = (linear * linear - 4.0 * square * constant).sqrt();
    let tangent_mm = 2.0 * constant / (root - linear);
    let corner = |passed: &Passed, way: f64| {
        let [x, y] = passed.at;
        let [along_x, along_y] = passed.along;
        [
            x + way * tangent_mm * along_x,
            y + way * tangent_mm * along_y,
        ]
    };
    let [first, second] = [corner(from, 1.0), corner(to, -1.0)];
    let joint = [
        f64::midpoint(first[0], second[0]),
        f64::midpoint(first[1], second[1]),
    ];
    let along_joint = unit(difference(second, joint));
    let pair = [
        arc_from(from, joint)?,
        arc_from(
            &Passed {
                at: joint,
                along: along_joint,
            },
            to.at,
        )?,
    ];
    tangent_mm.is_finite().then_some(pair)
}

/// The arc that leaves a place in its direction and leads to another.
fn arc_from(start: &Passed, to: Place) -> Option<Piece> {
    let chord = difference(to, start.at);
    let (beside, ahead) = (cross(start.along, chord), dot(start.along, chord));
    let sweep_rad = 2.0 * libm::atan2(beside, ahead);
    let chord_mm = length(chord);
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
    let [along_x, along_y] = start.along;
    let centre = [from[0] - along_y * radius_mm, from[1] + along_x * radius_mm];
    Some(Piece::Arc {
        from,
        to,
        centre,
        sweep_rad,
    })
}

fn combined(before: [f64; 3], here: [f64; 3], how: impl Fn(f64, f64) -> f64) -> [f64; 3] {
    [
        how(before[0], here[0]),
        how(before[1], here[1]),
        how(before[2], here[2]),
    ]
}

fn difference(to: Place, from: Place) -> Place {
    [to[0] - from[0], to[1] - from[1]]
}

fn dot(one: Place, other: Place) -> f64 {
    one[0] * other[0] + one[1] * other[1]
}

/// Positive if the other lies to the left of the one.
fn cross(one: Place, other: Place) -> f64 {
    one[0] * other[1] - one[1] * other[0]
}

fn length(place: Place) -> f64 {
    libm::hypot(place[0], place[1])
}

/// Its direction; zero if it has none.
fn unit(place: Place) -> Place {
    let length = length(place);
    if length > 0.0 {
        [place[0] / length, place[1] / length]
    } else {
        place
    }
}
