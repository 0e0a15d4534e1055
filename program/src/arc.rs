//! The geometry of one arc block, in the plane: where its centre is and which way round it goes.

use std::f64::consts::SQRT_2;

use path::geometry::{AxisVector, Element, Shape, sweep_between_rad};

use crate::flat::Flat;
use crate::refusal::{Refusal, wrong};

/// Ends nearer than this are one point, and the arc a full circle: 1 nm, as LinuxCNC's CIRCLE_FUZZ.
const FULL_CIRCLE_CHORD_MM: f64 = 1e-6;

/// The smallest radius taken for an arc: 1 nm.
const RADIUS_MIN_MM: f64 = 1e-6;

/// A radius difference of the two ends below this is rounding of the arithmetic; the centre stays as programmed.
const ROUNDING_MM: f64 = 1e-9;

/// How an arc block names its circle, in the two axes of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Circle {
    /// Centre in machine coordinates (first, second axis of the plane).
    Centre(Flat),
    /// Radius; negative for the way round that is longer than half a turn.
    RadiusMm(f64),
}

/// An arc block, its words understood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArcBlock {
    /// Start in machine coordinates.
    pub from: AxisVector,
    /// End in machine coordinates.
    pub to: AxisVector,
    /// First and second axis of the plane; counter-clockwise leads from the first to the second.
    pub plane: [usize; 2],
    /// Where the circle is.
    pub circle: Circle,
    /// G2 rather than G3.
    pub clockwise: bool,
    /// Turns, the last included, at least 1.
    pub turns: u32,
    /// How far the radii of start and end may differ, and what an R may be short by.
    pub tolerance: ArcTolerance,
}

/// Radii that differ by more than this are no rounding of three decimals.
const SPIRAL_MM: f64 = 0.002;

/// How exact the words of an arc must be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArcTolerance {
    /// An R may be short by so much, in mm.
    pub short_mm: f64,
    /// Radii of start and end may differ by so much in any case, in mm.
    pub radii_mm: f64,
    /// And by a thousandth of the radius up to so much, in mm.
    pub radii_most_mm: f64,
}

impl ArcTolerance {
    /// Programmed in mm: an R as in NIST §3.5.3, radii as LinuxCNC 2.9 was found to take them, 2·0.01·√2.
    pub const METRIC: ArcTolerance = ArcTolerance {
        short_mm: 0.002,
        radii_mm: 0.02 * SQRT_2,
        radii_most_mm: 2.0 * SQRT_2,
    };
    /// The same, programmed in inches.
    pub const INCH: ArcTolerance = ArcTolerance {
        short_mm: 0.0002 * 25.4,
        radii_mm: 0.002 * SQRT_2 * 25.4,
        radii_most_mm: 0.2 * SQRT_2 * 25.4,
    };

    /// How far radii about this one may differ, in mm.
    fn radii(&self, radius_mm: f64) -> f64 {
        (1e-3 * radius_mm)
            .min(self.radii_most_mm)
            .max(self.radii_mm)
    }
}

impl ArcBlock {
    /// The one or two shapes the block becomes; see the crate's page for when it is two.
    pub fn shapes(&self) -> Result<Vec<Shape>, Refusal> {
        let centre = self.centre()?;
        let chord = self.in_plane(&self.to) - self.in_plane(&self.from);
        let [start_radius_mm, end_radius_mm] = self.radii_mm(centre);
        if start_radius_mm < RADIUS_MIN_MM {
            let right = "the centre must lie away from the start";
            return wrong("an arc of radius zero", right);
        }
        let difference_mm = (start_radius_mm - end_radius_mm).abs();
        let allowed_mm = self.tolerance.radii(start_radius_mm.max(end_radius_mm));
        if difference_mm > allowed_mm {
            let found = format!(
                "an arc whose start is {start_radius_mm:.4} mm and whose end is {end_radius_mm:.4} mm from its centre"
            );
            let right = format!("the radii may differ by at most {allowed_mm:.3} mm");
            return wrong(found, right);
        }
        let centre = self.placed(centre);
        let chord_mm = chord.length();
        if difference_mm <= ROUNDING_MM || chord_mm <= FULL_CIRCLE_CHORD_MM {
            let sweep_rad = self.sweep_rad(&self.from, &self.to, &centre, self.turns);
            return Ok(vec![Element::arc_shape(
                self.from, self.to, centre, self.plane, sweep_rad,
            )]);
        }
        let mean_mm = (start_radius_mm + end_radius_mm) / 2.0;
        Ok(self.pieces(&centre, mean_mm))
    }

