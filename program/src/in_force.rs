//! The codes in force: the motion mode, the modes, and the words that set them.

use std::ops::Deref;

use path::geometry::PathTolerance;
use serde::{Deserialize, Serialize};

use crate::act::Acts;
use crate::cycles::Turning;
use crate::refusal::Refusal;
use crate::state::{FeedMode, FeedWord, ModalState, Motion, plane_of_code};
use crate::words::{Group, READ_BY, Words, group_of};

mod spindle;

const MM_PER_INCH: f64 = 25.4;

/// The largest tolerance, in mm.
const TOLERANCE_MAX_MM: f64 = 5.0;

/// The codes in force. Their modes can be read as they stand; only the words of the language change them.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct InForce {
    motion: Motion,
    modes: ModalState,
    /// G98 or G99 was said.
    pub return_was_said: bool,
}

impl Deref for InForce {
    type Target = ModalState;

    fn deref(&self) -> &ModalState {
        &self.modes
    }
}

impl InForce {
    /// The motion mode.
    pub fn motion(&self) -> Motion {
        self.motion
    }

    /// Puts another motion mode in force.
    pub fn move_by(&mut self, motion: Motion) {
        self.motion = motion;
    }

    /// The modes as they stand, for saving them.
    pub fn modes(&self) -> &ModalState {
        &self.modes
    }

    /// Restores saved modes, but for spindle and coolant: those change on the machine.
    pub fn restore(&mut self, saved: &ModalState) {
        self.modes = ModalState {
            spindle: self.modes.spindle,
            surface: self.modes.surface,
            coolant: self.modes.coolant,
            ..*saved
        };
    }

    /// Program units to mm.
    pub fn unit_mm(&self) -> f64 {
        if self.inches { MM_PER_INCH } else { 1.0 }
    }

    /// The radius that a length along X stands for: half of it where it is a diameter (G7).
    pub fn radius_of(&self, length: f64) -> f64 {
        if self.diameters { length / 2.0 } else { length }
    }

    /// Ten times the code of the motion mode.
    pub fn motion_code(&self) -> f64 {
        match self.motion {
            Motion::None => 800.0,
            Motion::Rapid => 0.0,
            Motion::Line => 10.0,
            Motion::Arc { clockwise: true } => 20.0,
            Motion::Arc { clockwise: false } => 30.0,
            Motion::Probe(number) => f64::from(number),
            Motion::Cycle(cycle) => f64::from(cycle as u32),
            Motion::Spline(spline) => f64::from(spline as u32),
            Motion::InStep(motion) => f64::from(motion as u32),
        }
    }

    /// How the spindle turns.
    pub fn turning(&self) -> Option<Turning> {
        match self.spindle.direction {
            0 => None,
            1 => Some(Turning::Clockwise),
            _ => Some(Turning::CounterClockwise),
        }
    }

    /// How far the path may be left, `tolerance_mm` where G64 does not say.
    pub fn tolerance(&self, tolerance_mm: f64) -> PathTolerance {
        if self.path_control != 640 {
            return PathTolerance::EXACT;
        }
        let [corner_mm, chord_mm] = self.path_words;
        let corner_mm = corner_mm.unwrap_or(tolerance_mm);
        PathTolerance {
            corner_mm,
            chord_mm: chord_mm.unwrap_or(corner_mm),
            rotary_deg: 0.0,
        }
    }

    /// Whether the tool rests before and behind each motion (G61.1).
    pub fn stops_exactly(&self) -> bool {
        self.path_control == 611
    }

    /// Puts a code in force that says how later words are read.
    fn set(&mut self, group: Group, number: u32) {
        let modes = &mut self.modes;
        match group {
            Group::Plane => modes.plane = plane_of_code(number),
            Group::Units => modes.inches = number == 200,
            Group::Diameter => modes.diameters = number == 70,
            Group::PathControl => {
                modes.path_control = number;
                modes.path_words = [None; 2];
            }
            Group::Distance => modes.incremental = number == 910,
            Group::ArcDistance => modes.arc_absolute = number == 901,
            Group::FeedMode => {
                modes.feed_mode = FeedMode::of_code(number).unwrap_or(FeedMode::PerMinute);
            }
            Group::CycleReturn => modes.returns_to_r = number == 990,
            _ => {}
        }
    }

