//! The canned cycles: the words of their blocks, and the moves that these become.

use super::modes::{dwell_right, is_dwell};
use super::*;
use crate::cycles::{CycleBlock, Level, Levels, PECKS_MAX, Step, Turning, Wait};
use crate::flat::Flat;

/// What is said where the return height is LinuxCNC's other one.
const RETURN_HEIGHT: &str = "neither G98 nor G99 is said: holes return to the level before the cycles (G98), not to R as in LinuxCNC";

/// The most holes of one drilling block.
const REPEATS_MAX: f64 = 10_000.0;

impl Interpreter {
    /// Holes of which each is a step of distance and angle from the one before.
    fn drill_circle(
        &mut self,
        line: u32,
        words: &Words,
        repeats: u32,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let Motion::Cycle(cycle) = self.motion else {
            return Ok(());
        };
        let mut single = words.clone();
        single.remove("L");
        for _ in 0..repeats {
            self.drill(line, &single, cycle, offset)?;
        }
        Ok(())
    }

    /// The holes of a block of a cycle.
    pub(super) fn drill(
        &mut self,
        line: u32,
        words: &Words,
        cycle: Cycle,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let repeats = holes(words)?;
        if repeats > 1 && self.modes.incremental && words.first_of("@^").is_some() {
            return self.drill_circle(line, words, repeats, offset);
        }
        let block = self.cycle_block(words, cycle, offset)?;
        self.series = Some(block.series);
        if matches!(cycle, Cycle::TapRight | Cycle::TapLeft) {
            self.check_speed_is_constant(cycle, offset)?;
        }
        let feed = self.feed(&self.position, offset)?;
        let per_turn = self.feed_per_turn();
        self.output.check_room(block.steps_max(), offset)?;
        if !self.return_was_said && block.series.initial_mm > block.levels.r_mm {
            self.note(line, RETURN_HEIGHT);
        }
        let mut shapes = Vec::new();
        let mut here = self.tool_place();
        let mut tapping = false;
        for step in block.steps() {
            // The overrides count again where the tap is out of the hole.
            let taps = matches!(step, Step::Tap(_));
            if taps && !tapping {
                self.cycle_overrides(line, false);
                self.begin_tap(line, feed);
            } else if tapping && matches!(step, Step::Rapid(_)) {
                self.end_tap(line);
                self.cycle_overrides(line, true);
            }
            tapping = taps || (tapping && !matches!(step, Step::Rapid(_)));
            let (to, feed) = match step {
                Step::Rapid(to) => (to, Feed::Rapid),
                Step::Feed(to) | Step::Tap(to) => {
                    self.output.straight_feeds += 1;
                    (to, feed)
                }
                Step::Dwell(seconds) => {
                    let dwell = Element::dwell(line, here, seconds);
                    self.output.add(dwell);
                    continue;
                }
                event => {
                    self.cycle_event(line, event);
                    continue;
                }
            };
            let shape = Shape::Line { from: here, to };
            self.add_shape(line, shape.clone(), feed, per_turn);
            shapes.push(shape);
            here = to;
        }
        if tapping {
            self.end_tap(line);
            self.cycle_overrides(line, true);
        }
        self.position = here;
        self.stands = None;
        if_none(self.outside(words, &shapes, offset))
    }

    /// What a cycle does with the spindle and the program.
    fn cycle_event(&mut self, line: u32, step: Step) {
        match step {
            Step::SpindleStop => self.turn_spindle(line, 0),
            Step::SpindleStart(Turning::Clockwise) => self.turn_spindle(line, 1),
            Step::SpindleStart(Turning::CounterClockwise) => self.turn_spindle(line, -1),
            Step::SpindleOrient => self.event(line, EventKind::SpindleOrient(0.0)),
            Step::ProgramStop => self.event(line, EventKind::ProgramStop),
            Step::Rapid(_) | Step::Feed(_) | Step::Tap(_) | Step::Dwell(_) => {}
        }
    }

    /// From here on a spindle with encoder keeps step: the pitch is the feed at the speed of the spindle.
    fn begin_tap(&mut self, line: u32, feed: Feed) {
        let turns_s = self.modes.spindle.speed / 60.0;
        if let (Feed::PathMmS(mm_s), true) = (feed, turns_s > 0.0) {
            self.event(line, EventKind::SpindleCoupled(mm_s / turns_s));
        }
    }

    fn end_tap(&mut self, line: u32) {
        if self.modes.spindle.speed > 0.0 {
            self.event(line, EventKind::SpindleUncoupled);
        }
    }

    /// Whether the override of the feed counts, as a cycle has it.
    fn cycle_overrides(&mut self, line: u32, count: bool) {
        if self.modes.feed_override {
            self.event(line, EventKind::OverridesEnabled(count));
        }
    }

    /// How the spindle turns.
    fn turning(&self) -> Option<Turning> {
        match self.modes.spindle.direction {
            0 => None,
            1 => Some(Turning::Clockwise),
            _ => Some(Turning::CounterClockwise),
        }
    }

