//! Codes that are done once: G10, G28, G30, G52, G92, and the choice of a work offset.

use super::*;
use crate::reader::Word;

impl Interpreter {
    /// G54 to G59.3.
    pub(super) fn work_offset_words(&mut self, words: &Words) {
        let Some((number, _)) = words.code(Group::WorkOffset) else {
            return;
        };
        self.set_work_offset_of(number);
        self.take_offsets();
    }

    /// Names the work offset of a code in the parameter for the one in force.
    pub(super) fn set_work_offset_of(&mut self, code: u32) {
        let system = match code {
            591..=593 => code - 584,
            _ => code / 10 - 53,
        };
        self.parameters.set(base::WORK_OFFSET, f64::from(system));
    }

    /// The code of the block that is done once; its axis words are no motion.
    pub(super) fn once(&mut self, line: u32, words: &mut Words) -> Result<(), Vec<Refusal>> {
        let Some((number, word)) = words.code(Group::Once) else {
            return Ok(());
        };
        match number {
            100 => self.set_data(words, word)?,
            280 => self.go_home(line, words, base::HOME_28, word)?,
            300 => self.go_home(line, words, base::HOME_30, word)?,
            281 => self.set_vector(base::HOME_28, self.position),
            301 => self.set_vector(base::HOME_30, self.position),
            520 => self.shift(words, |value, _| value),
            920 => self.shift(words, |value, here| here - value),
            921 => {
                self.set_g92(AxisVector::zeros(), false);
                for number in base::G92_APPLIES + 1..base::G92_APPLIES + 10 {
                    self.parameters.set(number, 0.0);
                }
            }
            922 => self.set_g92(AxisVector::zeros(), false),
            923 => self.set_g92(self.vector_of(base::G92_APPLIES + 1), true),
            _ => return Ok(()),
        }
        words.remove(AXIS_LETTERS);
        words.remove("IJKR");
        Ok(())
    }

    fn set_g92(&mut self, offset: AxisVector, applies: bool) {
        self.offsets.g92 = offset;
        self.parameters
            .set(base::G92_APPLIES, f64::from(u8::from(applies)));
        self.refresh_zero();
    }

    /// G52 and G92: `offset` makes of a word, and of where the tool is without G92, what is added along its axis.
    fn shift(&mut self, words: &Words, offset: impl Fn(f64, f64) -> f64) {
        let here = self.in_program(&self.position) + self.offsets.g92;
        let mut g92 = self.offsets.g92;
        for (index, (component, here)) in g92.iter_mut().zip(&here).enumerate() {
            if let Some(value) = self.axis_value(words, index) {
                *component = offset(value, *here);
            }
        }
        self.set_vector(base::G92_APPLIES + 1, g92);
        self.set_g92(g92, true);
    }

    /// G28 and G30: over the place that the words name, then the axes that they name (or all) to the place that is kept.
    fn go_home(
        &mut self,
        line: u32,
        words: &Words,
        first: u32,
        word: Word,
    ) -> Result<(), Vec<Refusal>> {
        let mut home = self.vector_of(first);
        if words.first_of(AXIS_LETTERS).is_some() {
            // Whatever the motion mode. G53 is no part of such a block, so nothing is refused.
            let over = self.target(words).unwrap_or(self.position);
            for (index, (component, over)) in home.iter_mut().zip(&over).enumerate() {
                if self.axis_value(words, index).is_none() {
                    *component = *over;
                }
            }
            self.rapid_to(line, words, over, word.offset)?;
        }
        let places = home.iter_mut().zip(&self.position);
        for (component, here) in places.skip(self.setup.axes.len()) {
            *component = *here;
        }
        let home = self.shorter_ways(home);
        self.rapid_to(line, words, home, word.offset)
    }

    fn rapid_to(
        &mut self,
        line: u32,
        words: &Words,
        to: AxisVector,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let way = self.straight_to(to);
        self.go(line, words, way, Feed::Rapid, offset)
    }

    /// G10.
    fn set_data(&mut self, words: &Words, word: Word) -> Result<(), Refusal> {
        let right = "L2 and L20 set a work offset, L1, L10 and L11 a tool";
        let Some(l) = words.value('L') else {
            return refuse(word.offset, "G10 without L", right);
        };
        match l.value {
            2.0 | 20.0 => self.set_work_offset(words, l.value == 20.0, word.offset),
            1.0 | 10.0 | 11.0 => self.set_tool(words, l.value as u32, word.offset),
            _ => refuse(l.offset, format!("G10 {l}"), right),
        }
    }

    /// G10 L2 and L20: of the work offset P, or of the one in force with P0.
    fn set_work_offset(
        &mut self,
        words: &Words,
        by_place: bool,
        offset: usize,
    ) -> Result<(), Refusal> {
        let given = words.value('P').map_or(-1.0, |p| p.value);
        let known = (0.0..=9.0).contains(&given) && given.fract() == 0.0;
        if !known {
            let right = "the work offset: P1 for G54 to P9 for G59.3, P0 for the one in force";
            let found = format!("G10 with P{given}");
            return refuse(words.place('P', offset), found, right);
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
        let turned_axes = self.offsets.turned_axes.filter(|_| turned);
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
        let mut there = self.offsets;
        there.work = self.vector_of(first);
        there.turn_by(self.parameters.get(first + 9));
        there.refresh_zero();
        let place = self.with_words(words, there.in_program(&self.position));
        there.work = AxisVector::zeros();
        there.refresh_zero();
        self.position - there.in_machine(&place)
    }
}
