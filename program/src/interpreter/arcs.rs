//! The words of an arc block.

use super::*;
use crate::arc::ArcRefusal;

impl Interpreter {
    /// Understands the words of an arc.
    pub(super) fn arc_block(
        &self,
        words: &Words,
        to: AxisVector,
        clockwise: bool,
        offset: usize,
    ) -> Result<ArcBlock, Refusal> {
        let plane = self.plane_axes(offset)?;
        let circle = self.circle(words, plane, offset)?;
        let turns = turns(words)?;
        let tolerance = if self.inches {
            ArcTolerance::INCH
        } else {
            ArcTolerance::METRIC
        };
        let (from, to) = if self.arc_is_tilted() {
            (self.in_program(&self.position), self.in_program(&to))
        } else {
            (self.position, to)
        };
        Ok(ArcBlock {
            from,
            to,
            plane,
            circle,
            clockwise,
            turns,
            tolerance,
        })
    }

    /// Whether the plane of an arc stands askew in the machine: the work offset is turned about Z, and the plane is not XY. Such an arc is
    /// made in the coordinates of the program.
    fn arc_is_tilted(&self) -> bool {
        self.offsets.turn.is_some() && self.plane.0 != 17
    }

    /// The shapes of an arc in the machine, from where the tool is to `target`.
    pub(super) fn arc_shapes(
        &self,
        block: &ArcBlock,
        target: AxisVector,
    ) -> Result<Vec<Shape>, ArcRefusal> {
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
                    self.in_machine(to)
                };
                *centre = self.in_machine(centre);
                for direction in [u, v, axial] {
                    *direction = self.turned(*direction);
                }
                here = *to;
            }
        }
        Ok(shapes)
    }

    /// The axes of the plane: both slides.
    pub(super) fn plane_axes(&self, offset: usize) -> Result<[usize; 2], Refusal> {
        let (plane, letters, _) = self.plane;
        let mut axes = [0; 2];
        for (axis, letter) in axes.iter_mut().zip(letters) {
            let index = self
                .setup
                .axis_index(letter)
                .filter(|&index| !self.rotary.get(index).copied().unwrap_or(true));
            *axis = index.ok_or_else(|| {
                let found = format!(
                    "an arc in the plane {}{} (G{plane})",
                    letters[0], letters[1]
                );
                Refusal::new(
                    offset,
                    found,
                    format!("this machine has no slide {letter}; choose a plane it has"),
                )
            })?;
        }
        Ok(axes)
    }

    /// The circle, by its radius or by its centre.
    fn circle(&self, words: &Words, axes: [usize; 2], offset: usize) -> Result<Circle, Refusal> {
        let (plane, _, letters) = self.plane;
        let strays = ["I", "J", "K"]
            .into_iter()
            .filter(|letter| !letters.iter().any(|of_plane| letter.contains(*of_plane)));
        if let Some(stray) = strays.filter_map(|letter| words.first_of(letter)).next() {
            let found = format!("{} in an arc in G{plane}", stray.letter);
            let right = format!("arcs in G{plane} take {} and {}", letters[0], letters[1]);
            return Err(Refusal::new(stray.offset, found, right));
        }
        match (words.value('R'), words.first_of("IJK")) {
            (Some(radius), Some(_)) => Err(Refusal::new(
                radius.offset,
                "R together with I, J or K",
                "name the circle by R or by its centre, not both",
            )),
            (None, None) => {
                let right = format!(
                    "its centre by {} and {} or its radius by R",
                    letters[0], letters[1]
                );
                Err(Refusal::new(offset, "an arc without a centre", right))
            }
            (Some(radius), None) if radius.value == 0.0 => {
                Err(Refusal::new(radius.offset, "R0", "a radius is not 0"))
            }
            (Some(radius), None) => Ok(Circle::RadiusMm(radius.value * self.unit_mm())),
            (None, Some(_)) => self.centre(words, axes, offset).map(Circle::Centre),
        }
    }

    /// The centre that I, J, K name, in machine coordinates.
    fn centre(&self, words: &Words, axes: [usize; 2], offset: usize) -> Result<[f64; 2], Refusal> {
        let (_, _, letters) = self.plane;
        let mut arm = AxisVector::zeros();
        for (axis, letter) in axes.into_iter().zip(letters) {
            let word = words.value(letter);
            if self.arc_absolute && word.is_none() {
                let right = "in G90.1 both coordinates of the centre are needed";
                let found = format!("an arc without {letter}");
                return Err(Refusal::new(offset, found, right));
            }
            if let Some(component) = arm.get_mut(axis) {
                *component = word.map_or(0.0, |word| word.value) * self.unit_mm();
            }
        }
        let place = match (self.arc_is_tilted(), self.arc_absolute) {
            (true, true) => arm,
            (true, false) => self.in_program(&self.position) + arm,
            (false, true) => self.in_machine(&arm),
            (false, false) => self.position + self.turned(arm),
        };
        let centre = axes.map(|axis| place.get(axis).copied().unwrap_or(0.0));
        Ok(centre)
    }
}

/// Turns of the arc, the last one included.
fn turns(words: &Words) -> Result<u32, Refusal> {
    match words.value('P') {
        None => Ok(1),
        Some(p) if p.value >= 1.0 && p.value <= TURNS_MAX && p.value.fract() == 0.0 => {
            Ok(p.value as u32)
        }
        Some(p) => {
            let right = format!("turns are a whole number from 1 to {TURNS_MAX}");
            Err(Refusal::new(p.offset, format!("P{}", p.value), right))
        }
    }
}
