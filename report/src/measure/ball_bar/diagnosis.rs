//! Which part of a circle's deviation is explained by which cause: the marks of all causes ([`super::cause`]), fitted
//! together by least squares to the mean radial deviation of both directions, or of the one that there is.
//!
//! `e(θ, d) = Σ unknown · mark(θ, d) + rest`. A cause counts if what it does is above 0.05 µm and five times its standard
//! error; the others are left out and the fit is made again without them. Of the rest, *vibration* is what lies outside the
//! windows of reversals and is faster than 25 Hz: the scatter within a bin, and the distance of a bin from the mean of the
//! 40 ms (at least three bins) about it.
//!
//! *Effect*: from the lowest to the highest of what a cause does to the radius in both directions, the programmed circle
//! included. *Share*: its effect among the sum of all effects, the vibration's (2·√2·rms, as of a sine) and that of what
//! is left unexplained included.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, SQRT_2, TAU};

use nalgebra::{DMatrix, DVector};

use super::cause::{Cause, CauseKind, Mark, Setting, marks};
use super::profile::{BINS, Reading};

/// What is below this is nothing, in µm.
const EFFECT_MIN_UM: f64 = 0.05;
/// Standard errors that a cause must stand above.
const STANDARD_ERRORS: f64 = 5.0;
/// Added to the diagonal of the normal matrix of unit columns: marks that a part of a turn cannot tell apart stay small.
const RIDGE: f64 = 1e-9;
/// How often the way on which lost motion is taken up is set to what was found of it: the first time it is a step.
const WIDTH_STEPS: usize = 2;
/// What swings slower is no vibration, in s.
const SLOW_S: f64 = 0.040;
/// Shortest mean that a bin is held against, in bins to either side.
const SLOW_BINS_MIN: usize = 1;

/// One cause and what it does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// The cause.
    pub cause: Cause,
    /// Its size, in `unit`.
    pub value: f64,
    /// Unit of the size.
    pub unit: &'static str,
    /// Travel after which a cyclic error repeats, in mm; none of other causes.
    pub pitch_mm: Option<f64>,
    /// From the lowest to the highest of what it does to the radius, in µm.
    pub effect_um: f64,
    /// Share of the sum of all effects, in percent.
    pub share_percent: f64,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Diagnosis {
    /// The causes, the largest effect first.
    pub parts: Vec<Part>,
    /// Root mean square of the deviation about the fitted centre, in µm.
    pub deviation_rms_um: f64,
    /// Root mean square of what no cause explains, vibration included, in µm.
    pub rest_rms_um: f64,
}

/// The readings of one direction, +1 counter-clockwise, one for each bin of a turn.
pub type Direction<'a> = (f64, &'a [Option<Reading>]);

/// Finds the causes of the deviation of all directions together: both, or one. None where a fit is not possible.
pub fn diagnose(setting: &Setting, directions: &[Direction]) -> Option<Diagnosis> {
    let both_ways = directions.len() > 1;
    let mut columns = marks(setting, both_ways);
    for _ in 0..WIDTH_STEPS {
        columns = Fitted::of(setting, directions, columns)?.with_widths();
    }
    let mut fit = Fitted::of(setting, directions, columns)?;
    let kept: Vec<_> = fit.significant(setting, directions);
    fit = Fitted::of(setting, directions, kept)?;
    let mut parts: Vec<Part> = Vec::new();
    for (cause, columns) in fit.causes() {
        let effect_um = fit.range(setting, directions, &columns).effect_um();
        let (value, unit) = fit.value(setting, directions, cause, &columns);
        let pitch_mm = fit.pitch_mm(&columns);
        parts.push(Part {
            pitch_mm,
            ..part(cause, value, unit, effect_um)
        });
    }
    let rest = Rest::of(setting, directions, &fit);
    let (vibration_um, slow_um) = (rest.vibration_rms_um(), rest.slow_rms_um());
    let vibration = Cause::of(CauseKind::Vibration);
    let of_sine_um = 2.0 * SQRT_2 * vibration_um;
    parts.push(part(vibration, vibration_um, "µm rms", of_sine_um));
    let unexplained = Cause::of(CauseKind::Unexplained);
    parts.push(part(unexplained, slow_um, "µm rms", rest.slow.effect_um()));
    parts.retain(|part| part.effect_um >= EFFECT_MIN_UM);
    parts.sort_by(|a, b| {
        let by_effect = b.effect_um.total_cmp(&a.effect_um);
        by_effect.then(a.cause.cmp(&b.cause))
    });
    let sum_um: f64 = parts.iter().map(|part| part.effect_um).sum();
    for part in &mut parts {
        part.share_percent = 100.0 * part.effect_um / sum_um;
    }
    Some(Diagnosis {
        parts,
        deviation_rms_um: rest.deviation_rms_um(),
        rest_rms_um: libm::sqrt(vibration_um * vibration_um + slow_um * slow_um),
    })
}

