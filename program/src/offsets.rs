//! Coordinate systems: work offsets (G54 to G59.3), their rotation, G92, the length of the tool.
//!
//! A place of the program is at `tool + work + turned(program + g92)` of the machine (LinuxCNC manual, *Coordinate Systems*).

use path::geometry::AxisVector;
use serde::{Deserialize, Serialize};

/// The offsets in force, in mm and degrees.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Offsets {
    /// Of the work offset in force.
    work: AxisVector,
    /// Of G52 and G92.
    g92: AxisVector,
    /// Of the tool.
    tool: AxisVector,
    /// Cosine and sine of the rotation about Z, if there is one.
    turn: Option<(f64, f64)>,
    /// Where the zero of the program lies while nothing is turned.
    zero: AxisVector,
    /// The axes X and Y, which a rotation turns.
    turned_axes: Option<(usize, usize)>,
}

impl Offsets {
    /// No offsets, where a rotation would turn these axes.
    pub fn of_axes(turned_axes: Option<(usize, usize)>) -> Self {
        Self {
            turned_axes,
            ..Self::default()
        }
    }

    /// The work offset.
    pub fn work(&self) -> &AxisVector {
        &self.work
    }

    /// What G52 and G92 add.
    pub fn g92(&self) -> &AxisVector {
        &self.g92
    }

    /// What is taken off for the tool.
    pub fn tool(&self) -> &AxisVector {
        &self.tool
    }

    /// Where the zero of the program lies while nothing is turned.
    #[inline]
    pub fn zero(&self) -> &AxisVector {
        &self.zero
    }

    /// Whether the work offset is turned about Z.
    #[inline]
    pub fn is_turned(&self) -> bool {
        self.turn.is_some()
    }

    /// The axes X and Y, which a rotation turns.
    pub fn turned_axes(&self) -> Option<(usize, usize)> {
        self.turned_axes
    }

    fn refresh_zero(&mut self) {
        self.zero = self.work + (self.g92 + self.tool);
    }

    /// Puts a work offset in force, and its rotation about Z.
    pub fn set_work(&mut self, work: AxisVector, rotation_deg: f64) {
        self.work = work;
        self.turn = (rotation_deg != 0.0).then(|| {
            let angle_rad = rotation_deg.to_radians();
            (libm::cos(angle_rad), libm::sin(angle_rad))
        });
        self.refresh_zero();
    }

    /// Puts what G52 and G92 add in force.
    pub fn set_g92(&mut self, g92: AxisVector) {
        self.g92 = g92;
        self.refresh_zero();
    }

    /// Puts an offset of the tool in force.
    pub fn set_tool(&mut self, tool: AxisVector) {
        self.tool = tool;
        self.refresh_zero();
    }

    /// A displacement of the program, turned into that of the machine.
    pub fn turned(&self, mut displacement: AxisVector) -> AxisVector {
        if let (Some((cos, sin)), Some((x, y))) = (self.turn, self.turned_axes) {
            let (dx, dy) = (displacement[x], displacement[y]);
            displacement[x] = dx * cos - dy * sin;
            displacement[y] = dx * sin + dy * cos;
        }
        displacement
    }

    /// The other way round.
    pub fn turned_back(&self, mut displacement: AxisVector) -> AxisVector {
        if let (Some((cos, sin)), Some((x, y))) = (self.turn, self.turned_axes) {
            let (dx, dy) = (displacement[x], displacement[y]);
            displacement[x] = dx * cos + dy * sin;
            displacement[y] = dy * cos - dx * sin;
        }
        displacement
    }

    /// A place of the machine in the coordinates of the program, in mm.
    pub fn in_program(&self, place: &AxisVector) -> AxisVector {
        if self.turn.is_none() {
            return place - self.zero;
        }
        self.turned_back(place - (self.work + self.tool)) - self.g92
    }

    /// A place of the program in the coordinates of the machine, in mm.
    pub fn in_machine(&self, place: &AxisVector) -> AxisVector {
        if self.turn.is_none() {
            return self.zero + place;
        }
        self.work + self.tool + self.turned(place + self.g92)
    }
}
