//! Constant cutting speed (G96): the spindle turns the faster the nearer the tool is to its axis.
//!
//! At the distance r of X from the spindle's axis it turns at v/(2πr), and never faster than D (LinuxCNC manual, *G96, G97*). Program X0
//! is the axis. The master follows it scan by scan; here is what the program says, and the feeds per turn that depend on it.

use std::f64::consts::{FRAC_PI_4, TAU};

use path::geometry::{Feed, Shape};
use serde::{Deserialize, Serialize};

/// Along one element with a feed per turn, the speed of the spindle changes by this factor at most.
const SPEED_RATIO_MAX: f64 = 1.1;
/// Nearer to the axis nothing is cut, in mm: without a limit the speed would have none there.
const RADIUS_MM_MIN: f64 = 0.05;
/// Halvings of one shape: more than any in the travel of a machine need.
const HALVINGS_MAX: u32 = 16;

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
    pub surface: SurfaceSpeed,
    pub mm_per_turn: f64,
    /// X among the axes.
    pub axis: usize,
    /// The machine's spindle turns no faster.
    pub speed_max_rpm: f64,
}

impl SurfaceSpeed {
    /// Speed of the spindle with the tool at this place of X, in rev/min.
    pub fn rpm(&self, x_mm: f64, speed_max_rpm: f64) -> f64 {
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
