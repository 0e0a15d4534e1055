//! Where words lead: axis words, polar words, machine coordinates, and what they count.

use machine::TURN_DEG;
use path::geometry::{AxisVector, Feed, Shape};

use super::{Acts, Cause, Motion, Refusal, State, refuse};
use crate::compensation::Way;
use crate::flat::Flat;
use crate::letters::AXIS_LETTERS;
use crate::polar::Polar;
use crate::reader::Word;
use crate::words::{Group, Words, mask_of};

/// Words that say where.
pub const PLACES: u32 = mask_of(AXIS_LETTERS) | mask_of("@^");

/// Index of the letter X.
const X: usize = (b'X' - b'A') as usize;

/// A motion as a program asks for it.
#[derive(Debug, Clone)]
pub struct Leg {
    /// Its end, in machine coordinates.
    pub to: AxisVector,
    /// Its shapes, from where the tool stands.
    pub shapes: Vec<Shape>,
    /// Its way, from which that of the tool beside it follows.
    pub way: Way,
    pub feed: Feed,
}

impl State {
    /// What a number of the program counts along an axis: mm in its unit, degrees as they are.
    pub fn unit_of(&self, index: usize) -> f64 {
        match self.equipment.rotary.get(index) {
            Some(false) => self.in_force.unit_mm(),
            _ => 1.0,
        }
    }

    /// The value of an axis word in mm or degrees: an X of a lathe may be a diameter.
    pub(super) fn axis_value(&self, words: &Words, index: usize) -> Option<f64> {
        let letter = self.equipment.axes.get(index)?.letter;
        let value = words.value(letter)?.value * self.unit_of(index);
        Some(match letter {
            'X' => self.in_force.radius_of(value),
            _ => value,
        })
    }

    /// A length that the block gives beside its axis words, in mm.
    pub(super) fn length_mm(&self, words: &Words, letter: char) -> Option<f64> {
        let word = words.value(letter)?;
        Some(word.value * self.in_force.unit_mm())
    }

    /// A position, with what the axis words of a block say in its place.
    pub(super) fn with_words(&self, words: &Words, mut place: AxisVector) -> AxisVector {
        for (index, component) in place.iter_mut().enumerate() {
            *component = self.axis_value(words, index).unwrap_or(*component);
        }
        place
    }

    /// The axes of the plane: both slides.
    pub fn plane_axes(&self, offset: usize) -> Result<[usize; 2], Refusal> {
        let (plane, letters, _) = self.in_force.plane;
        let [first, second] = letters;
        let letter = match letters.map(|letter| self.equipment.slide(letter)) {
            [Some(u), Some(v)] => return Ok([u, v]),
            [None, _] => first,
            _ => second,
        };
        let found = format!("an arc in the plane {first}{second} (G{plane})");
        let right = format!("this machine has no slide {letter}; choose a plane it has");
        refuse(offset, found, right)
    }

    /// The motion of a block to a place: G0, G1, G2 or G3.
    pub fn leg(&self, cause: Cause, to: AxisVector, acts: &mut Acts) -> Result<Leg, Refusal> {
        let wrong = |wrong: Refusal| wrong.at(cause.offset);
        let (shapes, way) = match self.in_force.motion() {
            Motion::Rapid => (self.straight_to(to), Way::Rapid),
            Motion::Line => (self.straight_to(to), Way::Line),
            Motion::Arc { clockwise } => {
                // A missing feed is told before a wrong arc.
                self.feed(&to, cause.offset)?;
                let block = self.arc_block(cause, to, clockwise)?;
                let shapes = self.arc_shapes(&block, to).map_err(wrong)?;
                if block.is_spiral() {
                    acts.note("an arc whose ends are more than 0.002 mm unequally far from its centre: a circle through both ends is made of it");
                }
                (shapes, block.way().map_err(wrong)?)
            }
            _ => {
                let word = cause.words.first_in(PLACES);
                let letter = word.map_or('?', |word| word.letter);
                let found = format!("{letter} without a motion mode");
                return cause.refuse(found, "say how to move: G0, G1, G2 or G3");
            }
        };
        let feed = match way {
            Way::Rapid => Feed::Rapid,
            _ => self.feed_along(cause, &shapes, &to)?,
        };
        Ok(Leg {
            to,
            shapes,
            way,
            feed,
        })
    }

    /// A straight line from where the tool stands.
    pub fn straight_to(&self, to: AxisVector) -> Vec<Shape> {
        let from = self.tool_place();
        vec![Shape::Line { from, to }]
    }

    /// Where the block's axis words lead, in machine coordinates.
    pub fn target(&self, words: &Words) -> Result<AxisVector, Refusal> {
        if let Some((_, word)) = words.code(Group::MachineCoordinates) {
            return self.machine_target(words, word.offset);
        }
        if let Some(word) = words.first_of("@^") {
            return self.polar_target(words, word);
        }
        Ok(self.plain_target(words))
    }

    /// The same of plain axis words.
    fn plain_target(&self, words: &Words) -> AxisVector {
        let target = self.target_from_here(words);
        match self.in_force.incremental {
            true => target + self.owed,
            false => target,
        }
    }

    fn target_from_here(&self, words: &Words) -> AxisVector {
        if self.offsets.is_turned() {
            return self.turned_target(words);
        }
        self.target_by(|letter| Some(words.value((b'A' + letter as u8) as char)?.value))
    }

