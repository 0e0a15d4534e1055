//! What is read from the samples of one run: the steady part, the fitted circles, the quadrants and the curve.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::plots::CurvesKept;
use super::result::{ArcResult, CurvePoint, Deviations, Quadrant};
use super::runs::Run;
use crate::measure::ball_bar::BallBarMeter;
use crate::measure::fit::Fit;
use crate::turns::window_rad;

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
/// Turns of a run that the curve shows.
const TURNS_SHOWN: usize = 8;

/// One sample of a run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taken {
    pub(super) time_scans: f64,
    pub(super) speed_mm_s: f64,
    /// Angle travelled by the table since the start of the programmed arc.
    pub(super) along_rad: f64,
    pub(super) table_mm: [f64; 2],
    pub(super) motor_mm: [f64; 2],
}

/// What was taken of one run.
#[derive(Debug, Default)]
pub(super) struct Series {
    pub(super) taken: Vec<Taken>,
    /// From the last sample before a gap to the first behind it, in scans.
    pub(super) gaps: Vec<(f64, f64)>,
    pub(super) missing_scans: u64,
}

impl Series {
    /// Whether scans are missing somewhere between two samples.
    fn has_gap(&self, from: &Taken, to: &Taken) -> bool {
        let first = self.gaps.partition_point(|gap| gap.1 <= from.time_scans);
        let gap = self.gaps.get(first);
        gap.is_some_and(|gap| gap.0 < to.time_scans)
    }

    /// Angle over which steady samples follow each other, in rad.
    fn measured_rad(&self, steady: &[bool]) -> f64 {
        let pairs = self.taken.windows(2).zip(steady.windows(2));
        pairs
            .filter(|(_, steady)| steady.iter().all(|s| *s))
            .filter_map(|(pair, _)| pair.first().zip(pair.last()))
            .filter(|(one, two)| !self.has_gap(one, two))
            .map(|(one, two)| two.along_rad - one.along_rad)
            .sum()
    }

    /// Which samples were taken in steady motion.
    fn steady(&self, speed_mm_s: f64, angular_speed_rad_s: f64, period_s: f64) -> Vec<bool> {
        let settle_scans = SETTLE_S.min(SETTLE_RAD / angular_speed_rad_s) / period_s;
        let mut since: Option<f64> = None;
        let mut before: Option<&Taken> = None;
        let steady = self.taken.iter().map(|taken| {
            let before = before.replace(taken);
            // Speed within a gap is unknown: settling begins again behind it.
            if before.is_some_and(|before| self.has_gap(before, taken)) {
                since = None;
            }
            if taken.speed_mm_s < STEADY_SHARE * speed_mm_s {
                since = None;
                return false;
            }
            taken.time_scans - *since.get_or_insert(taken.time_scans) >= settle_scans
        });
        let steady: Vec<bool> = steady.collect();
        // An arc that ends before it settles is measured whole: with the swing of its run-in rather than not at all.
        if self.measured_rad(&steady) < STEADY_RAD_MIN {
            return vec![true; self.taken.len()];
        }
        steady
    }
}

/// What is kept of the samples of all runs, whatever their number.
#[derive(Debug, Default)]
pub(super) struct Keeps {
    pub(super) curves: CurvesKept,
    pub(super) ball_bars: BallBarMeter,
}

