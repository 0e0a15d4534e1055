//! Circular deviation and quadrant protrusions of every arc (ISO 230-4), as docs/methods/physics.md §5 lays down.
//!
//! - *Run*: consecutive elements on one circle, in one direction, at one feed. Its samples are those taken while the
//!   feedback named one of its elements.
//! - *Steady*: the path speed of the setpoints is at least 99 % of the run's highest and has been for
//!   min(100 ms, 120° of travel). Run-in, run-out and whatever a hold or an override leaves behind is skipped by this
//!   rule. A run that is steady over less than 30° (a corner) is measured whole.
//! - *Window* of a quadrant, in angles of the table, w the angular speed: from clip(6 ms·w, 2°, 12°) before it to
//!   clip(50 ms·w, 8°, 40°) after it.
//! - *Gap*: scans of the run that are missing in the log. The run is measured on what is there: the angle is carried over
//!   the gap by the path that the setpoints travelled meanwhile; behind it motion must have been steady again, for nobody
//!   saw whether it was; a quadrant whose window has a gap is not measured, for its peak may be what is missing; and the
//!   result says how many scans are. Deviations are then those of the measured part: lower bounds for the whole.
//! - Centre and radius are fitted to steady samples outside the windows and reported apart; what remains, outward
//!   positive, is the residual that protrusion (highest) and undercut (lowest) are read from.

mod evaluate;
pub mod plots;
mod result;
mod runs;

use std::f64::consts::TAU;

use bus::sample::{Feedback, PathTag};
use path::geometry::{AxisVector, Path};
use path::kinematics::Kinematics;

use super::ball_bar::BallBarMeter;
use crate::contour::begins_mm;
use evaluate::{Keeps, Series, Taken, measure};
pub use result::{ArcResult, CurvePoint, Deviations, Quadrant};
pub use runs::Circle;
use runs::{Run, find_runs, sweeps_rad};

/// Samples kept of one run; a longer run is thinned to every second, fourth … sample.
const SAMPLES_MAX: usize = 1 << 19;
/// Gaps kept apart in one run; what comes later joins the last, so that everything between is taken for missing.
const GAPS_MAX: usize = 1000;

/// The run that is being travelled.
struct Open {
    run: usize,
    series: Series,
    /// Angle travelled, as far as known before the next sample is seen, in rad.
    near_rad: f64,
    /// Whether scans are missing before the next sample.
    gap: bool,
    stride: usize,
    skipped: usize,
}

/// Measures the arcs of a path.
pub struct ArcMeter {
    period_s: f64,
    runs: Vec<Run>,
    /// Run of each element.
    run_of: Vec<Option<usize>>,
    /// Path length before each element, in mm.
    before_mm: Vec<f64>,
    /// Angle travelled on the element's own run before it, and on it, in rad.
    sweeps_rad: Vec<(f64, f64)>,
    lengths_mm: Vec<f64>,
    open: Option<Open>,
    /// Scan, path length and angle on the run's circle of the setpoints last seen.
    place: Option<(u64, f64, f64)>,
    speed_mm_s: f64,
    off_path: bool,
    /// Nothing of the path has been seen yet.
    unseen: bool,
    keeps: Keeps,
    results: Vec<ArcResult>,
}

impl ArcMeter {
    /// For one path.
    pub fn new(path: &Path, kinematics: &Kinematics, period_s: f64) -> Self {
        let (runs, run_of) = find_runs(path, kinematics);
        ArcMeter {
            period_s,
            before_mm: begins_mm(path),
            sweeps_rad: sweeps_rad(path, &run_of),
            lengths_mm: path.elements.iter().map(|e| e.length_mm).collect(),
            runs,
            run_of,
            open: None,
            place: None,
            speed_mm_s: 0.0,
            off_path: false,
            unseen: true,
            keeps: Keeps::default(),
            results: Vec::new(),
        }
    }

    /// The path is left in order, or the drives are off: until it is back on the path nothing is missing.
    pub fn leave(&mut self) {
        self.place = None;
        self.speed_mm_s = 0.0;
    }

    /// Begins a scan.
    ///
    /// Off the path nothing is taken; who returns to it goes on with the arc that was left.
    pub fn scan(&mut self, feedback: &Feedback, executing: bool) {
        self.off_path = feedback.tag.is_off_path();
        if self.off_path {
            self.leave();
            return;
        }
        let element = feedback.tag.element as usize;
        let run = self.run_of.get(element).copied().flatten();
        let run = run.filter(|_| executing);
        let angle_rad = self.angle_rad(&feedback.tag);
        let before_mm = self.before_mm.get(element).copied().unwrap_or(0.0);
        let place_mm = before_mm + feedback.tag.distance_mm;
        let gap = self.place.and_then(|(scan, from_mm, _)| {
            let scans = feedback.scan.saturating_sub(scan + 1);
            (scans > 0).then_some((scans, from_mm, place_mm))
        });
        if self.open.as_ref().map(|open| open.run) != run {
            self.miss(gap);
            self.close();
            self.open = run.map(|run| Open {
                run,
                series: Series::default(),
                near_rad: angle_rad,
                gap: false,
                stride: 1,
                skipped: 0,
            });
        }
        self.miss(gap);
        if std::mem::take(&mut self.unseen) {
            self.miss_beginning(angle_rad);
        }
        if let (Some(open), Some(_)) = (&mut self.open, gap) {
            open.gap = true;
            // The table was as far behind the setpoints before the gap as it is behind them now.
            open.near_rad = match (open.series.taken.last(), self.place) {
                (Some(last), Some((_, _, before_rad))) => last.along_rad + angle_rad - before_rad,
                _ => angle_rad,
            };
        }
        if let Some((scan, place_before_mm, _)) = self.place {
            let scans = feedback.scan.saturating_sub(scan).max(1) as f64;
            self.speed_mm_s = (place_mm - place_before_mm) / (scans * self.period_s);
        }
        self.place = Some((feedback.scan, place_mm, angle_rad));
    }

