//! Canned cycles G73, G74 and G81 to G89 (NIST §3.5.16; LinuxCNC 2.9, "G-Codes", for G73, G74 and the tapping of G84):
//! what they keep from block to block, and the steps of one block.

use path::geometry::AxisVector;
use serde::{Deserialize, Serialize};

use crate::codes::g_codes;
use crate::words::mask_of;

#[cfg(test)]
mod tests;

/// How far above the bottom of the hole a peck ends its rapid down, and how far G73 backs off: 0.01 inch, as the NIST
/// interpreter's `G83_RAPID_DELTA`.
const PECK_CLEARANCE_MM: f64 = 0.254;

/// A depth this near to the bottom is the bottom: 1 nm.
const DEPTH_ROUNDING_MM: f64 = 1e-6;

/// The most pecks of one hole.
pub const PECKS_MAX: f64 = 10_000.0;

g_codes! {
    /// Which cycle.
    pub enum Cycle {
        /// G73: in pecks of Q, backing off a little after each to break the chip.
        ChipBreak = 730,
        /// G74: left-hand tapping.
        TapLeft = 740,
        /// G81: down at feed, up in rapid.
        Drill = 810,
        /// G82: the same with a wait at the bottom.
        DrillAndDwell = 820,
        /// G83: in pecks of Q, out of the hole after each.
        Peck = 830,
        /// G84: right-hand tapping.
        TapRight = 840,
        /// G85: down and up at feed.
        Bore = 850,
        /// G86: down at feed, spindle stopped, up in rapid.
        BoreAndStop = 860,
        /// G87: through the hole beside its axis, then upwards at feed from below.
        BackBore = 870,
        /// G88: down at feed, spindle and program stopped; the operator draws the tool back.
        BoreByHand = 880,
        /// G89: down at feed, a wait, up at feed.
        BoreAndDwell = 890,
    }
}

/// Which word P of a cycle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wait {
    /// The cycle has none.
    None,
    /// 0 s if not given.
    Optional,
    /// In the first block of the cycle.
    Needed,
}

/// Which way a spindle turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turning {
    /// M3.
    Clockwise,
    /// M4.
    CounterClockwise,
}

impl Turning {
    /// The other way.
    pub fn reversed(self) -> Self {
        match self {
            Turning::Clockwise => Turning::CounterClockwise,
            Turning::CounterClockwise => Turning::Clockwise,
        }
    }
}

impl Cycle {
    /// The letters that its blocks make use of beside those of the axes, as bits.
    pub fn letters(self) -> u32 {
        let wait = match self.wait() {
            Wait::None => 0,
            _ => mask_of("P"),
        };
        let peck = if self.pecks() { mask_of("Q") } else { 0 };
        let aside = match self {
            Cycle::BackBore => mask_of("IJK"),
            _ => 0,
        };
        mask_of("RL") | wait | peck | aside
    }

    /// What P is to it.
    pub fn wait(self) -> Wait {
        match self {
            Cycle::DrillAndDwell | Cycle::BoreAndStop | Cycle::BoreByHand | Cycle::BoreAndDwell => {
                Wait::Needed
            }
            Cycle::TapLeft | Cycle::TapRight => Wait::Optional,
            _ => Wait::None,
        }
    }

    /// Whether Q is its peck.
    pub fn pecks(self) -> bool {
        matches!(self, Cycle::ChipBreak | Cycle::Peck)
    }

    /// What is wrong with a spindle that turns so, or stands, and what would be right.
    pub fn refused_spindle(self, turning: Option<Turning>) -> Option<(&'static str, &'static str)> {
        let stands = "a spindle that stands";
        match (self, turning) {
            (Cycle::TapRight, None) => Some((stands, "start it with M3 before the cycle")),
            (Cycle::TapRight, Some(Turning::CounterClockwise)) => Some((
                "a spindle that turns counter-clockwise",
                "G84 cuts right-hand threads: M3 before it, or G74 for left-hand ones",
            )),
            (Cycle::TapLeft, None) => Some((stands, "start it with M4 before the cycle")),
            (Cycle::TapLeft, Some(Turning::Clockwise)) => Some((
                "a spindle that turns clockwise",
                "G74 cuts left-hand threads: M4 before it, or G84 for right-hand ones",
            )),
            (Cycle::BoreAndStop | Cycle::BackBore | Cycle::BoreByHand, None) => {
                Some((stands, "start it with M3 or M4 before the cycle"))
            }
            _ => None,
        }
    }
}

/// A level as a block gave it, along the axis that drills.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Level {
    /// In G90: in the coordinates of the program.
    At(f64),
    /// In G91: from the level that it counts from.
    From(f64),
}

