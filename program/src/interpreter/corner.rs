//! `,R` and `,C`: what is put between two straight blocks (B-64304EN-2, "Optional chamfering and corner R").

use path::geometry::AxisVector;

use super::{Done, Group, Interpreter, Refusal, State, Words, refuse};
use crate::fanuc::{Modes, translate};
use crate::flat::Flat;
use crate::meaning::{Cause, PLACES};
use crate::reader::{Corner, Line, Word};
use crate::state::Motion;

/// Directions that differ by less are one straight line, in rad.
const STRAIGHT_RAD: f64 = 1e-9;

/// The block behind a corner, and how it is read.
#[derive(Debug, Clone)]
pub struct CornerAhead {
    /// As it was read.
    pub line: Line,
    /// The modes of Fanuc's language that are in force then.
    pub modes: Modes,
}

/// What the block behind a corner has to be.
const NEXT: &str = "the next block is straight, G1 with axis words, and changes no mode";

impl Corner {
    /// As a person writes it.
    pub fn shown(&self) -> String {
        format!(",{}{}", if self.rounds { 'R' } else { 'C' }, self.size)
    }

    /// Refuses one that no block follows.
    pub fn without_next(&self) -> Refusal {
        let found = format!("{} without a next block", self.shown());
        Refusal::new(self.offset, found, NEXT)
    }
}

impl CornerAhead {
    /// The words of the block, with the program at the corner.
    fn words(&self, corner: Corner, there: &State) -> Result<Words, Refusal> {
        let (mut line, mut modes) = (self.line.clone(), self.modes);
        let none = || corner.without_next();
        translate(&mut line, there, &mut modes).map_err(|_| none())?;
        let mut words = Words::default();
        words.sort(&line, there.equipment()).map_err(|_| none())?;
        let groups = [
            Group::Once,
            Group::MachineCoordinates,
            Group::Plane,
            Group::Distance,
            Group::Units,
            Group::CutterCompensation,
            Group::WorkOffset,
        ];
        let changes = groups.iter().any(|group| words.code(*group).is_some());
        let motion = words.code(Group::Motion);
        let turns = motion.is_some_and(|(code, _)| code != 10);
        if changes || turns || words.first_in(PLACES).is_none() {
            let found = format!("{} before a block that is no G1 alone", corner.shown());
            return refuse(corner.offset, found, NEXT);
        }
        Ok(words)
    }
}

impl Interpreter {
    /// The block that comes next has a corner at its end.
    pub fn meet_corner(&mut self, corner: Corner, ahead: CornerAhead) {
        self.corner = Some(Box::new((corner, ahead)));
    }

    /// Whether the corner was not met by a motion; it is gone then.
    pub fn corner_is_left(&mut self) -> bool {
        self.corner.take().is_some()
    }

    /// A straight feed to `end`, and the corner at it; the next block begins behind the corner.
    pub(super) fn round_corner(
        &mut self,
        cause: Cause,
        end: AxisVector,
        corner: Corner,
        ahead: &CornerAhead,
    ) -> Done {
        let shown = corner.shown();
        let [u, v] = self.state.plane_axes(corner.offset)?;
        let plane = [u, v];
        let from = *self.state.position();
        let mut there = self.state.clone();
        there.go_ahead(end);
        there.owe(AxisVector::zeros());
        let next = there.target(&ahead.words(corner, &there)?)?;
        let aside = |a: &AxisVector, b: &AxisVector| {
            (0..a.len()).any(|axis| axis != u && axis != v && a[axis] != b[axis])
        };
        if aside(&from, &end) || aside(&end, &next) {
            let right = "both blocks of a corner move in the plane alone";
            return refuse(corner.offset, shown, right);
        }
        let (first, second) = (
            Flat::of(&(end - from), plane),
            Flat::of(&(next - end), plane),
        );
        let (before_mm, behind_mm) = (first.length(), second.length());
        let size_mm = corner.size * self.state.in_force().unit_mm();
        let turn_rad = first.angle_to(second);
        let off_mm = match corner.rounds {
            true => size_mm * libm::tan(turn_rad.abs() / 2.0),
            false => size_mm,
        };
        let is_line = before_mm == 0.0 || behind_mm == 0.0 || turn_rad.abs() < STRAIGHT_RAD;
        if is_line || size_mm == 0.0 {
            let leg = self.change(cause.line, |state, acts| state.leg(cause, end, acts))?;
            return self.follow(cause, leg);
        }
        if !(off_mm <= before_mm && off_mm <= behind_mm) {
            let found = format!(
                "{shown}, which takes {off_mm:.4} mm off blocks of {before_mm:.4} and {behind_mm:.4} mm"
            );
            return refuse(corner.offset, found, "a corner that fits between both ends");
        }
        let ends = [
            end - (end - from) * (off_mm / before_mm),
            end + (next - end) * (off_mm / behind_mm),
        ];
        let mut arc = Words::default();
        arc.insert(Word {
            letter: 'R',
            value: corner.size,
            offset: corner.offset,
        });
        let arc = Cause::new(cause.line, &arc, corner.offset);
        for (index, to) in ends.into_iter().enumerate() {
            let rounds = index == 1 && corner.rounds;
            if rounds {
                self.state.move_by(Motion::Arc {
                    clockwise: turn_rad < 0.0,
                });
            }
            let cause = if rounds { arc } else { cause };
            let leg = self.change(cause.line, |state, acts| state.leg(cause, to, acts));
            self.state.move_by(Motion::Line);
            self.follow(cause, leg?)?;
        }
        self.state.owe(end - ends[1]);
        Ok(())
    }
}