    /// Counts the scans of a gap (how many, from where on the path to where, in mm) that were the open run's: as many as its
    /// share of the way.
    fn miss(&mut self, gap: Option<(u64, f64, f64)>) {
        let (Some((scans, from_mm, to_mm)), Some(open)) = (gap, &mut self.open) else {
            return;
        };
        let Some(run) = self.runs.get(open.run) else {
            return;
        };
        let start_mm = self.before_mm.get(run.elements.0).copied().unwrap_or(0.0);
        let last = run.elements.1;
        let last_mm = self.before_mm.get(last).zip(self.lengths_mm.get(last));
        let end_mm = last_mm.map_or(start_mm, |(before_mm, length_mm)| before_mm + length_mm);
        let way_mm = to_mm - from_mm;
        let on_run_mm = to_mm.clamp(start_mm, end_mm) - from_mm.clamp(start_mm, end_mm);
        let share = if way_mm > 0.0 {
            on_run_mm / way_mm
        } else {
            1.0
        };
        open.series.missing_scans += libm::round(scans as f64 * share) as u64;
    }

    /// A log that begins on a circle does not have the way to there: so many scans at the programmed feed.
    fn miss_beginning(&mut self, angle_rad: f64) {
        let Some(open) = &mut self.open else { return };
        let circle = self.runs.get(open.run).map(|run| &run.circle);
        let way = circle.map(|circle| (angle_rad * circle.radius_mm, circle.feed_mm_s));
        // From rest nobody comes this far in one scan.
        if let Some((way_mm, Some(feed_mm_s))) = way
            && way_mm > 1.0
        {
            open.series.missing_scans += libm::ceil(way_mm / (feed_mm_s * self.period_s)) as u64;
        }
    }

    /// Angle from the start of its run to a place on the programmed path, in rad; 0 off every circle.
    fn angle_rad(&self, tag: &PathTag) -> f64 {
        let element = tag.element as usize;
        let known = self
            .sweeps_rad
            .get(element)
            .zip(self.lengths_mm.get(element));
        known.map_or(0.0, |((before_rad, sweep_rad), length_mm)| {
            let share = tag.distance_mm / length_mm.max(f64::MIN_POSITIVE);
            let share = if share.is_finite() { share } else { 0.0 };
            before_rad + sweep_rad * share.clamp(0.0, 1.0)
        })
    }

    /// Takes one instrument sample of the scan started last; time in scans.
    pub fn sample(&mut self, time_scans: f64, table: &AxisVector, motor: &AxisVector) {
        if self.off_path {
            return;
        }
        let Some(open) = &mut self.open else { return };
        let Some(run) = self.runs.get(open.run) else {
            return;
        };
        open.skipped += 1;
        // The first behind a gap is always taken: from it on the angle is counted again.
        if open.skipped < open.stride && !open.gap {
            return;
        }
        open.skipped = 0;
        let circle = &run.circle;
        let of = |point: &AxisVector| {
            let along = |index: usize| {
                let axis = point.get(circle.plane[index]).copied().unwrap_or(0.0);
                axis - circle.centre_mm[index]
            };
            [along(0), along(1)]
        };
        let table_mm = of(table);
        let angle_rad = libm::atan2(table_mm[1], table_mm[0]);
        let sign = if circle.clockwise { -1.0 } else { 1.0 };
        let raw_rad = sign * (angle_rad - run.start_angle_rad);
        // The first sample lies within half a turn of the start, each further one within half a turn of the last.
        let near_rad = match open.series.taken.last() {
            Some(taken) if !open.gap => taken.along_rad,
            _ => open.near_rad,
        };
        let along_rad = raw_rad - TAU * libm::round((raw_rad - near_rad) / TAU);
        let taken = Taken {
            time_scans,
            speed_mm_s: self.speed_mm_s,
            along_rad,
            table_mm,
            motor_mm: of(motor),
        };
        let finite = taken.table_mm.iter().chain(&taken.motor_mm);
        if !finite.copied().all(f64::is_finite) {
            return;
        }
        if std::mem::take(&mut open.gap) {
            let before = open.series.taken.last();
            let from = before.map_or(f64::NEG_INFINITY, |before| before.time_scans);
            let full = open.series.gaps.len() >= GAPS_MAX;
            match open.series.gaps.last_mut().filter(|_| full) {
                Some(last) => last.1 = time_scans,
                None => open.series.gaps.push((from, time_scans)),
            }
        }
        open.series.taken.push(taken);
        if open.series.taken.len() >= SAMPLES_MAX {
            let mut index = 0;
            open.series.taken.retain(|_| {
                index += 1;
                index % 2 == 0
            });
            open.stride *= 2;
        }
    }

    /// Ends the measurement: the arcs, and what circles travelled both ways are measured by.
    pub fn finish(mut self) -> (Vec<ArcResult>, BallBarMeter) {
        self.close();
        (self.results, self.keeps.ball_bars)
    }

    fn close(&mut self) {
        let Some(open) = self.open.take() else { return };
        if let Some(run) = self.runs.get(open.run) {
            self.results
                .extend(measure(run, &open.series, self.period_s, &mut self.keeps));
        }
    }
}
