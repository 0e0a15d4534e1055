//! Path geometry: the elements a part program expands into, each a curve parameterised by its own length.
//!
//! A [`Path`] is a pure function of the program, the machine file and the start position. It knows nothing of speed or
//! time: the same point is named by the same (element, distance) whatever the feed, the override or the moment of a
//! restart, which is what lets a restarted planner go on from a tag it reads in the feedback.

mod correction;
mod shape;
#[cfg(test)]
mod tests;

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use nalgebra::SVector;

pub use correction::{Correction, CubicPiece};

/// The most axes that a path moves: one for each letter. A cell may have other axes beside these.
pub const PATH_AXES: usize = 9;

/// One value per axis, in axis units (mm for slides, degrees for rotary axes); unused axes are zero.
pub type AxisVector = SVector<f64, PATH_AXES>;

/// Which axes are rotary (true); they count in degrees and stay out of a path length as long as any slide moves.
pub type RotaryAxes = [bool; PATH_AXES];

/// No rotary axis: every axis counts in the path length.
pub const ALL_LINEAR: RotaryAxes = [false; PATH_AXES];

/// How fast an element may be travelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Feed {
    /// As fast as the axes allow (G0).
    Rapid,
    /// Along the path, in mm/s (G1, G2, G3).
    PathMmS(f64),
}

/// How far the path that is travelled may leave the programmed one (G64), in mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathTolerance {
    /// At corners (P); 0: the path is travelled exactly (G61).
    pub corner_mm: f64,
    /// Along chords that stand for a curve (Q); 0: as at corners.
    pub chord_mm: f64,
    /// Of rotary axes, in degrees; 0: as the machine has it.
    pub rotary_deg: f64,
}

impl PathTolerance {
    /// The path is travelled exactly.
    pub const EXACT: Self = Self {
        corner_mm: 0.0,
        chord_mm: 0.0,
        rotary_deg: 0.0,
    };
}

/// The curve of one element.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "a path is one block of memory, read in every scan: no pointer per arc"
)]
pub enum Shape {
    /// A straight line.
    Line {
        /// Start, in axis units.
        from: AxisVector,
        /// End, in axis units.
        to: AxisVector,
    },
    /// A circular arc or helix: `centre + radius·(u·cos φ + v·sin φ) + axial·τ`, φ from `start_angle_rad` over
    /// `sweep_rad`, τ from 0 to 1 in proportion.
    Arc {
        /// Start, in axis units; on the circle to rounding.
        from: AxisVector,
        /// End, in axis units; on the circle to rounding. Stored, so that the next element starts at the same bits.
        to: AxisVector,
        /// Centre of the circle at the start of the sweep, in axis units.
        centre: AxisVector,
        /// Radius in mm, above 0.
        radius_mm: f64,
        /// First unit vector of the plane.
        u: AxisVector,
        /// Second unit vector of the plane (counter-clockwise from `u`).
        v: AxisVector,
        /// Angle at the start, from `u`.
        start_angle_rad: f64,
        /// Signed angle travelled, positive counter-clockwise.
        sweep_rad: f64,
        /// Travel of the axes out of the plane over the whole sweep; zero for a plane arc.
        axial: AxisVector,
    },
    /// No motion for a time (G4).
    Dwell {
        /// Where the machine waits.
        at: AxisVector,
        /// How long, in s.
        seconds: f64,
    },
}

/// One piece of path, made from one block of the program.
#[derive(Debug, Clone, PartialEq)]
pub struct Element {
    /// Line of the program file it comes from, counted from 1.
    pub line: u32,
    /// Its curve.
    pub shape: Shape,
    /// Its speed limit from the program.
    pub feed: Feed,
    /// Length along the curve in mm (degrees if only rotary axes move); 0 for a dwell.
    pub length_mm: f64,
    /// The tool comes to rest before it, whatever stands before: something happens there first.
    pub rests_before: bool,
    /// How far the path that is travelled may leave it.
    pub tolerance: PathTolerance,
    /// What [rounding](crate::rounding) adds to its curve; none where it is travelled as programmed.
    pub rounding: Option<Arc<Correction>>,
}

/// The whole path of a program.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Path {
    /// In order of travel; each starts exactly where the one before ends.
    pub elements: Vec<Element>,
}

/// A vector of the first axes alone.
pub(crate) fn first_axes<const AXES: usize>(vector: &AxisVector) -> SVector<f64, AXES> {
    vector.fixed_rows::<AXES>(0).into_owned()
}

/// The unit vector of one axis; zero for an index no cell has.
pub fn axis_unit(axis: usize) -> AxisVector {
    let mut unit = AxisVector::zeros();
    if let Some(component) = unit.get_mut(axis) {
        *component = 1.0;
    }
    unit
}

