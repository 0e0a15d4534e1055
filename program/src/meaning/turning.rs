//! The lathe cycles G70, G71 and G72: their words, the lines of their profile, and the moves that these become.

use super::{Cause, Feed, Group, Leg, Motion, Refusal, State, Words, refuse};
use crate::arc::{ArcBlock, ArcTolerance, Circle};
use crate::codes::shown_code;
use crate::compensation::Way;
use crate::flat::Flat;
use crate::reader::Word;
use crate::roughing::{Cut, Finishing, Piece, Pockets, Roughing, finishing, roughing};

/// The most passes of G70.
const PASSES_MAX: f64 = 1_000.0;

/// A profile while its lines are read.
#[derive(Debug, Clone)]
pub struct ProfileReading {
    /// Its pieces so far, in the coordinates of the program.
    pieces: Vec<Piece>,
    start: Flat,
    at: Flat,
    motion: Motion,
}

/// Whether a motion code is a lathe cycle that has a profile.
pub fn is_turning(number: u32) -> bool {
    matches!(number, 700 | 710..=712 | 720..=722)
}

impl State {
    /// A profile that begins where the block says, or where the tool is.
    pub fn begin_profile(&self, words: &Words, word: Word) -> Result<ProfileReading, Refusal> {
        let code = shown_code((word.value * 10.0).round() as u32);
        let refuse =
            |what: &str, right: &str| refuse(word.offset, format!("G{code} {what}"), right);
        if self.in_force.plane.0 != 18 {
            return refuse("outside G18", "turning is in the plane ZX: G18 before it");
        }
        if self.in_force.incremental {
            return refuse("in G91", "its profile is absolute: G90 before it");
        }
        let plane = self.plane_axes(word.offset)?;
        let start = self.profile_place(
            words,
            Flat::of(&self.offsets.in_program(&self.position), plane),
        )?;
        Ok(ProfileReading {
            pieces: vec![],
            start,
            at: start,
            motion: self.in_force.motion(),
        })
    }

    /// Z and X of a block, in mm; what it does not say stays.
    fn profile_place(&self, words: &Words, from: Flat) -> Result<Flat, Refusal> {
        let value = |letter| {
            let index = self.equipment.axis_index(letter)?;
            self.axis_value(words, index)
        };
        Ok(Flat::new(
            value('Z').unwrap_or(from.u),
            value('X').unwrap_or(from.v),
        ))
    }

    /// One line of a profile.
    pub fn add_to_profile(
        &self,
        reading: &mut ProfileReading,
        words: &Words,
    ) -> Result<(), Refusal> {
        for (number, word) in words.codes() {
            match (word.letter, number) {
                ('G', 0 | 10 | 20 | 30) => reading.motion = Motion::of_code(number),
                _ => {
                    let found = format!("{word} in a profile");
                    let right = "a profile holds G0, G1, G2 and G3 with X, Z, I, K and R";
                    return refuse(word.offset, found, right);
                }
            }
        }
        if let Some(word) = words.first_of("YABCUVW@^") {
            let found = format!("{word} in a profile");
            return refuse(word.offset, found, "a profile lies in X and Z");
        }
        let (from, to) = (reading.at, self.profile_place(words, reading.at)?);
        if from == to {
            return Ok(());
        }
        let arc = match reading.motion {
            Motion::Arc { clockwise } => {
                Some((self.profile_centre(words, from, to, clockwise)?, !clockwise))
            }
            Motion::Rapid | Motion::Line => None,
            _ => {
                let offset = words.first_of("XZ").map_or(0, |word| word.offset);
                let right = "say how the profile goes on: G1, G2 or G3";
                return refuse(offset, "a profile without a motion mode", right);
            }
        };
        reading.pieces.push(Piece { to, arc });
        reading.at = to;
        Ok(())
    }

