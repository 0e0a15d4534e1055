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
//!   the gap by the path that the setpoints travelled meanwhile; behind it motion must have been steady anew, for nobody
//!   saw whether it was; a quadrant whose window has a gap is not measured, for its peak may be what is missing; and the
//!   result says how many scans are. Deviations are then those of the measured part: lower bounds for the whole.
//! - Centre and radius are fitted to steady samples outside the windows and reported apart; what remains, outward
//!   positive, is the residual that protrusion (highest) and undercut (lowest) are read from.

pub mod plots;

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use bus::sample::{Feedback, PathTag};
use control::kinematics::Kinematics;
use control::path::{AxisVector, Element, Feed, Path, Shape};

use super::fit::{Fit, FitKind};

/// Samples kept of one run; a longer run is thinned to every second, fourth … sample.
const SAMPLES_MAX: usize = 1 << 19;
/// Share of the highest path speed from which motion counts as steady.
const STEADY_SHARE: f64 = 0.99;
/// Longest time that motion must have been steady, in s: five time constants of a position loop of 50 1/s, after which the
/// swing from the run-in's acceleration has died away.
const SETTLE_S: f64 = 0.100;
/// Longest angle for the same, in rad.
const SETTLE_RAD: f64 = 120.0 * PI / 180.0;
/// Shortest steady part that a measurement is limited to, in rad.
const STEADY_RAD_MIN: f64 = 30.0 * PI / 180.0;
/// Angular bins of the curve kept for plots, per turn.
const BINS_PER_TURN: f64 = 1440.0;
/// Gaps kept apart in one run; what comes later joins the last, so that everything between is taken for missing.
const GAPS_MAX: usize = 1000;
/// Turns of a run that the curve shows.
const TURNS_SHOWN: usize = 8;

/// The circle a run of elements lies on.
#[derive(Debug, Clone, PartialEq)]
pub struct Circle {
    /// Indices of the axes of its plane: first, second.
    pub plane: [usize; 2],
    /// Its centre in the plane, in mm.
    pub centre_mm: [f64; 2],
    /// Its radius, in mm.
    pub radius_mm: f64,
    /// Whether it is travelled clockwise, seen with the first axis to the right and the second up.
    pub clockwise: bool,
    /// Programmed feed, in mm/s; none for rapid.
    pub feed_mm_s: Option<f64>,
}

/// A run of elements on one circle.
#[derive(Debug, Clone)]
struct Run {
    circle: Circle,
    /// Elements, first to last.
    elements: (usize, usize),
    line: u32,
    start_angle_rad: f64,
    /// Angle travelled, positive.
    sweep_rad: f64,
    /// Where the axes of its plane reverse, if that is not at the quadrants: (angle in one turn, 0 or 1 for the axis of the
    /// plane), in rising order.
    reversals: Option<Vec<(f64, usize)>>,
}

/// What remained at one quadrant whose whole window lies on the arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quadrant {
    /// Axis that reverses there.
    pub axis: usize,
    /// Where, unwrapped along the run as in [`ArcResult::angle_of`], in rad.
    pub angle_rad: f64,
    /// Largest residual, in µm.
    pub protrusion_um: f64,
    /// Angle of the largest residual, in rad.
    pub protrusion_angle_rad: f64,
    /// Smallest residual, in µm.
    pub undercut_um: f64,
    /// Width of the protrusion at half its height, in ms; none if it is no bump.
    pub width_half_height_ms: Option<f64>,
    /// Whether the whole window lies in steady motion.
    pub steady: bool,
}

/// One point of the curve for plots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Angle about the programmed centre, in rad.
    pub angle_rad: f64,
    /// Residual of the table, in µm.
    pub table_um: f64,
    /// Residual of the motor side, backlash compensation removed, in µm.
    pub motor_um: f64,
}

/// Deviations of one series (table or motor side).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviations {
    /// Fit to samples outside the windows.
    pub fit: Fit,
    /// Highest minus lowest residual about the fitted centre, in µm (ISO 230-4 circular deviation G).
    pub circular_um: f64,
    /// Highest and lowest distance from the programmed radius about the fitted centre, in µm (F of ISO 230-4).
    pub radial_um: (f64, f64),
    /// The same about the programmed centre.
    pub programmed_um: (f64, f64),
}