fn part(cause: Cause, value: f64, unit: &'static str, effect_um: f64) -> Part {
    Part {
        cause,
        value,
        unit,
        pitch_mm: None,
        effect_um,
        share_percent: 0.0,
    }
}

/// All readings of all directions.
fn readings<'a>(directions: &'a [Direction<'a>]) -> impl Iterator<Item = (f64, &'a Reading)> {
    directions.iter().flat_map(|(direction, readings)| {
        let readings = readings.iter().flatten();
        readings.map(|reading| (*direction, reading))
    })
}

/// Lowest and highest, from 0.
#[derive(Debug, Clone, Copy, Default)]
struct Range {
    low_um: f64,
    high_um: f64,
}

impl Range {
    fn take(&mut self, value_um: f64) {
        self.low_um = self.low_um.min(value_um);
        self.high_um = self.high_um.max(value_um);
    }

    fn effect_um(&self) -> f64 {
        self.high_um - self.low_um
    }

    /// The one that is farther from nothing.
    fn extreme_um(&self) -> f64 {
        if self.high_um >= -self.low_um {
            self.high_um
        } else {
            self.low_um
        }
    }
}

/// Unknowns fitted by least squares.
struct Fitted {
    columns: Vec<(Option<Cause>, Mark)>,
    unknowns_um: DVector<f64>,
    /// Of the unknowns, in µm².
    covariance_um2: DMatrix<f64>,
}

impl Fitted {
    /// Normal equations of unit columns.
    fn of(
        setting: &Setting,
        directions: &[Direction],
        columns: Vec<(Option<Cause>, Mark)>,
    ) -> Option<Fitted> {
        let size = columns.len();
        let mut normal = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        let (mut squares_um2, mut count) = (0.0, 0.0);
        for (direction, reading) in readings(directions) {
            let row = row(setting, &columns, reading.angle_rad, direction);
            normal.ger(1.0, &row, &row, 1.0);
            right.axpy(reading.radial_um, &row, 1.0);
            squares_um2 += reading.radial_um * reading.radial_um;
            count += 1.0;
        }
        if count < 2.0 * size as f64 {
            return None;
        }
        // A mark of which nothing was measured stays nothing.
        let scale = normal.diagonal().map(|d| libm::sqrt(d).max(1e-6));
        let mut unit = normal.clone();
        for (at, value) in unit.iter_mut().enumerate() {
            let (row, column) = (at % size, at / size);
            let of = |index: usize| scale.get(index).copied().unwrap_or(1.0);
            *value /= of(row) * of(column);
            if row == column {
                *value += RIDGE;
            }
        }
        let cholesky = unit.cholesky()?;
        let unknowns_um = cholesky.solve(&right.component_div(&scale));
        let unknowns_um = unknowns_um.component_div(&scale);
        let left_um2 = squares_um2 - 2.0 * unknowns_um.dot(&right)
            + unknowns_um.dot(&(&normal * &unknowns_um));
        let variance_um2 = left_um2.max(0.0) / (count - size as f64);
        let inverse_scale = DMatrix::from_diagonal(&scale.map(|scale| 1.0 / scale));
        let covariance_um2 = &inverse_scale * cholesky.inverse() * &inverse_scale * variance_um2;
        Some(Fitted {
            columns,
            unknowns_um,
            covariance_um2,
        })
    }

