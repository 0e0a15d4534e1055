//! Codes that are done once: G10, G28, G30, G52, G92, and the choice of a work offset.

use super::*;
use crate::reader::Word;

impl Interpreter {
    /// G54 to G59.3.
    pub(super) fn work_offset_words(&mut self, words: &Words) {
        let Some((number, _)) = words.code(Group::WorkOffset) else {
            return;
        };
        let system = match number {
            591..=593 => number - 584,
            _ => number / 10 - 53,
        };
        self.parameters.set(base::WORK_OFFSET, f64::from(system));
        self.take_offsets();
    }

    /// The code of the block that is done once; its axis words are no motion.
    pub(super) fn once(&mut self, line: u32, words: &mut Words) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let Some((number, word)) = words.code(Group::Once) else {
            return Ok(());
        };
        match number {
            100 => self.set_data(words, word).map_err(one)?,
            280 => self.go_home(line, words, base::HOME_28, word)?,
            300 => self.go_home(line, words, base::HOME_30, word)?,
            281 => self.keep_home(base::HOME_28),
            301 => self.keep_home(base::HOME_30),
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
        AXIS_LETTERS.chars().for_each(|letter| words.remove(letter));
        "IJKR".chars().for_each(|letter| words.remove(letter));
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
        for index in 0..self.setup.axes.len() {
            let here = here.get(index).copied().unwrap_or(0.0);
            if let (Some(value), Some(component)) =
                (self.axis_value(words, index), g92.get_mut(index))
            {
                *component = offset(value, here);
            }
        }
        for (index, value) in g92.iter().enumerate() {
            if let Some(number) = self.number_of(base::G92_APPLIES + 1, index) {
                self.parameters.set(number, *value);
            }
        }
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
            let over = self.motionless_target(words);
            for (index, component) in home.iter_mut().enumerate() {
                if self.axis_value(words, index).is_none() {
                    *component = over.get(index).copied().unwrap_or(0.0);
                }
            }
            self.rapid_to(line, words, over, word.offset)?;
        }
        for (component, here) in home
            .iter_mut()
            .zip(self.position.iter())
            .skip(self.setup.axes.len())
        {
            *component = *here;
        }
        for (index, component) in home.iter_mut().enumerate() {
            *component = self.on_shorter_way(index, *component);
        }
        self.rapid_to(line, words, home, word.offset)
    }

    /// Where the axis words lead, whatever the motion mode.
    fn motionless_target(&self, words: &Words) -> AxisVector {
        // G53 is no part of such a block, so nothing is refused.
        self.target(words).unwrap_or(self.position)
    }

    fn rapid_to(
        &mut self,
        line: u32,
        words: &Words,
        to: AxisVector,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let from = self.tool_place();
        self.go(
            line,
            words,
            vec![Shape::Line { from, to }],
            Feed::Rapid,
            offset,
        )
    }

    /// G28.1 and G30.1.
    fn keep_home(&mut self, first: u32) {
        for index in 0..self.setup.axes.len() {
            if let Some(number) = self.number_of(first, index) {
                let here = self.position.get(index).copied().unwrap_or(0.0);
                self.parameters.set(number, here);
            }
        }
    }

    /// G10.
    fn set_data(&mut self, words: &Words, word: Word) -> Result<(), Refusal> {
        let how = words.value('L').map_or(-1.0, |l| l.value);
        match how {
            2.0 | 20.0 => self.set_work_offset(words, how == 20.0, word.offset),
            1.0 | 10.0 | 11.0 => self.set_tool(words, how as u32, word.offset),
            _ => {
                let place = words.value('L').map_or(word.offset, |l| l.offset);
                let right = "L2 and L20 set a work offset, L1, L10 and L11 a tool";
                let found = match words.value('L') {
                    Some(_) => format!("G10 L{how}"),
                    None => "G10 without L".into(),
                };
                Err(Refusal::new(place, found, right))
            }
        }
    }

    /// G10 L2 and L20: of the work offset P, or of the one in force with P0.
    fn set_work_offset(
        &mut self,
        words: &Words,
        by_place: bool,
        offset: usize,
    ) -> Result<(), Refusal> {
        let p = words.value('P');
        let given = p.map_or(-1.0, |p| p.value);
        let known = (0.0..=9.0).contains(&given) && given.fract() == 0.0;
        if !known {
            let right = "the work offset: P1 for G54 to P9 for G59.3, P0 for the one in force";
            let place = p.map_or(offset, |p| p.offset);
            return Err(Refusal::new(place, format!("G10 with P{given}"), right));
        }
        let first = match given as u32 {
            0 => self.work_base(),
            system => base::G54 + 20 * (system - 1),
        };
        if let Some(r) = words.value('R') {
            if by_place {
                return Err(Refusal::new(
                    r.offset,
                    "R in G10 L20",
                    "R belongs to G10 L2: the rotation",
                ));
            }
            self.parameters.set(first + 9, r.value);
        }
        let zero = self.zero_for(words, first);
        // Where X and Y are turned, the zero of one depends on both: else the tool would not be where the words say.
        let turned_axes = self.offsets.turned_axes.filter(|&(x, y)| {
            let turned = by_place && self.parameters.get(first + 9) != 0.0;
            turned
                && [x, y]
                    .iter()
                    .any(|&axis| self.axis_value(words, axis).is_some())
        });
        for index in 0..self.setup.axes.len() {
            let of_zero = zero.get(index).copied();
            let value = if turned_axes.is_some_and(|(x, y)| index == x || index == y) {
                of_zero
            } else {
                let given = self.axis_value(words, index);
                given.and_then(|value| if by_place { of_zero } else { Some(value) })
            };
            if let (Some(value), Some(number)) = (value, self.number_of(first, index)) {
                self.parameters.set(number, value);
            }
        }
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
        let mut place = there.in_program(&self.position);
        for (index, component) in place.iter_mut().enumerate().take(self.setup.axes.len()) {
            if let Some(value) = self.axis_value(words, index) {
                *component = value;
            }
        }
        there.work = AxisVector::zeros();
        there.refresh_zero();
        self.position - there.in_machine(&place)
    }
}