    /// Understands the words of a block of a cycle.
    pub(super) fn cycle_block(
        &self,
        words: &Words,
        cycle: Cycle,
        offset: usize,
    ) -> Result<CycleBlock, Refusal> {
        let axes = self.cycle_axes(words, cycle, offset)?;
        let turning = self.turning();
        self.allows_cycle(cycle, &axes, turning, offset)?;
        let series = self.cycle_series(words, cycle, &axes, offset)?;
        let levels = self.cycle_levels(words, &series, offset)?;
        let repeats = holes(words)?;
        let mut hole = self.target(words)?;
        hole[axes.drill_axis] = self.position[axes.drill_axis];
        let pitch = if self.modes.incremental {
            hole - self.position
        } else {
            AxisVector::zeros()
        };
        let [u, v] = series.aside_mm;
        let aside = Flat::new(u, v).put_into(AxisVector::zeros(), axes.plane);
        let aside = self.turned(aside);
        let block = CycleBlock {
            from: self.position,
            hole,
            pitch,
            repeats,
            aside,
            series,
            levels,
            returns_to_r: self.modes.returns_to_r,
            turning,
        };
        if cycle.pecks() && block.pecks() >= PECKS_MAX {
            let (peck, count) = (series.peck_mm / self.unit_mm(), block.pecks() + 1.0);
            let found = format!("Q{peck} with {count} pecks a hole");
            let right = format!("at most {PECKS_MAX} pecks");
            return refuse(words.place('Q', offset), found, right);
        }
        Ok(block)
    }

    /// Refuses a cycle that the modes in force or the spindle do not allow.
    fn allows_cycle(
        &self,
        cycle: Cycle,
        axes: &CycleAxes,
        turning: Option<Turning>,
        offset: usize,
    ) -> Result<(), Refusal> {
        if self.modes.feed_mode == FeedMode::InverseTime {
            let right = "a cycle has no time of its own: G94 before it";
            return refuse(offset, format!("{cycle} in G93"), right);
        }
        if axes.plane_number != 17 && self.offsets.turn.is_some() {
            let plane = axes.plane_number;
            let found = format!("{cycle} in G{plane} where X and Y are turned");
            let right = "a cycle runs along an axis: only Z is one there, in G17";
            return refuse(offset, found, right);
        }
        if let Some((found, right)) = cycle.refused_spindle(turning) {
            return refuse(offset, format!("{cycle} with {found}"), right);
        }
        Ok(())
    }

    /// The axes of a cycle; refuses a block that is none of it.
    fn cycle_axes(&self, words: &Words, cycle: Cycle, offset: usize) -> Result<CycleAxes, Refusal> {
        let (number, letters, offset_letters) = self.modes.plane;
        let (drill_letter, level_letter) = match number {
            18 => ('Y', 'J'),
            19 => ('X', 'I'),
            _ => ('Z', 'K'),
        };
        let [first, second] = letters.map(|letter| self.slide(letter));
        let Some(drill_axis) = self.slide(drill_letter) else {
            let found = format!("{cycle} in G{number}");
            let right = format!(
                "a cycle runs along {drill_letter} there: this machine has no slide {drill_letter}"
            );
            return refuse(offset, found, right);
        };
        if let Some(word) = words.first_of("ABCUVW") {
            let found = format!("{word} in {cycle}");
            return refuse(word.offset, found, "a cycle moves X, Y and Z");
        }
        if words.first_of("XYZ@^").is_none() {
            let right = "say where: X, Y or Z";
            return refuse(offset, format!("{cycle} without a hole"), right);
        }
        // A machine without one of the plane's axes drills all the same; only G87 steps aside along them.
        Ok(CycleAxes {
            plane_number: number,
            plane: [first, second].map(|axis| axis.unwrap_or(drill_axis)),
            complete: first.is_some() && second.is_some(),
            drill_axis,
            drill_letter,
            offset_letters,
            level_letter,
        })
    }

    /// The words of a block of a cycle that stay: its own, else those from the block before.
    fn cycle_series(
        &self,
        words: &Words,
        cycle: Cycle,
        axes: &CycleAxes,
        offset: usize,
    ) -> Result<Series, Refusal> {
        let is_next = |series: &Series| series.drill_axis == axes.drill_axis;
        let in_a_row = self.series.filter(is_next);
        let kept = in_a_row.filter(|series| series.cycle == cycle);
        let missing = |letter: char, what: &str| missing(cycle, letter, what).at(offset);
        let drill_letter = axes.drill_letter;
        let r = self
            .level(self.length_mm(words, 'R'))
            .or(kept.map(|kept| kept.r))
            .ok_or_else(|| missing('R', "the level to feed from"))?;
        let bottom = self
            .level(self.axis_value(words, axes.drill_axis))
            .or(kept.map(|kept| kept.bottom))
            .ok_or_else(|| missing(drill_letter, "the bottom of the hole"))?;
        let given_s = seconds_at_the_bottom(words)?.or(kept.map(|kept| kept.dwell_s));
        let dwell_s = match cycle.wait() {
            Wait::None => 0.0,
            Wait::Optional => given_s.unwrap_or(0.0),
            Wait::Needed => {
                given_s.ok_or_else(|| missing('P', "the seconds to wait at the bottom"))?
            }
        };
        let peck_mm = if cycle.pecks() {
            self.peck_mm(words)?
                .or(kept.map(|kept| kept.peck_mm))
                .ok_or_else(|| missing('Q', "the depth of one peck"))?
        } else {
            0.0
        };
        let mut series = Series {
            cycle,
            drill_axis: axes.drill_axis,
            initial_mm: in_a_row.map_or(self.position[axes.drill_axis], |series| series.initial_mm),
            r,
            bottom,
            dwell_s,
            peck_mm,
            aside_mm: kept.map_or([0.0; 2], |kept| kept.aside_mm),
            top: kept.map_or(Level::From(0.0), |kept| kept.top),
        };
        if cycle == Cycle::BackBore {
            self.back_bore_words(words, axes, &mut series, kept.is_some(), offset)?;
        }
        Ok(series)
    }

