//! Iterative learning along the path of a program that is run again and again.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use core::ops::Range;

use crate::zero_phase::ZeroPhase;
use path::geometry::AxisVector;

/// Part of the error that one pass takes over, as long as passes get better.
pub const GAIN: f64 = 0.7;
/// Corner of the low pass on what is learned, in Hz. With 120 Hz more is left (as modelled, LuGre); with 200 Hz
/// soft screws and slow drives get worse again after some passes (docs/methods/path-learning.md).
pub const CORNER_HZ: f64 = 150.0;
/// Most that a command is corrected by, in mm.
pub const CORRECTION_MAX_MM: f64 = 0.05;
/// Towards a rest, a rapid or the path's ends a correction fades over this time, in s.
const FADE_S: f64 = 0.02;
/// What a thinned correction may be off by, in mm.
pub const THINNED_MM: f64 = 2e-5;
/// What its learned speed may be off by, as a part of it, and at least, in mm/s.
const THINNED_SPEED: f64 = 0.01;
const THINNED_SPEED_MM_S: f64 = 0.05;
/// Scans that one step of thinning joins at most.
const JOINED_MAX: usize = 64;
/// Largest lag of the tool behind its command that is believed, in s.
const LAG_MAX_S: f64 = 0.05;
/// What is looked at of a reversal: from so long before it to so long behind it, in s.
const REVERSAL_BEFORE_S: f64 = 0.01;
const REVERSAL_AFTER_S: f64 = 0.1;

/// One scan of a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct PassScan {
    /// Length of the path up to the setpoint, in mm.
    pub place_mm: f64,
    /// Whether the tool moves on an element with a feed.
    pub feeds: bool,
    /// Setpoint of every axis, in mm.
    pub command_mm: AxisVector,
    /// From where the tool was, by the scale, to the nearest place of the path: across the path, in mm.
    pub error_mm: AxisVector,
    /// How far the tool was behind the setpoint along the path, in mm.
    pub behind_mm: f64,
    /// What was added to the command, in mm.
    pub correction_mm: AxisVector,
}

/// What a pass left of error, by the scale, in µm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PassError {
    /// Largest distance from the path near a reversal of an axis, mean over the reversals; the root mean square of all where none is.
    pub mean_um: f64,
    /// Largest of them; of all where there is no reversal.
    pub worst_um: f64,
    /// Root mean square of the distance from the path.
    pub rms_um: f64,
}

/// One place of a correction of all axes.
#[derive(Debug, Clone, PartialEq)]
pub struct PathKnot {
    /// Length of the path up to here, in mm.
    pub place_mm: f64,
    /// Speed along the path, in mm/s.
    pub speed_mm_s: f64,
    /// What is added to the position command of each axis, in mm.
    pub correction_mm: AxisVector,
}

/// A pass of a program, scan by scan without a gap, and what it teaches for the next.
///
/// `u ← w·Q[w·(u + γ·n(t + T))]`: u the correction over time, n the error across the path by the scale, T the lag with which the tool
/// follows, Q a low pass without phase, w the fading at rests and rapids. As the setpoints of a program repeat to the bit, time is place.
/// Source: Bristow, Tharayil, Alleyne (2006), "A survey of iterative learning control", IEEE Control Systems Magazine 26(3), 96–114
/// (Q-filter and learning function; monotone where `‖Q(1 − γ·G)‖ < 1`); docs/methods/path-learning.md.
#[derive(Debug, Clone)]
pub struct Pass {
    scan_s: f64,
    axes: usize,
    scans: Vec<PassScan>,
}

impl Pass {
    /// Of so many axes, with these scans.
    pub fn new(scan_s: f64, axes: usize, scans: Vec<PassScan>) -> Pass {
        Pass {
            scan_s,
            axes,
            scans,
        }
    }

    /// Speed along the path from a scan to the next, in mm/s.
    fn speed_mm_s(&self, index: usize) -> f64 {
        let place_mm = |at: usize| self.scans.get(at).map(|scan| scan.place_mm);
        match (place_mm(index), place_mm(index + 1)) {
            (Some(here), Some(next)) => (next - here) / self.scan_s,
            _ => 0.0,
        }
    }

    /// Whether there is something to learn in this scan: a motion with a feed.
    fn counts(&self, index: usize) -> bool {
        let feeds = self.scans.get(index).is_some_and(|scan| scan.feeds);
        feeds && self.speed_mm_s(index) > 0.0
    }

