//! The canned cycles: the words of their blocks, and the moves that these become.

use serde::{Deserialize, Serialize};

use machine::Dialect;

use super::feeds::{dwell_right, is_dwell};
use super::{Acts, AxisVector, Cause, EventKind, Feed, Refusal, State, Words, refuse};
use crate::cycles::{Cycle, CycleBlock, Level, Levels, PECKS_MAX, Series, Step, Turning, Wait};
use crate::flat::Flat;
use crate::state::{FeedMode, Motion};

/// What is said where the return height is LinuxCNC's other one.
const RETURN_HEIGHT: &str = "neither G98 nor G99 is said: holes return to the level before the cycles (G98), not to R as in LinuxCNC";

/// The most holes of one drilling block.
const REPEATS_MAX: f64 = 10_000.0;

/// What drilling cycles in a row keep; nothing between them.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Drilling {
    series: Option<Series>,
    /// L0 in Fanuc's language: the words of the block are kept, and no hole is drilled.
    #[serde(skip)]
    pub only_keeps: bool,
}

impl Drilling {
    /// A motion of another kind ends the row.
    pub fn leave(&mut self, motion: Motion) {
        if !matches!(motion, Motion::Cycle(_)) {
            self.series = None;
        }
    }

    /// Cycles in a row return with the tip of the tool, which is longer now, to where it was before them.
    pub fn lengthen(&mut self, longer: &AxisVector) {
        if let Some(series) = &mut self.series {
            series.initial_mm += longer.get(series.drill_axis).copied().unwrap_or(0.0);
        }
    }

    /// A block of a cycle, its words understood.
    pub fn block(
        &mut self,
        state: &State,
        cause: Cause,
        cycle: Cycle,
    ) -> Result<CycleBlock, Refusal> {
        let block = state.cycle_block(cause, cycle, self.series)?;
        self.series = Some(block.series);
        if matches!(cycle, Cycle::TapRight | Cycle::TapLeft) {
            state.check_speed_is_constant(cycle, cause.offset)?;
        }
        Ok(block)
    }
}

impl State {
    /// Holes of which each is a step of distance and angle from the one before: a block of its own for each. How many they are.
    pub fn holes_in_steps(&self, words: &Words) -> Result<Option<u32>, Refusal> {
        let repeats = holes(words)?;
        let steps = self.in_force.incremental && words.first_of("@^").is_some();
        Ok(Some(repeats).filter(|repeats| *repeats > 1 && steps))
    }

    /// What a block of a cycle makes at a feed.
    pub fn drilled(&self, block: &CycleBlock, feed: Feed) -> Acts {
        let steps = block.steps();
        let mut acts = Acts(Vec::with_capacity(steps.len() + 1));
        let returns_higher = block.series.initial_mm > block.levels.r_mm;
        let says = !self.in_force.return_was_said && self.equipment.dialect == Dialect::LinuxCnc;
        if says && returns_higher {
            acts.note(RETURN_HEIGHT);
        }
        let mut tapping = false;
        for step in steps {
            // The overrides count again where the tap is out of the hole.
            let leaves = matches!(step, Step::Rapid(_));
            if tapping && leaves {
                self.end_tap(&mut acts);
                tapping = false;
            }
            match step {
                Step::Rapid(to) => acts.go(to, Feed::Rapid),
                Step::Feed(to) => acts.go(to, feed),
                Step::Tap(to) => {
                    if !tapping {
                        self.begin_tap(feed, &mut acts);
                        tapping = true;
                    }
                    acts.go(to, feed);
                }
                Step::Dwell(seconds) => acts.dwell(seconds),
                Step::SpindleStop => acts.event(EventKind::SpindleStop),
                Step::SpindleStart(Turning::Clockwise) => acts.event(EventKind::SpindleClockwise),
                Step::SpindleStart(_) => acts.event(EventKind::SpindleCounterClockwise),
                Step::SpindleOrient => acts.event(EventKind::SpindleOrient(0.0)),
                Step::ProgramStop => acts.event(EventKind::ProgramStop),
            }
        }
        if tapping {
            self.end_tap(&mut acts);
        }
        acts
    }

    /// From here on a spindle with encoder keeps step: the pitch is the feed at the speed of the spindle.
    fn begin_tap(&self, feed: Feed, acts: &mut Acts) {
        if self.in_force.feed_override {
            acts.event(EventKind::OverridesEnabled(false));
        }
        let turns_s = self.in_force.spindle.speed / 60.0;
        if let (Feed::PathMmS(mm_s), true) = (feed, turns_s > 0.0) {
            acts.event(EventKind::SpindleCoupled(mm_s / turns_s));
        }
    }

    fn end_tap(&self, acts: &mut Acts) {
        if self.in_force.spindle.speed > 0.0 {
            acts.event(EventKind::SpindleUncoupled);
        }
        if self.in_force.feed_override {
            acts.event(EventKind::OverridesEnabled(true));
        }
    }