/// Length of a straight displacement: of its slides if any of them moves (mm), else of its rotary axes (degrees), as
/// feed words are read by RS274/NGC (Kramer, Proctor, Messina 2000, §2.1.2.5).
pub fn displacement_length_mm(displacement: &AxisVector, rotary: &RotaryAxes) -> f64 {
    let squared = |of_rotary: bool| -> f64 {
        let picked = displacement
            .iter()
            .zip(rotary)
            .filter(|&(_, &is_rotary)| is_rotary == of_rotary);
        picked.map(|(component, _)| component * component).sum()
    };
    let linear = squared(false);
    if linear > 0.0 {
        linear.sqrt()
    } else {
        squared(true).sqrt()
    }
}

/// Angle travelled about a centre from `from` to `to` in the plane of axes `plane` (first, second), in rad: positive
/// counter-clockwise, negative clockwise. `turns` ≥ 1 counts the turns, the last included, as the P word does; 0 is read as 1.
///
/// Ends closer together than `full_circle_chord_mm` in the plane are one point: a full circle.
pub fn sweep_between_rad(
    from: &AxisVector,
    to: &AxisVector,
    centre: &AxisVector,
    plane: [usize; 2],
    clockwise: bool,
    turns: u32,
    full_circle_chord_mm: f64,
) -> f64 {
    let (u, v) = (axis_unit(plane[0]), axis_unit(plane[1]));
    let (start, end, chord) = (from - centre, to - centre, to - from);
    let more_rad = TAU * f64::from(turns.max(1) - 1);
    let angle_rad = if libm::hypot(chord.dot(&u), chord.dot(&v)) <= full_circle_chord_mm {
        TAU
    } else {
        let (ax, ay, bx, by) = (start.dot(&u), start.dot(&v), end.dot(&u), end.dot(&v));
        // From cross and dot product: exact zero for equal directions, no loss by subtracting two angles.
        let counter_clockwise_rad = libm::atan2(ax * by - ay * bx, ax * bx + ay * by);
        let along_rad = if clockwise {
            -counter_clockwise_rad
        } else {
            counter_clockwise_rad
        };
        if along_rad <= 0.0 {
            along_rad + TAU
        } else {
            along_rad
        }
    };
    if clockwise {
        -(angle_rad + more_rad)
    } else {
        angle_rad + more_rad
    }
}

impl Element {
    /// An element of a given shape; its length leaves out rotary axes as [`Shape::length_with_rotary_mm`] says.
    pub fn new(line: u32, shape: Shape, feed: Feed, rotary: &RotaryAxes) -> Self {
        let length_mm = shape.length_with_rotary_mm(rotary);
        Self {
            line,
            shape,
            feed,
            length_mm,
            rests_before: false,
            tolerance: PathTolerance::EXACT,
            rounding: None,
        }
    }

    /// A straight line of slides.
    pub fn line(line: u32, from: AxisVector, to: AxisVector, feed: Feed) -> Self {
        Self::new(line, Shape::Line { from, to }, feed, &ALL_LINEAR)
    }

    /// An arc or helix of slides in the plane of the axes `plane` (first, second) about `centre`; axes out of the plane
    /// go from `from` to `to` in proportion to the angle.
    ///
    /// The radius is that of `from`; that `to` lies on the same circle after `sweep_rad` is the caller's to see to.
    pub fn arc(
        line: u32,
        from: AxisVector,
        to: AxisVector,
        centre: AxisVector,
        plane: [usize; 2],
        sweep_rad: f64,
        feed: Feed,
    ) -> Self {
        Self::new(
            line,
            Self::arc_shape(from, to, centre, plane, sweep_rad),
            feed,
            &ALL_LINEAR,
        )
    }

    /// The shape behind [`Element::arc`], for machines with rotary axes.
    pub fn arc_shape(
        from: AxisVector,
        to: AxisVector,
        centre: AxisVector,
        plane: [usize; 2],
        sweep_rad: f64,
    ) -> Shape {
        let (u, v) = (axis_unit(plane[0]), axis_unit(plane[1]));
        let spoke = from - centre;
        let (first_mm, second_mm) = (spoke.dot(&u), spoke.dot(&v));
        // The centre carries the start position of the axes out of the plane.
        let centre = from - u * first_mm - v * second_mm;
        let travel = to - from;
        Shape::Arc {
            from,
            to,
            centre,
            radius_mm: libm::hypot(first_mm, second_mm),
            u,
            v,
            start_angle_rad: libm::atan2(second_mm, first_mm),
            sweep_rad,
            axial: travel - u * travel.dot(&u) - v * travel.dot(&v),
        }
    }

