//! Points and directions of a plane, for geometry that knows no other axes.

use serde::{Deserialize, Serialize};
use std::ops::{Add, Mul, Neg, Sub};

use path::geometry::AxisVector;

/// Points nearer than this are one point: 1 nm, as in arcs.
const SAME_POINT_MM: f64 = 1e-6;

/// A point of a plane, or a direction in it: first and second axis, in mm.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Flat {
    /// Along the first axis.
    pub u: f64,
    /// Along the second axis; counter-clockwise leads from the first to the second.
    pub v: f64,
}

impl Flat {
    /// A point by its two coordinates.
    pub fn new(u: f64, v: f64) -> Self {
        Self { u, v }
    }

    /// The two components of a position that lie in a plane.
    pub fn of(position: &AxisVector, plane: [usize; 2]) -> Self {
        let [u, v] = plane.map(|axis| position.get(axis).copied().unwrap_or(0.0));
        Self { u, v }
    }

    /// `position` with these two components.
    pub fn put_into(self, mut position: AxisVector, plane: [usize; 2]) -> AxisVector {
        for (axis, value) in plane.into_iter().zip([self.u, self.v]) {
            if let Some(component) = position.get_mut(axis) {
                *component = value;
            }
        }
        position
    }

    /// Scalar product.
    pub fn dot(self, other: Self) -> f64 {
        self.u * other.u + self.v * other.v
    }

    /// Cross product: positive where `other` is counter-clockwise of this.
    pub fn cross(self, other: Self) -> f64 {
        self.u * other.v - self.v * other.u
    }

    /// Length in mm.
    pub fn length(self) -> f64 {
        libm::hypot(self.u, self.v)
    }

    /// A quarter turn counter-clockwise.
    pub fn left(self) -> Self {
        Self::new(-self.v, self.u)
    }

    /// The direction, of length 1; none for a length of 0 or one that is no number.
    pub fn unit(self) -> Option<Self> {
        let length = self.length();
        (length > 0.0 && length.is_finite()).then(|| self * (1.0 / length))
    }

    /// The angle that leads from this direction to `other`, in rad, from -π to π, positive counter-clockwise.
    pub fn angle_to(self, other: Self) -> f64 {
        libm::atan2(self.cross(other), self.dot(other))
    }
}

/// Angle travelled about a centre, in rad, at least 0: from one point to another, with whole turns before; ends in one
/// point are a full circle.
pub fn sweep_rad(from: Flat, to: Flat, centre: Flat, clockwise: bool, turns: u32) -> f64 {
    let angle_rad = if (to - from).length() <= SAME_POINT_MM {
        std::f64::consts::TAU
    } else {
        let counter_clockwise_rad = (from - centre).angle_to(to - centre);
        let along_rad = if clockwise {
            -counter_clockwise_rad
        } else {
            counter_clockwise_rad
        };
        if along_rad <= 0.0 {
            along_rad + std::f64::consts::TAU
        } else {
            along_rad
        }
    };
    angle_rad + std::f64::consts::TAU * f64::from(turns.max(1) - 1)
}

/// Where a line through `point` along the unit vector `along` meets a circle: the point it comes to first and the one
/// it comes to last; none if it passes the circle by.
pub fn line_meets_circle(
    point: Flat,
    along: Flat,
    centre: Flat,
    radius_mm: f64,
) -> Option<[Flat; 2]> {
    let away_mm = along.cross(centre - point);
    if away_mm.abs() > radius_mm {
        return None;
    }
    let half_mm = ((radius_mm - away_mm) * (radius_mm + away_mm))
        .max(0.0)
        .sqrt();
    let foot = centre + along.left() * -away_mm;
    Some([foot - along * half_mm, foot + along * half_mm])
}

/// Where two circles meet: the point on the left of the way from the first centre to the second, and that on its right.
pub fn circles_meet(
    first: Flat,
    first_radius_mm: f64,
    second: Flat,
    second_radius_mm: f64,
) -> Option<[Flat; 2]> {
    let between = second - first;
    let along = between.unit()?;
    let apart_mm = between.length();
    let along_mm = (first_radius_mm * first_radius_mm - second_radius_mm * second_radius_mm
        + apart_mm * apart_mm)
        / (2.0 * apart_mm);
    let squared = first_radius_mm * first_radius_mm - along_mm * along_mm;
    if !squared.is_finite() || squared < 0.0 {
        return None;
    }
    let (foot, height) = (first + along * along_mm, along.left() * squared.sqrt());
    Some([foot + height, foot - height])
}

impl Add for Flat {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.u + other.u, self.v + other.v)
    }
}

impl Sub for Flat {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.u - other.u, self.v - other.v)
    }
}

impl Neg for Flat {
    type Output = Self;

    fn neg(self) -> Self {
        Self::new(-self.u, -self.v)
    }
}

impl Mul<f64> for Flat {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self::new(self.u * factor, self.v * factor)
    }
}