    /// Understands the words of a block of a cycle.
    fn cycle_block(
        &self,
        cause: Cause,
        cycle: Cycle,
        row: Option<Series>,
    ) -> Result<CycleBlock, Refusal> {
        let words = cause.words;
        let axes = self.cycle_axes(cause, cycle)?;
        let turning = self.in_force.turning();
        self.allows_cycle(cause, cycle, &axes)?;
        let series = self.cycle_series(cause, cycle, &axes, row)?;
        let levels = self.cycle_levels(cause, &series)?;
        let repeats = holes(words)?;
        let mut hole = self.target(words)?;
        hole[axes.drill_axis] = self.position[axes.drill_axis];
        let pitch = if self.in_force.incremental {
            hole - self.position
        } else {
            AxisVector::zeros()
        };
        let [u, v] = series.aside_mm;
        let aside = Flat::new(u, v).put_into(AxisVector::zeros(), axes.plane);
        let aside = self.offsets.turned(aside);
        let block = CycleBlock {
            from: self.position,
            hole,
            pitch,
            repeats,
            aside,
            series,
            levels,
            returns_to_r: self.in_force.returns_to_r,
            turning,
        };
        if cycle.pecks() && block.pecks() >= PECKS_MAX {
            let peck = series.peck_mm / self.in_force.unit_mm();
            let count = block.pecks() + 1.0;
            let found = format!("Q{peck} with {count} pecks a hole");
            let right = format!("at most {PECKS_MAX} pecks");
            return refuse(cause.place('Q'), found, right);
        }
        Ok(block)
    }

    /// Refuses a cycle that the modes in force or the spindle do not allow.
    fn allows_cycle(&self, cause: Cause, cycle: Cycle, axes: &CycleAxes) -> Result<(), Refusal> {
        if self.in_force.feed_mode == FeedMode::InverseTime {
            let right = "a cycle has no time of its own: G94 before it";
            return cause.refuse(format!("{cycle} in G93"), right);
        }
        if axes.plane_number != 17 && self.offsets.is_turned() {
            let plane = axes.plane_number;
            let found = format!("{cycle} in G{plane} where X and Y are turned");
            let right = "a cycle runs along an axis: only Z is one there, in G17";
            return cause.refuse(found, right);
        }
        if let Some((found, right)) = cycle.refused_spindle(self.in_force.turning()) {
            return cause.refuse(format!("{cycle} with {found}"), right);
        }
        Ok(())
    }

    /// The axes of a cycle; refuses a block that is none of it.
    fn cycle_axes(&self, cause: Cause, cycle: Cycle) -> Result<CycleAxes, Refusal> {
        let (number, letters, offset_letters) = self.in_force.plane;
        let (drill_letter, level_letter) = match number {
            18 => ('Y', 'J'),
            19 => ('X', 'I'),
            _ => ('Z', 'K'),
        };
        let [first, second] = letters.map(|letter| self.equipment.slide(letter));
        let Some(drill_axis) = self.equipment.slide(drill_letter) else {
            let found = format!("{cycle} in G{number}");
            let right = format!(
                "a cycle runs along {drill_letter} there: this machine has no slide {drill_letter}"
            );
            return cause.refuse(found, right);
        };
        if let Some(word) = cause.words.first_of("ABCUVW") {
            let found = format!("{word} in {cycle}");
            return refuse(word.offset, found, "a cycle moves X, Y and Z");
        }
        if cause.words.first_of("XYZ@^").is_none() {
            let right = "say where: X, Y or Z";
            return cause.refuse(format!("{cycle} without a hole"), right);
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
        cause: Cause,
        cycle: Cycle,
        axes: &CycleAxes,
        row: Option<Series>,
    ) -> Result<Series, Refusal> {
        let Cause { words, offset, .. } = cause;
        let is_next = |series: &Series| series.drill_axis == axes.drill_axis;
        let in_a_row = row.filter(is_next);
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
            self.back_bore_words(cause, axes, &mut series, kept.is_some())?;
        }
        Ok(series)
    }

    /// The words that only G87 has: I, J and K, two of them steps aside, the third a level.
    fn back_bore_words(
        &self,
        cause: Cause,
        axes: &CycleAxes,
        series: &mut Series,
        stays: bool,
    ) -> Result<(), Refusal> {
        let Cause { words, offset, .. } = cause;
        let missing = |letter, what: &str| missing(Cycle::BackBore, letter, what).at(offset);
        if !axes.complete {
            let right = "back boring steps aside in the plane: both its axes must be slides";
            return cause.refuse("G87", right);
        }
        for (step_mm, letter) in series.aside_mm.iter_mut().zip(axes.offset_letters) {
            match words.value(letter) {
                Some(word) => *step_mm = word.value * self.in_force.unit_mm(),
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

    /// A level that the block gives.
    fn level(&self, given_mm: Option<f64>) -> Option<Level> {
        given_mm.map(|mm| match self.in_force.incremental {
            true => Level::From(mm),
            false => Level::At(mm),
        })
    }

    /// The levels of a block, in machine coordinates.
    fn cycle_levels(&self, cause: Cause, series: &Series) -> Result<Levels, Refusal> {
        let zero_mm = self.offsets.zero()[series.drill_axis];
        let levels = series.levels(zero_mm);
        if levels.r_mm < levels.bottom_mm {
            let axis = self.equipment.axes.get(series.drill_axis);
            let letter = axis.map_or('Z', |axis| axis.letter);
            let [r, bottom] =
                [levels.r_mm, levels.bottom_mm].map(|mm| (mm - zero_mm) / self.in_force.unit_mm());
            let cycle = series.cycle;
            let found = format!("{cycle} with R at {r:.4} below {letter} at {bottom:.4}");
            let place = cause.words.place('R', cause.place(letter));
            return refuse(place, found, "R lies above the bottom of the hole");
        }
        Ok(levels)
    }

    /// Depth of a peck that the block gives, in mm.
    fn peck_mm(&self, words: &Words) -> Result<Option<f64>, Refusal> {
        match words.value('Q') {
            Some(q) if q.value <= 0.0 => q.refuse("a peck is above 0"),
            _ => Ok(self.length_mm(words, 'Q')),
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
