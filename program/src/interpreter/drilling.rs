//! The drilling cycles G81, G82 and G83: the words of their blocks, and the moves that these become.

use super::*;

impl Interpreter<'_> {
    /// The holes of a drilling block.
    pub(super) fn drill(
        &mut self,
        line: u32,
        words: &Words,
        cycle: Cycle,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let block = self.cycle_block(words, cycle, offset).map_err(one)?;
        self.series = Some(block.series);
        let feed = self.feed(&self.position, offset).map_err(one)?;
        if self.path.elements.len() as f64 + block.steps_max() > ELEMENTS_MAX as f64 {
            let found = format!("holes that take the path beyond {ELEMENTS_MAX} elements");
            return Err(one(Refusal::new(offset, found, "split the program")));
        }
        let mut shapes = Vec::new();
        let mut elements = Vec::new();
        let mut here = self.position;
        for step in block.steps() {
            let (to, feed) = match step {
                Step::Dwell(seconds) => {
                    elements.push(Element::dwell(line, here, seconds));
                    continue;
                }
                Step::Rapid(to) => (to, Feed::Rapid),
                Step::Feed(to) => {
                    self.straight_feeds += 1;
                    (to, feed)
                }
            };
            let shape = Shape::Line { from: here, to };
            let element = Element::new(line, shape.clone(), feed, &self.rotary);
            if element.length_mm > 0.0 {
                elements.push(element);
            }
            shapes.push(shape);
            here = to;
        }
        let outside = self.outside(words, &shapes, offset);
        self.path.elements.extend(elements);
        self.position = here;
        if outside.is_empty() {
            Ok(())
        } else {
            Err(outside)
        }
    }

    /// Understands the words of a drilling block.
    pub(super) fn cycle_block(
        &self,
        words: &Words,
        cycle: Cycle,
        offset: usize,
    ) -> Result<CycleBlock, Refusal> {
        let drill_axis = self.drill_axis(words, cycle, offset)?;
        let series = self.cycle_series(words, cycle, drill_axis, offset)?;
        let repeats = holes(words)?;
        let mut hole = self.target(words);
        if let (Some(of_hole), Some(here)) =
            (hole.get_mut(drill_axis), self.position.get(drill_axis))
        {
            *of_hole = *here;
        }
        let pitch = if self.incremental {
            hole - self.position
        } else {
            AxisVector::zeros()
        };
        let block = CycleBlock {
            from: self.position,
            hole,
            pitch,
            repeats,
            drill_axis,
            series,
            returns_to_r: self.returns_to_r,
        };
        if cycle == Cycle::Peck && block.pecks() >= PECKS_MAX {
            let place = words.value('Q').map_or(offset, |q| q.offset);
            let found = format!(
                "Q{} with {} pecks a hole",
                series.peck_mm / self.unit_mm(),
                block.pecks() + 1.0
            );
            return Err(Refusal::new(
                place,
                found,
                format!("at most {PECKS_MAX} pecks"),
            ));
        }
        Ok(block)
    }

    /// The axis that drills; refuses a block that is none of a drilling cycle.
    fn drill_axis(&self, words: &Words, cycle: Cycle, offset: usize) -> Result<usize, Refusal> {
        let code = cycle.code();
        let (plane, letters, _) = self.plane;
        if plane != 17 {
            let found = format!(
                "{code} in the plane {}{} (G{plane})",
                letters[0], letters[1]
            );
            let right = "drilling cycles are supported along Z: choose the plane XY with G17";
            return Err(Refusal::new(offset, found, right));
        }
        let slide = |letter| {
            let index = self.setup.axis_index(letter)?;
            self.rotary
                .get(index)
                .is_some_and(|rotary| !rotary)
                .then_some(index)
        };
        let Some(drill_axis) = slide('Z') else {
            let right = "drilling cycles run along Z: this machine has no slide Z";
            return Err(Refusal::new(offset, code, right));
        };
        if let Some(word) = words.first_of("ABCUVW") {
            let found = format!("{}{} in {code}", word.letter, word.value);
            return Err(Refusal::new(
                word.offset,
                found,
                "a drilling cycle moves X, Y and Z",
            ));
        }
        if words.first_of("XYZ").is_none() {
            let right = "say where: X, Y or Z";
            return Err(Refusal::new(
                offset,
                format!("{code} without a hole"),
                right,
            ));
        }
        Ok(drill_axis)
    }

    /// The levels, the wait and the peck of a drilling block: its own words, else those that stay from the block before.
    pub(super) fn cycle_series(
        &self,
        words: &Words,
        cycle: Cycle,
        drill_axis: usize,
        offset: usize,
    ) -> Result<Series, Refusal> {
        let code = cycle.code();
        let kept = self.series.filter(|series| series.cycle == cycle);
        let missing = |letter: char, what: &str| {
            let found = format!("{code} without {letter}");
            Refusal::new(
                offset,
                found,
                format!("{what} in the first block of a cycle"),
            )
        };
        let here_mm = self.position.get(drill_axis).copied().unwrap_or(0.0);
        let zero_mm = self
            .setup
            .work_offset
            .get(drill_axis)
            .copied()
            .unwrap_or(0.0);
        let level = |letter: char, counts_from_mm: f64| {
            words.value(letter).map(|word| {
                let from_mm = if self.incremental {
                    counts_from_mm
                } else {
                    zero_mm
                };
                from_mm + word.value * self.unit_mm()
            })
        };
        let r_mm = level('R', here_mm)
            .or(kept.map(|kept| kept.r_mm))
            .ok_or_else(|| missing('R', "the level to feed from"))?;
        let bottom_mm = level('Z', r_mm)
            .or(kept.map(|kept| kept.bottom_mm))
            .ok_or_else(|| missing('Z', "the bottom of the hole"))?;
        if r_mm < bottom_mm {
            let place = words.value('R').or(words.value('Z'));
            let (r, z) = [r_mm, bottom_mm]
                .map(|mm| (mm - zero_mm) / self.unit_mm())
                .into();
            let found = format!("{code} with R at {r:.4} below Z at {z:.4}");
            let place = place.map_or(offset, |word| word.offset);
            return Err(Refusal::new(
                place,
                found,
                "R lies above the bottom of the hole",
            ));
        }
        let dwell_s = match cycle {
            Cycle::DrillAndDwell => seconds_at_the_bottom(words)?
                .or(kept.map(|kept| kept.dwell_s))
                .ok_or_else(|| missing('P', "the seconds to wait at the bottom"))?,
            _ => 0.0,
        };
        let peck_mm = match cycle {
            Cycle::Peck => self
                .peck_mm(words)?
                .or(kept.map(|kept| kept.peck_mm))
                .ok_or_else(|| missing('Q', "the depth of one peck"))?,
            _ => 0.0,
        };
        Ok(Series {
            cycle,
            initial_mm: self.series.map_or(here_mm, |series| series.initial_mm),
            r_mm,
            bottom_mm,
            dwell_s,
            peck_mm,
        })
    }

    /// Depth of a peck that the block gives, in mm.
    fn peck_mm(&self, words: &Words) -> Result<Option<f64>, Refusal> {
        match words.value('Q') {
            Some(q) if q.value <= 0.0 => {
                let found = format!("Q{}", q.value);
                Err(Refusal::new(q.offset, found, "a peck is above 0"))
            }
            given => Ok(given.map(|q| q.value * self.unit_mm())),
        }
    }
}

/// Seconds to wait in the hole that the block gives.
fn seconds_at_the_bottom(words: &Words) -> Result<Option<f64>, Refusal> {
    match words.value('P') {
        Some(p) if p.value < 0.0 => {
            let found = format!("P{}", p.value);
            Err(Refusal::new(p.offset, found, "a time is 0 s or more"))
        }
        given => Ok(given.map(|p| p.value)),
    }
}

/// Holes that the block drills.
fn holes(words: &Words) -> Result<u32, Refusal> {
    match words.value('L') {
        None => Ok(1),
        Some(l) if l.value >= 1.0 && l.value <= REPEATS_MAX && l.value.fract() == 0.0 => {
            Ok(l.value as u32)
        }
        Some(l) => {
            let right = format!("holes are a whole number from 1 to {REPEATS_MAX}");
            Err(Refusal::new(l.offset, format!("L{}", l.value), right))
        }
    }
}
