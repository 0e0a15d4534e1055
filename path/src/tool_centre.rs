//! Control of the tool's centre point (G43.4, "TCP", "RTCP"): where slides must go so that the tip of the tool keeps to its path on the
//! work while rotary axes turn the work, the tool, or both.
//!
//! Each rotary axis is a line in space, as it lies with all axes at 0; it turns what it carries right-handed about its direction. Nested
//! axes are turns about such lines, one after the other (the product of exponentials: R. Brockett, *Robotic manipulators and the
//! product of exponentials formula*, 1984; K. Lynch, F. Park, *Modern Robotics*, 2017, §4.1). So a machine is described as it was
//! measured: lines need not meet, nor stand at right angles.
//!
//! With `W` the turns of the work, `T` the turns of the tool, `p` the slides, `l` the length of the tool and `w` a point of the work:
//! `W(w) = p + T(−l)`. Programs say `w + l`: with all rotary axes at 0 this is `p`.

use nalgebra::Vector3;

use crate::geometry::{AxisVector, Shape};

/// A point or a direction in X, Y and Z.
type Point = Vector3<f64>;

/// A path that would need more pieces is refused.
pub const PIECES_MAX: f64 = 20_000.0;

/// A rotary axis as a line in space, with all axes at 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotaryLine {
    axis: usize,
    point_mm: Point,
    /// Of length 1.
    direction: Point,
}

/// Which lines turn the tool and the work.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ToolCentre {
    /// X, Y and Z among the axes.
    slides: [usize; 3],
    /// What carries the work, the line nearest to the bed first.
    work: Vec<RotaryLine>,
    /// What carries the tool, the line nearest to the slides first.
    tool: Vec<RotaryLine>,
}

/// X, Y and Z of a place, which these axes have.
pub fn slides_of(slides: [usize; 3], place: &AxisVector) -> [f64; 3] {
    slides.map(|axis| place.get(axis).copied().unwrap_or(0.0))
}

/// The place with another X, Y and Z.
pub fn with_slides(slides: [usize; 3], mut place: AxisVector, values: [f64; 3]) -> AxisVector {
    for (axis, value) in slides.into_iter().zip(values) {
        if let Some(component) = place.get_mut(axis) {
            *component = value;
        }
    }
    place
}

impl RotaryLine {
    /// The axis of this index, about a line through a point, in mm, along a direction of any length; none for a direction without
    /// length.
    pub fn new(axis: usize, point_mm: [f64; 3], direction: [f64; 3]) -> Option<Self> {
        let direction = Point::from(direction);
        let length = direction.norm();
        (length > 0.0 && length.is_finite()).then(|| Self {
            axis,
            point_mm: Point::from(point_mm),
            direction: direction / length,
        })
    }

    fn angle_rad(&self, axes: &AxisVector) -> f64 {
        axes.get(self.axis).copied().unwrap_or(0.0).to_radians()
    }

    /// The same for directions.
    fn of_directions(&self) -> Self {
        Self {
            point_mm: Point::zeros(),
            ..*self
        }
    }

    /// A point, turned about the line (Rodrigues' formula).
    fn turned(&self, point: Point, angle_rad: f64) -> Point {
        if angle_rad == 0.0 {
            return point;
        }
        let arm = point - self.point_mm;
        let (sin, cos) = (libm::sin(angle_rad), libm::cos(angle_rad));
        let along = self.direction * self.direction.dot(&arm);
        self.point_mm + along + (arm - along) * cos + self.direction.cross(&arm) * sin
    }
}

impl ToolCentre {
    /// Of a machine whose X, Y and Z are these axes.
    pub fn new(slides: [usize; 3], work: Vec<RotaryLine>, tool: Vec<RotaryLine>) -> Self {
        Self { slides, work, tool }
    }

    /// All that makes it, as numbers: machines with the same are the same here.
    pub fn numbers(&self) -> Vec<f64> {
        let lines = |lines: &[RotaryLine]| {
            let numbers = lines.iter().flat_map(|line| {
                let places = line.point_mm.iter().chain(line.direction.iter()).copied();
                std::iter::once(line.axis as f64).chain(places)
            });
            std::iter::once(lines.len() as f64)
                .chain(numbers)
                .collect::<Vec<_>>()
        };
        let slides = self.slides.iter().map(|axis| *axis as f64);
        slides
            .chain(lines(&self.work))
            .chain(lines(&self.tool))
            .collect()
    }

    fn slides_of(&self, place: &AxisVector) -> Point {
        Point::from(slides_of(self.slides, place))
    }

