//! The motion of a block: where it leads, at which feed, and whether the axes may go there.

use super::*;
use crate::compensation::Way;
use crate::flat::Flat;
use crate::polar::Polar;
use crate::reader::Word;
use crate::words::mask_of;
use machine::TURN_DEG;
use path::travel::Travel;

/// Words that say where.
const PLACES: u32 = mask_of(AXIS_LETTERS) | mask_of("@^");

impl Interpreter {
    /// The motion of a block, if it has one.
    pub(super) fn travel(&mut self, line: u32, words: &Words) -> Result<(), Vec<Refusal>> {
        let axis_word = words.first_in(PLACES);
        // The R of M19 is an angle of the spindle.
        let code = words.code(Group::Motion);
        let orients = code.is_none() && matches!(words.code(Group::Spindle), Some((190, _)));
        let circle_word = words.first_of(if orients { "IJK" } else { "IJKR" });
        let word = code.map(|(_, word)| word).or(axis_word).or(circle_word);
        let Some(offset) = word.map(|word| word.offset) else {
            return Ok(());
        };
        if code.is_some_and(|(number, _)| is_turning(number)) {
            // Done behind the block, by the lines of its profile.
            return Ok(());
        }
        self.check_motion_beside(offset)?;
        match self.motion {
            _ if matches!(code, Some((53, _))) => return self.close_spline(line, words, offset),
            Motion::Cycle(cycle) => return self.drill(line, words, cycle, offset),
            Motion::Spline(spline) => return self.spline(line, words, spline, offset),
            Motion::InStep(motion) => return self.in_step(line, words, motion, offset),
            _ if axis_word.is_none() && circle_word.is_none() => return Ok(()),
            _ => {}
        }
        let target = self.target(words)?;
        let (shapes, way, feed) = match self.motion {
            Motion::None | Motion::Cycle(_) | Motion::Spline(_) | Motion::InStep(_) => {
                let letter = axis_word.map_or('?', |word| word.letter);
                let found = format!("{letter} without a motion mode");
                let right = "say how to move: G0, G1, G2 or G3";
                return refuse(offset, found, right);
            }
            Motion::Rapid => (self.straight_to(target), Way::Rapid, Feed::Rapid),
            Motion::Probe(number) => return self.probe(line, words, target, number, offset),
            Motion::Line => {
                let shapes = self.straight_to(target);
                let feed = self.feed_along(words, &shapes, &target, offset)?;
                self.output.straight_feeds += 1;
                (shapes, Way::Line, feed)
            }
            Motion::Arc { clockwise } => {
                // A missing feed is told before a wrong arc.
                self.feed(&target, offset)?;
                self.output.arc_feeds += 1;
                let (shapes, way) = self.arc_way(line, words, target, clockwise, offset)?;
                let feed = self.feed_along(words, &shapes, &target, offset)?;
                (shapes, way, feed)
            }
        };
        self.run_move(line, words, target, (shapes, way, feed), offset)
    }

    /// The shapes and the way of an arc block.
    fn arc_way(
        &mut self,
        line: u32,
        words: &Words,
        target: AxisVector,
        clockwise: bool,
        offset: usize,
    ) -> Result<(Vec<Shape>, Way), Refusal> {
        let block = self.arc_block(words, target, clockwise, offset)?;
        let wrong = |wrong: Refusal| wrong.at(offset);
        let shapes = self.arc_shapes(&block, target).map_err(wrong)?;
        if block.is_spiral() {
            let text = "an arc whose ends are more than 0.002 mm unequally far from its centre: a circle through both ends is made of it";
            self.note(line, text);
        }
        Ok((shapes, Self::way_of(&block).map_err(wrong)?))
    }

    /// Adds shapes to the path; refuses those that leave the travel.
    pub(super) fn go(
        &mut self,
        line: u32,
        words: &Words,
        shapes: Vec<Shape>,
        feed: Feed,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let outside = self.outside(words, &shapes, offset);
        if let Some(last) = shapes.last() {
            self.position = last.end();
            self.stands = None;
        }
        let per_turn = self.feed_per_turn();
        for shape in shapes {
            self.add_shape(line, shape, feed, per_turn);
        }
        self.output.check_room(0.0, offset)?;
        if_none(outside)
    }

    /// A straight line from where the tool stands.
    pub(super) fn straight_to(&self, to: AxisVector) -> Vec<Shape> {
        let from = self.tool_place();
        vec![Shape::Line { from, to }]
    }