    /// Weight of each scan: 1 where the tool feeds, fading to 0 where it does not.
    fn weights(&self) -> Vec<f64> {
        let fade_scans = (FADE_S / self.scan_s).max(1.0);
        let mut distance = vec![f64::INFINITY; self.scans.len()];
        let step = |far: &mut f64, index: usize, place: &mut f64| {
            *far = if self.counts(index) { *far + 1.0 } else { 0.0 };
            *place = far.min(*place);
        };
        // The first scan of the path is an end of it.
        let mut far = -1.0;
        for (index, place) in distance.iter_mut().enumerate() {
            step(&mut far, index, place);
        }
        far = -1.0;
        for (index, place) in distance.iter_mut().enumerate().rev() {
            step(&mut far, index, place);
        }
        let fade = |far: f64| {
            let part = (far / fade_scans).min(1.0);
            0.5 - 0.5 * libm::cos(core::f64::consts::PI * part)
        };
        distance.into_iter().map(fade).collect()
    }

    /// How long the tool follows its command, in s, by least squares over the whole pass.
    pub fn lag_s(&self) -> f64 {
        let (mut both, mut square) = (0.0, 0.0);
        for (index, scan) in self.scans.iter().enumerate() {
            if self.counts(index) && scan.behind_mm.is_finite() {
                let speed_mm_s = self.speed_mm_s(index);
                both += scan.behind_mm * speed_mm_s;
                square += speed_mm_s * speed_mm_s;
            }
        }
        if square > 0.0 {
            (both / square).clamp(-LAG_MAX_S, LAG_MAX_S)
        } else {
            0.0
        }
    }

    /// The correction after this pass, of which `gain` of the error is taken over.
    pub fn learned(&self, gain: f64, corner_hz: f64) -> Vec<PathKnot> {
        let weights = self.weights();
        let filter = ZeroPhase::new(corner_hz, self.scan_s);
        let lag_scans = self.lag_s() / self.scan_s;
        let mut corrections = vec![AxisVector::zeros(); self.scans.len()];
        for axis in 0..self.axes {
            let mut of_axis: Vec<f64> = self
                .scans
                .iter()
                .zip(&weights)
                .enumerate()
                .map(|(index, (scan, weight))| {
                    let error_mm = self.error_mm(axis, index as f64 + lag_scans);
                    let before_mm = scan.correction_mm.get(axis).copied().unwrap_or(0.0);
                    weight * (before_mm + gain * error_mm)
                })
                .collect();
            filter.filter(&mut of_axis);
            for ((to, value), weight) in corrections.iter_mut().zip(of_axis).zip(&weights) {
                if let Some(to) = to.get_mut(axis) {
                    let limited = (weight * value).clamp(-CORRECTION_MAX_MM, CORRECTION_MAX_MM);
                    *to = if limited.is_finite() { limited } else { 0.0 };
                }
            }
        }
        self.thinned(corrections)
    }

    /// Error across the path at a time, in scans; 0 where it is not known.
    fn error_mm(&self, axis: usize, at_scan: f64) -> f64 {
        let low = libm::floor(at_scan);
        let of = |index: f64| {
            let index = index as usize;
            let scan = self.scans.get(index).filter(|_| self.counts(index));
            let error_mm = scan.and_then(|scan| scan.error_mm.get(axis)).copied();
            error_mm.filter(|mm| mm.is_finite()).unwrap_or(0.0)
        };
        if low < 0.0 {
            return 0.0;
        }
        let (here, next) = (of(low), of(low + 1.0));
        here + (next - here) * (at_scan - low)
    }

    /// Knots of the correction over the place: only those without which it would be off.
    fn thinned(&self, corrections: Vec<AxisVector>) -> Vec<PathKnot> {
        let mut all: Vec<PathKnot> = Vec::new();
        for (index, (scan, correction_mm)) in self.scans.iter().zip(corrections).enumerate() {
            // Where the tool rests the place stands still: one knot of it is enough.
            if all.last().is_none_or(|last| scan.place_mm > last.place_mm) {
                all.push(PathKnot {
                    place_mm: scan.place_mm,
                    speed_mm_s: self.speed_mm_s(index),
                    correction_mm,
                });
            }
        }
        thinned(all)
    }

