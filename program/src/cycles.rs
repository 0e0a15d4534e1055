//! Canned drilling cycles G81, G82 and G83 (NIST §3.5.16): what they keep from block to block, and the moves of one block.

use control::path::AxisVector;

/// How far above the bottom of the hole a peck ends its rapid down: 0.01 inch, as the NIST interpreter's
/// `G83_RAPID_DELTA`.
const PECK_CLEARANCE_MM: f64 = 0.254;

/// A depth this near to the bottom is the bottom: 1 nm.
const DEPTH_ROUNDING_MM: f64 = 1e-6;

/// The most pecks of one hole.
pub const PECKS_MAX: f64 = 10_000.0;

/// Which cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cycle {
    /// G81: down at feed, up in rapid.
    Drill,
    /// G82: the same with a wait at the bottom.
    DrillAndDwell,
    /// G83: in pecks of Q, out of the hole after each.
    Peck,
}

impl Cycle {
    /// The cycle of a code, given ten times its number.
    pub fn of_code(number: u32) -> Option<Self> {
        match number {
            810 => Some(Cycle::Drill),
            820 => Some(Cycle::DrillAndDwell),
            830 => Some(Cycle::Peck),
            _ => None,
        }
    }

    /// Its code.
    pub fn code(self) -> &'static str {
        match self {
            Cycle::Drill => "G81",
            Cycle::DrillAndDwell => "G82",
            Cycle::Peck => "G83",
        }
    }
}

/// What stays in force over blocks of cycles in a row; levels are machine coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Series {
    /// The cycle whose words these are.
    pub cycle: Cycle,
    /// Z before the first of the cycles in a row: where G98 returns to.
    pub initial_mm: f64,
    /// R: the level from which it is fed.
    pub r_mm: f64,
    /// Z: the bottom.
    pub bottom_mm: f64,
    /// P of G82.
    pub dwell_s: f64,
    /// Q of G83, above 0.
    pub peck_mm: f64,
}

/// One move of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// In rapid to a place.
    Rapid(AxisVector),
    /// At feed to a place.
    Feed(AxisVector),
    /// A wait, in s.
    Dwell(f64),
}

/// A cycle block, its words understood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleBlock {
    /// Where the tool is.
    pub from: AxisVector,
    /// Over the first hole; Z does not count.
    pub hole: AxisVector,
    /// From each hole to the next.
    pub pitch: AxisVector,
    /// L: how many holes.
    pub repeats: u32,
    /// Index of Z.
    pub drill_axis: usize,
    /// What is done at each.
    pub series: Series,
    /// G99: up to R only, instead of to where Z was before the first cycle.
    pub returns_to_r: bool,
}

impl CycleBlock {
    /// How many steps a block has at most.
    pub fn steps_max(&self) -> f64 {
        let pecks = match self.series.cycle {
            Cycle::Peck => (self.pecks() + 1.0).max(1.0),
            _ => 1.0,
        };
        1.0 + f64::from(self.repeats) * (4.0 + 3.0 * pecks)
    }

    /// Pecks of one hole before the last.
    pub fn pecks(&self) -> f64 {
        let depth_mm = self.series.r_mm - self.series.bottom_mm;
        libm::ceil((depth_mm - DEPTH_ROUNDING_MM) / self.series.peck_mm) - 1.0
    }

    /// Z after each hole.
    fn clear_mm(&self) -> f64 {
        if self.returns_to_r {
            self.series.r_mm
        } else {
            self.series.initial_mm.max(self.series.r_mm)
        }
    }

    /// The moves, in order: up to R if the tool is below it; then for each hole over it, to R, the drilling, and back up.
    pub fn steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        let series = &self.series;
        let at_level = |over: &AxisVector, level_mm: f64| {
            let mut place = *over;
            if let Some(z) = place.get_mut(self.drill_axis) {
                *z = level_mm;
            }
            place
        };
        let mut level_mm = self.from.get(self.drill_axis).copied().unwrap_or(0.0);
        if level_mm < series.r_mm {
            level_mm = series.r_mm;
            steps.push(Step::Rapid(at_level(&self.from, level_mm)));
        }
        for index in 0..self.repeats {
            let over = self.hole + self.pitch * f64::from(index);
            steps.push(Step::Rapid(at_level(&over, level_mm)));
            steps.push(Step::Rapid(at_level(&over, series.r_mm)));
            if series.cycle == Cycle::Peck {
                let mut peck = 1.0;
                while peck <= self.pecks() {
                    let depth_mm = series.r_mm - peck * series.peck_mm;
                    let down_mm = (depth_mm + PECK_CLEARANCE_MM).min(series.r_mm);
                    steps.push(Step::Feed(at_level(&over, depth_mm)));
                    steps.push(Step::Rapid(at_level(&over, series.r_mm)));
                    steps.push(Step::Rapid(at_level(&over, down_mm)));
                    peck += 1.0;
                }
            }
            steps.push(Step::Feed(at_level(&over, series.bottom_mm)));
            if series.cycle == Cycle::DrillAndDwell && series.dwell_s > 0.0 {
                steps.push(Step::Dwell(series.dwell_s));
            }
            level_mm = self.clear_mm();
            steps.push(Step::Rapid(at_level(&over, level_mm)));
        }
        steps
    }
}