/// Measures one run; none if nothing was taken of it.
pub(super) fn measure(
    run: &Run,
    series: &Series,
    period_s: f64,
    keeps: &mut Keeps,
) -> Option<ArcResult> {
    let (first, last) = (series.taken.first()?, series.taken.last()?);
    let taken = series.taken.iter();
    let speed_mm_s = taken.fold(0.0, |most: f64, t| most.max(t.speed_mm_s));
    let angular_speed_rad_s = speed_mm_s / run.circle.radius_mm;
    let judged = Judged {
        run,
        series,
        steady: series.steady(speed_mm_s, angular_speed_rad_s, period_s),
        window_rad: window_rad(angular_speed_rad_s),
        sign: if run.circle.clockwise { -1.0 } else { 1.0 },
        period_s,
    };
    let quadrants_along = judged.quadrants_along(first, last);
    // The bumps stay out of the fit: they would pull the circle outwards and hide a part of their own height.
    let of_fit = judged.outside_windows(&quadrants_along);
    let table = judged.deviations(&of_fit, |taken| taken.table_mm);
    let motor = judged.deviations(&of_fit, |taken| taken.motor_mm);
    let quadrants = quadrants_along.iter();
    let quadrants = quadrants.filter_map(|&(at_rad, axis)| {
        judged.quadrant(&table.fit, at_rad, *run.circle.plane.get(axis)?)
    });
    let mut result = ArcResult {
        line: run.line,
        elements: run.elements,
        scans: (first.time_scans, last.time_scans),
        turns: run.sweep_rad / TAU,
        measured_deg: series.measured_rad(&judged.steady).to_degrees(),
        missing_scans: series.missing_scans,
        speed_mm_s,
        table,
        motor,
        quadrants: quadrants.collect(),
        curve: Vec::new(),
        start_angle_rad: run.start_angle_rad,
        circle: run.circle.clone(),
    };
    if keeps.curves.keep(&result) {
        result.curve = judged.curve(&table.fit, &motor.fit);
    }
    let steady = judged.steady_samples().map(|taken| taken.table_mm);
    keeps.ball_bars.take(&result, steady);
    Some(result)
}

fn widen(range: &mut (f64, f64), value: f64) {
    range.0 = range.0.max(value);
    range.1 = range.1.min(value);
}

/// A run whose samples have been judged for steady motion.
struct Judged<'a> {
    run: &'a Run,
    series: &'a Series,
    steady: Vec<bool>,
    window_rad: (f64, f64),
    /// −1 if it is travelled clockwise.
    sign: f64,
    period_s: f64,
}

