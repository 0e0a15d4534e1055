//! Coordinate systems: work offsets (G54 to G59.3), their rotation, G92, the length of the tool.
//!
//! A place of the program is at `tool + work + turned(program + g92)` of the machine (LinuxCNC manual, *Coordinate Systems*).

use path::geometry::AxisVector;
use serde::{Deserialize, Serialize};

/// The offsets in force, in mm and degrees.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Offsets {
    /// Of the work offset in force, and of what a rotation about another centre than its zero adds.
    work: AxisVector,
    /// Of the work offset in force alone, and its rotation in degrees.
    alone: (AxisVector, f64),
    /// G68: centre in X and Y of the work offset, in mm, and angle in degrees.
    about: Option<([f64; 2], f64)>,
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
        self.alone = (work, rotation_deg);
        self.refresh_turn();
        self.refresh_zero();
    }

    /// G68: turns what the program says about a centre, beside the rotation of the work offset; none ends that.
    pub fn turn_about(&mut self, about: Option<([f64; 2], f64)>) {
        self.about = about;
        self.refresh_turn();
        self.refresh_zero();
    }

    /// Whether G68 is in force.
    pub fn is_turned_about(&self) -> bool {
        self.about.is_some()
    }

    /// The angle of G68, in degrees; 0 without.
    pub fn turned_about_deg(&self) -> f64 {
        self.about.map_or(0.0, |(_, angle_deg)| angle_deg)
    }

    /// The rotation of the work offset alone, then that about the centre: work + turned(centre) − turned both ways(centre).
    fn refresh_turn(&mut self) {
        let (work, rotation_deg) = self.alone;
        let of = |angle_deg: f64| {
            (angle_deg != 0.0).then(|| {
                let angle_rad = angle_deg.to_radians();
                (libm::cos(angle_rad), libm::sin(angle_rad))
            })
        };
        self.work = work;
        self.turn = of(rotation_deg);
        if let (Some((centre_mm, angle_deg)), Some((x, y))) = (self.about, self.turned_axes) {
            let mut centre = AxisVector::zeros();
            (centre[x], centre[y]) = (centre_mm[0], centre_mm[1]);
            let once = self.turned(centre);
            self.turn = of(rotation_deg + angle_deg);
            self.work = work + once - self.turned(centre);
        }
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