    /// The columns, those of lost motion with the way on which what was found of it is taken up.
    fn with_widths(self) -> Vec<(Option<Cause>, Mark)> {
        let Fitted {
            columns,
            unknowns_um,
            ..
        } = self;
        let found_um = unknowns_um.iter();
        let columns = columns.into_iter().zip(found_um);
        let wide = columns.map(|((cause, mark), found_um)| match mark {
            Mark::LostMotion { axis, side, .. } => {
                let wide_mm = found_um.max(0.0) * 1e-3;
                let mark = Mark::LostMotion {
                    axis,
                    side,
                    wide_mm,
                };
                (cause, mark)
            }
            other => (cause, other),
        });
        wide.collect()
    }

    /// Columns of each cause.
    fn causes(&self) -> BTreeMap<Cause, Vec<usize>> {
        let mut causes: BTreeMap<Cause, Vec<usize>> = BTreeMap::new();
        for (index, (cause, _)) in self.columns.iter().enumerate() {
            if let Some(cause) = cause {
                causes.entry(*cause).or_default().push(index);
            }
        }
        causes
    }

    /// What some columns do at an angle, in µm.
    fn at_um(
        &self,
        setting: &Setting,
        columns: &[usize],
        (direction, angle_rad): (f64, f64),
    ) -> f64 {
        let of = |index: &usize| {
            let (_, mark) = self.columns.get(*index)?;
            let unknown_um = self.unknowns_um.get(*index)?;
            Some(unknown_um * mark.at(setting, angle_rad, direction))
        };
        columns.iter().filter_map(of).sum()
    }

    fn range(&self, setting: &Setting, directions: &[Direction], columns: &[usize]) -> Range {
        let mut range = Range::default();
        for (direction, reading) in readings(directions) {
            range.take(self.at_um(setting, columns, (direction, reading.angle_rad)));
        }
        range
    }

    /// The columns whose cause stands out, and those of the centre.
    fn significant(
        &self,
        setting: &Setting,
        directions: &[Direction],
    ) -> Vec<(Option<Cause>, Mark)> {
        let mut keeps: Vec<bool> = self.columns.iter().map(|(c, _)| c.is_none()).collect();
        for (_, columns) in self.causes() {
            let effect_um = self.range(setting, directions, &columns).effect_um();
            let stands_out = effect_um >= EFFECT_MIN_UM
                && readings(directions).any(|(direction, reading)| {
                    let place = (direction, reading.angle_rad);
                    let does_um = self.at_um(setting, &columns, place).abs();
                    // Most are far from their extreme: only those near it can stand out.
                    does_um > 0.4 * effect_um
                        && does_um
                            > STANDARD_ERRORS * self.standard_error_um(setting, &columns, place)
                });
            for index in columns {
                if let Some(keep) = keeps.get_mut(index) {
                    *keep = stands_out;
                }
            }
        }
        let kept = self.columns.iter().zip(keeps);
        kept.filter_map(|(column, keep)| keep.then_some(*column))
            .collect()
    }

    fn standard_error_um(
        &self,
        setting: &Setting,
        columns: &[usize],
        (direction, angle_rad): (f64, f64),
    ) -> f64 {
        let does = |index: &usize| {
            let mark = self.columns.get(*index);
            mark.map_or(0.0, |(_, mark)| mark.at(setting, angle_rad, direction))
        };
        let does: Vec<(usize, f64)> = columns.iter().map(|index| (*index, does(index))).collect();
        let mut variance_um2 = 0.0;
        for (one, of_one) in &does {
            for (other, of_other) in &does {
                let covariance = self.covariance_um2.get((*one, *other));
                variance_um2 += of_one * of_other * covariance.copied().unwrap_or(0.0);
            }
        }
        libm::sqrt(variance_um2.max(0.0))
    }