impl Level {
    /// In machine coordinates, where the program's zero and the level that it counts from lie.
    pub fn placed_mm(self, zero_mm: f64, counts_from_mm: f64) -> f64 {
        match self {
            Level::At(mm) => zero_mm + mm,
            Level::From(mm) => counts_from_mm + mm,
        }
    }
}

/// What stays in force over blocks of cycles in a row.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// The cycle whose words these are.
    pub cycle: Cycle,
    /// Index of the axis that drills.
    pub drill_axis: usize,
    /// Where that axis was before the first of the cycles in a row, in machine coordinates: where G98 returns to.
    pub initial_mm: f64,
    /// R: from where it is fed; in G91 from `initial_mm`.
    pub r: Level,
    /// Z: the bottom; in G91 from R.
    pub bottom: Level,
    /// P.
    pub dwell_s: f64,
    /// Q, above 0.
    pub peck_mm: f64,
    /// G87: the step aside in the plane, along its first and second axis.
    pub aside_mm: [f64; 2],
    /// G87: how far up it bores; in G91 from the bottom.
    pub top: Level,
}

impl Series {
    /// Its levels in machine coordinates, where the program's zero lies at `zero_mm`.
    pub fn levels(&self, zero_mm: f64) -> Levels {
        let r_mm = self.r.placed_mm(zero_mm, self.initial_mm);
        let bottom_mm = self.bottom.placed_mm(zero_mm, r_mm);
        Levels {
            r_mm,
            bottom_mm,
            top_mm: self.top.placed_mm(zero_mm, bottom_mm),
        }
    }
}

/// The levels of one block in machine coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// From where it is fed.
    pub r_mm: f64,
    /// The bottom.
    pub bottom_mm: f64,
    /// G87: how far up it bores.
    pub top_mm: f64,
}

/// One step of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// In rapid to a place.
    Rapid(AxisVector),
    /// At feed to a place.
    Feed(AxisVector),
    /// At feed to a place as a tap: the feed belongs to the spindle's speed, so no override counts.
    Tap(AxisVector),
    /// A wait, in s.
    Dwell(f64),
    /// The spindle is stopped.
    SpindleStop,
    /// The spindle is started.
    SpindleStart(Turning),
    /// The spindle, stopped, is turned to its angle 0.
    SpindleOrient,
    /// The program waits for its operator.
    ProgramStop,
}

/// A cycle block, its words understood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleBlock {
    /// Where the tool is.
    pub from: AxisVector,
    /// Over the first hole; the axis that drills does not count.
    pub hole: AxisVector,
    /// From each hole to the next.
    pub pitch: AxisVector,
    /// L: how many holes.
    pub repeats: u32,
    /// G87: the step aside in the plane.
    pub aside: AxisVector,
    /// What is done at each.
    pub series: Series,
    /// At which levels.
    pub levels: Levels,
    /// G99: up to R only, instead of to where it was before the first cycle.
    pub returns_to_r: bool,
    /// How the spindle turns before it.
    pub turning: Option<Turning>,
}

impl CycleBlock {
    /// How many steps a block has at most.
    pub fn steps_max(&self) -> f64 {
        let pecks = match self.series.cycle.pecks() {
            true => (self.pecks() + 1.0).max(1.0),
            false => 1.0,
        };
        1.0 + f64::from(self.repeats) * (14.0 + 3.0 * pecks)
    }

    /// Pecks of one hole before the last.
    pub fn pecks(&self) -> f64 {
        let depth_mm = self.levels.r_mm - self.levels.bottom_mm;
        libm::ceil((depth_mm - DEPTH_ROUNDING_MM) / self.series.peck_mm) - 1.0
    }

    /// Where the axis that drills is after each hole.
    fn clear_mm(&self) -> f64 {
        if self.returns_to_r {
            self.levels.r_mm
        } else {
            self.series.initial_mm.max(self.levels.r_mm)
        }
    }

    /// A place at another level.
    fn at_level(&self, over: &AxisVector, level_mm: f64) -> AxisVector {
        let mut place = *over;
        if let Some(component) = place.get_mut(self.series.drill_axis) {
            *component = level_mm;
        }
        place
    }

