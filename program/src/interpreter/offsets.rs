//! Which offsets are in force: those that parameters hold, and those of the tool.

use super::*;

impl Interpreter {
    /// The first work offset is the machine's, unless a program before has kept another one.
    pub(super) fn set_first_offsets(&mut self) {
        let axis = |letter| self.setup.axis_index(letter);
        self.offsets.turned_axes = axis('X').zip(axis('Y'));
        self.parameters.set(base::WORK_OFFSET, 1.0);
        self.set_vector(base::G54, self.setup.work_offset);
        for (number, value) in &self.setup.parameters {
            self.parameters.set(*number, *value);
        }
        if self.parameters.get(base::G92_APPLIES) != 0.0 {
            self.offsets.g92 = self.vector_of(base::G92_APPLIES + 1);
        }
        self.take_offsets();
    }

    /// The parameter of an axis in a group of nine.
    fn number_of(&self, first: u32, index: usize) -> Option<u32> {
        let letter = self.setup.axes.get(index)?.letter;
        Some(first + AXIS_LETTERS.find(letter)? as u32)
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

    /// Sets a group of nine parameters to a position.
    pub(super) fn set_vector(&mut self, first: u32, vector: AxisVector) {
        for (index, value) in vector.iter().enumerate() {
            if let Some(number) = self.number_of(first, index) {
                self.parameters.set(number, *value);
            }
        }
    }

    /// A position, with what the axis words of a block say in its place.
    pub(super) fn with_words(&self, words: &Words, mut place: AxisVector) -> AxisVector {
        for (index, component) in place.iter_mut().enumerate() {
            *component = self.axis_value(words, index).unwrap_or(*component);
        }
        place
    }

    /// The axis of a letter, if it is a slide.
    pub(super) fn slide(&self, letter: char) -> Option<usize> {
        let index = self.setup.axis_index(letter);
        index.filter(|index| self.rotary.get(*index) == Some(&false))
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
        if self.modes.diameters {
            length / 2.0
        } else {
            length
        }
    }
}