    /// Height of a spike as it was measured, without the other causes: where the fitted one has at least a third of its own,
    /// for no sum of bumps has the very tip.
    fn height_um(&self, setting: &Setting, directions: &[Direction], columns: &[usize]) -> f64 {
        let fitted_um = self.range(setting, directions, columns).extreme_um();
        let all: Vec<usize> = (0..self.columns.len()).collect();
        let mut height_um = fitted_um;
        for (direction, reading) in readings(directions) {
            let place = (direction, reading.angle_rad);
            let here_um = self.at_um(setting, columns, place);
            let measured_um = reading.radial_um - self.at_um(setting, &all, place) + here_um;
            let at_spike = here_um * fitted_um.signum() > fitted_um.abs() / 3.0;
            if at_spike && measured_um * fitted_um.signum() > height_um.abs() {
                height_um = measured_um;
            }
        }
        height_um
    }

    /// The size of a cause, in the unit that it is known by.
    fn value(
        &self,
        setting: &Setting,
        directions: &[Direction],
        cause: Cause,
        columns: &[usize],
    ) -> (f64, &'static str) {
        let unknowns = columns.iter().map(|index| self.unknowns_um.get(*index));
        let unknowns: Vec<f64> = unknowns.map(|um| um.copied().unwrap_or(0.0)).collect();
        let first_um = unknowns.first().copied().unwrap_or(0.0);
        let per_m = 2.0 * first_um / (setting.radius_mm * 1e-3);
        match cause.kind {
            CauseKind::Scaling | CauseKind::Squareness => (per_m, "µm/m"),
            CauseKind::ServoMismatch => {
                // R·ω·τ/2 in µm, R·ω in mm/s: τ in ms.
                let speed_mm_s = setting.radius_mm * setting.angular_speed_rad_s;
                (2.0 * first_um / speed_mm_s, "ms")
            }
            CauseKind::ReversalSpike => (self.height_um(setting, directions, columns), "µm"),
            CauseKind::Cyclic => (self.largest_wave_um(columns).0, "µm"),
            _ => (first_um, "µm"),
        }
    }

    /// Amplitude of the largest wave among the columns of a cyclic error, in µm, and its first column; sine and cosine of a
    /// wave follow each other.
    fn largest_wave_um(&self, columns: &[usize]) -> (f64, Option<usize>) {
        let of = |index: &usize| self.unknowns_um.get(*index).copied().unwrap_or(0.0);
        let waves = columns.chunks(2).map(|pair| {
            let square_um2: f64 = pair.iter().map(|index| of(index) * of(index)).sum();
            (libm::sqrt(square_um2), pair.first().copied())
        });
        waves.fold(
            (0.0, None),
            |most, wave| if wave.0 > most.0 { wave } else { most },
        )
    }

    /// Travel after which the largest wave among these columns repeats, in mm; none where they are of no cyclic error.
    fn pitch_mm(&self, columns: &[usize]) -> Option<f64> {
        let (_, first) = self.largest_wave_um(columns);
        match self.columns.get(first?)? {
            (_, Mark::Cyclic { wave, .. }) => Some(TAU / wave),
            _ => None,
        }
    }
}

fn row(
    setting: &Setting,
    columns: &[(Option<Cause>, Mark)],
    angle_rad: f64,
    direction: f64,
) -> DVector<f64> {
    let values = columns.iter();
    let values = values.map(|(_, mark)| mark.at(setting, angle_rad, direction));
    DVector::from_iterator(columns.len(), values)
}

