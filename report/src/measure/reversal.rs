//! Every change of direction of an axis command, what was done about it and what it left on the table.

use bus::sample::{AxisCommand, PathTag};
use machine::{Machine, ReversalMethod};
use path::geometry::{Feed, Path, Shape};
use serde::Serialize;

use super::arc::{ArcResult, Quadrant};
use crate::rounded::r3;
use crate::turns::Turns;

/// Longest time by which a friction pulse may come after the reversal it belongs to, in s.
const PULSE_LATE_S: f64 = 0.1;
/// Reversals of an axis that are kept; those behind them are counted only.
pub(super) const REVERSALS_MAX: usize = 10_000;
/// Friction pulses of an axis that are kept: with small reversals that are none, more than reversals.
const PULSES_MAX: usize = 4 * REVERSALS_MAX;
/// Largest difference between the angle of a reversal and the quadrant it is matched with, in rad.
const QUADRANT_RAD: f64 = 0.2;

/// One reversal, as the report has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReversalResult {
    /// The axis.
    pub axis: String,
    /// Its index.
    #[serde(skip)]
    pub index: usize,
    /// Direction after it: −1 or 1.
    pub new_direction: i32,
    /// First scan commanded in the new direction.
    pub scan: u64,
    /// Line of the program.
    pub block: Option<u32>,
    /// Radius of the arc it happens on, in mm; none elsewhere.
    pub radius_mm: Option<f64>,
    /// Programmed feed, in mm/min; none at rapid.
    pub feed_mm_min: Option<f64>,
    /// What starts a friction pulse on this axis; `none` where there is none.
    pub trigger: &'static str,
    /// Time by which the pulse began before the command's own reversal, in ms; none if none began.
    pub kick_lead_ms: Option<f64>,
    /// Largest residual in its window, in µm; none where the window is not wholly on an arc.
    pub protrusion_um: Option<f64>,
    /// Smallest residual, in µm.
    pub undercut_um: Option<f64>,
    /// Width of the protrusion at half height, in ms.
    pub width_half_height_ms: Option<f64>,
    /// Whether the arc was in steady motion over the whole window.
    pub steady: bool,
}

#[derive(Debug, Clone, Copy)]
struct Turn {
    scan: u64,
    /// When the velocity of the command goes through zero, in scans.
    time_scans: f64,
    direction: i32,
    tag: PathTag,
    executing: bool,
}

/// Finds the reversals of one axis.
pub struct ReversalMeter {
    search: Turns<Turn>,
    last: Option<(u64, i64)>,
    last_step: i64,
    last_pulse_mm_s: f64,
    turns: Vec<Turn>,
    /// Scan and direction of every friction pulse that began.
    pulses: Vec<(u64, i32)>,
}

impl ReversalMeter {
    /// For an axis of this increment, in mm.
    pub fn new(increment_mm: f64) -> Self {
        ReversalMeter {
            search: Turns::new(increment_mm),
            last: None,
            last_step: 0,
            last_pulse_mm_s: 0.0,
            turns: Vec::new(),
            pulses: Vec::new(),
        }
    }

    /// Scans are missing.
    pub fn interrupt(&mut self) {
        self.search.interrupt();
        self.last = None;
        self.last_step = 0;
        // Compares with nothing: when a pulse began that already runs behind the gap nobody saw.
        self.last_pulse_mm_s = f64::NAN;
    }

    /// Takes the command of one scan.
    pub fn take(&mut self, command: &AxisCommand) {
        let pulse_mm_s = command.friction_pulse_mm_s;
        let turned = pulse_mm_s * self.last_pulse_mm_s <= 0.0;
        if pulse_mm_s != 0.0 && pulse_mm_s.is_finite() && turned {
            let direction = if pulse_mm_s > 0.0 { 1 } else { -1 };
            if self.turns.len() <= REVERSALS_MAX && self.pulses.len() < PULSES_MAX {
                self.pulses.push((command.scan, direction));
            }
        }
        self.last_pulse_mm_s = pulse_mm_s;
        let before = self.last.replace((command.scan, command.position));
        let step = before.map_or(0, |(_, last)| command.position.saturating_sub(last));
        let contiguous = before.is_some_and(|(scan, _)| command.scan == scan + 1);
        let last_step = if contiguous { self.last_step } else { 0 };
        let turn = self.search.take(command.position, |direction| Turn {
            scan: command.scan,
            time_scans: zero_of_velocity(command.scan, last_step, step, direction.into()),
            direction,
            tag: command.tag,
            executing: !command.held.is_none(),
        });
        // One more than is listed: it ends the time of the last one.
        if self.turns.len() <= REVERSALS_MAX {
            self.turns.extend(turn.map(|(turn, _)| turn));
        }
        self.last_step = step;
    }

    /// Reversals that are not listed.
    pub fn not_listed(&self) -> u64 {
        self.search.count.saturating_sub(REVERSALS_MAX as u64)
    }