    /// A wait at one place. Its feed is [`Feed::Rapid`]: nothing limits what does not move.
    pub fn dwell(line: u32, at: AxisVector, seconds: f64) -> Self {
        Self {
            line,
            shape: Shape::Dwell { at, seconds },
            feed: Feed::Rapid,
            length_mm: 0.0,
            rests_before: false,
            tolerance: PathTolerance::EXACT,
            rounding: None,
        }
    }

    /// Where it starts, to the bit.
    pub fn start(&self) -> AxisVector {
        self.shape.start()
    }

    /// Where it ends, to the bit.
    pub fn end(&self) -> AxisVector {
        self.shape.end()
    }

    /// Lowest and highest position of each axis on it, extreme points of arcs included.
    pub fn bounds(&self) -> (AxisVector, AxisVector) {
        self.shape.bounds()
    }

    /// Whether it is a wait without motion.
    pub fn is_dwell(&self) -> bool {
        matches!(self.shape, Shape::Dwell { .. })
    }

    /// The point `distance_mm` along it, rounded if it is. Unrounded, at and before 0 this is the stored start, at and beyond its
    /// length the stored end, to the bit.
    pub fn point(&self, distance_mm: f64) -> AxisVector {
        self.first_at(distance_mm)
    }

    /// The same of the first axes alone, to the bit.
    pub(crate) fn first_at<const AXES: usize>(&self, distance_mm: f64) -> SVector<f64, AXES> {
        let programmed = self.first_programmed(distance_mm);
        let distance_mm = distance_mm.clamp(0.0, self.length_mm);
        let correction = self.rounding.as_ref();
        match correction.and_then(|correction| correction.piece_at(distance_mm)) {
            Some(piece) => programmed + piece.first_axes().value_at(distance_mm),
            None => programmed,
        }
    }

    /// The point `distance_mm` along it as it is programmed.
    pub fn programmed_point(&self, distance_mm: f64) -> AxisVector {
        self.first_programmed(distance_mm)
    }

    fn first_programmed<const AXES: usize>(&self, distance_mm: f64) -> SVector<f64, AXES> {
        if distance_mm <= 0.0 {
            return first_axes(&self.start());
        }
        if distance_mm >= self.length_mm {
            return first_axes(&self.end());
        }
        self.shape.first_at_share(distance_mm / self.length_mm)
    }

    fn added(&self, correction: &Correction, distance_mm: f64) -> [AxisVector; 2] {
        correction.slopes_at(distance_mm.clamp(0.0, self.length_mm))
    }

    /// Derivative of the point with respect to the distance: a unit vector where only slides move and nothing is rounded. Beyond the
    /// ends the tangent at the end; zero for a dwell.
    pub fn tangent(&self, distance_mm: f64) -> AxisVector {
        let programmed = self.shape.tangent(distance_mm, self.length_mm);
        match &self.rounding {
            Some(correction) => programmed + self.added(correction, distance_mm)[0],
            None => programmed,
        }
    }

    /// Second derivative of the point with respect to the distance, in 1/mm; zero for lines and dwells where nothing is rounded. Times the
    /// path speed squared it is the centripetal acceleration of each axis.
    pub fn curvature_per_mm(&self, distance_mm: f64) -> AxisVector {
        let programmed = self.shape.curvature_per_mm(distance_mm, self.length_mm);
        match &self.rounding {
            Some(correction) => programmed + self.added(correction, distance_mm)[1],
            None => programmed,
        }
    }

    /// Length of the second derivative of the programmed curve, the same all along the element: 1/radius for a plane arc.
    pub fn curvature_magnitude_per_mm(&self) -> f64 {
        self.shape.curvature_magnitude_per_mm(self.length_mm)
    }