/// What the causes leave.
#[derive(Debug, Default)]
struct Rest {
    fast_um2: f64,
    slow_um2: f64,
    deviation_um2: f64,
    count: f64,
    slow: Range,
}

impl Rest {
    fn of(setting: &Setting, directions: &[Direction], fit: &Fitted) -> Rest {
        let mut rest = Rest::default();
        let all: Vec<usize> = (0..fit.columns.len()).collect();
        let of_centre = fit.columns.iter().enumerate();
        let of_centre = of_centre.filter(|(_, (cause, _))| cause.is_none());
        let centre: Vec<usize> = of_centre.map(|(index, _)| index).collect();
        for (direction, readings) in directions {
            let left_um = |reading: &Reading| {
                reading.radial_um - fit.at_um(setting, &all, (*direction, reading.angle_rad))
            };
            let all_um: Vec<Option<f64>> = readings
                .iter()
                .map(|reading| reading.as_ref().map(left_um))
                .collect();
            for (index, reading) in readings.iter().enumerate() {
                let (Some(reading), Some(Some(left_um))) = (reading, all_um.get(index)) else {
                    continue;
                };
                let of_centre_um = fit.at_um(setting, &centre, (*direction, reading.angle_rad));
                let deviation_um = reading.radial_um - of_centre_um;
                rest.deviation_um2 += deviation_um * deviation_um + reading.scatter_um2;
                rest.count += 1.0;
                if near_reversal(setting, *direction, reading.angle_rad) {
                    rest.take(0.0, *left_um, reading.scatter_um2);
                } else {
                    let slow_um = mean_about(&all_um, index, slow_bins(setting));
                    let fast_um = left_um - slow_um;
                    rest.take(fast_um * fast_um + reading.scatter_um2, slow_um, 0.0);
                }
            }
        }
        rest
    }

    fn take(&mut self, fast_um2: f64, slow_um: f64, scatter_um2: f64) {
        self.fast_um2 += fast_um2;
        self.slow_um2 += slow_um * slow_um + scatter_um2;
        self.slow.take(slow_um);
    }

    fn rms(&self, sum_um2: f64) -> f64 {
        libm::sqrt(sum_um2 / self.count.max(1.0))
    }

    fn vibration_rms_um(&self) -> f64 {
        self.rms(self.fast_um2)
    }

    fn slow_rms_um(&self) -> f64 {
        self.rms(self.slow_um2)
    }

    fn deviation_rms_um(&self) -> f64 {
        self.rms(self.deviation_um2)
    }
}

/// Whether an angle lies in the window of a reversal.
fn near_reversal(setting: &Setting, direction: f64, angle_rad: f64) -> bool {
    let (before_rad, behind_rad) = setting.window_rad;
    let quarters = direction * angle_rad / FRAC_PI_2;
    let since_rad = (quarters - libm::floor(quarters)) * FRAC_PI_2;
    since_rad <= behind_rad || since_rad >= FRAC_PI_2 - before_rad
}

/// Bins to either side of one that its slow part is the mean of.
fn slow_bins(setting: &Setting) -> usize {
    let rad = setting.angular_speed_rad_s * SLOW_S;
    let bins = libm::round(rad / TAU * BINS as f64 / 2.0);
    (bins.clamp(0.0, BINS as f64 / 8.0) as usize).max(SLOW_BINS_MIN)
}

/// Mean of the bins about one, round the turn; of those that have a reading.
fn mean_about(left_um: &[Option<f64>], index: usize, bins: usize) -> f64 {
    let count = left_um.len();
    let first = index + count - bins.min(count);
    let about = (first..=first + 2 * bins).map(|at| left_um.get(at % count.max(1)));
    let (mut sum_um, mut known) = (0.0, 0.0);
    for um in about.flatten().flatten() {
        sum_um += um;
        known += 1.0;
    }
    sum_um / f64::max(known, 1.0)
}
