//! What words mean: the state that they are read in, and from words and state to places, feeds, ways and lists of moves.
//!
//! Nothing is done here. What a block changes in the state it changes by one call of a word's own; all else only looks at it.

use std::sync::Arc;

use path::geometry::{AxisVector, Feed};
use serde::{Deserialize, Serialize};

use crate::act::Acts;
use crate::equipment::Equipment;
use crate::in_force::InForce;
use crate::offsets::Offsets;
use crate::parameters::{Parameters, base};
use crate::program::{EventKind, Setup};
use crate::refusal::{Refusal, refuse};
use crate::state::{Motion, SavedModes};
use crate::tilted_plane::TiltedPlane;
use crate::tools::Tools;
use crate::words::{Group, Words, group_of, mode_words};

mod arcs;
mod drilling;
mod feeds;
mod inputs_outputs;
mod left;
mod modal;
mod names;
mod offset_words;
mod places;
mod radius;
mod splines;
mod straight;
mod threads;
mod tool_centre;
mod tool_words;
mod turning;
mod use_of_words;

pub use use_of_words::goes_home_first;

pub use drilling::Drilling;
pub use inputs_outputs::{input_asked, output_switched};
pub use modal::Modal;
pub use offset_words::MORE_WORK;
pub use places::{Leg, PLACES};
pub use splines::Splines;
pub use straight::StraightLeg;
pub use turning::{ProfileReading, is_turning};

/// The part of a block that asks for something: its line, its words, and the place of the word that asks.
#[derive(Debug, Clone, Copy)]
pub struct Cause<'a> {
    /// Line in the file, counted from 1.
    pub line: u32,
    /// All words of the block.
    pub words: &'a Words,
    /// Byte offset of the word in the line.
    pub offset: usize,
}

impl<'a> Cause<'a> {
    /// The word at a place of a line.
    pub fn new(line: u32, words: &'a Words, offset: usize) -> Self {
        Self {
            line,
            words,
            offset,
        }
    }

    /// Refuses the block at the word that asks.
    pub fn refuse<T, E: From<Refusal>>(
        &self,
        found: impl Into<String>,
        right: impl Into<String>,
    ) -> Result<T, E> {
        refuse(self.offset, found, right)
    }

    /// The place of a word, or in its place of the one that asks.
    pub fn place(&self, letter: char) -> usize {
        self.words.place(letter, self.offset)
    }
}

/// The state that the words of a block are read in.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct State {
    #[serde(skip)]
    equipment: Equipment,
    in_force: InForce,
    tools: Tools,
    offsets: Offsets,
    /// Place of the program in machine coordinates; the tool's too, unless it stands beside.
    position: AxisVector,
    /// Place of the tool where it is another one.
    stands: Option<AxisVector>,
    /// Where the axes are while the tool's centre point is controlled (G43.4): places of the program are none of theirs then.
    axes: Option<AxisVector>,
    /// The plane of G68.2.
    plane: Option<TiltedPlane>,
    /// What an incremental word of the next block counts from, seen from the program's place: the corner that a `,R` cut off.
    owed: AxisVector,
    /// The offset of G54.1 in force, from 1; none while that of a code G54 to G59.3 is.
    more_work: Option<u32>,
    parameters: Parameters,
}

impl State {
    /// The state that a run begins with, the tool at `start`.
    pub fn new(setup: &Arc<Setup>, start: AxisVector) -> Self {
        let axis = |letter| setup.axis_index(letter);
        let mut state = Self {
            equipment: Equipment::of(setup),
            tools: Tools::of(setup),
            offsets: Offsets::of_axes(axis('X').zip(axis('Y'))),
            position: start,
            ..Self::default()
        };
        if setup.tolerance_mm > 0.0 {
            state.in_force.begin_in_g64();
        }
        state.set_first_offsets();
        state.begin_with_tool();
        for (letter, value) in mode_words(&setup.beginning.modes).flatten() {
            let code = (value * 10.0).round() as u32;
            if letter == 'G' && group_of('G', code) == Some(Group::WorkOffset) {
                state.set_work_offset_of(code);
            } else {
                state.in_force.begin_with(letter, value);
            }
        }
        state.take_offsets();
        state
    }

    /// Takes what a snapshot leaves out from a fresh one.
    pub fn complete(&mut self, fresh: &Self) {
        self.equipment = fresh.equipment.clone();
        self.tools.share(&fresh.tools);
    }