/// One run on one circle, measured.
#[derive(Debug, Clone)]
pub struct ArcResult {
    /// The circle.
    pub circle: Circle,
    /// Line of the program.
    pub line: u32,
    /// Elements, first to last.
    pub elements: (usize, usize),
    /// Scans, first to last.
    pub scans: (f64, f64),
    /// Turns programmed.
    pub turns: f64,
    /// Part of the run that was measured, in degrees of the table.
    pub measured_deg: f64,
    /// Scans missing between its first and its last sample, or before its first.
    pub missing_scans: u64,
    /// Highest path speed, in mm/s.
    pub speed_mm_s: f64,
    /// The table.
    pub table: Deviations,
    /// The motor side, backlash compensation removed.
    pub motor: Deviations,
    /// Quadrants that were crossed, window and all.
    pub quadrants: Vec<Quadrant>,
    /// The residuals, thinned; empty where no plot shows them ([`plots`]).
    pub curve: Vec<CurvePoint>,
    start_angle_rad: f64,
}

impl ArcResult {
    /// Signed unwrapped angle of a place on the programmed circle, `along_rad` travelled from the start.
    pub fn angle_of(&self, along_rad: f64) -> f64 {
        let sign = if self.circle.clockwise { -1.0 } else { 1.0 };
        self.start_angle_rad + sign * along_rad
    }
}

#[derive(Debug, Clone, Copy)]
struct Taken {
    time_scans: f64,
    speed_mm_s: f64,
    /// Angle travelled by the table since the start of the programmed arc.
    along_rad: f64,
    table_mm: [f64; 2],
    motor_mm: [f64; 2],
}

/// From the last sample before a gap to the first behind it, in scans.
type Gap = (f64, f64);

struct Open {
    run: usize,
    taken: Vec<Taken>,
    gaps: Vec<Gap>,
    missing_scans: u64,
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
    curves: plots::CurvesKept,
    results: Vec<ArcResult>,
}

