//! Which work offset is in force, and the codes that set offsets once: G10, G52, G92, G28.1 and G30.1.

use super::{AxisVector, Cause, Group, Refusal, State, Words, base, refuse};

/// The first parameter of the offsets of G54.1: twenty for each, in the order of those of G54.
pub const MORE_WORK: u32 = 14_001;

impl State {
    /// The first work offset is the machine's, unless a program before has kept another one.
    pub(super) fn set_first_offsets(&mut self) {
        let equipment = self.equipment.clone();
        self.parameters.set(base::WORK_OFFSET, 1.0);
        self.set_vector(base::G54, equipment.work_offset);
        for (number, value) in &equipment.parameters {
            self.parameters.set(*number, *value);
        }
        if self.parameters.get(base::G92_APPLIES) != 0.0 {
            self.offsets.set_g92(self.vector_of(base::G92_APPLIES + 1));
        }
        self.take_offsets();
    }

    /// The position that a group of nine parameters holds.
    pub fn vector_of(&self, first: u32) -> AxisVector {
        let mut vector = AxisVector::zeros();
        for (index, component) in vector.iter_mut().enumerate() {
            if let Some(at) = self.equipment.place_in_nine(index) {
                *component = self.parameters.get(first + at as u32);
            }
        }
        vector
    }

    /// Sets a group of nine parameters to a position.
    pub fn set_vector(&mut self, first: u32, vector: AxisVector) {
        for (index, value) in vector.iter().enumerate() {
            if let Some(at) = self.equipment.place_in_nine(index) {
                self.parameters.set(first + at as u32, *value);
            }
        }
    }

    /// Index of the work offset in force: 0 is G54.
    pub fn work_offset(&self) -> usize {
        self.parameters.get(base::WORK_OFFSET).clamp(1.0, 9.0) as usize - 1
    }

    /// The first parameter of the work offset in force.
    fn work_base(&self) -> u32 {
        match self.more_work {
            Some(number) => MORE_WORK + 20 * (number - 1),
            None => base::G54 + 20 * self.work_offset() as u32,
        }
    }

    /// The offset of G54.1 in force, from 1.
    pub fn more_work(&self) -> Option<u32> {
        self.more_work
    }

    /// Puts an offset of G54.1 in force, from 1.
    pub fn choose_more_work(&mut self, number: Option<u32>) {
        self.more_work = number;
        self.take_offsets();
    }

    /// Sets a work offset along an axis, to a value in the unit of the program: the group that begins with this parameter, and the index
    /// of the axis' letter.
    pub fn set_offset_along(&mut self, first: u32, letter: u32, axis: usize, value: f64) {
        let unit = self.unit_of(axis);
        self.parameters.set(first + letter, value * unit);
        if first == self.work_base() {
            self.take_offsets();
        }
    }

    /// G68: turns what the program says about a centre, each coordinate in the unit of the program or that of the tool, by an angle in
    /// degrees; both may count from those in force. None ends that.
    pub fn turn_about(&mut self, turn: Option<([Option<f64>; 2], f64, bool)>) {
        let Some((centre, angle_deg, incremental)) = turn else {
            self.offsets.turn_about(None);
            return;
        };
        let Some((x, y)) = self.offsets.turned_axes() else {
            return;
        };
        // The centre is a place of the program as it is not turned, in G91 too; the angle alone adds.
        let mut unturned = self.offsets;
        unturned.turn_about(None);
        let here = unturned.in_program(&self.position);
        let before_deg = self.offsets.turned_about_deg();
        let place = |given: Option<f64>, axis: usize| {
            let here = here.get(axis).copied().unwrap_or(0.0);
            let g92 = self.offsets.g92().get(axis).copied().unwrap_or(0.0);
            given.map_or(here, |given| given * self.unit_of(axis)) + g92
        };
        let centre_mm = [place(centre[0], x), place(centre[1], y)];
        let angle_deg = angle_deg + if incremental { before_deg } else { 0.0 };
        self.offsets.turn_about(Some((centre_mm, angle_deg)));
    }

    /// Takes the work offset in force from the parameters.
    pub(super) fn take_offsets(&mut self) {
        let first = self.work_base();
        let rotation_deg = self.parameters.get(first + 9);
        self.offsets.set_work(self.vector_of(first), rotation_deg);
    }

    /// G54 to G59.3.
    pub fn work_offset_words(&mut self, words: &Words) {
        if let Some((number, _)) = words.code(Group::WorkOffset) {
            self.set_work_offset_of(number);
            self.take_offsets();
        }
    }

    /// Names the work offset of a code in the parameter for the one in force.
    pub(super) fn set_work_offset_of(&mut self, code: u32) {
        self.more_work = None;
        let system = match code {
            591..=593 => code - 584,
            _ => code / 10 - 53,
        };
        self.parameters.set(base::WORK_OFFSET, f64::from(system));
    }

