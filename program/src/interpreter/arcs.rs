//! The words of an arc block.

use super::*;

impl Interpreter<'_> {
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
        let tolerance_mm = if self.inches {
            ARC_TOLERANCE_INCH_MM
        } else {
            ARC_TOLERANCE_MM
        };
        Ok(ArcBlock {
            from: self.position,
            to,
            plane,
            circle,
            clockwise,
            turns,
            tolerance_mm,
        })
    }

    /// The axes of the plane: both slides.
    fn plane_axes(&self, offset: usize) -> Result<[usize; 2], Refusal> {
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
        if let Some(stray) = words
            .values
            .iter()
            .find(|word| "IJK".contains(word.letter) && !letters.contains(&word.letter))
        {
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
        let origin = if self.arc_absolute {
            &self.setup.work_offset
        } else {
            &self.position
        };
        let mut centre = [0.0; 2];
        for ((component, axis), letter) in centre.iter_mut().zip(axes).zip(letters) {
            let word = words.value(letter);
            if self.arc_absolute && word.is_none() {
                let right = "in G90.1 both coordinates of the centre are needed";
                let found = format!("an arc without {letter}");
                return Err(Refusal::new(offset, found, right));
            }
            let value_mm = word.map_or(0.0, |word| word.value) * self.unit_mm();
            *component = origin.get(axis).copied().unwrap_or(0.0) + value_mm;
        }
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
