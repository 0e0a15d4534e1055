//! Path geometry: the elements a part program expands into, each a curve parameterised by its own length.
//!
//! A [`Path`] is a pure function of the program, the machine file and the start position. It knows nothing of speed or
//! time: the same point is named by the same (element, distance) whatever the feed, the override or the moment of a
//! restart, which is what lets a restarted planner go on from a tag it reads in the feedback.

use std::f64::consts::{PI, TAU};

use nalgebra::SVector;

/// The most axes one cell can have.
pub const MAX_AXES: usize = 8;

/// One value per axis, in axis units (mm for slides, degrees for rotary axes); unused axes are zero.
pub type AxisVector = SVector<f64, MAX_AXES>;

/// Which axes are rotary (true); they count in degrees and stay out of a path length as long as any slide moves.
pub type RotaryAxes = [bool; MAX_AXES];

/// No rotary axis: every axis counts in the path length.
pub const ALL_LINEAR: RotaryAxes = [false; MAX_AXES];

/// How fast an element may be travelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Feed {
    /// As fast as the axes allow (G0).
    Rapid,
    /// Along the path, in mm/s (G1, G2, G3).
    PathMmS(f64),
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
}

/// The whole path of a program.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Path {
    /// In order of travel; each starts exactly where the one before ends.
    pub elements: Vec<Element>,
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
/// counter-clockwise, negative clockwise. `turns` ≥ 1 counts the turns begun, as the P word does; 0 is read as 1.
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

impl Shape {
    /// Where it starts, to the bit.
    pub fn start(&self) -> AxisVector {
        match self {
            Shape::Line { from, .. } | Shape::Arc { from, .. } => *from,
            Shape::Dwell { at, .. } => *at,
        }
    }

    /// Where it ends, to the bit.
    pub fn end(&self) -> AxisVector {
        match self {
            Shape::Line { to, .. } | Shape::Arc { to, .. } => *to,
            Shape::Dwell { at, .. } => *at,
        }
    }

    /// Length along the curve if every axis is a slide, in mm; 0 for a dwell.
    pub fn length_mm(&self) -> f64 {
        self.length_with_rotary_mm(&ALL_LINEAR)
    }