impl ArcMeter {
    /// For one path.
    pub fn new(path: &Path, kinematics: &Kinematics, period_s: f64) -> Self {
        let (runs, run_of) = find_runs(path, kinematics);
        let mut length_mm = 0.0;
        let before_mm = path.elements.iter().map(|element| {
            let before = length_mm;
            length_mm += element.length_mm;
            before
        });
        ArcMeter {
            period_s,
            before_mm: before_mm.collect(),
            sweeps_rad: sweeps_rad(path, &run_of),
            lengths_mm: path.elements.iter().map(|e| e.length_mm).collect(),
            runs,
            run_of,
            open: None,
            place: None,
            speed_mm_s: 0.0,
            off_path: false,
            unseen: true,
            curves: plots::CurvesKept::default(),
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
                taken: Vec::new(),
                gaps: Vec::new(),
                missing_scans: 0,
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
            open.near_rad = match (open.taken.last(), self.place) {
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
        open.missing_scans += libm::round(scans as f64 * share) as u64;
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
            open.missing_scans += libm::ceil(way_mm / (feed_mm_s * self.period_s)) as u64;
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

    /// Takes one instrument sample of the scan begun last; time in scans.
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
        let near_rad = match open.taken.last() {
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
            let before = open.taken.last();
            let from = before.map_or(f64::NEG_INFINITY, |before| before.time_scans);
            let full = open.gaps.len() >= GAPS_MAX;
            match open.gaps.last_mut().filter(|_| full) {
                Some(last) => last.1 = time_scans,
                None => open.gaps.push((from, time_scans)),
            }
        }
        open.taken.push(taken);
        if open.taken.len() >= SAMPLES_MAX {
            let mut index = 0;
            open.taken.retain(|_| {
                index += 1;
                index % 2 == 0
            });
            open.stride *= 2;
        }
    }

    /// Ends the measurement.
    pub fn finish(mut self) -> Vec<ArcResult> {
        self.close();
        self.results
    }

    fn close(&mut self) {
        let Some(open) = self.open.take() else { return };
        if let Some(run) = self.runs.get(open.run) {
            self.results
                .extend(measure(run, &open, self.period_s, &mut self.curves));
        }
    }
}

fn circle_of(element: &Element) -> Option<(Circle, f64, f64)> {
    let Shape::Arc {
        centre,
        radius_mm,
        u,
        v,
        start_angle_rad,
        sweep_rad,
        ..
    } = &element.shape
    else {
        return None;
    };
    let axis = |unit: &AxisVector| unit.iter().position(|component| *component == 1.0);
    let plane = [axis(u)?, axis(v)?];
    let circle = Circle {
        plane,
        centre_mm: [centre.dot(u), centre.dot(v)],
        radius_mm: *radius_mm,
        clockwise: *sweep_rad < 0.0,
        feed_mm_s: match element.feed {
            Feed::PathMmS(feed) => Some(feed),
            Feed::Rapid => None,
        },
    };
    Some((circle, *start_angle_rad, sweep_rad.abs()))
}

/// Whether two arcs lie on one circle: centre and radius within 0.1 µm, far above the rounding of a program's numbers
/// carried through arithmetic and far below what is measured.
fn same_circle(a: &Circle, b: &Circle) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-4;
    a.plane == b.plane
        && a.clockwise == b.clockwise
        && a.feed_mm_s == b.feed_mm_s
        && near(a.radius_mm, b.radius_mm)
        && near(a.centre_mm[0], b.centre_mm[0])
        && near(a.centre_mm[1], b.centre_mm[1])
}

/// Places of a turn looked at for reversals; between two of them an axis reverses at most once.
const REVERSAL_STEPS: u32 = 720;

/// Where on a circle the axes of its plane reverse: they are found by the sign of their speed and halving. None where they
/// are the program's axes, which reverse at the quadrants.
fn reversals_on(
    element: &Element,
    circle: &Circle,
    kinematics: &Kinematics,
) -> Option<Vec<(f64, usize)>> {
    if *kinematics == Kinematics::Cartesian {
        return None;
    }
    let [first, second] = circle.plane;
    let speed = |angle_rad: f64, axis: usize| {
        let (sine, cosine) = (libm::sin(angle_rad), libm::cos(angle_rad));
        let (mut place, mut tangent) = (element.start(), AxisVector::zeros());
        for (axis, centre_mm, spoke, along) in [
            (first, circle.centre_mm[0], cosine, -sine),
            (second, circle.centre_mm[1], sine, cosine),
        ] {
            if let (Some(place), Some(tangent)) = (place.get_mut(axis), tangent.get_mut(axis)) {
                *place = centre_mm + circle.radius_mm * spoke;
                *tangent = along;
            }
        }
        let of_axes = kinematics.axes_tangent(&place, &tangent);
        of_axes.get(axis).copied().unwrap_or(0.0)
    };
    let mut reversals = Vec::new();
    for (index, axis) in circle.plane.into_iter().enumerate() {
        for step in 0..REVERSAL_STEPS {
            // Off the quadrants, so that a speed of zero there lies between two places.
            let place_rad = |step: u32| (f64::from(step) + 0.5) * TAU / f64::from(REVERSAL_STEPS);
            let (mut low_rad, mut high_rad) = (place_rad(step), place_rad(step + 1));
            let low_speed = speed(low_rad, axis);
            if low_speed * speed(high_rad, axis) >= 0.0 {
                continue;
            }
            for _ in 0..50 {
                let middle_rad = 0.5 * (low_rad + high_rad);
                if low_speed * speed(middle_rad, axis) > 0.0 {
                    low_rad = middle_rad;
                } else {
                    high_rad = middle_rad;
                }
            }
            reversals.push((high_rad, index));
        }
    }
    reversals.sort_by(|a, b| a.0.total_cmp(&b.0));
    Some(reversals)
}

/// Angle travelled on each element's run before it, and on it, in rad.
fn sweeps_rad(path: &Path, run_of: &[Option<usize>]) -> Vec<(f64, f64)> {
    let mut before = (None, 0.0);
    let elements = path.elements.iter().zip(run_of);
    elements
        .map(|(element, run)| {
            if before.0 != *run {
                before = (*run, 0.0);
            }
            let sweep_rad = match &element.shape {
                Shape::Arc { sweep_rad, .. } if run.is_some() => sweep_rad.abs(),
                _ => 0.0,
            };
            let before_rad = before.1;
            before.1 += sweep_rad;
            (before_rad, sweep_rad)
        })
        .collect()
}

fn find_runs(path: &Path, kinematics: &Kinematics) -> (Vec<Run>, Vec<Option<usize>>) {
    let mut runs: Vec<Run> = Vec::new();
    let mut run_of: Vec<Option<usize>> = Vec::with_capacity(path.elements.len());
    for (index, element) in path.elements.iter().enumerate() {
        let Some((circle, start_angle_rad, sweep_rad)) = circle_of(element) else {
            run_of.push(None);
            continue;
        };
        match runs.last_mut() {
            Some(run) if run.elements.1 + 1 == index && same_circle(&run.circle, &circle) => {
                run.elements.1 = index;
                run.sweep_rad += sweep_rad;
            }
            _ => runs.push(Run {
                reversals: reversals_on(element, &circle, kinematics),
                circle,
                elements: (index, index),
                line: element.line,
                start_angle_rad,
                sweep_rad,
            }),
        }
        run_of.push(Some(runs.len() - 1));
    }
    (runs, run_of)
}

/// Window about a quadrant, in rad before and after it.
pub fn window_rad(angular_speed_rad_s: f64) -> (f64, f64) {
    let clip = |seconds: f64, low_deg: f64, high_deg: f64| {
        (seconds * angular_speed_rad_s).clamp(low_deg.to_radians(), high_deg.to_radians())
    };
    (clip(0.006, 2.0, 12.0), clip(0.050, 8.0, 40.0))
}

fn measure(
    run: &Run,
    open: &Open,
    period_s: f64,
    curves: &mut plots::CurvesKept,
) -> Option<ArcResult> {
    let (taken, gaps) = (open.taken.as_slice(), open.gaps.as_slice());
    let (first, last) = (taken.first()?, taken.last()?);
    let radius_mm = run.circle.radius_mm;
    let speed_mm_s = taken
        .iter()
        .fold(0.0, |most: f64, t| most.max(t.speed_mm_s));
    let angular_speed_rad_s = speed_mm_s / radius_mm;
    let steady = steady_samples(taken, gaps, speed_mm_s, angular_speed_rad_s, period_s);
    let window = window_rad(angular_speed_rad_s);
    let sign = if run.circle.clockwise { -1.0 } else { 1.0 };
    let quadrants_along = match &run.reversals {
        None => quadrants_along(run.start_angle_rad, sign, first, last, window),
        Some(of_a_turn) => {
            reversals_along(run.start_angle_rad, sign, first, last, window, of_a_turn)
        }
    };
    let in_window = |along_rad: f64| {
        // They are in rising order: only the first whose window has not ended before can hold it.
        let first = quadrants_along.partition_point(|(at, _)| at + window.1 < along_rad);
        let at = quadrants_along.get(first);
        at.is_some_and(|(at, _)| along_rad >= at - window.0)
    };
    let of_fit: Vec<bool> = taken
        .iter()
        .zip(&steady)
        .map(|(taken, steady)| *steady && !in_window(taken.along_rad))
        .collect();
    let deviations = |of: fn(&Taken) -> [f64; 2]| {
        let points = taken
            .iter()
            .zip(&of_fit)
            .filter(|(_, used)| **used)
            .map(|(taken, _)| of(taken));
        let fit = Fit::to_points(points, radius_mm);
        let measured = taken.iter().zip(&steady).filter(|(_, steady)| **steady);
        let none = (f64::NEG_INFINITY, f64::INFINITY);
        let (mut residual, mut programmed) = (none, none);
        for (taken, _) in measured {
            let [x, y] = of(taken);
            widen(&mut residual, fit.residual_mm([x, y], radius_mm) * 1e3);
            widen(&mut programmed, ((x * x + y * y).sqrt() - radius_mm) * 1e3);
        }
        let radius_error_um = fit.radius_error_mm * 1e3;
        Deviations {
            fit,
            circular_um: residual.0 - residual.1,
            radial_um: (residual.0 + radius_error_um, residual.1 + radius_error_um),
            programmed_um: programmed,
        }
    };
    let table = deviations(|taken| taken.table_mm);
    let motor = deviations(|taken| taken.motor_mm);
    let quadrants = quadrants_along.iter().filter_map(|(at, axis)| {
        let axis = run.circle.plane[*axis];
        let angle_rad = run.start_angle_rad + sign * at;
        quadrant(
            taken,
            gaps,
            &steady,
            &table.fit,
            radius_mm,
            *at,
            window,
            period_s,
            angle_rad,
            axis,
            sign,
            run.start_angle_rad,
        )
    });
    let mut result = ArcResult {
        line: run.line,
        elements: run.elements,
        scans: (first.time_scans, last.time_scans),
        turns: run.sweep_rad / TAU,
        measured_deg: measured_rad(taken, gaps, &steady).to_degrees(),
        missing_scans: open.missing_scans,
        speed_mm_s,
        table,
        motor,
        quadrants: quadrants.collect(),
        curve: Vec::new(),
        start_angle_rad: run.start_angle_rad,
        circle: run.circle.clone(),
    };
    if curves.keep(&result) {
        result.curve = curve(taken, &steady, run, sign, &table.fit, &motor.fit);
    }
    Some(result)
}

fn widen(range: &mut (f64, f64), value: f64) {
    range.0 = range.0.max(value);
    range.1 = range.1.min(value);
}

/// Whether scans are missing somewhere between two samples.
fn has_gap(gaps: &[Gap], from: &Taken, to: &Taken) -> bool {
    let first = gaps.partition_point(|gap| gap.1 <= from.time_scans);
    gaps.get(first).is_some_and(|gap| gap.0 < to.time_scans)
}

/// Angle over which steady samples follow each other, in rad.
fn measured_rad(taken: &[Taken], gaps: &[Gap], steady: &[bool]) -> f64 {
    let pairs = taken.windows(2).zip(steady.windows(2));
    pairs
        .filter(|(_, steady)| steady.iter().all(|s| *s))
        .filter_map(|(pair, _)| pair.first().zip(pair.last()))
        .filter(|(one, two)| !has_gap(gaps, one, two))
        .map(|(one, two)| two.along_rad - one.along_rad)
        .sum()
}

fn steady_samples(
    taken: &[Taken],
    gaps: &[Gap],
    speed_mm_s: f64,
    angular_speed_rad_s: f64,
    period_s: f64,
) -> Vec<bool> {
    let settle_scans = SETTLE_S.min(SETTLE_RAD / angular_speed_rad_s) / period_s;
    let mut since: Option<f64> = None;
    let mut before: Option<&Taken> = None;
    let steady: Vec<bool> = taken
        .iter()
        .map(|taken| {
            let before = before.replace(taken);
            if before.is_some_and(|before| has_gap(gaps, before, taken)) {
                since = None;
            }
            if taken.speed_mm_s < STEADY_SHARE * speed_mm_s {
                since = None;
                return false;
            }
            taken.time_scans - *since.get_or_insert(taken.time_scans) >= settle_scans
        })
        .collect();
    if measured_rad(taken, gaps, &steady) < STEADY_RAD_MIN {
        return vec![true; taken.len()];
    }
    steady
}

/// Quadrants whose window the samples touch: (angle along the run, 0 or 1 for the axis of the plane that reverses).
fn quadrants_along(
    start_angle_rad: f64,
    sign: f64,
    first: &Taken,
    last: &Taken,
    window: (f64, f64),
) -> Vec<(f64, usize)> {
    let offset = sign * start_angle_rad;
    let low = libm::ceil((first.along_rad - window.1 + offset) / FRAC_PI_2) as i64;
    let high = libm::floor((last.along_rad + window.0 + offset) / FRAC_PI_2) as i64;
    // A run has far fewer quadrants than this; it bounds what a damaged log can ask for.
    (low..=high.min(low.saturating_add(100_000)))
        .map(|k| (k as f64 * FRAC_PI_2 - offset, k.rem_euclid(2) as usize))
        .collect()
}

/// The same where the axes reverse elsewhere than at the quadrants.
fn reversals_along(
    start_angle_rad: f64,
    sign: f64,
    first: &Taken,
    last: &Taken,
    window: (f64, f64),
    of_a_turn: &[(f64, usize)],
) -> Vec<(f64, usize)> {
    let (low_rad, high_rad) = (first.along_rad - window.1, last.along_rad + window.0);
    let turns = libm::ceil(((high_rad - low_rad) / TAU).clamp(0.0, 25_000.0)) as u32 + 1;
    let mut along: Vec<(f64, usize)> = Vec::new();
    for (angle_rad, axis) in of_a_turn {
        let at_rad = sign * (angle_rad - start_angle_rad);
        let first_rad = at_rad + TAU * libm::ceil((low_rad - at_rad) / TAU);
        let of_turns = (0..turns).map(|turn| (first_rad + f64::from(turn) * TAU, *axis));
        along.extend(of_turns.take_while(|(at_rad, _)| *at_rad <= high_rad));
    }
    along.sort_by(|a, b| a.0.total_cmp(&b.0));
    along
}

#[allow(clippy::too_many_arguments)]
fn quadrant(
    taken: &[Taken],
    gaps: &[Gap],
    steady: &[bool],
    fit: &Fit,
    radius_mm: f64,
    at_rad: f64,
    window: (f64, f64),
    period_s: f64,
    angle_rad: f64,
    axis: usize,
    sign: f64,
    start_angle_rad: f64,
) -> Option<Quadrant> {
    let (from, to) = (at_rad - window.0, at_rad + window.1);
    // A window that leaves the arc holds something else than this reversal on this circle.
    if taken.first()?.along_rad > from || taken.last()?.along_rad < to {
        return None;
    }
    let begin = taken.partition_point(|taken| taken.along_rad < from);
    let end = taken.partition_point(|taken| taken.along_rad <= to);
    let inside = taken.get(begin..end).filter(|inside| !inside.is_empty())?;
    let before = taken.get(begin.saturating_sub(1))?;
    if has_gap(gaps, before, taken.get(end).or(taken.last())?) {
        return None;
    }
    let residual_um = |taken: &Taken| fit.residual_mm(taken.table_mm, radius_mm) * 1e3;
    let (mut highest, mut lowest) = ((0, f64::NEG_INFINITY), f64::INFINITY);
    for (index, taken) in inside.iter().enumerate() {
        let e = residual_um(taken);
        if e > highest.1 {
            highest = (index, e);
        }
        lowest = lowest.min(e);
    }
    let half_um = highest.1 / 2.0;
    let below = |taken: &Taken| residual_um(taken) < half_um;
    let (rising, falling) = inside.split_at_checked(highest.0)?;
    let start = rising.iter().rev().find(|taken| below(taken));
    let stop = falling.iter().find(|taken| below(taken));
    let width_half_height_ms = match (start, stop) {
        (Some(start), Some(stop)) if highest.1 > 0.0 => {
            Some((stop.time_scans - start.time_scans) * period_s * 1e3)
        }
        _ => None,
    };
    let peak = inside.get(highest.0)?;
    Some(Quadrant {
        axis,
        angle_rad,
        protrusion_um: highest.1,
        protrusion_angle_rad: start_angle_rad + sign * peak.along_rad,
        undercut_um: lowest,
        width_half_height_ms,
        steady: steady.get(begin..end)?.iter().all(|steady| *steady),
    })
}

/// Highest and lowest residual per angular bin, in order of travel.
fn curve(
    taken: &[Taken],
    steady: &[bool],
    run: &Run,
    sign: f64,
    table: &Fit,
    motor: &Fit,
) -> Vec<CurvePoint> {
    let radius_mm = run.circle.radius_mm;
    let bin_of = |taken: &Taken| libm::floor(taken.along_rad / TAU * BINS_PER_TURN) as i64;
    let most = TURNS_SHOWN * BINS_PER_TURN as usize * 2;
    let mut points: Vec<CurvePoint> = Vec::new();
    let mut measured = taken
        .iter()
        .zip(steady)
        .filter_map(|(taken, steady)| steady.then_some(taken))
        .peekable();
    while let Some(first) = measured.next() {
        let point = |taken: &Taken| CurvePoint {
            angle_rad: run.start_angle_rad + sign * taken.along_rad,
            table_um: table.residual_mm(taken.table_mm, radius_mm) * 1e3,
            motor_um: motor.residual_mm(taken.motor_mm, radius_mm) * 1e3,
        };
        let (mut low, mut high) = (point(first), point(first));
        while let Some(next) = measured.next_if(|next| bin_of(next) == bin_of(first)) {
            let next = point(next);
            if next.table_um < low.table_um {
                low = next;
            }
            if next.table_um > high.table_um {
                high = next;
            }
        }
        let (one, two) = if sign * low.angle_rad <= sign * high.angle_rad {
            (low, high)
        } else {
            (high, low)
        };
        points.push(one);
        if two != one {
            points.push(two);
        }
        if points.len() >= most {
            break;
        }
    }
    points
}

/// Whether the residuals were read from a fitted circle.
pub fn fitted(fit: &Fit) -> bool {
    fit.kind == FitKind::LeastSquares
}
