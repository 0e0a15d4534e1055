//! Constant cutting speed (G96): the spindle turns the faster the nearer the tool is to its axis.
//!
//! At the distance r of X from the spindle's axis it turns at v/(2πr), and never faster than D (LinuxCNC manual, *G96, G97*). Program X0
//! is the axis. The master follows it scan by scan; here is what the program says, and the feeds per turn that depend on it.

use std::f64::consts::{FRAC_PI_4, TAU};

use path::geometry::{Element, Feed, Shape};
use serde::{Deserialize, Serialize};

use super::{FeedMode, Group, Interpreter};
use crate::program::EventKind;
use crate::words::{Refusal, Words};

/// Along one element with a feed per turn, the speed of the spindle changes by this factor at most.
const SPEED_RATIO_MAX: f64 = 1.1;
/// Nearer to the axis nothing is cut, in mm: without a limit the speed would have none there.
const RADIUS_MM_MIN: f64 = 0.05;
/// Halvings of one shape: more than any in the travel of a machine need.
const HALVINGS_MAX: u32 = 16;
const METRES_PER_FOOT: f64 = 0.3048;

/// G96 is in force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceSpeed {
    /// S, in m/min.
    pub m_min: f64,
    /// D, in rev/min; none without it.
    pub limit_rpm: Option<f64>,
    /// Where the axis of the spindle is, along X of the machine.
    pub centre_mm: f64,
}

/// A feed per turn while the speed follows the radius.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FeedPerTurn {
    surface: SurfaceSpeed,
    mm_per_turn: f64,
    /// X among the axes.
    axis: usize,
    /// The machine's spindle turns no faster.
    speed_max_rpm: f64,
}

impl SurfaceSpeed {
    /// Speed of the spindle with the tool at this place of X, in rev/min.
    fn rpm(&self, x_mm: f64, speed_max_rpm: f64) -> f64 {
        let radius_mm = (x_mm - self.centre_mm).abs().max(RADIUS_MM_MIN);
        let most_rpm = self.limit_rpm.unwrap_or(f64::INFINITY).min(speed_max_rpm);
        (self.m_min * 1e3 / (TAU * radius_mm)).min(most_rpm)
    }
}

impl FeedPerTurn {
    fn rpm(&self, shape: &Shape, share: f64) -> f64 {
        let place = shape.at_share(share);
        let x_mm = place.get(self.axis).copied().unwrap_or(0.0);
        self.surface.rpm(x_mm, self.speed_max_rpm)
    }

    /// A shape in pieces, each with the feed for the slowest turn in it.
    pub fn along(&self, shape: Shape) -> Vec<(Shape, Feed)> {
        let mut pieces = vec![];
        self.cut(shape, 0, &mut pieces);
        pieces
    }

    fn cut(&self, shape: Shape, halvings: u32, pieces: &mut Vec<(Shape, Feed)>) {
        let at = [0.0, 0.5, 1.0].map(|share| self.rpm(&shape, share));
        let most_rpm = at.iter().copied().fold(0.0, f64::max);
        let least_rpm = at.iter().copied().fold(f64::INFINITY, f64::min);
        // A full turn begins and ends at the same radius: it is looked at in eighths at least.
        let wide = matches!(&shape, Shape::Arc { sweep_rad, .. } if sweep_rad.abs() > FRAC_PI_4);
        if (wide || most_rpm > SPEED_RATIO_MAX * least_rpm) && halvings < HALVINGS_MAX {
            let (first, second) = shape.halves();
            self.cut(first, halvings + 1, pieces);
            self.cut(second, halvings + 1, pieces);
            return;
        }
        pieces.push((shape, Feed::PathMmS(self.mm_per_turn * least_rpm / 60.0)));
    }
}

impl Interpreter {
    /// G96 and G97.
    pub(super) fn spindle_mode(&mut self, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::SpindleMode) else {
            return Ok(());
        };
        if number == 970 {
            if self.surface.take().is_some() && words.value('S').is_none() {
                let right = "the speed in rev/min, such as G97 S1000: S was a cutting speed";
                return Err(Refusal::new(word.offset, "G97 without S behind G96", right));
            }
            return Ok(());
        }
        if words.value('S').is_none() {
            let right = "the cutting speed in m/min, in G20 in feet/min, such as G96 D2500 S250";
            return Err(Refusal::new(word.offset, "G96 without S", right));
        }
        if self.setup.axis_index('X').is_none() {
            let right = "the speed follows the distance of X from the spindle's axis: this machine has no X";
            return Err(Refusal::new(word.offset, "G96", right));
        }
        self.surface = Some(SurfaceSpeed {
            m_min: 0.0,
            limit_rpm: words.value('D').map(|limit| limit.value.abs()),
            centre_mm: self.surface_centre_mm(),
        });
        Ok(())
    }

    /// S: the speed of the spindle, or of the cut.
    pub(super) fn set_speed(&mut self, line: u32, speed: f64) {
        self.spindle.speed = speed;
        let unit = if self.inches { METRES_PER_FOOT } else { 1.0 };
        let centre_mm = self.surface_centre_mm();
        match &mut self.surface {
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
        let Some(surface) = self.surface else {
            return;
        };
        let centre_mm = self.surface_centre_mm();
        if surface.centre_mm != centre_mm {
            let followed = SurfaceSpeed {
                centre_mm,
                ..surface
            };
            self.surface = Some(followed);
            self.event(line, EventKind::SurfaceSpeed(followed));
        }
    }

    /// Along X of the machine, in mm.
    fn surface_centre_mm(&self) -> f64 {
        let axis = self.setup.axis_index('X');
        axis.and_then(|axis| self.offsets.zero.get(axis).copied())
            .unwrap_or(0.0)
    }

    /// A motion that needs a spindle of one speed.
    pub(super) fn check_speed_is_constant(&self, code: &str, offset: usize) -> Result<(), Refusal> {
        if self.surface.is_none() {
            return Ok(());
        }
        let found = format!("{code} in G96");
        let right = "one speed of the spindle: G97 and S in rev/min before it";
        Err(Refusal::new(offset, found, right))
    }

    /// Speed of the spindle with the tool at a place of the machine, in rev/min.
    pub(super) fn spindle_rpm_at(&self, place: &super::AxisVector) -> f64 {
        let Some(surface) = &self.surface else {
            return self.spindle.speed;
        };
        let axis = self.setup.axis_index('X');
        let x_mm = axis.and_then(|axis| place.get(axis).copied());
        surface.rpm(x_mm.unwrap_or(0.0), self.setup.spindle_max_rpm())
    }

    /// The feed per turn in force, where the speed follows the radius.
    pub(super) fn feed_per_turn(&self) -> Option<FeedPerTurn> {
        let surface = self.surface?;
        let feed = self.feed?;
        (self.feed_mode == FeedMode::PerRevolution).then_some(FeedPerTurn {
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