    /// Where plain values of axes lead, each by the index of its letter, while nothing is turned.
    #[inline]
    pub(super) fn target_by(&self, value_of: impl Fn(usize) -> Option<f64>) -> AxisVector {
        let axes = &self.equipment.straight_axes;
        let unit_mm = self.in_force.unit_mm();
        let incremental = self.in_force.incremental;
        let mut target = self.position;
        let places = target
            .iter_mut()
            .zip(&self.equipment.rotary)
            .zip(self.offsets.zero().iter());
        for (&(letter, ..), ((component, rotary), zero)) in axes.each.iter().zip(places) {
            let Some(value) = value_of(letter) else {
                continue;
            };
            let mut value = value * if *rotary { 1.0 } else { unit_mm };
            if letter == X {
                value = self.in_force.radius_of(value);
            }
            let from = if incremental { *component } else { *zero };
            *component = from + value;
        }
        if axes.has_endless && !incremental {
            return self.shorter_ways(target);
        }
        target
    }

    /// Where an axis goes for an absolute place: one that turns without end to the nearest of the places that are whole turns apart,
    /// of two as near in positive direction. (Fanuc, parameters ROA = 1 and RAB = 0 of 1008.)
    fn on_shorter_way(&self, index: usize, place: f64) -> f64 {
        let axis = self.equipment.axes.get(index);
        let endless = axis.is_some_and(|axis| axis.modulo);
        let here = self.position.get(index).copied().filter(|_| endless);
        here.map_or(place, |here| {
            place + TURN_DEG * libm::floor((here - place) / TURN_DEG + 0.5)
        })
    }

    /// A place, reached the shorter way by each axis that turns without end.
    pub(super) fn shorter_ways(&self, mut place: AxisVector) -> AxisVector {
        for (index, component) in place.iter_mut().enumerate() {
            *component = self.on_shorter_way(index, *component);
        }
        place
    }

    /// Where polar words lead: X and Y by them, the other axes by their own words.
    fn polar_target(&self, words: &Words, word: Word) -> Result<AxisVector, Refusal> {
        let [Some(x), Some(y)] = ['X', 'Y'].map(|letter| self.equipment.slide(letter)) else {
            let right = "@ and ^ are places in X and Y: this machine has no such slides";
            return refuse(word.offset, "a polar word", right);
        };
        let plane = [x, y];
        if let Some(other) = words.first_of("XY") {
            let found = format!("{} beside a polar word", other.letter);
            let right = "X and Y, or @ and ^: one of the two in a block";
            return refuse(other.offset, found, right);
        }
        let polar = Polar {
            radius_mm: self.length_mm(words, '@'),
            angle_deg: words.value('^').map(|word| word.value),
        };
        let from = Flat::of(&self.offsets.in_program(&self.position), plane);
        let place = polar
            .place(from, self.in_force.incremental)
            .map_err(|wrong| wrong.at(word.offset))?;
        let target = self.plain_target(words);
        let place = self
            .offsets
            .in_machine(&place.put_into(self.offsets.in_program(&target), plane));
        Ok(Flat::of(&place, plane).put_into(target, plane))
    }

    /// The same where the work offset is turned.
    fn turned_target(&self, words: &Words) -> AxisVector {
        if self.in_force.incremental {
            let step = self.with_words(words, AxisVector::zeros());
            return self.position + self.offsets.turned(step);
        }
        let place = self.with_words(words, self.offsets.in_program(&self.position));
        self.shorter_ways(self.offsets.in_machine(&place))
    }

    /// G53: the words are machine coordinates.
    fn machine_target(&self, words: &Words, offset: usize) -> Result<AxisVector, Refusal> {
        if !matches!(self.in_force.motion(), Motion::Rapid | Motion::Line) {
            return refuse(offset, "G53 without G0 or G1", "G53 goes with G0 or G1");
        }
        if self.in_force.incremental {
            let right = "machine coordinates are absolute: G90 before it";
            return refuse(offset, "G53 in G91", right);
        }
        if let Some(word) = words.first_of("@^") {
            let right = "machine coordinates are X, Y and the other axes";
            return refuse(word.offset, "a polar word with G53", right);
        }
        let mut target = self.position;
        for (index, component) in target.iter_mut().enumerate() {
            if let Some(value) = self.axis_value(words, index) {
                *component = self.on_shorter_way(index, value);
            }
        }
        Ok(target)
    }

    /// G28 and G30: where the axis words lead, over which the axes go home, whatever the motion mode. G53 is no part of such a block, so
    /// nothing is refused.
    pub fn over_home(&self, words: &Words) -> AxisVector {
        self.target(words).unwrap_or(self.position)
    }

    /// G28 and G30: the place that parameters keep for the axes that the words name, for all if they name none.
    pub fn home(&self, first: u32, cause: Cause, over: Option<AxisVector>) -> AxisVector {
        let mut home = self.vector_of(first);
        for (index, component) in home.iter_mut().enumerate() {
            let stays = index >= self.equipment.axes.len();
            let over = over.filter(|_| self.axis_value(cause.words, index).is_none());
            let stays = Some(self.position).filter(|_| stays);
            let place = stays.or(over).and_then(|of| of.get(index).copied());
            *component = place.unwrap_or(*component);
        }
        self.shorter_ways(home)
    }
}