    fn with_slides(&self, place: AxisVector, slides: Point) -> AxisVector {
        with_slides(self.slides, place, slides.into())
    }

    /// Where a point goes that these lines carry.
    fn carried(lines: &[RotaryLine], axes: &AxisVector, point: Point) -> Point {
        let turn = |point, line: &RotaryLine| line.turned(point, line.angle_rad(axes));
        lines.iter().rev().fold(point, turn)
    }

    /// Place of the axes for a programmed place, with a tool of this length, in mm.
    pub fn axes(&self, programmed: &AxisVector, length_mm: &AxisVector) -> AxisVector {
        let length = self.slides_of(length_mm);
        let on_work = self.slides_of(programmed) - length;
        let tip = Self::carried(&self.work, programmed, on_work);
        let from_slides = Self::carried(&self.tool, programmed, -length);
        self.with_slides(*programmed, tip - from_slides)
    }

    /// The programmed place for a place of the axes: the other way round.
    pub fn programmed(&self, axes: &AxisVector, length_mm: &AxisVector) -> AxisVector {
        let length = self.slides_of(length_mm);
        let tip = self.slides_of(axes) + Self::carried(&self.tool, axes, -length);
        let back = |point, line: &RotaryLine| line.turned(point, -line.angle_rad(axes));
        let on_work = self.work.iter().fold(tip, back);
        self.with_slides(*axes, on_work + length)
    }

    /// Largest distance of a point from any of the lines that carry it, wherever they have turned, in mm.
    fn reach_mm(lines: &[RotaryLine], point: Point) -> f64 {
        let mut reach_mm = 0.0;
        let mut at = point;
        for line in lines.iter().rev() {
            reach_mm += (at - line.point_mm).norm();
            at = line.point_mm;
        }
        reach_mm
    }

    /// How far a degree of all rotary axes moves the tip on the work at most, in mm, with the tool at a programmed place.
    pub fn mm_per_degree(&self, programmed: &AxisVector, length_mm: &AxisVector) -> f64 {
        let length = self.slides_of(length_mm);
        let of_work = Self::reach_mm(&self.work, self.slides_of(programmed) - length);
        (of_work + Self::reach_mm(&self.tool, -length)).to_radians()
    }

    /// A programmed shape as the axes go along it, from where they are: itself where nothing turns, else lines whose ends are on it and
    /// that leave it by at most `chord_mm` between; none where that takes more than [`PIECES_MAX`].
    ///
    /// Between its ends a line leaves the curve by an eighth of the curve's second derivative, times the square of its share, at most. That
    /// of the slides is bounded by what turns: `ω²` at a distance, and `2ω` times the speed.
    pub fn pieces(
        &self,
        shape: &Shape,
        from: AxisVector,
        length_mm: &AxisVector,
        chord_mm: f64,
    ) -> Option<Vec<Shape>> {
        let (start, end) = (shape.start(), shape.end());
        let turn_of = |lines: &[RotaryLine]| -> f64 {
            let turns = lines.iter().map(|line| {
                let way = |place: &AxisVector| line.angle_rad(place);
                (way(&end) - way(&start)).abs()
            });
            turns.sum()
        };
        let (of_work, of_tool) = (turn_of(&self.work), turn_of(&self.tool));
        if of_work + of_tool == 0.0 {
            return Some(vec![self.moved(shape, from, length_mm)]);
        }
        let (speed_mm, bend_mm) = match shape {
            Shape::Arc {
                radius_mm,
                sweep_rad,
                axial,
                ..
            } => (
                libm::hypot(radius_mm * sweep_rad, self.slides_of(axial).norm()),
                radius_mm * sweep_rad * sweep_rad,
            ),
            _ => (self.slides_of(&(end - start)).norm(), 0.0),
        };
        let length = self.slides_of(length_mm);
        let work_mm = Self::reach_mm(&self.work, self.slides_of(&start) - length) + speed_mm;
        let tool_mm = Self::reach_mm(&self.tool, -length);
        let bend_mm = bend_mm
            + 2.0 * of_work * speed_mm
            + of_work * of_work * work_mm
            + of_tool * of_tool * tool_mm;
        let count = libm::ceil(libm::sqrt(bend_mm / (8.0 * chord_mm))).max(1.0);
        if count.is_nan() || count > PIECES_MAX {
            return None;
        }
        let mut from = from;
        let pieces = (1..=count as u32).map(|piece| {
            let to = self.axes(&shape.at_share(f64::from(piece) / count), length_mm);
            let line = Shape::Line { from, to };
            from = to;
            line
        });
        Some(pieces.collect())
    }