    /// The words that only G87 has: I, J and K, two of them steps aside, the third a level.
    fn back_bore_words(
        &self,
        words: &Words,
        axes: &CycleAxes,
        series: &mut Series,
        stays: bool,
        offset: usize,
    ) -> Result<(), Refusal> {
        let missing = |letter, what: &str| missing(Cycle::BackBore, letter, what).at(offset);
        if !axes.complete {
            let right = "back boring steps aside in the plane: both its axes must be slides";
            return refuse(offset, "G87", right);
        }
        for (step_mm, letter) in series.aside_mm.iter_mut().zip(axes.offset_letters) {
            match words.value(letter) {
                Some(word) => *step_mm = word.value * self.unit_mm(),
                None if stays => {}
                None => return Err(missing(letter, "the step aside, to pass the hole,")),
            }
        }
        match self.level(self.length_mm(words, axes.level_letter)) {
            Some(level) => series.top = level,
            None if stays => {}
            None => return Err(missing(axes.level_letter, "the level to bore up to")),
        }
        Ok(())
    }

    /// A length that the block gives beside its axis words.
    fn length_mm(&self, words: &Words, letter: char) -> Option<f64> {
        words.value(letter).map(|word| word.value * self.unit_mm())
    }

    /// A level that the block gives.
    fn level(&self, given_mm: Option<f64>) -> Option<Level> {
        given_mm.map(|mm| {
            if self.modes.incremental {
                Level::From(mm)
            } else {
                Level::At(mm)
            }
        })
    }

    /// The levels of a block, in machine coordinates.
    fn cycle_levels(
        &self,
        words: &Words,
        series: &Series,
        offset: usize,
    ) -> Result<Levels, Refusal> {
        let zero_mm = self.offsets.zero[series.drill_axis];
        let levels = series.levels(zero_mm);
        if levels.r_mm < levels.bottom_mm {
            let axis = self.setup.axes.get(series.drill_axis);
            let letter = axis.map_or('Z', |axis| axis.letter);
            let [r, bottom] =
                [levels.r_mm, levels.bottom_mm].map(|mm| (mm - zero_mm) / self.unit_mm());
            let cycle = series.cycle;
            let found = format!("{cycle} with R at {r:.4} below {letter} at {bottom:.4}");
            let place = words.place('R', words.place(letter, offset));
            return refuse(place, found, "R lies above the bottom of the hole");
        }
        Ok(levels)
    }

    /// Depth of a peck that the block gives, in mm.
    fn peck_mm(&self, words: &Words) -> Result<Option<f64>, Refusal> {
        match words.value('Q') {
            Some(q) if q.value <= 0.0 => q.refuse("a peck is above 0"),
            given => Ok(given.map(|q| q.value * self.unit_mm())),
        }
    }
}

/// The axes that a cycle moves, with the letters of its words.
struct CycleAxes {
    /// 17, 18 or 19.
    plane_number: u32,
    /// Of the plane, first and second.
    plane: [usize; 2],
    /// The machine has both.
    complete: bool,
    drill_axis: usize,
    /// Its bottom.
    drill_letter: char,
    /// Of G87: the steps aside along the axes of the plane.
    offset_letters: [char; 2],
    /// Of G87: the level to bore up to.
    level_letter: char,
}

/// Seconds to wait in the hole that the block gives.
fn seconds_at_the_bottom(words: &Words) -> Result<Option<f64>, Refusal> {
    match words.value('P') {
        Some(p) if !is_dwell(p.value) => p.refuse(dwell_right()),
        given => Ok(given.map(|p| p.value)),
    }
}

/// A word that a cycle has to have.
fn missing(cycle: Cycle, letter: char, what: &str) -> Refusal {
    let found = format!("{cycle} without {letter}");
    let right = format!("{what} in the first block of a cycle");
    Refusal::new(0, found, right)
}

/// Holes that the block drills.
fn holes(words: &Words) -> Result<u32, Refusal> {
    let given = words.whole('L', "holes are a whole number", 1.0..=REPEATS_MAX)?;
    Ok(given.unwrap_or(1))
}