    /// Length along the curve: of its slides, in mm, if any of them moves, else of its rotary axes, in degrees. Rotary
    /// axes that travel together with slides follow in proportion. 0 for a dwell.
    pub fn length_with_rotary_mm(&self, rotary: &RotaryAxes) -> f64 {
        match self {
            Shape::Line { from, to } => displacement_length_mm(&(to - from), rotary),
            Shape::Arc {
                radius_mm,
                sweep_rad,
                axial,
                ..
            } => {
                let mut slides = *axial;
                for (component, is_rotary) in slides.iter_mut().zip(rotary) {
                    if *is_rotary {
                        *component = 0.0;
                    }
                }
                let around_mm = radius_mm * sweep_rad;
                (around_mm * around_mm + slides.norm_squared()).sqrt()
            }
            Shape::Dwell { .. } => 0.0,
        }
    }

    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        let all = |vector: &AxisVector| vector.iter().all(|component| component.is_finite());
        match self {
            Shape::Line { from, to } => all(from) && all(to),
            Shape::Arc {
                from,
                to,
                centre,
                radius_mm,
                u,
                v,
                start_angle_rad,
                sweep_rad,
                axial,
            } => {
                [from, to, centre, u, v, axial].into_iter().all(all)
                    && radius_mm.is_finite()
                    && start_angle_rad.is_finite()
                    && sweep_rad.is_finite()
            }
            Shape::Dwell { at, seconds } => all(at) && seconds.is_finite(),
        }
    }

    /// Lowest and highest position of each axis on it, extreme points of arcs included.
    pub fn bounds(&self) -> (AxisVector, AxisVector) {
        let (mut low, mut high) = (self.start(), self.start());
        self.widen(&mut low, &mut high);
        (low, high)
    }

    /// Widens `low` and `high` to hold every point of the curve; an arc's extreme points are found in closed form.
    fn widen(&self, low: &mut AxisVector, high: &mut AxisVector) {
        let mut take = |axis: usize, value: f64| {
            if let (Some(low), Some(high)) = (low.get_mut(axis), high.get_mut(axis)) {
                *low = low.min(value);
                *high = high.max(value);
            }
        };
        for end in [self.start(), self.end()] {
            end.iter()
                .enumerate()
                .for_each(|(axis, value)| take(axis, *value));
        }
        let Shape::Arc {
            centre,
            radius_mm,
            u,
            v,
            start_angle_rad,
            sweep_rad,
            axial,
            ..
        } = self
        else {
            return;
        };
        let (from_rad, to_rad) = if *sweep_rad < 0.0 {
            (start_angle_rad + sweep_rad, *start_angle_rad)
        } else {
            (*start_angle_rad, start_angle_rad + sweep_rad)
        };
        let components = centre.iter().zip(u.iter()).zip(v.iter()).zip(axial.iter());
        for (axis, (((centre, u), v), axial)) in components.enumerate() {
            // On this axis the arc is amplitude·cos(φ − phase) + axial·τ; its slope is zero where
            // sin(φ − phase) = axial / (amplitude·sweep).
            let amplitude_mm = radius_mm * libm::hypot(*u, *v);
            let sine = axial / (amplitude_mm * sweep_rad);
            if amplitude_mm == 0.0 || !(-1.0..=1.0).contains(&sine) {
                continue;
            }
            let phase_rad = libm::atan2(*v, *u);
            for relative_rad in [libm::asin(sine), PI - libm::asin(sine)] {
                let angle_rad = phase_rad + relative_rad;
                let first = libm::ceil((from_rad - angle_rad) / TAU);
                let last = libm::floor((to_rad - angle_rad) / TAU);
                if first > last {
                    continue;
                }
                for turn in [first, last] {
                    let share =
                        ((angle_rad + turn * TAU - start_angle_rad) / sweep_rad).clamp(0.0, 1.0);
                    take(
                        axis,
                        centre + amplitude_mm * libm::cos(relative_rad) + axial * share,
                    );
                }
            }
        }
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

    /// The point `distance_mm` along it. At and before 0 this is the stored start, at and beyond its length the stored
    /// end, to the bit.
    pub fn point(&self, distance_mm: f64) -> AxisVector {
        if distance_mm <= 0.0 {
            return self.start();
        }
        if distance_mm >= self.length_mm {
            return self.end();
        }
        let share = distance_mm / self.length_mm;
        match &self.shape {
            Shape::Line { from, to } => from + (to - from) * share,
            Shape::Arc {
                centre,
                radius_mm,
                u,
                v,
                start_angle_rad,
                sweep_rad,
                axial,
                ..
            } => {
                let angle_rad = start_angle_rad + sweep_rad * share;
                centre
                    + u * (radius_mm * libm::cos(angle_rad))
                    + v * (radius_mm * libm::sin(angle_rad))
                    + axial * share
            }
            Shape::Dwell { at, .. } => *at,
        }
    }

    /// Derivative of the point with respect to the distance: a unit vector where only slides move. Beyond the ends the
    /// tangent at the end; zero for a dwell.
    pub fn tangent(&self, distance_mm: f64) -> AxisVector {
        if self.length_mm <= 0.0 {
            return AxisVector::zeros();
        }
        match &self.shape {
            Shape::Line { from, to } => (to - from) / self.length_mm,
            Shape::Arc {
                radius_mm,
                u,
                v,
                start_angle_rad,
                sweep_rad,
                axial,
                ..
            } => {
                let share = (distance_mm / self.length_mm).clamp(0.0, 1.0);
                let angle_rad = start_angle_rad + sweep_rad * share;
                let around_mm = radius_mm * sweep_rad;
                (v * (around_mm * libm::cos(angle_rad)) - u * (around_mm * libm::sin(angle_rad))
                    + axial)
                    / self.length_mm
            }
            Shape::Dwell { .. } => AxisVector::zeros(),
        }
    }

    /// Second derivative of the point with respect to the distance, in 1/mm; zero for lines and dwells. Times the path
    /// speed squared it is the centripetal acceleration of each axis.
    pub fn curvature_per_mm(&self, distance_mm: f64) -> AxisVector {
        match &self.shape {
            Shape::Arc {
                u,
                v,
                start_angle_rad,
                sweep_rad,
                ..
            } if self.length_mm > 0.0 => {
                let share = (distance_mm / self.length_mm).clamp(0.0, 1.0);
                let angle_rad = start_angle_rad + sweep_rad * share;
                (u * libm::cos(angle_rad) + v * libm::sin(angle_rad))
                    * -self.curvature_magnitude_per_mm()
            }
            _ => AxisVector::zeros(),
        }
    }

    /// Length of [`Element::curvature_per_mm`], the same all along the element: 1/radius for a plane arc.
    pub fn curvature_magnitude_per_mm(&self) -> f64 {
        match &self.shape {
            Shape::Arc {
                radius_mm,
                sweep_rad,
                ..
            } if self.length_mm > 0.0 => {
                let angle_per_mm = sweep_rad / self.length_mm;
                radius_mm * angle_per_mm * angle_per_mm
            }
            _ => 0.0,
        }
    }

    /// The place on the element nearest to `point`: (distance along it, distance of the point from it), in mm. This is
    /// the contour error of a measured position.
    ///
    /// A line projects; an arc projects the angle; a helix refines both candidates of neighbouring turns by Newton
    /// steps. Where several turns of a circle lie over each other the first is named. NaN in gives NaN deviation.
    pub fn closest_distance(&self, point: &AxisVector) -> (f64, f64) {
        let deviation_mm = |distance_mm: f64| (point - self.point(distance_mm)).norm();
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
        self.elements.iter().map(|element| element.length_mm).sum()
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FEED: Feed = Feed::PathMmS(50.0);
    const XY: [usize; 2] = [0, 1];

    fn at(values: &[f64]) -> AxisVector {
        let mut vector = AxisVector::zeros();
        for (component, value) in vector.iter_mut().zip(values) {
            *component = *value;
        }
        vector
    }

    fn circle(radius_mm: f64, sweep_rad: f64, axial_mm: f64) -> Element {
        let to = at(&[
            radius_mm * libm::cos(sweep_rad),
            radius_mm * libm::sin(sweep_rad),
            axial_mm,
        ]);
        Element::arc(3, at(&[radius_mm, 0.0]), to, at(&[]), XY, sweep_rad, FEED)
    }

    /// Any line or arc of a size a machine tool has, in any of the three planes.
    fn any_element() -> impl Strategy<Value = Element> {
        let coordinate = || -300.0..300.0f64;
        let point =
            move || [coordinate(), coordinate(), coordinate()].prop_map(|values| at(&values));
        let line = (point(), point()).prop_map(|(from, to)| Element::line(1, from, to, FEED));
        let plane = prop_oneof![Just([0, 1]), Just([2, 0]), Just([1, 2])];
        let sweep = prop_oneof![0.01..14.0f64, -14.0..-0.01f64];
        let axial = prop_oneof![Just(0.0), -50.0..50.0f64];
        let arc = (point(), plane, 0.5..200.0f64, -3.1..3.1f64, sweep, axial).prop_map(
            |(centre, plane, radius_mm, start_rad, sweep_rad, axial_mm)| {
                let (u, v) = (axis_unit(plane[0]), axis_unit(plane[1]));
                let on_circle =
                    |angle: f64| centre + (u * libm::cos(angle) + v * libm::sin(angle)) * radius_mm;
                let normal = axis_unit(3 - plane[0] - plane[1]);
                let (from, to) = (
                    on_circle(start_rad),
                    on_circle(start_rad + sweep_rad) + normal * axial_mm,
                );
                Element::arc(2, from, to, centre, plane, sweep_rad, FEED)
            },
        );
        prop_oneof![line, arc]
    }

    #[test]
    fn a_line_is_as_long_as_its_chord_and_ends_where_it_was_told() {
        let element = Element::line(7, at(&[0.1, 0.2]), at(&[3.1, 4.2]), FEED);
        assert!((element.length_mm - 5.0).abs() < 1e-14);
        assert_eq!(element.point(element.length_mm), at(&[3.1, 4.2]));
        assert_eq!(element.point(0.0), at(&[0.1, 0.2]));
        assert_eq!(element.curvature_magnitude_per_mm(), 0.0);
    }

    #[test]
    fn a_full_circle_is_two_pi_r_long_and_curved_by_one_over_r() {
        let element = circle(25.0, TAU, 0.0);
        assert!((element.length_mm - 50.0 * PI).abs() < 1e-12);
        assert!((element.curvature_magnitude_per_mm() - 0.04).abs() < 1e-15);
        assert!((element.point(12.5 * PI) - at(&[0.0, 25.0])).norm() < 1e-12);
    }

    #[test]
    fn a_clockwise_arc_goes_the_other_way() {
        let element = circle(10.0, -PI / 2.0, 0.0);
        assert!((element.tangent(0.0) - at(&[0.0, -1.0])).norm() < 1e-15);
    }

    #[test]
    fn a_helix_counts_its_rise_in_its_length() {
        let element = circle(10.0, 2.0 * TAU, 6.0);
        assert!((element.length_mm - (40.0 * PI).hypot(6.0)).abs() < 1e-12);
    }

    #[test]
    fn rotary_axes_count_in_degrees_only_when_no_slide_moves() {
        let rotary = [false, false, false, true, false, false, false, false];
        let move_of = |to: &[f64]| {
            Element::new(
                1,
                Shape::Line {
                    from: at(&[]),
                    to: at(to),
                },
                FEED,
                &rotary,
            )
            .length_mm
        };
        assert_eq!(move_of(&[0.0, 0.0, 0.0, 90.0]), 90.0);
        assert_eq!(move_of(&[3.0, 4.0, 0.0, 90.0]), 5.0);
    }

    #[test]
    fn bounds_hold_the_quadrant_points_of_an_arc() {
        let from = at(&[libm::cos(-0.5) * 10.0, libm::sin(-0.5) * 10.0]);
        let to = at(&[libm::cos(2.0) * 10.0, libm::sin(2.0) * 10.0]);
        let path = Path {
            elements: vec![Element::arc(1, from, to, at(&[]), XY, 2.5, FEED)],
        };
        let (low, high) = path.bounds().unwrap();
        assert_eq!((high[0], high[1]), (10.0, 10.0));
        assert_eq!((low[0], low[1]), (to[0], from[1]));
    }

    #[test]
    fn an_empty_path_has_no_ends() {
        let path = Path::default();
        assert_eq!(
            (path.length_mm(), path.start(), path.bounds()),
            (0.0, None, None)
        );
    }

    #[test]
    fn a_break_between_elements_is_found() {
        let line = |from: f64, to: f64| Element::line(1, at(&[from]), at(&[to]), FEED);
        assert_eq!(
            Path {
                elements: vec![line(0.0, 1.0), line(1.0, 2.0)]
            }
            .first_break(),
            None
        );
        assert_eq!(
            Path {
                elements: vec![line(0.0, 1.0), line(1.0 + 1e-15, 2.0)]
            }
            .first_break(),
            Some(1)
        );
    }

    #[test]
    fn nan_is_found_wherever_it_hides() {
        assert!(
            !Path {
                elements: vec![Element::dwell(1, at(&[f64::NAN]), 1.0)]
            }
            .is_finite()
        );
        assert!(
            !Path {
                elements: vec![Element::line(
                    1,
                    at(&[]),
                    at(&[1.0]),
                    Feed::PathMmS(f64::NAN)
                )]
            }
            .is_finite()
        );
        assert!(
            Path {
                elements: vec![circle(1.0, TAU, 0.0)]
            }
            .is_finite()
        );
    }

    #[test]
    fn a_dwell_has_a_place_and_no_length() {
        let element = Element::dwell(4, at(&[1.0, 2.0]), 0.5);
        assert!(element.is_dwell());
        assert_eq!(element.point(1.0), at(&[1.0, 2.0]));
        assert_eq!(element.tangent(0.0), AxisVector::zeros());
        assert_eq!(element.closest_distance(&at(&[1.0, 5.0])), (0.0, 3.0));
    }

    #[test]
    fn deviation_from_a_circle_is_the_radial_error() {
        let element = circle(25.0, 2.0 * TAU, 0.0);
        let (distance_mm, deviation_mm) = element.closest_distance(&at(&[0.0, 25.003]));
        assert!((distance_mm - 12.5 * PI).abs() < 1e-9);
        assert!((deviation_mm - 0.003).abs() < 1e-12);
    }

    #[test]
    fn deviation_past_the_end_is_measured_to_the_end() {
        let (distance_mm, deviation_mm) =
            Element::line(1, at(&[]), at(&[10.0]), FEED).closest_distance(&at(&[13.0, 4.0]));
        assert_eq!((distance_mm, deviation_mm), (10.0, 5.0));
        let quarter = circle(10.0, PI / 2.0, 0.0);
        let (distance_mm, _) = quarter.closest_distance(&at(&[-1.0, 12.0]));
        assert_eq!(distance_mm, quarter.length_mm);
    }

    #[test]
    fn sweeps_go_round_the_commanded_way() {
        let (from, to, centre) = (at(&[10.0]), at(&[0.0, 10.0]), at(&[]));
        let sweep = |to, clockwise, turns| {
            sweep_between_rad(&from, to, &centre, XY, clockwise, turns, 1e-6)
        };
        assert!((sweep(&to, false, 1) - PI / 2.0).abs() < 1e-15);
        assert!((sweep(&to, true, 1) + 1.5 * PI).abs() < 1e-15);
        assert!((sweep(&to, false, 3) - 4.5 * PI).abs() < 1e-14);
        assert_eq!(sweep(&from, false, 1), TAU);
        assert_eq!(sweep(&from, true, 2), -2.0 * TAU);
    }

    proptest! {
        #[test]
        fn ends_are_the_stored_bits_and_the_curve_runs_into_them(element in any_element()) {
            prop_assert_eq!(element.point(0.0), element.start());
            prop_assert_eq!(element.point(element.length_mm), element.end());
            let step_mm = 1e-9 * element.length_mm;
            prop_assert!((element.point(step_mm) - element.start()).norm() < 1e-5);
            prop_assert!((element.point(element.length_mm - step_mm) - element.end()).norm() < 1e-5);
        }

        #[test]
        fn tangent_and_curvature_agree_with_finite_differences(element in any_element(), share in 0.05..0.95f64) {
            let s = share * element.length_mm;
            let h = 1e-4 * element.length_mm.min(1.0);
            let tangent = (element.point(s + h) - element.point(s - h)) / (2.0 * h);
            prop_assert!((tangent - element.tangent(s)).norm() < 1e-6, "{} {}", tangent, element.tangent(s));
            prop_assert!((element.tangent(s).norm() - 1.0).abs() < 1e-12);
            let curvature = (element.tangent(s + h) - element.tangent(s - h)) / (2.0 * h);
            prop_assert!((curvature - element.curvature_per_mm(s)).norm() < 1e-6);
            let magnitude = element.curvature_per_mm(s).norm();
            prop_assert!((magnitude - element.curvature_magnitude_per_mm()).abs() < 1e-12);
        }

        #[test]
        fn a_point_on_the_curve_is_its_own_closest_point(element in any_element(), share in 0.0..1.0f64) {
            let point = element.point(share * element.length_mm);
            let (distance_mm, deviation_mm) = element.closest_distance(&point);
            prop_assert!(deviation_mm < 1e-6, "{deviation_mm}");
            prop_assert!((element.point(distance_mm) - point).norm() < 1e-6);
        }

        #[test]
        fn no_sample_of_the_curve_is_closer_than_the_closest_point(
            element in any_element(), offset in [-0.2..0.2f64, -0.2..0.2f64, -0.2..0.2f64], share in 0.0..1.0f64,
        ) {
            let point = element.point(share * element.length_mm) + at(&offset);
            let (_, deviation_mm) = element.closest_distance(&point);
            for index in 0..=400 {
                let sample = element.point(element.length_mm * f64::from(index) / 400.0);
                prop_assert!((sample - point).norm() >= deviation_mm - 1e-7);
            }
        }

        #[test]
        fn bounds_hold_every_point_and_are_touched(element in any_element()) {
            let (low, high) = element.bounds();
            let (mut seen_low, mut seen_high) = (element.start(), element.start());
            for index in 0..=2000 {
                let point = element.point(element.length_mm * f64::from(index) / 2000.0);
                seen_low = seen_low.inf(&point);
                seen_high = seen_high.sup(&point);
            }
            prop_assert!((seen_low - low).min() > -1e-9 && (high - seen_high).min() > -1e-9);
            prop_assert!((seen_low - low).max() < 0.01 && (high - seen_high).max() < 0.01);
        }

        #[test]
        fn lengths_add_up(from in -100.0..100.0f64, to in 101.0..300.0f64, share in 0.1..0.9f64) {
            let whole = Element::line(1, at(&[from]), at(&[to]), FEED);
            let middle = whole.point(share * whole.length_mm);
            let path = Path { elements: vec![
                Element::line(1, at(&[from]), middle, FEED),
                Element::line(2, middle, at(&[to]), FEED),
            ] };
            prop_assert!((path.length_mm() - whole.length_mm).abs() < 1e-12);
            prop_assert_eq!(path.first_break(), None);
            prop_assert_eq!(path.line_of(1), Some(2));
            prop_assert_eq!(path.end(), Some(at(&[to])));
        }
    }
}