    /// A shape along which nothing turns, from where the axes are: as rigid as it is.
    fn moved(&self, shape: &Shape, start: AxisVector, length_mm: &AxisVector) -> Shape {
        let turned = |direction: &AxisVector| self.direction(&shape.start(), direction);
        let mut moved = shape.moved(|place| self.axes(place, length_mm), turned);
        match &mut moved {
            Shape::Line { from, .. } | Shape::Arc { from, .. } => *from = start,
            Shape::Dwell { at, .. } => *at = start,
        }
        moved
    }

    /// A direction on the work, as the slides go with the axes at a place.
    fn direction(&self, axes: &AxisVector, direction: &AxisVector) -> AxisVector {
        let ends = [self.slides_of(direction), Point::zeros()];
        let [end, zero] = ends.map(|point| Self::carried(&self.work, axes, point));
        self.with_slides(*direction, end - zero)
    }

    /// Direction of the tool on the work, from its tip to its holder; a tool along Z with all rotary axes at 0.
    pub fn tool_direction(&self, axes: &AxisVector) -> [f64; 3] {
        let turned = |direction: Point, (line, sign): &(RotaryLine, f64)| {
            line.of_directions()
                .turned(direction, sign * line.angle_rad(axes))
        };
        let turns = self.turns_of_tool();
        turns.iter().rev().fold(Point::z(), turned).into()
    }

    /// What turns the tool against the work, the line nearest to the work first, and whether positive angles do so forward or backward.
    fn turns_of_tool(&self) -> Vec<(RotaryLine, f64)> {
        let of_work = self.work.iter().rev().map(|line| (*line, -1.0));
        let of_tool = self.tool.iter().map(|line| (*line, 1.0));
        of_work.chain(of_tool).collect()
    }

    /// Angles of the two rotary axes at which the tool stands along a direction on the work, each as an axis and degrees from −180 to
    /// 180; none for an axis that may stand anywhere. There are two ways at most, none where the axes cannot, or are not two (Paden and
    /// Kahan's second subproblem: R. Murray, Z. Li, S. Sastry, *A Mathematical Introduction to Robotic Manipulation*, 1994, §3.2).
    pub fn orientations(&self, direction: [f64; 3]) -> Vec<[(usize, Option<f64>); 2]> {
        let turns = self.turns_of_tool();
        let [(outer, outer_sign), (inner, inner_sign)] = turns.as_slice() else {
            return Vec::new();
        };
        let wanted = Point::from(direction).normalize();
        let tool = Point::z();
        let (k1, k2) = (outer.direction, inner.direction);
        // Between both turns the tool keeps its share along the inner line and has that of the outer one already.
        let (s, p1, p2) = (k1.dot(&k2), k1.dot(&wanted), k2.dot(&tool));
        let skew = 1.0 - s * s;
        if skew < SAME_DIRECTION {
            return Vec::new();
        }
        let (a, b) = ((p1 - s * p2) / skew, (p2 - s * p1) / skew);
        let left = 1.0 - a * a - b * b - 2.0 * a * b * s;
        if left.is_nan() || left < -SAME_DIRECTION {
            return Vec::new();
        }
        let across = k1.cross(&k2) * libm::sqrt(left.max(0.0) / skew);
        let ways = if left > SAME_DIRECTION { 2 } else { 1 };
        let solutions = [across, -across].into_iter().take(ways).map(|across| {
            let between = k1 * a + k2 * b + across;
            let outer_deg = angle_deg(k1, between, wanted).map(|angle| angle * outer_sign);
            let inner_deg = angle_deg(k2, tool, between).map(|angle| angle * inner_sign);
            [(outer.axis, outer_deg), (inner.axis, inner_deg)]
        });
        solutions.collect()
    }
}

/// Directions are the same whose sine is below the root of this.
const SAME_DIRECTION: f64 = 1e-18;

/// The angle about a direction from one vector to another; none where both lie along it.
fn angle_deg(about: Point, from: Point, to: Point) -> Option<f64> {
    let along = about.dot(&from) * about.dot(&to);
    let (sin, cos) = (about.dot(&from.cross(&to)), from.dot(&to) - along);
    (libm::hypot(sin, cos) > ALONG).then(|| libm::atan2(sin, cos).to_degrees())
}

/// A vector that is nearer to a direction lies along it.
const ALONG: f64 = 1e-12;