    /// Programs begin in G64 where the machine has a tolerance.
    pub fn begin_in_g64(&mut self) {
        self.modes.path_control = 640;
    }

    /// Takes a mode that the run begins with; that of a work offset is none of these.
    pub fn begin_with(&mut self, letter: char, value: f64) {
        let code = (value * 10.0).round() as u32;
        match (letter, code) {
            ('F', _) => self.feed_by(value),
            ('S', _) => self.modes.spindle.speed = value,
            ('P', _) => self.modes.path_words[0] = Some(value),
            ('Q', _) => self.modes.path_words[1] = Some(value),
            ('M', 30) => self.modes.spindle.direction = 1,
            ('M', 40) => self.modes.spindle.direction = -1,
            ('M', 70) => self.modes.coolant[0] = true,
            ('M', _) => self.modes.coolant[1] = true,
            (_, 0..=30) => self.motion = Motion::of_code(code),
            _ => {
                if let Some(group) = group_of('G', code) {
                    self.set(group, code);
                }
            }
        }
    }

    /// Codes of a block that say how later words are read.
    pub fn read_by(&mut self, words: &Words) {
        for group in READ_BY {
            if let Some((number, _)) = words.code(group) {
                self.set(group, number);
            }
        }
        self.return_was_said |= words.code(Group::CycleReturn).is_some();
    }

    /// G93 to G95, and F.
    pub fn feed_words(&mut self, words: &Words, acts: &mut Acts) {
        if let Some((number, _)) = words.code(Group::FeedMode) {
            let before = self.feed_mode;
            self.set(Group::FeedMode, number);
            if self.feed_mode != before {
                // A feed of another kind is none.
                self.modes.feed = None;
            }
        }
        let Some(feed) = words.value('F') else { return };
        let changes_to = words.code(Group::Units).map(|(number, _)| number == 200);
        if changes_to.is_some_and(|inches| inches != self.inches) {
            acts.note(if self.inches {
                "F in the block that changes to mm is read in inches: put G21 into a block before it"
            } else {
                "F in the block that changes to inches is read in mm: put G20 into a block before it"
            });
        }
        self.feed_by(feed.value);
    }

    /// F: 0 takes the feed away, the next feed motion needs another.
    fn feed_by(&mut self, value: f64) {
        let unit_mm = self.unit_mm();
        self.modes.feed = (value > 0.0).then_some(FeedWord { value, unit_mm });
    }

    /// A block of straight motion.
    #[inline]
    pub fn move_straight(&mut self, rapid: bool, feed: Option<FeedWord>) {
        self.modes.feed = feed;
        self.motion = if rapid { Motion::Rapid } else { Motion::Line };
    }

    /// P and Q of a block with G64, which have `tolerance_mm` where it has neither.
    pub fn rounding_words(
        &mut self,
        words: &Words,
        tolerance_mm: f64,
        acts: &mut Acts,
    ) -> Result<(), Refusal> {
        for (said, letter) in ['P', 'Q'].into_iter().enumerate() {
            let Some(word) = words.value(letter) else {
                continue;
            };
            let tolerance_mm = word.value * self.unit_mm();
            if !(0.0..=TOLERANCE_MAX_MM).contains(&tolerance_mm) {
                return word.refuse("a tolerance is 0 to 5 mm");
            }
            if let Some(kept) = self.modes.path_words.get_mut(said) {
                *kept = Some(tolerance_mm);
            }
        }
        if self.path_words == [None; 2] && tolerance_mm <= 0.0 {
            acts.note("G64 without P follows the exact path here: [path] tolerance_mm of the machine file says how far it may leave it");
        }
        Ok(())
    }
}
