//! The words of an arc block.

use path::geometry::{AxisVector, Shape};

use super::{Cause, Refusal, State, Words, refuse};
use crate::arc::{ArcBlock, ArcTolerance, Circle};
use crate::compensation::{Bow, Way};
use crate::flat::Flat;

/// The most turns of one arc.
const TURNS_MAX: f64 = 10_000.0;

impl State {
    /// Understands the words of an arc.
    pub(super) fn arc_block(
        &self,
        cause: Cause,
        to: AxisVector,
        clockwise: bool,
    ) -> Result<ArcBlock, Refusal> {
        let Cause { words, offset, .. } = cause;
        let plane = self.plane_axes(offset)?;
        let circle = self.circle(words, plane, offset)?;
        let turns = words.whole('P', "turns are a whole number", 1.0..=TURNS_MAX)?;
        let tolerance = match self.in_force.inches {
            true => ArcTolerance::INCH,
            false => ArcTolerance::METRIC,
        };
        let (from, to) = if self.arc_is_tilted() {
            (
                self.offsets.in_program(&self.position),
                self.offsets.in_program(&to),
            )
        } else {
            (self.position, to)
        };
        Ok(ArcBlock {
            from,
            to,
            plane,
            circle,
            clockwise,
            turns: turns.unwrap_or(1),
            tolerance,
        })
    }

    /// Whether the plane of an arc stands askew in the machine: the work offset is turned about Z, and the plane is not XY. Such an arc is
    /// made in the coordinates of the program.
    fn arc_is_tilted(&self) -> bool {
        self.offsets.is_turned() && self.in_force.plane.0 != 17
    }

    /// The shapes of an arc in the machine, from where the tool is to `target`.
    pub(super) fn arc_shapes(
        &self,
        block: &ArcBlock,
        target: AxisVector,
    ) -> Result<Vec<Shape>, Refusal> {
        let mut shapes = block.shapes()?;
        if !self.arc_is_tilted() {
            return Ok(shapes);
        }
        let mut here = self.position;
        let last = shapes.len().saturating_sub(1);
        for (index, shape) in shapes.iter_mut().enumerate() {
            if let Shape::Arc {
                from,
                to,
                centre,
                u,
                v,
                axial,
                ..
            } = shape
            {
                *from = here;
                *to = if index == last {
                    target
                } else {
                    self.offsets.in_machine(to)
                };
                *centre = self.offsets.in_machine(centre);
                for direction in [u, v, axial] {
                    *direction = self.offsets.turned(*direction);
                }
                here = *to;
            }
        }
        Ok(shapes)
    }

    /// The circle, by its radius or by its centre.
    fn circle(&self, words: &Words, axes: [usize; 2], offset: usize) -> Result<Circle, Refusal> {
        let (plane, _, [first, second]) = self.in_force.plane;
        let mut strays = ['I', 'J', 'K'].into_iter();
        let stray = strays.find(|letter| *letter != first && *letter != second);
        if let Some(stray) = stray.and_then(|letter| words.value(letter)) {
            let found = format!("{} in an arc in G{plane}", stray.letter);
            let right = format!("arcs in G{plane} take {first} and {second}");
            return refuse(stray.offset, found, right);
        }
        match (words.value('R'), words.first_of("IJK")) {
            (Some(radius), Some(_)) => {
                let right = "name the circle by R or by its centre, not both";
                refuse(radius.offset, "R together with I, J or K", right)
            }
            (None, None) => {
                let right = format!("its centre by {first} and {second} or its radius by R");
                refuse(offset, "an arc without a centre", right)
            }
            (Some(radius), None) if radius.value == 0.0 => {
                refuse(radius.offset, "R0", "a radius is not 0")
            }
            (Some(radius), None) => Ok(Circle::RadiusMm(radius.value * self.in_force.unit_mm())),
            (None, Some(_)) => self.centre(words, axes, offset).map(Circle::Centre),
        }
    }

    /// The centre that I, J, K name, in machine coordinates.
    fn centre(&self, words: &Words, axes: [usize; 2], offset: usize) -> Result<Flat, Refusal> {
        let (_, _, letters) = self.in_force.plane;
        let missing = |letter: &char| words.value(*letter).is_none();
        if let Some(letter) = letters.into_iter().find(missing)
            && self.in_force.arc_absolute
        {
            let right = "in G90.1 both coordinates of the centre are needed";
            return refuse(offset, format!("an arc without {letter}"), right);
        }
        let [u, v] = letters.map(|letter| words.value(letter).map_or(0.0, |word| word.value));
        let arm = (Flat::new(u, v) * self.in_force.unit_mm()).put_into(AxisVector::zeros(), axes);
        let place = match (self.arc_is_tilted(), self.in_force.arc_absolute) {
            (true, true) => arm,
            (true, false) => self.offsets.in_program(&self.position) + arm,
            (false, true) => self.offsets.in_machine(&arm),
            (false, false) => self.position + self.offsets.turned(arm),
        };
        Ok(Flat::of(&place, axes))
    }
}

impl ArcBlock {
    /// The way of the arc.
    pub fn way(&self) -> Result<Way, Refusal> {
        Ok(Way::Arc(Bow {
            centre: self.centre()?,
            clockwise: self.clockwise,
            turns: self.turns,
        }))
    }
}