    pub fn equipment(&self) -> &Equipment {
        &self.equipment
    }

    pub fn in_force(&self) -> &InForce {
        &self.in_force
    }

    pub fn tools(&self) -> &Tools {
        &self.tools
    }

    pub fn offsets(&self) -> &Offsets {
        &self.offsets
    }

    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The parameters, to set those of the program's own.
    pub fn own_parameters(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    /// Place of the program, in machine coordinates.
    pub fn position(&self) -> &AxisVector {
        &self.position
    }

    /// Place of the tool where it is another one than the program's.
    pub fn stands(&self) -> Option<&AxisVector> {
        self.stands.as_ref()
    }

    /// Place of the tool: beside the programmed place while a compensation is on, and until the first move behind it.
    pub fn tool_place(&self) -> AxisVector {
        self.stands.unwrap_or(self.position)
    }

    /// Program and tool are at the end of a motion.
    pub fn go_to(&mut self, end: AxisVector) {
        self.position = end;
        self.stands = None;
    }

    /// The program is at the end of a motion, which the tool makes beside it.
    pub fn go_ahead(&mut self, end: AxisVector) {
        self.position = end;
    }

    /// The next block counts incremental words from so far beside the program's place.
    pub fn owe(&mut self, aside: AxisVector) {
        self.owed = aside;
    }

    /// How far beside it, along the axis of a letter, in the unit of the program.
    pub fn owed_along(&self, letter: char) -> f64 {
        let axis = self.equipment.axis_index(letter);
        axis.map_or(0.0, |axis| self.owed[axis] / self.unit_of(axis))
    }

    /// Whether it does.
    pub fn owes(&self) -> bool {
        self.owed != AxisVector::zeros()
    }

    /// Goes along a block of straight motion; its start.
    #[inline]
    pub fn go_straight(&mut self, leg: &StraightLeg) -> AxisVector {
        self.in_force
            .move_straight(leg.feed == Feed::Rapid, leg.feed_word);
        std::mem::replace(&mut self.position, leg.to)
    }

    /// The tool stands at a place; one that is the program's is none of its own, unless the tool is to go beside the contour.
    pub fn stand(&mut self, place: AxisVector, beside: bool) {
        self.stands = Some(place).filter(|place| beside || *place != self.position);
    }

    /// A probe has tripped at a place, or not, and rests at another.
    pub fn probed(&mut self, at: AxisVector, rests: AxisVector, tripped: bool) {
        self.position = rests;
        let mut place = self.offsets.in_program(&at);
        for (index, component) in place.iter_mut().enumerate() {
            *component /= self.unit_of(index);
        }
        self.set_vector(base::PROBED, place);
        let tripped = f64::from(u8::from(tripped));
        self.parameters.set(base::PROBED + 9, tripped);
    }

    /// Writes the position into its parameters.
    pub fn show_position_parameters(&mut self) {
        for letter in 0..9 {
            let value = self.position_of(letter);
            self.parameters.set(base::POSITION + letter as u32, value);
        }
    }

    /// G7, G8, the codes that say how later words are read, and the motion mode.
    pub fn mode_words(&mut self, words: &Words, acts: &mut Acts) -> Result<(), Refusal> {
        if let Some((70, word)) = words.code(Group::Diameter)
            && self.equipment.axis_index('X').is_none()
        {
            let right = "G7 reads X as a diameter: this machine has no X";
            return refuse(word.offset, "G7", right);
        }
        self.in_force.read_by(words);
        if matches!(words.code(Group::PathControl), Some((640, _))) {
            let tolerance_mm = self.equipment.tolerance_mm;
            self.in_force.rounding_words(words, tolerance_mm, acts)?;
        }
        let Some((number, word)) = words.code(Group::Motion) else {
            return Ok(());
        };
        let probes = self.equipment.probe || self.equipment.answers_assumed;
        if matches!(number, 382..=385) && !probes {
            let right = "probing is not supported on this machine: it has no probe ([program] probe in the machine file)";
            return word.refuse(right);
        }
        // G5.3 ends what G5.2 began.
        if number != 53 && !is_turning(number) {
            self.in_force.move_by(Motion::of_code(number));
        }
        Ok(())
    }

    /// Another motion mode than that of the block is in force behind it.
    pub fn move_by(&mut self, motion: Motion) {
        self.in_force.move_by(motion);
    }

    /// G93 to G95, and F.
    pub fn feed_words(&mut self, words: &Words, acts: &mut Acts) {
        self.in_force.feed_words(words, acts);
    }

    /// G96, G97, S and T.
    pub fn speed_and_tool(&mut self, words: &Words, acts: &mut Acts) -> Result<(), Refusal> {
        if words.code(Group::SpindleMode).is_some() {
            let axis = self.equipment.axis_index('X');
            let centre_mm = axis.map(|_| self.centre_mm());
            self.in_force.spindle_mode(words, centre_mm)?;
        }
        if let Some(speed) = words.value('S') {
            let centre_mm = self.centre_mm();
            self.in_force.set_speed(speed.value, centre_mm, acts);
        }
        match words.value('T') {
            Some(tool) => self.tools.prepare(tool, acts),
            None => Ok(()),
        }
    }

    /// M6, M61, M3 to M5 and M19.
    pub fn change_and_turn(&mut self, words: &Words, acts: &mut Acts) -> Result<(), Refusal> {
        self.change_tool(words, acts)?;
        self.in_force.spindle_words(words, acts)
    }

    /// Coolant, overrides, and M100 to M199.
    pub fn coolant_and_codes(&mut self, words: &Words, acts: &mut Acts) -> Result<(), Refusal> {
        self.in_force.coolant_words(words, acts);
        self.in_force.override_words(words, acts);
        let Some((number, word)) = words.code(Group::User) else {
            return Ok(());
        };
        let code = number / 10;
        let by_machine = self.equipment.machine_codes.contains(&code);
        if !by_machine && !self.equipment.user_codes {
            let right = "user M-codes run a program of the machine builder, or are done by the machine: the machine file names the folder ([program] user_codes) or the numbers ([functions.m_codes])";
            return refuse(word.offset, format!("M{code}"), right);
        }
        if let Some(q) = words.value('Q').filter(|_| by_machine) {
            let right = "an M-code that the machine does has no Q: its value is P";
            return refuse(q.offset, "Q", right);
        }
        let value = |letter| words.value(letter).map_or(-1.0, |word| word.value);
        let (p, q) = (value('P'), value('Q'));
        acts.event(EventKind::UserCode { code, p, q });
        Ok(())
    }

    /// The axis of the spindle is where the program has its X0 now.
    pub fn follow_centre(&mut self, acts: &mut Acts) {
        if self.in_force.surface.is_some() {
            let centre_mm = self.centre_mm();
            self.in_force.follow_centre(centre_mm, acts);
        }
    }

    /// The axis of the spindle along X of the machine, in mm.
    fn centre_mm(&self) -> f64 {
        let axis = self.equipment.axis_index('X');
        axis.map_or(0.0, |axis| self.offsets.zero()[axis])
    }

    /// What M70 and M73 save.
    pub fn saved_modes(&self) -> SavedModes {
        SavedModes {
            modes: *self.in_force.modes(),
            work_offset: self.parameters.get(base::WORK_OFFSET),
            tool_length: *self.offsets.tool(),
            tool_length_of: self.tools.offset_of,
            controls_tool_centre: self.controls_tool_centre(),
            more_work: self.more_work,
        }
    }

    /// Restores what was saved.
    pub fn restore(&mut self, saved: &SavedModes, acts: &mut Acts) {
        let before = *self.in_force.modes();
        self.in_force.restore(&saved.modes);
        if self.plane.is_some() {
            self.change_plane(None);
            acts.note("modes that are restored end a tilted plane (G68.2)");
        }
        self.parameters.set(base::WORK_OFFSET, saved.work_offset);
        self.more_work = saved.more_work;
        // Which length counts is no mode, only whether one does.
        let counts = |length: &AxisVector| *length != AxisVector::zeros();
        let controls = self.controls_tool_centre();
        if counts(&saved.tool_length) != counts(self.offsets.tool())
            || saved.controls_tool_centre != controls
        {
            self.apply_offset(saved.tool_length, saved.tool_length_of, acts);
        }
        self.take_offsets();
        if saved.controls_tool_centre && !self.controls_tool_centre() {
            self.control_tool_centre();
        }
        let centre_mm = self.centre_mm();
        self.in_force
            .tell_restored(&saved.modes, &before, centre_mm, acts);
    }
}