    /// What this pass left.
    pub fn error(&self) -> PassError {
        let size_um = self.sizes_um();
        let counted = (0..self.scans.len()).filter(|index| self.counts(*index));
        let count = counted.count().max(1) as f64;
        let rms_um = libm::sqrt(size_um.iter().map(|um| um * um).sum::<f64>() / count);
        let of_all = (rms_um, size_um.iter().copied().fold(0.0, f64::max));
        let (mean_um, worst_um) = self.peaks_um(&size_um, 0..self.axes).unwrap_or(of_all);
        PassError {
            mean_um,
            worst_um,
            rms_um,
        }
    }

    /// Largest distance from the path near a reversal of this axis, in µm: mean and worst over its reversals; none without any.
    pub fn error_of_axis_um(&self, axis: usize) -> Option<(f64, f64)> {
        self.peaks_um(&self.sizes_um(), axis..axis + 1)
    }

    /// Mean and worst of the largest of these near the reversals of some axes.
    fn peaks_um(&self, size_um: &[f64], axes: Range<usize>) -> Option<(f64, f64)> {
        let reversals = axes.flat_map(|axis| self.reversals(axis));
        let peaks_um: Vec<f64> = reversals
            .filter_map(|(from, to)| size_um.get(from..to))
            .map(|um| um.iter().copied().fold(0.0, f64::max))
            .collect();
        let count = peaks_um.len().max(1) as f64;
        let worst_um = peaks_um.iter().copied().reduce(f64::max)?;
        Some((peaks_um.iter().sum::<f64>() / count, worst_um))
    }

    /// Distance from the path in each scan, in µm; 0 where it does not count.
    fn sizes_um(&self) -> Vec<f64> {
        let of = |(index, scan): (usize, &PassScan)| {
            if self.counts(index) {
                scan.error_mm.norm() * 1e3
            } else {
                0.0
            }
        };
        self.scans.iter().enumerate().map(of).collect()
    }

    /// Scans around each reversal of this axis on an element with a feed.
    fn reversals(&self, axis: usize) -> Vec<(usize, usize)> {
        let scans_of = |time_s: f64| libm::round(time_s / self.scan_s) as usize;
        let mut found = Vec::new();
        let mut direction = 0.0;
        let mut last_mm: Option<f64> = None;
        for (index, scan) in self.scans.iter().enumerate() {
            let command_mm = scan.command_mm.get(axis).copied().unwrap_or(0.0);
            let step_mm = command_mm - last_mm.unwrap_or(command_mm);
            last_mm = Some(command_mm);
            if !self.counts(index) {
                // What turns round at a rest is no reversal on the path.
                direction = 0.0;
            } else if step_mm != 0.0 {
                if step_mm * direction < 0.0 {
                    let from = index.saturating_sub(scans_of(REVERSAL_BEFORE_S));
                    let to = index + scans_of(REVERSAL_AFTER_S);
                    found.push((from, to.min(self.scans.len())));
                }
                direction = step_mm.signum();
            }
        }
        found
    }
}

/// Leaves out every knot that lies on the line between its neighbours to within [`THINNED_MM`] and a hundredth of the speed.
pub fn thinned(all: Vec<PathKnot>) -> Vec<PathKnot> {
    let mut kept: Vec<PathKnot> = Vec::new();
    let mut from = 0;
    while let Some(knot) = all.get(from) {
        kept.push(knot.clone());
        let mut to = from + 1;
        while to + 1 < all.len() && to - from < JOINED_MAX && joins(&all, from, to + 1) {
            to += 1;
        }
        from = to;
    }
    kept
}

/// Whether all knots between these two lie on the line between them.
fn joins(all: &[PathKnot], from: usize, to: usize) -> bool {
    let (Some(first), Some(last)) = (all.get(from), all.get(to)) else {
        return false;
    };
    let between = all.get(from + 1..to).unwrap_or_default();
    between.iter().all(|knot| {
        let part = (knot.place_mm - first.place_mm) / (last.place_mm - first.place_mm);
        let correction_mm = first.correction_mm + (last.correction_mm - first.correction_mm) * part;
        let speed_mm_s = first.speed_mm_s + (last.speed_mm_s - first.speed_mm_s) * part;
        let bound_mm_s = (THINNED_SPEED * knot.speed_mm_s).max(THINNED_SPEED_MM_S);
        (correction_mm - knot.correction_mm).amax() <= THINNED_MM
            && (speed_mm_s - knot.speed_mm_s).abs() <= bound_mm_s
    })
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests;