impl Judged<'_> {
    /// Where axes reverse and the samples touch the window: (angle along the run, 0 or 1 for the axis of the plane).
    fn quadrants_along(&self, first: &Taken, last: &Taken) -> Vec<(f64, usize)> {
        let low_rad = first.along_rad - self.window_rad.1;
        let high_rad = last.along_rad + self.window_rad.0;
        // Where the axes are not those of the plane, kinematics has told their reversals; else one comes each quarter turn.
        let Some(of_a_turn) = &self.run.reversals else {
            let offset_rad = self.sign * self.run.start_angle_rad;
            let low = libm::ceil((low_rad + offset_rad) / FRAC_PI_2) as i64;
            let high = libm::floor((high_rad + offset_rad) / FRAC_PI_2) as i64;
            // A run has far fewer quadrants than this; it bounds what a damaged log can ask for.
            return (low..=high.min(low.saturating_add(100_000)))
                .map(|k| (k as f64 * FRAC_PI_2 - offset_rad, k.rem_euclid(2) as usize))
                .collect();
        };
        let turns = libm::ceil(((high_rad - low_rad) / TAU).clamp(0.0, 25_000.0)) as u32 + 1;
        let mut along: Vec<(f64, usize)> = Vec::new();
        for (angle_rad, axis) in of_a_turn {
            let at_rad = self.sign * (angle_rad - self.run.start_angle_rad);
            let first_rad = at_rad + TAU * libm::ceil((low_rad - at_rad) / TAU);
            let of_turns = (0..turns).map(|turn| (first_rad + f64::from(turn) * TAU, *axis));
            along.extend(of_turns.take_while(|(at_rad, _)| *at_rad <= high_rad));
        }
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        along
    }

    /// Which samples a circle is fitted to: steady and in no window of these quadrants.
    fn outside_windows(&self, quadrants_along: &[(f64, usize)]) -> Vec<bool> {
        let (before, after) = self.window_rad;
        let in_window = |along_rad: f64| {
            // They are in rising order: only the first whose window has not ended before can hold it.
            let first = quadrants_along.partition_point(|(at, _)| at + after < along_rad);
            let at = quadrants_along.get(first);
            at.is_some_and(|(at, _)| along_rad >= at - before)
        };
        let taken = self.series.taken.iter().zip(&self.steady);
        taken
            .map(|(taken, steady)| *steady && !in_window(taken.along_rad))
            .collect()
    }

    /// Samples of the steady part.
    fn steady_samples(&self) -> impl Iterator<Item = &Taken> + Clone {
        let taken = self.series.taken.iter().zip(&self.steady);
        taken.filter_map(|(taken, steady)| steady.then_some(taken))
    }

    fn deviations(&self, of_fit: &[bool], of: fn(&Taken) -> [f64; 2]) -> Deviations {
        let radius_mm = self.run.circle.radius_mm;
        let points = self.series.taken.iter().zip(of_fit);
        let points = points.filter(|(_, used)| **used);
        let points = points.map(|(taken, _)| of(taken));
        let fit = Fit::to_points(points, radius_mm);
        let none = (f64::NEG_INFINITY, f64::INFINITY);
        let (mut residual, mut programmed) = (none, none);
        // The range is that of all steady samples: the bumps that the fit leaves out are what it is to show.
        for taken in self.steady_samples() {
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
    }

    /// What remained at one quadrant about the fitted circle; none if its window is not wholly measured.
    fn quadrant(&self, fit: &Fit, at_rad: f64, axis: usize) -> Option<Quadrant> {
        let taken = self.series.taken.as_slice();
        let (from, to) = (at_rad - self.window_rad.0, at_rad + self.window_rad.1);
        // A window that leaves the arc holds something else than this reversal on this circle.
        if taken.first()?.along_rad > from || taken.last()?.along_rad < to {
            return None;
        }
        let begin = taken.partition_point(|taken| taken.along_rad < from);
        let end = taken.partition_point(|taken| taken.along_rad <= to);
        let inside = taken.get(begin..end).filter(|inside| !inside.is_empty())?;
        let before = taken.get(begin.saturating_sub(1))?;
        let behind = taken.get(end).or(taken.last())?;
        if self.series.has_gap(before, behind) {
            return None;
        }
        let radius_mm = self.run.circle.radius_mm;
        let residual_um = |taken: &Taken| fit.residual_mm(taken.table_mm, radius_mm) * 1e3;
        let (mut highest, mut lowest) = ((0, f64::NEG_INFINITY), f64::INFINITY);
        for (index, taken) in inside.iter().enumerate() {
            let e = residual_um(taken);
            if e > highest.1 {
                highest = (index, e);
            }
            lowest = lowest.min(e);
        }
        // The walk to half height goes outwards from the peak: another bump in the window does not widen this one.
        let half_um = highest.1 / 2.0;
        let below = |taken: &Taken| residual_um(taken) < half_um;
        let (rising, falling) = inside.split_at_checked(highest.0)?;
        let start = rising.iter().rev().find(|taken| below(taken));
        let stop = falling.iter().find(|taken| below(taken));
        let width_half_height_ms = match (start, stop) {
            (Some(start), Some(stop)) if highest.1 > 0.0 => {
                Some((stop.time_scans - start.time_scans) * self.period_s * 1e3)
            }
            _ => None,
        };
        let (start_rad, peak) = (self.run.start_angle_rad, inside.get(highest.0)?);
        Some(Quadrant {
            axis,
            angle_rad: start_rad + self.sign * at_rad,
            protrusion_um: highest.1,
            protrusion_angle_rad: start_rad + self.sign * peak.along_rad,
            undercut_um: lowest,
            width_half_height_ms,
            steady: self.steady.get(begin..end)?.iter().all(|steady| *steady),
        })
    }

    /// Highest and lowest residual per angular bin, in order of travel.
    fn curve(&self, table: &Fit, motor: &Fit) -> Vec<CurvePoint> {
        let (radius_mm, sign) = (self.run.circle.radius_mm, self.sign);
        let bin_of = |taken: &Taken| libm::floor(taken.along_rad / TAU * BINS_PER_TURN) as i64;
        let most = TURNS_SHOWN * BINS_PER_TURN as usize * 2;
        let mut points: Vec<CurvePoint> = Vec::new();
        let mut measured = self.steady_samples().peekable();
        // A bin shows its two extremes, in order of travel: a mean would cut the bumps that the plot is for.
        while let Some(first) = measured.next() {
            let point = |taken: &Taken| CurvePoint {
                angle_rad: self.run.start_angle_rad + sign * taken.along_rad,
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
}
