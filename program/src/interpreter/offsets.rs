//! Coordinate systems: work offsets (G54 to G59.3), their rotation, G92, the length of the tool.
//!
//! A place of the program is at `tool + work + turned(program + g92)` of the machine (LinuxCNC manual, *Coordinate Systems*).

use super::*;
use crate::parameters::POSITION_LETTERS;
use serde::{Deserialize, Serialize};

/// The offsets in force, in mm and degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Offsets {
    /// Of the work offset in force.
    #[serde(with = "snapshot::vector")]
    pub work: AxisVector,
    /// Of G52 and G92.
    #[serde(with = "snapshot::vector")]
    pub g92: AxisVector,
    /// Of the tool.
    #[serde(with = "snapshot::vector")]
    pub tool: AxisVector,
    /// Cosine and sine of the rotation about Z, if there is one.
    pub turn: Option<(f64, f64)>,
    /// Where the zero of the program lies while nothing is turned.
    #[serde(with = "snapshot::vector")]
    pub zero: AxisVector,
    /// The axes X and Y, which a rotation turns.
    pub turned_axes: Option<(usize, usize)>,
}

impl Default for Offsets {
    fn default() -> Self {
        let zeros = AxisVector::zeros();
        Self {
            work: zeros,
            g92: zeros,
            tool: zeros,
            turn: None,
            zero: zeros,
            turned_axes: None,
        }
    }
}

impl Offsets {
    pub fn refresh_zero(&mut self) {
        self.zero = self.work + (self.g92 + self.tool);
    }

    /// Turns the work offset about Z.
    pub fn turn_by(&mut self, rotation_deg: f64) {
        self.turn = (rotation_deg != 0.0).then(|| {
            let angle_rad = rotation_deg.to_radians();
            (libm::cos(angle_rad), libm::sin(angle_rad))
        });
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

impl Interpreter {
    /// The first work offset is the machine's, unless a program before has kept another one.
    pub(super) fn set_first_offsets(&mut self) {
        let axis = |letter| self.setup.axis_index(letter);
        self.offsets.turned_axes = axis('X').zip(axis('Y'));
        self.parameters.set(base::WORK_OFFSET, 1.0);
        let offset = self.setup.work_offset;
        for (index, value) in offset.iter().enumerate() {
            if let Some(number) = self.number_of(base::G54, index) {
                self.parameters.set(number, *value);
            }
        }
        for (number, value) in &self.setup.parameters {
            self.parameters.set(*number, *value);
        }
        if self.parameters.get(base::G92_APPLIES) != 0.0 {
            self.offsets.g92 = self.vector_of(base::G92_APPLIES + 1);
        }
        self.take_offsets();
    }

    /// The parameter of an axis in a group of nine.
    pub(super) fn number_of(&self, first: u32, index: usize) -> Option<u32> {
        let letter = self.setup.axes.get(index)?.letter;
        Some(first + POSITION_LETTERS.find(letter)? as u32)
    }

    /// The position that a group of nine parameters holds.
    pub(super) fn vector_of(&self, first: u32) -> AxisVector {
        let mut vector = AxisVector::zeros();
        for (index, component) in vector.iter_mut().enumerate() {
            if let Some(number) = self.number_of(first, index) {
                *component = self.parameters.get(number);
            }
        }
        vector
    }

    /// The first parameter of the work offset in force.
    pub(super) fn work_base(&self) -> u32 {
        let system = self.parameters.get(base::WORK_OFFSET).clamp(1.0, 9.0) as u32;
        base::G54 + 20 * (system - 1)
    }

    /// Takes the work offset in force, and G92 if it applies, from the parameters.
    pub(super) fn take_offsets(&mut self) {
        let first = self.work_base();
        self.offsets.work = self.vector_of(first);
        self.offsets.turn_by(self.parameters.get(first + 9));
        self.refresh_zero();
    }

    pub(super) fn refresh_zero(&mut self) {
        self.offsets.refresh_zero();
    }

    /// A displacement of the program, turned into that of the machine.
    pub(super) fn turned(&self, displacement: AxisVector) -> AxisVector {
        self.offsets.turned(displacement)
    }

    /// A place of the machine in the coordinates of the program, in mm.
    pub(super) fn in_program(&self, place: &AxisVector) -> AxisVector {
        self.offsets.in_program(place)
    }

    /// A place of the program in the coordinates of the machine, in mm.
    pub(super) fn in_machine(&self, place: &AxisVector) -> AxisVector {
        self.offsets.in_machine(place)
    }

    /// What a number of the program counts along an axis: mm in its unit, degrees as they are.
    pub(super) fn unit_of(&self, index: usize) -> f64 {
        match self.rotary.get(index) {
            Some(false) => self.unit_mm(),
            _ => 1.0,
        }
    }

    /// The value of an axis word in mm or degrees: an X of a lathe may be a diameter.
    pub(super) fn axis_value(&self, words: &Words, index: usize) -> Option<f64> {
        let letter = self.setup.axes.get(index)?.letter;
        let value = words.value(letter)?.value * self.unit_of(index);
        Some(match letter {
            'X' => self.radius_of(value),
            _ => value,
        })
    }

    /// The radius that a length along X stands for: half of it where it is a diameter (G7).
    pub(super) fn radius_of(&self, length: f64) -> f64 {
        if self.diameters { length / 2.0 } else { length }
    }
}