    /// Ends the search and looks up what each reversal left on the table.
    pub fn finish(
        self,
        axis: usize,
        machine: &Machine,
        path: &Path,
        arcs: &[ArcResult],
    ) -> Vec<ReversalResult> {
        let period_s = machine.scan_period_s();
        let settings = machine.axes.get(axis);
        let name = settings.map_or("?", |axis| &axis.name);
        let trigger = match settings.map(|axis| axis.reversal) {
            Some(reversal) if reversal.method == ReversalMethod::FrictionPulse => {
                reversal.trigger.word()
            }
            _ => "none",
        };
        let mut earliest_scans = f64::NEG_INFINITY;
        let mut pulses = self.pulses.iter().peekable();
        let mut results = Vec::new();
        for (index, turn) in self.turns.iter().enumerate().take(REVERSALS_MAX) {
            let next_scans = self
                .turns
                .get(index + 1)
                .map_or(f64::INFINITY, |t| t.time_scans);
            let latest_scans = (turn.time_scans + PULSE_LATE_S / period_s).min(next_scans);
            let mut pulse_scans = None;
            while let Some((scan, direction)) =
                pulses.next_if(|(scan, _)| (*scan as f64) <= latest_scans)
            {
                if *direction == turn.direction && *scan as f64 > earliest_scans {
                    pulse_scans = pulse_scans.or(Some(*scan as f64));
                }
            }
            earliest_scans = turn.time_scans;
            let element = path
                .elements
                .get(turn.tag.element as usize)
                .filter(|_| turn.executing);
            let radius_mm = element.and_then(|element| match &element.shape {
                Shape::Arc {
                    radius_mm, u, v, ..
                } => {
                    let moves = |unit: &path::geometry::AxisVector| unit.get(axis) == Some(&1.0);
                    (moves(u) || moves(v)).then_some(*radius_mm)
                }
                _ => None,
            });
            let quadrant = element.and_then(|_| quadrant_of(turn, axis, path, arcs));
            results.push(ReversalResult {
                axis: name.into(),
                index: axis,
                new_direction: turn.direction,
                scan: turn.scan,
                block: element.map(|element| element.line),
                radius_mm: radius_mm.map(|radius_mm| libm::round(radius_mm * 1e6) / 1e6),
                feed_mm_min: element.and_then(|element| match element.feed {
                    Feed::PathMmS(feed) => Some(r3(feed * 60.0)),
                    Feed::Rapid => None,
                }),
                trigger,
                kick_lead_ms: pulse_scans
                    .map(|scans| r3((turn.time_scans - scans) * period_s * 1e3)),
                protrusion_um: quadrant.map(|quadrant| r3(quadrant.protrusion_um)),
                undercut_um: quadrant.map(|quadrant| r3(quadrant.undercut_um)),
                width_half_height_ms: quadrant
                    .and_then(|quadrant| quadrant.width_half_height_ms.map(r3)),
                steady: quadrant.is_some_and(|quadrant| quadrant.steady),
            });
        }
        results
    }
}

/// Between the middles of two steps of opposite sign the velocity is taken as a straight line; after rest the motion
/// begins with the step.
fn zero_of_velocity(scan: u64, last_step: i64, step: i64, direction: i64) -> f64 {
    if last_step.saturating_mul(direction) >= 0 {
        return scan as f64 - 1.0;
    }
    let (before, after) = (last_step.unsigned_abs() as f64, step.unsigned_abs() as f64);
    scan as f64 - 1.5 + before / (before + after)
}

fn quadrant_of<'a>(
    turn: &Turn,
    axis: usize,
    path: &Path,
    arcs: &'a [ArcResult],
) -> Option<&'a Quadrant> {
    let element = turn.tag.element as usize;
    let scan = turn.scan as f64;
    // They are in order of travel.
    let over = arcs.partition_point(|arc| arc.scans.1 + 2.0 < scan);
    let started = arcs.get(over..)?.iter();
    let mut started = started.take_while(|arc| scan >= arc.scans.0 - 2.0);
    let arc = started.find(|arc| (arc.elements.0..=arc.elements.1).contains(&element))?;
    let before = path.elements.get(arc.elements.0..element)?;
    let sweep_rad = |element: &path::geometry::Element| match &element.shape {
        Shape::Arc { sweep_rad, .. } => sweep_rad.abs(),
        _ => 0.0,
    };
    let here = path.elements.get(element)?;
    let along_rad = before.iter().map(sweep_rad).sum::<f64>()
        + sweep_rad(here) * (turn.tag.distance_mm / here.length_mm.max(f64::MIN_POSITIVE));
    let angle_rad = arc.angle_of(along_rad);
    arc.quadrants
        .iter()
        .filter(|quadrant| quadrant.axis == axis)
        .map(|quadrant| (quadrant, (quadrant.angle_rad - angle_rad).abs()))
        .filter(|(_, distance_rad)| *distance_rad < QUADRANT_RAD)
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(quadrant, _)| quadrant)
}