    /// The place on the element nearest to `point`: (distance along it, distance of the point from it), in mm. This is
    /// the contour error of a measured position.
    ///
    /// A line projects; an arc projects the angle; a helix refines both candidates of neighbouring turns by Newton
    /// steps. Where several turns of a circle lie over each other the first is named. NaN in gives NaN deviation.
    pub fn closest_distance(&self, point: &AxisVector) -> (f64, f64) {
        let deviation_mm = |distance_mm: f64| (point - self.point(distance_mm)).norm();
        if self.rounding.is_some() {
            return self.closest_on_rounded(point);
        }
        let mut best = (0.0, deviation_mm(0.0));
        let mut offer = |distance_mm: f64| {
            let deviation_mm = deviation_mm(distance_mm);
            if deviation_mm < best.1 {
                best = (distance_mm, deviation_mm);
            }
        };
        match &self.shape {
            Shape::Dwell { .. } => {}
            Shape::Line { from, to } => {
                let chord = to - from;
                let share = (point - from).dot(&chord) / chord.norm_squared();
                offer(share.clamp(0.0, 1.0) * self.length_mm);
                offer(self.length_mm);
            }
            Shape::Arc {
                centre,
                u,
                v,
                start_angle_rad,
                sweep_rad,
                axial,
                ..
            } => {
                let spoke = point - centre;
                let turn = TAU / sweep_rad.abs();
                // Share of the sweep at which the angle is that of the point, first turn.
                let angle_rad = libm::atan2(spoke.dot(v), spoke.dot(u)) - start_angle_rad;
                let along_rad = if *sweep_rad < 0.0 {
                    -angle_rad
                } else {
                    angle_rad
                };
                let first_share = (along_rad / TAU - libm::floor(along_rad / TAU)) * turn;
                let axial_squared = axial.norm_squared();
                if axial_squared > 0.0 {
                    let level_share = (spoke.dot(axial) / axial_squared).clamp(0.0, 1.0);
                    let turns_below = libm::floor((level_share - first_share) / turn);
                    for share in [
                        level_share,
                        first_share + turns_below * turn,
                        first_share + (turns_below + 1.0) * turn,
                    ] {
                        offer(self.refine_closest(point, share.clamp(0.0, 1.0) * self.length_mm));
                    }
                } else if first_share <= 1.0 {
                    offer(first_share * self.length_mm);
                }
                offer(self.length_mm);
            }
        }
        best
    }

    /// The same on a rounded element: from the place that is nearest on the programmed one.
    fn closest_on_rounded(&self, point: &AxisVector) -> (f64, f64) {
        let programmed = Self {
            rounding: None,
            ..self.clone()
        };
        let (nearest_mm, _) = programmed.closest_distance(point);
        let starts = [nearest_mm, 0.0, self.length_mm];
        let places = starts.map(|start_mm| self.refine_closest(point, start_mm));
        let both = places.into_iter().chain(starts);
        let offers = both.map(|place_mm| (place_mm, (point - self.point(place_mm)).norm()));
        offers
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((nearest_mm, f64::NAN))
    }

    /// Newton steps on ½|point − curve(s)|² from a starting distance, kept inside the element.
    fn refine_closest(&self, point: &AxisVector, start_mm: f64) -> f64 {
        let mut distance_mm = start_mm;
        for _ in 0..12 {
            let gap = point - self.point(distance_mm);
            let tangent = self.tangent(distance_mm);
            let speed_squared = tangent.norm_squared();
            let full = speed_squared - gap.dot(&self.curvature_per_mm(distance_mm));
            // Outside the region where Newton descends, the Gauss-Newton step still does.
            let slope = if full > 0.1 * speed_squared {
                full
            } else {
                speed_squared
            };
            let step_mm = gap.dot(&tangent) / slope;
            if !step_mm.is_finite() {
                break;
            }
            let next_mm = (distance_mm + step_mm).clamp(0.0, self.length_mm);
            if next_mm == distance_mm {
                break;
            }
            distance_mm = next_mm;
        }
        distance_mm
    }
}

impl Path {
    /// Sum of the lengths of all elements, in mm.
    pub fn length_mm(&self) -> f64 {
        let lengths = self.elements.iter().map(|element| element.length_mm);
        lengths.fold(0.0, |sum, length| sum + length)
    }

    /// Where it starts; none for an empty path.
    pub fn start(&self) -> Option<AxisVector> {
        self.elements.first().map(Element::start)
    }

    /// Where it ends; none for an empty path.
    pub fn end(&self) -> Option<AxisVector> {
        self.elements.last().map(Element::end)
    }

    /// Lowest and highest position of each axis, extreme points of arcs included; none for an empty path.
    pub fn bounds(&self) -> Option<(AxisVector, AxisVector)> {
        let mut low = self.start()?;
        let mut high = low;
        for element in &self.elements {
            element.shape.widen(&mut low, &mut high);
        }
        Some((low, high))
    }

    /// Line of the program file an element comes from.
    pub fn line_of(&self, element: usize) -> Option<u32> {
        self.elements.get(element).map(|element| element.line)
    }

    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        let feed =
            |feed: Feed| !matches!(feed, Feed::PathMmS(speed_mm_s) if !speed_mm_s.is_finite());
        self.elements.iter().all(|element| {
            element.shape.is_finite() && element.length_mm.is_finite() && feed(element.feed)
        })
    }

    /// The first element that does not start, to the bit, where the one before ends.
    pub fn first_break(&self) -> Option<usize> {
        let same = |a: &AxisVector, b: &AxisVector| {
            a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
        };
        let pairs = self.elements.iter().zip(self.elements.iter().skip(1));
        pairs
            .enumerate()
            .find(|(_, (a, b))| !same(&a.end(), &b.start()))
            .map(|(index, _)| index + 1)
    }
}