    /// Where the block's axis words lead, in machine coordinates.
    pub(super) fn target(&self, words: &Words) -> Result<AxisVector, Refusal> {
        if let Some((_, word)) = words.code(Group::MachineCoordinates) {
            return self.machine_target(words, word.offset);
        }
        if let Some(word) = words.first_of("@^") {
            return self.polar_target(words, word);
        }
        Ok(self.plain_target(words))
    }

    /// The same of plain axis words.
    fn plain_target(&self, words: &Words) -> AxisVector {
        if self.offsets.turn.is_some() {
            return self.turned_target(words);
        }
        let mut target = self.position;
        for (index, component) in target.iter_mut().enumerate().take(self.setup.axes.len()) {
            if let Some(value) = self.axis_value(words, index) {
                let zero = self.offsets.zero.get(index).copied().unwrap_or(0.0);
                *component = if self.modes.incremental {
                    *component + value
                } else {
                    self.on_shorter_way(index, zero + value)
                };
            }
        }
        target
    }

    /// Where an axis goes for an absolute place: one that turns without end to the nearest of the places that are whole turns apart,
    /// of two as near in positive direction. (Fanuc, parameters ROA = 1 and RAB = 0 of 1008.)
    pub(super) fn on_shorter_way(&self, index: usize, place: f64) -> f64 {
        let endless = self.setup.axes.get(index).is_some_and(|axis| axis.modulo);
        let here = self.position.get(index).copied().filter(|_| endless);
        here.map_or(place, |here| {
            place + TURN_DEG * libm::floor((here - place) / TURN_DEG + 0.5)
        })
    }

    /// Where polar words lead: X and Y by them, the other axes by their own words.
    fn polar_target(&self, words: &Words, word: Word) -> Result<AxisVector, Refusal> {
        let [Some(x), Some(y)] = ['X', 'Y'].map(|letter| self.slide(letter)) else {
            let right = "@ and ^ are places in X and Y: this machine has no such slides";
            return refuse(word.offset, "a polar word", right);
        };
        let plane = [x, y];
        if let Some(other) = words.first_of("XY") {
            let found = format!("{} beside a polar word", other.letter);
            let right = "X and Y, or @ and ^: one of the two in a block";
            return refuse(other.offset, found, right);
        }
        let polar = Polar {
            radius_mm: words.value('@').map(|word| word.value * self.unit_mm()),
            angle_deg: words.value('^').map(|word| word.value),
        };
        let from = Flat::of(&self.in_program(&self.position), plane);
        let place = polar
            .place(from, self.modes.incremental)
            .map_err(|wrong| wrong.at(word.offset))?;
        let target = self.plain_target(words);
        let place = self.in_machine(&place.put_into(self.in_program(&target), plane));
        Ok(Flat::of(&place, plane).put_into(target, plane))
    }

    /// The same where the work offset is turned.
    fn turned_target(&self, words: &Words) -> AxisVector {
        if self.modes.incremental {
            let step = self.with_words(words, AxisVector::zeros());
            return self.position + self.turned(step);
        }
        let place = self.with_words(words, self.in_program(&self.position));
        self.shorter_ways(self.in_machine(&place))
    }

    /// A place, reached the shorter way by each axis that turns without end.
    pub(super) fn shorter_ways(&self, mut place: AxisVector) -> AxisVector {
        for (index, component) in place.iter_mut().enumerate() {
            *component = self.on_shorter_way(index, *component);
        }
        place
    }

    /// G53: the words are machine coordinates.
    fn machine_target(&self, words: &Words, offset: usize) -> Result<AxisVector, Refusal> {
        if !matches!(self.motion, Motion::Rapid | Motion::Line) {
            return refuse(offset, "G53 without G0 or G1", "G53 goes with G0 or G1");
        }
        if self.modes.incremental {
            let right = "machine coordinates are absolute: G90 before it";
            return refuse(offset, "G53 in G91", right);
        }
        if let Some(word) = words.first_of("@^") {
            let right = "machine coordinates are X, Y and the other axes";
            return refuse(word.offset, "a polar word with G53", right);
        }
        let mut target = self.position;
        for (index, component) in target.iter_mut().enumerate().take(self.setup.axes.len()) {
            if let Some(value) = self.axis_value(words, index) {
                *component = self.on_shorter_way(index, value);
            }
        }
        Ok(target)
    }

