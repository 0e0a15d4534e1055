//! A tilted work plane (G68.2): X, Y and Z of the program lie askew on the work, and the tool stands along Z (G53.1).

use path::geometry::{AxisVector, Shape};
use path::tool_centre::{slides_of, with_slides};
use serde::{Deserialize, Serialize};

/// Rows of a rotation.
type Rotation = [[f64; 3]; 3];

/// A plane on the work.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TiltedPlane {
    /// X, Y and Z among the axes.
    slides: [usize; 3],
    /// Its zero, from the program's zero, in mm.
    origin_mm: [f64; 3],
    /// From directions of the plane to those of the program.
    rotation: Rotation,
}

/// About the axis Z (2) or X (0).
fn about(axis: usize, angle_deg: f64) -> Rotation {
    let angle_rad = angle_deg.to_radians();
    let (sin, cos) = (libm::sin(angle_rad), libm::cos(angle_rad));
    match axis {
        0 => [[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]],
        _ => [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]],
    }
}

fn times(rotation: &Rotation, vector: [f64; 3]) -> [f64; 3] {
    rotation.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
}

fn transposed(rotation: &Rotation) -> Rotation {
    let [[a, b, c], [d, e, f], [g, h, i]] = *rotation;
    [[a, d, g], [b, e, h], [c, f, i]]
}

/// One rotation behind another.
fn product(first: &Rotation, second: &Rotation) -> Rotation {
    transposed(&transposed(second).map(|column| times(first, column)))
}

impl TiltedPlane {
    /// With its zero at a place of the program, turned by I about Z, then by J about the new X, then by K about the new Z, in degrees
    /// (Fanuc's Euler angles).
    pub fn of_euler_angles(slides: [usize; 3], origin_mm: [f64; 3], angles_deg: [f64; 3]) -> Self {
        let [i, j, k] = angles_deg;
        Self {
            slides,
            origin_mm,
            rotation: product(&product(&about(2, i), &about(0, j)), &about(2, k)),
        }
    }

    /// Its Z, as a direction of the program.
    pub fn normal(&self) -> [f64; 3] {
        times(&self.rotation, [0.0, 0.0, 1.0])
    }

    fn slides_of(&self, place: &AxisVector) -> [f64; 3] {
        slides_of(self.slides, place)
    }

    fn with_slides(&self, place: AxisVector, slides: [f64; 3]) -> AxisVector {
        with_slides(self.slides, place, slides)
    }

    /// A place of the plane, on the work; `zero` is the program's zero.
    pub fn on_work(&self, place: &AxisVector, zero: &AxisVector) -> AxisVector {
        let turned = times(&self.rotation, self.slides_of(&(place - zero)));
        let mut slides = self.slides_of(zero);
        for ((value, origin), turned) in slides.iter_mut().zip(self.origin_mm).zip(turned) {
            *value += origin + turned;
        }
        self.with_slides(*place, slides)
    }

    /// The other way round.
    pub fn in_plane(&self, place: &AxisVector, zero: &AxisVector) -> AxisVector {
        let mut way = self.slides_of(&(place - zero));
        for (value, origin) in way.iter_mut().zip(self.origin_mm) {
            *value -= origin;
        }
        let mut slides = self.slides_of(zero);
        for (value, turned) in slides
            .iter_mut()
            .zip(times(&transposed(&self.rotation), way))
        {
            *value += turned;
        }
        self.with_slides(*place, slides)
    }

    /// A shape of the plane, on the work.
    pub fn shape_on_work(&self, shape: &Shape, zero: &AxisVector) -> Shape {
        shape.moved(
            |place| self.on_work(place, zero),
            |direction| {
                let turned = times(&self.rotation, self.slides_of(direction));
                self.with_slides(*direction, turned)
            },
        )
    }
}
