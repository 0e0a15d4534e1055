//! The motion of a block: where it leads, at which feed, and whether the axes may go there.

use super::*;

impl Interpreter<'_> {
    /// The motion of a block, if it has one.
    pub(super) fn travel(&mut self, line: u32, words: &Words) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let axis_word = words.first_of(AXIS_LETTERS);
        let offset = words
            .code(Group::Motion)
            .map(|(_, word)| word)
            .or(axis_word)
            .or(words.first_of("IJKR"));
        let Some(offset) = offset.map(|word| word.offset) else {
            return Ok(());
        };
        if let Motion::Cycle(cycle) = self.motion {
            return self.drill(line, words, cycle, offset);
        }
        let target = self.target(words);
        let straight = || {
            vec![Shape::Line {
                from: self.position,
                to: target,
            }]
        };
        let (shapes, feed) = match self.motion {
            _ if axis_word.is_none() && words.first_of("IJKR").is_none() => return Ok(()),
            Motion::None | Motion::Cycle(_) => {
                let found = format!(
                    "{} without a motion mode",
                    axis_word.map_or('?', |word| word.letter)
                );
                return Err(one(Refusal::new(
                    offset,
                    found,
                    "say how to move: G0, G1, G2 or G3",
                )));
            }
            Motion::Rapid => (straight(), Feed::Rapid),
            Motion::Line => {
                let feed = self.feed(&target, offset).map_err(one)?;
                let shapes = straight();
                self.straight_feeds += 1;
                (shapes, feed)
            }
            Motion::Arc { clockwise } => {
                let feed = self.feed(&target, offset).map_err(one)?;
                self.arc_feeds += 1;
                let block = self
                    .arc_block(words, target, clockwise, offset)
                    .map_err(one)?;
                let shapes = block.shapes();
                (
                    shapes.map_err(|(found, right)| one(Refusal::new(offset, found, right)))?,
                    feed,
                )
            }
        };
        let outside = self.outside(words, &shapes, offset);
        for shape in shapes {
            let element = Element::new(line, shape, feed, &self.rotary);
            if element.length_mm > 0.0 {
                self.path.elements.push(element);
            }
        }
        self.position = target;
        if outside.is_empty() {
            Ok(())
        } else {
            Err(outside)
        }
    }

    /// Where the block's axis words lead, in machine coordinates.
    pub(super) fn target(&self, words: &Words) -> AxisVector {
        let mut target = self.position;
        let axes = target
            .iter_mut()
            .zip(&self.setup.axes)
            .zip(self.setup.work_offset.iter());
        for ((component, axis), work_offset) in axes {
            if let Some(word) = words.value(axis.letter) {
                let value = if axis.rotary {
                    word.value
                } else {
                    word.value * self.unit_mm()
                };
                *component = if self.incremental {
                    *component + value
                } else {
                    work_offset + value
                };
            }
        }
        target
    }

    pub(super) fn feed(&self, target: &AxisVector, offset: usize) -> Result<Feed, Refusal> {
        let Some((feed_mm_s, feed_deg_s)) = self.feed_per_s else {
            let right = "give an F word (mm/min) in or before the first G1, G2 or G3";
            return Err(Refusal::new(offset, "a feed motion without a feed", right));
        };
        let travel = target - self.position;
        let slides_move = travel
            .iter()
            .zip(&self.rotary)
            .any(|(component, rotary)| !rotary && *component != 0.0);
        let rotary_only = !slides_move && displacement_length_mm(&travel, &self.rotary) > 0.0;
        Ok(Feed::PathMmS(if rotary_only {
            feed_deg_s
        } else {
            feed_mm_s
        }))
    }

    /// The axes that would leave their travel, and where.
    pub(super) fn outside(&self, words: &Words, shapes: &[Shape], offset: usize) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        for (index, axis) in self.setup.axes.iter().enumerate() {
            let mut worst: Option<f64> = None;
            for shape in shapes {
                // A machine that stands outside its travel may move back in: the start of a line is not judged.
                let (low, high) = match shape {
                    Shape::Line { to, .. } => (*to, *to),
                    other => other.bounds(),
                };
                for value in [low.get(index), high.get(index)]
                    .into_iter()
                    .flatten()
                    .copied()
                {
                    let inside = value >= axis.travel_min - TRAVEL_ROUNDING
                        && value <= axis.travel_max + TRAVEL_ROUNDING;
                    if !inside && worst.is_none() {
                        worst = Some(value);
                    }
                }
            }
            let Some(value) = worst else {
                continue;
            };
            let unit = if axis.rotary { "degrees" } else { "mm" };
            let work_offset = self.setup.work_offset.get(index).copied().unwrap_or(0.0);
            let mut found = format!("axis {} would reach {value:.4} {unit}", axis.letter);
            if work_offset != 0.0 {
                found += &format!(
                    " in machine coordinates ({:.4} in the program's)",
                    value - work_offset
                );
            }
            let right = format!(
                "the travel is {} to {} {unit}",
                axis.travel_min, axis.travel_max
            );
            let offset = words.value(axis.letter).map_or(offset, |word| word.offset);
            let mut refusal = Refusal::new(offset, found, right);
            refusal.state_stays_known = true;
            refusals.push(refusal);
        }
        refusals
    }
}