    /// A code that sets offsets or places once.
    pub fn set_once(&mut self, number: u32, cause: Cause) -> Result<(), Refusal> {
        match number {
            100 => self.set_data(cause)?,
            281 => self.set_vector(base::HOME_28, self.position),
            301 => self.set_vector(base::HOME_30, self.position),
            682 => self.tilt_plane(cause)?,
            690 => self.change_plane(None),
            520 => self.shift(cause.words, |value, _| value),
            920 => self.shift(cause.words, |value, here| here - value),
            921 => {
                self.set_g92(AxisVector::zeros(), false);
                for number in base::G92_APPLIES + 1..base::G92_APPLIES + 10 {
                    self.parameters.set(number, 0.0);
                }
            }
            922 => self.set_g92(AxisVector::zeros(), false),
            923 => self.set_g92(self.vector_of(base::G92_APPLIES + 1), true),
            _ => {}
        }
        Ok(())
    }

    fn set_g92(&mut self, offset: AxisVector, applies: bool) {
        self.offsets.set_g92(offset);
        self.parameters
            .set(base::G92_APPLIES, f64::from(u8::from(applies)));
    }

    /// G52 and G92: `offset` makes of a word, and of where the tool is without G92, what is added along its axis.
    fn shift(&mut self, words: &Words, offset: impl Fn(f64, f64) -> f64) {
        let mut g92 = *self.offsets.g92();
        let here = self.offsets.in_program(&self.position) + g92;
        for (index, (component, here)) in g92.iter_mut().zip(&here).enumerate() {
            if let Some(value) = self.axis_value(words, index) {
                *component = offset(value, *here);
            }
        }
        self.set_vector(base::G92_APPLIES + 1, g92);
        self.set_g92(g92, true);
    }

    /// G10.
    fn set_data(&mut self, cause: Cause) -> Result<(), Refusal> {
        let right = "L2 and L20 set a work offset, L1, L10 and L11 a tool";
        let Some(l) = cause.words.value('L') else {
            return cause.refuse("G10 without L", right);
        };
        match l.value {
            2.0 | 20.0 => self.set_work_offset(cause, l.value == 20.0),
            1.0 | 10.0 | 11.0 => self.set_tool(cause, l.value as u32),
            _ => refuse(l.offset, format!("G10 {l}"), right),
        }
    }

    /// G10 L2 and L20: of the work offset P, or of the one in force with P0.
    fn set_work_offset(&mut self, cause: Cause, by_place: bool) -> Result<(), Refusal> {
        let words = cause.words;
        let given = words.value('P').map_or(-1.0, |p| p.value);
        let known = (0.0..=9.0).contains(&given) && given.fract() == 0.0;
        if !known {
            let right = "the work offset: P1 for G54 to P9 for G59.3, P0 for the one in force";
            let found = format!("G10 with P{given}");
            return refuse(cause.place('P'), found, right);
        }
        let first = match given as u32 {
            0 => self.work_base(),
            system => base::G54 + 20 * (system - 1),
        };
        if let Some(r) = words.value('R') {
            if by_place {
                let right = "R belongs to G10 L2: the rotation";
                return refuse(r.offset, "R in G10 L20", right);
            }
            self.parameters.set(first + 9, r.value);
        }
        let zero = self.zero_for(words, first);
        // Where X and Y are turned, the zero of one depends on both: else the tool would not be where the words say.
        let turned = by_place && self.parameters.get(first + 9) != 0.0;
        let turned_axes = self.offsets.turned_axes().filter(|_| turned);
        let is_named = |axis: usize| self.axis_value(words, axis).is_some();
        let turned_axes = turned_axes.filter(|&(x, y)| is_named(x) || is_named(y));
        let mut offset = self.vector_of(first);
        for (index, (component, zero)) in offset.iter_mut().zip(&zero).enumerate() {
            let given = self.axis_value(words, index);
            let by_turn = turned_axes.is_some_and(|(x, y)| index == x || index == y);
            match given {
                Some(value) if !by_place => *component = value,
                None if !by_turn => {}
                _ => *component = *zero,
            }
        }
        self.set_vector(first, offset);
        // What was set by parameters takes force where the offset does.
        if first == self.work_base() {
            self.take_offsets();
        }
        Ok(())
    }

    /// The work offset with which the tool is where the words say.
    fn zero_for(&self, words: &Words, first: u32) -> AxisVector {
        let rotation_deg = self.parameters.get(first + 9);
        let mut there = self.offsets;
        there.set_work(self.vector_of(first), rotation_deg);
        let place = self.with_words(words, there.in_program(&self.position));
        there.set_work(AxisVector::zeros(), rotation_deg);
        self.position - there.in_machine(&place)
    }
}