    /// The centre of an arc of a profile.
    fn profile_centre(
        &self,
        words: &Words,
        from: Flat,
        to: Flat,
        clockwise: bool,
    ) -> Result<Flat, Refusal> {
        let offset = words.first_of("XZIKR").map_or(0, |word| word.offset);
        if words.value('R').is_none() {
            if words.first_of("IK").is_none() {
                let right = "its centre by I and K or its radius by R";
                return refuse(offset, "an arc without a centre", right);
            }
            let arm = Flat::new(
                words.value('K').map_or(0.0, |word| word.value),
                words.value('I').map_or(0.0, |word| word.value),
            ) * self.in_force.unit_mm();
            let absolute = self.in_force.arc_absolute;
            return Ok(if absolute { arm } else { from + arm });
        }
        let radius_mm = words.value('R').map_or(0.0, |word| word.value) * self.in_force.unit_mm();
        let chord = to - from;
        let squared = radius_mm * radius_mm / chord.dot(chord) - 0.25;
        if radius_mm < 0.0 || squared < -1e-9 {
            let found = format!("R of {radius_mm:.4} mm in a profile");
            let right = "a radius above 0 that reaches both ends";
            return refuse(offset, found, right);
        }
        let height = chord.left() * squared.max(0.0).sqrt();
        let height = if clockwise { -height } else { height };
        Ok((from + to) * 0.5 + height)
    }

    /// The cuts of a cycle along a profile, its way to the start first.
    pub fn cuts(&self, cause: Cause, reading: &ProfileReading) -> Result<Vec<Cut>, Refusal> {
        let Cause { words, offset, .. } = cause;
        let number = words.code(Group::Motion).map_or(0, |(number, _)| number);
        let code = shown_code(number);
        let wrong =
            |Refusal { found, right, .. }| Refusal::new(offset, format!("G{code}: {found}"), right);
        let length = |letter, default_mm| self.length_mm(words, letter).unwrap_or(default_mm);
        let unit_mm = self.in_force.unit_mm();
        let start = reading.start;
        let cuts = if number == 700 {
            let passes = words.whole('P', "passes are a whole number", 1.0..=PASSES_MAX);
            let words = Finishing {
                start,
                from_mm: length('D', 0.0),
                to_mm: length('E', 0.0),
                passes: passes.map_err(|wrong| wrong.at(offset))?.unwrap_or(1),
            };
            finishing(&reading.pieces, &words)
        } else {
            let words = Roughing {
                start,
                leave_mm: length('D', 0.0),
                depth_mm: length('I', unit_mm),
                retract_mm: length('R', 0.5 * unit_mm),
                shift: Flat::new(length('W', 0.0), length('U', 0.0)),
                pockets: match number % 10 {
                    1 => Pockets::Leave,
                    2 => Pockets::Only,
                    _ => Pockets::Cut,
                },
                facing: number >= 720,
            };
            roughing(&reading.pieces, &words)
        };
        let cuts = cuts.map_err(wrong)?;
        Ok(std::iter::once(Cut::Rapid(start)).chain(cuts).collect())
    }

    /// The motion of a cut from where the program is, and its motion mode.
    pub fn leg_of_cut(&self, cut: Cut, offset: usize) -> Result<(Leg, Motion), Refusal> {
        let plane = self.plane_axes(offset)?;
        let program = self.offsets.in_program(&self.position);
        let in_machine = |place: Flat| {
            Flat::of(
                &self.offsets.in_machine(&place.put_into(program, plane)),
                plane,
            )
        };
        let (Cut::Rapid(to) | Cut::Feed(to) | Cut::Arc { to, .. }) = cut;
        let to = in_machine(to).put_into(self.position, plane);
        let feed = match cut {
            Cut::Rapid(_) => Feed::Rapid,
            _ => self.feed(&to, offset)?,
        };
        let (shapes, way, motion) = match cut {
            Cut::Rapid(_) => (self.straight_to(to), Way::Rapid, Motion::Rapid),
            Cut::Feed(_) => (self.straight_to(to), Way::Line, Motion::Line),
            Cut::Arc {
                centre,
                counter_clockwise,
                ..
            } => {
                let clockwise = !counter_clockwise;
                let block = ArcBlock {
                    from: self.position,
                    to,
                    plane,
                    circle: Circle::Centre(in_machine(centre)),
                    clockwise,
                    turns: 1,
                    tolerance: ArcTolerance::METRIC,
                };
                let shapes = block.shapes().map_err(|wrong| wrong.at(offset))?;
                (shapes, block.way()?, Motion::Arc { clockwise })
            }
        };
        let leg = Leg {
            to,
            shapes,
            way,
            feed,
        };
        Ok((leg, motion))
    }
}
