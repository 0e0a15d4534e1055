//! The words of the spindle's speed, G96 and G97, and feeds for each turn.

use std::fmt::Display;

use super::*;

const METRES_PER_FOOT: f64 = 0.3048;

impl Interpreter {
    /// G96 and G97.
    pub(super) fn spindle_mode(&mut self, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::SpindleMode) else {
            return Ok(());
        };
        if number == 970 {
            if self.modes.surface.take().is_some() && words.value('S').is_none() {
                let right = "the speed in rev/min, such as G97 S1000: S was a cutting speed";
                return refuse(word.offset, "G97 without S behind G96", right);
            }
            return Ok(());
        }
        if words.value('S').is_none() {
            let right = "the cutting speed in m/min, in G20 in feet/min, such as G96 D2500 S250";
            return refuse(word.offset, "G96 without S", right);
        }
        if self.setup.axis_index('X').is_none() {
            let right = "the speed follows the distance of X from the spindle's axis: this machine has no X";
            return refuse(word.offset, "G96", right);
        }
        self.modes.surface = Some(SurfaceSpeed {
            m_min: 0.0,
            limit_rpm: words.value('D').map(|limit| limit.value.abs()),
            centre_mm: self.surface_centre_mm(),
        });
        Ok(())
    }

    /// S: the speed of the spindle, or of the cut.
    pub(super) fn set_speed(&mut self, line: u32, speed: f64) {
        self.modes.spindle.speed = speed;
        let unit = if self.modes.inches {
            METRES_PER_FOOT
        } else {
            1.0
        };
        let centre_mm = self.surface_centre_mm();
        match &mut self.modes.surface {
            Some(surface) => {
                surface.m_min = speed.abs() * unit;
                surface.centre_mm = centre_mm;
                let kind = EventKind::SurfaceSpeed(*surface);
                self.event(line, kind);
            }
            None => self.event(line, EventKind::SpindleSpeedRpm(speed)),
        }
    }

    /// The axis of the spindle is where the program has its X0 now.
    pub(super) fn follow_centre(&mut self, line: u32) {
        let Some(surface) = self.modes.surface else {
            return;
        };
        let centre_mm = self.surface_centre_mm();
        if surface.centre_mm != centre_mm {
            let followed = SurfaceSpeed {
                centre_mm,
                ..surface
            };
            self.modes.surface = Some(followed);
            self.event(line, EventKind::SurfaceSpeed(followed));
        }
    }

    /// Along X of the machine, in mm.
    fn surface_centre_mm(&self) -> f64 {
        let axis = self.setup.axis_index('X');
        axis.map_or(0.0, |axis| self.offsets.zero[axis])
    }

    /// A motion that needs a spindle of one speed.
    pub(super) fn check_speed_is_constant(
        &self,
        code: impl Display,
        offset: usize,
    ) -> Result<(), Refusal> {
        if self.modes.surface.is_none() {
            return Ok(());
        }
        let found = format!("{code} in G96");
        let right = "one speed of the spindle: G97 and S in rev/min before it";
        refuse(offset, found, right)
    }

    /// Speed of the spindle with the tool at a place of the machine, in rev/min.
    pub(super) fn spindle_rpm_at(&self, place: &AxisVector) -> f64 {
        let Some(surface) = &self.modes.surface else {
            return self.modes.spindle.speed;
        };
        let axis = self.setup.axis_index('X');
        let x_mm = axis.and_then(|axis| place.get(axis).copied());
        surface.rpm(x_mm.unwrap_or(0.0), self.setup.spindle_max_rpm())
    }

    /// The feed per turn in force, where the speed follows the radius.
    pub(super) fn feed_per_turn(&self) -> Option<FeedPerTurn> {
        let surface = self.modes.surface?;
        let feed = self.modes.feed?;
        (self.modes.feed_mode == FeedMode::PerRevolution).then_some(FeedPerTurn {
            surface,
            mm_per_turn: feed.value * feed.unit_mm,
            axis: self.setup.axis_index('X')?,
            speed_max_rpm: self.setup.spindle_max_rpm(),
        })
    }

    /// Adds a shape to the path, in pieces where its feed follows the speed of the spindle.
    pub(super) fn add_shape(
        &mut self,
        line: u32,
        shape: Shape,
        feed: Feed,
        per_turn: Option<FeedPerTurn>,
    ) {
        let Some(per_turn) = per_turn.filter(|_| feed != Feed::Rapid) else {
            return self.add_piece(line, shape, feed);
        };
        for (shape, feed) in per_turn.along(shape) {
            self.add_piece(line, shape, feed);
        }
    }

    fn add_piece(&mut self, line: u32, shape: Shape, feed: Feed) {
        let mut element = Element::new(line, shape, feed, &self.rotary);
        if element.length_mm > 0.0 {
            (element.tolerance, element.rests_before) = self.path_mode();
            self.output.add(element);
        }
    }
}