    /// How far start and end are from a centre.
    fn radii_mm(&self, centre: Flat) -> [f64; 2] {
        [&self.from, &self.to].map(|point| (self.in_plane(point) - centre).length())
    }

    /// Whether start and end are less equally far from the centre than rounding leaves them.
    pub fn is_spiral(&self) -> bool {
        // An R has its centre equally far from both.
        let Circle::Centre(centre) = self.circle else {
            return false;
        };
        let [start_mm, end_mm] = self.radii_mm(centre);
        (start_mm - end_mm).abs() > SPIRAL_MM
    }

    /// Where the centre is, before rounding is taken out.
    pub fn centre(&self) -> Result<Flat, Refusal> {
        match self.circle {
            Circle::Centre(centre) => Ok(centre),
            Circle::RadiusMm(radius_mm) => self.centre_of_radius(radius_mm),
        }
    }

    fn sweep_rad(
        &self,
        from: &AxisVector,
        to: &AxisVector,
        centre: &AxisVector,
        turns: u32,
    ) -> f64 {
        sweep_between_rad(
            from,
            to,
            centre,
            self.plane,
            self.clockwise,
            turns,
            FULL_CIRCLE_CHORD_MM,
        )
    }

    /// The pieces of an arc whose ends are not equally far from its centre: one, or two beyond half a turn.
    fn pieces(&self, centre: &AxisVector, mean_mm: f64) -> Vec<Shape> {
        let sweep_rad = self.sweep_rad(&self.from, &self.to, centre, self.turns);
        let piece = |from: AxisVector, to: AxisVector, turns: u32| {
            let centre = self.onto_bisector(centre, &from, &to);
            Element::arc_shape(
                from,
                to,
                centre,
                self.plane,
                self.sweep_rad(&from, &to, &centre, turns),
            )
        };
        if sweep_rad.abs() <= std::f64::consts::PI {
            return vec![piece(self.from, self.to, 1)];
        }
        // Half-way round, on the mean radius. All whole turns stay in the first piece.
        let first_turn_rad = self.sweep_rad(&self.from, &self.to, centre, 1);
        let spoke = self.in_plane(&(self.from - *centre));
        let angle_rad = libm::atan2(spoke.v, spoke.u) + first_turn_rad / 2.0;
        let share = (sweep_rad - first_turn_rad / 2.0) / sweep_rad;
        let direction = Flat::new(libm::cos(angle_rad), libm::sin(angle_rad));
        let middle = self.in_plane(centre) + direction * mean_mm;
        let middle = middle.put_into(self.from + (self.to - self.from) * share, self.plane);
        vec![
            piece(self.from, middle, self.turns),
            piece(middle, self.to, 1),
        ]
    }

    /// The centre that an R word means (NIST §3.5.3.1): the shorter way round, the longer for a negative R.
    fn centre_of_radius(&self, radius_mm: f64) -> Result<Flat, Refusal> {
        let start = self.in_plane(&self.from);
        let chord = self.in_plane(&self.to) - start;
        let chord_mm = chord.length();
        if chord_mm <= FULL_CIRCLE_CHORD_MM {
            let right = "name the centre with I, J, K for a full circle";
            return wrong("an R arc that ends where it starts", right);
        }
        let (radius, half_mm) = (radius_mm.abs(), chord_mm / 2.0);
        if half_mm > radius + self.tolerance.short_mm {
            let found = format!("R of {radius:.4} mm for ends {chord_mm:.4} mm apart");
            return wrong(found, format!("R must be at least {half_mm:.4} mm"));
        }
        // A radius short by no more than the tolerance means half a turn.
        let height_mm = (radius * radius - half_mm * half_mm).max(0.0).sqrt();
        let left = (radius_mm < 0.0) == self.clockwise;
        let signed_mm = if left { height_mm } else { -height_mm };
        Ok(Flat::new(
            start.u + chord.u / 2.0 - chord.v / chord_mm * signed_mm,
            start.v + chord.v / 2.0 + chord.u / chord_mm * signed_mm,
        ))
    }

    /// The centre moved along the chord of two points until both are equally far from it.
    fn onto_bisector(&self, centre: &AxisVector, from: &AxisVector, to: &AxisVector) -> AxisVector {
        let [start, end, old] = [from, to, centre].map(|point| self.in_plane(point));
        let chord = end - start;
        let middle = (start + end) * 0.5 - old;
        let share = middle.dot(chord) / chord.dot(chord);
        self.placed(old + chord * share)
    }

    fn in_plane(&self, vector: &AxisVector) -> Flat {
        Flat::of(vector, self.plane)
    }

    /// A point of the plane, with the other components of the start.
    fn placed(&self, point: Flat) -> AxisVector {
        point.put_into(self.from, self.plane)
    }
}