    /// The steps, in order: up to R if the tool is below it; then for each hole over it, to R, the cycle, and back up.
    pub fn steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        let from = self.from.get(self.series.drill_axis);
        let mut level_mm = from.copied().unwrap_or(0.0);
        if level_mm < self.levels.r_mm {
            level_mm = self.levels.r_mm;
            steps.push(Step::Rapid(self.at_level(&self.from, level_mm)));
        }
        for index in 0..self.repeats {
            let over = self.hole + self.pitch * f64::from(index);
            steps.push(Step::Rapid(self.at_level(&over, level_mm)));
            steps.push(Step::Rapid(self.at_level(&over, self.levels.r_mm)));
            self.hole_steps(&over, &mut steps);
            level_mm = self.clear_mm();
        }
        steps
    }

    /// The steps of one hole, from over it at R to over it at the level between the holes.
    fn hole_steps(&self, over: &AxisVector, steps: &mut Vec<Step>) {
        let bottom = self.at_level(over, self.levels.bottom_mm);
        let clear = self.at_level(over, self.clear_mm());
        let at_r = self.at_level(over, self.levels.r_mm);
        let dwell_s = self.series.dwell_s;
        let dwell = (dwell_s > 0.0).then_some(Step::Dwell(dwell_s));
        let restart = self.turning.map(Step::SpindleStart);
        match self.series.cycle {
            Cycle::Drill => steps.extend([Step::Feed(bottom), Step::Rapid(clear)]),
            Cycle::ChipBreak | Cycle::Peck => {
                self.peck_steps(over, steps);
                steps.extend([Step::Feed(bottom), Step::Rapid(clear)]);
            }
            Cycle::DrillAndDwell | Cycle::BoreAndDwell => {
                steps.push(Step::Feed(bottom));
                steps.extend(dwell);
                steps.push(match self.series.cycle {
                    Cycle::BoreAndDwell => Step::Feed(clear),
                    _ => Step::Rapid(clear),
                });
            }
            Cycle::TapLeft | Cycle::TapRight => {
                steps.extend([Step::Tap(bottom), Step::SpindleStop]);
                steps.extend(self.turning.map(|way| Step::SpindleStart(way.reversed())));
                steps.extend(dwell);
                steps.extend([Step::Tap(clear), Step::SpindleStop]);
                steps.extend(restart);
            }
            Cycle::Bore => {
                steps.extend([Step::Feed(bottom), Step::Feed(at_r), Step::Rapid(clear)]);
            }
            Cycle::BoreAndStop | Cycle::BoreByHand => {
                let by_hand = self.series.cycle == Cycle::BoreByHand;
                steps.push(Step::Feed(bottom));
                steps.extend(dwell);
                steps.push(Step::SpindleStop);
                // The operator draws the tool back while the program waits; what is left of the way, the program does.
                steps.extend(by_hand.then_some(Step::ProgramStop));
                steps.push(Step::Rapid(clear));
                steps.extend(restart);
            }
            Cycle::BackBore => self.back_bore_steps(over, steps),
        }
    }

    /// The pecks before the last.
    fn peck_steps(&self, over: &AxisVector, steps: &mut Vec<Step>) {
        let r_mm = self.levels.r_mm;
        let mut peck = 1.0;
        while peck <= self.pecks() {
            let depth_mm = r_mm - peck * self.series.peck_mm;
            let off_mm = depth_mm + PECK_CLEARANCE_MM;
            steps.push(Step::Feed(self.at_level(over, depth_mm)));
            if self.series.cycle == Cycle::Peck {
                steps.push(Step::Rapid(self.at_level(over, r_mm)));
                steps.push(Step::Rapid(self.at_level(over, off_mm.min(r_mm))));
            } else {
                steps.push(Step::Rapid(self.at_level(over, off_mm)));
            }
            peck += 1.0;
        }
    }

    /// G87: beside the hole's axis through it with the spindle oriented, onto the axis, up to K and down again at feed, and
    /// out the same way.
    fn back_bore_steps(&self, over: &AxisVector, steps: &mut Vec<Step>) {
        let aside = over + self.aside;
        let Levels {
            r_mm,
            bottom_mm,
            top_mm,
        } = self.levels;
        let restart = self.turning.map(Step::SpindleStart);
        steps.extend([
            Step::Rapid(self.at_level(&aside, r_mm)),
            Step::SpindleStop,
            Step::SpindleOrient,
            Step::Rapid(self.at_level(&aside, bottom_mm)),
            Step::Rapid(self.at_level(over, bottom_mm)),
        ]);
        steps.extend(restart);
        steps.extend([
            Step::Feed(self.at_level(over, top_mm)),
            Step::Feed(self.at_level(over, bottom_mm)),
            Step::SpindleStop,
            Step::SpindleOrient,
            Step::Rapid(self.at_level(&aside, bottom_mm)),
            Step::Rapid(self.at_level(&aside, self.clear_mm())),
            Step::Rapid(self.at_level(over, self.clear_mm())),
        ]);
        steps.extend(restart);
    }
}