    /// The feed of a motion to `target`, by the feed that is in force.
    pub(super) fn feed(&self, target: &AxisVector, offset: usize) -> Result<Feed, Refusal> {
        let Some(FeedWord { value, unit_mm }) = self.modes.feed else {
            let right = match self.modes.feed_mode {
                FeedMode::PerMinute => {
                    "give an F word (mm/min) in or before the first G1, G2 or G3"
                }
                FeedMode::PerRevolution => "give an F word (mm per revolution) behind G95",
                FeedMode::InverseTime => "in G93 each feed motion has an F word of its own",
            };
            return refuse(offset, "a feed motion without a feed", right);
        };
        if self.modes.feed_mode == FeedMode::PerRevolution {
            if self.modes.spindle.speed <= 0.0 {
                let right = "in G95 the feed follows the spindle: S and M3 or M4 before it";
                return refuse(offset, "a feed per revolution without S", right);
            }
            let mm_s = value * unit_mm * self.spindle_rpm_at(target) / 60.0;
            return Ok(Feed::PathMmS(mm_s));
        }
        Ok(self.feed_per_minute(FeedWord { value, unit_mm }, target))
    }

    /// The feed of a motion to `target` by an F word of G94.
    pub(super) fn feed_per_minute(
        &self,
        FeedWord { value, unit_mm }: FeedWord,
        target: &AxisVector,
    ) -> Feed {
        let travel = target - self.position;
        let slides_move = travel
            .iter()
            .zip(&self.rotary)
            .any(|(component, rotary)| !rotary && *component != 0.0);
        let rotary_only = !slides_move && displacement_length_mm(&travel, &self.rotary) > 0.0;
        Feed::PathMmS(if rotary_only {
            value / 60.0
        } else {
            value * unit_mm / 60.0
        })
    }

    /// The same along shapes, whose length counts in G93.
    pub(super) fn feed_along(
        &self,
        words: &Words,
        shapes: &[Shape],
        target: &AxisVector,
        offset: usize,
    ) -> Result<Feed, Refusal> {
        if self.modes.feed_mode != FeedMode::InverseTime {
            return self.feed(target, offset);
        }
        let Some(f) = words.value('F').filter(|f| f.value > 0.0) else {
            let right = "in G93 each feed motion has an F word of its own";
            return refuse(offset, "a feed motion without a feed", right);
        };
        let lengths = shapes
            .iter()
            .map(|of| of.length_with_rotary_mm(&self.rotary));
        let length: f64 = lengths.sum();
        Ok(Feed::PathMmS(length * f.value / 60.0))
    }

    /// The axes that would leave their travel, and where. One that a block before was refused for and that this block does not name is
    /// not told again.
    pub(super) fn outside(
        &mut self,
        words: &Words,
        shapes: &[Shape],
        offset: usize,
    ) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        for (index, axis) in self.setup.axes.iter().enumerate() {
            let bit = 1 << index;
            let was_told = self.told_outside & bit != 0;
            let travel = Travel {
                min: axis.travel_min - TRAVEL_ROUNDING,
                max: axis.travel_max + TRAVEL_ROUNDING,
            };
            let mut outside = shapes.iter().flat_map(|shape| {
                let (low, high) = match shape {
                    Shape::Line { to, .. } => (*to, *to),
                    other => other.bounds(),
                };
                // A block that was refused leaves an axis where it is not.
                let from = shape.start().get(index).copied().filter(|_| !was_told);
                let reach = from.map_or(travel, |from| travel.from_place(from));
                let ends = [low, high].map(|place| place.get(index).copied());
                ends.into_iter()
                    .flatten()
                    .filter(move |place| !reach.holds(*place))
            });
            let Some(value) = outside.next() else {
                self.told_outside &= !bit;
                continue;
            };
            if was_told && words.value(axis.letter).is_none() {
                continue;
            }
            self.told_outside |= bit;
            let unit = if axis.rotary { "degrees" } else { "mm" };
            let zero = self.offsets.zero.get(index).copied().unwrap_or(0.0);
            let mut found = format!("axis {} would reach {value:.4} {unit}", axis.letter);
            if zero != 0.0 {
                let place = value - zero;
                found += &format!(" in machine coordinates ({place:.4} in the program's)");
            }
            let (low, high) = (axis.travel_min, axis.travel_max);
            let right = format!("the travel is {low} to {high} {unit}");
            let mut refusal = Refusal::new(words.place(axis.letter, offset), found, right);
            refusal.state_stays_known = true;
            refusals.push(refusal);
        }
        refusals
    }
}
