//! Points of chords are evened out.
//!
//! Points of a curve that a CAM system writes with few decimals, or that were measured, lie beside it at random. Chords of 0.05 mm whose ends
//! are 1 µm off turn by 50 mrad at each, which no axis follows at speed. So each point between chords moves to the place where a parabola
//! through its neighbours passes it: local regression with tricube weights (Cleveland, J. Am. Stat. Assoc. 74, 1979; for points at
//! equal distances Savitzky, Golay, Anal. Chem. 36, 1964). Points of a smooth curve hardly move, ends of longer lines, of arcs and at corners
//! not at all, and no point moves further than [`SHARE`] of its tolerance; what it takes of that is missing to the rounding.

use nalgebra::SVector;

use crate::geometry::{AxisVector, first_axes};

use super::{Junction, RoundingSettings, of_all};

/// Of its tolerance, how far a point moves at most.
const SHARE: f64 = 0.3;
/// Points to either side that a parabola is laid through, at most; the last has no weight.
pub(super) const FITTED: usize = 9;
/// Fewest to either side with which a parabola is not just through all of its points.
const FITTED_MIN: usize = 3;
/// Turn over a parabola times its half span `B`, in tolerances `P`, at most: for a circle `B²/R ≤ 36·P`, three times what rounding spans. There it
/// is `0.02·B⁴/R³` off.
const SPAN_TURN: f64 = 72.0;

/// How far the point at a junction moves, and the size of that over what it may deviate.
pub(super) fn move_point<const AXES: usize>(
    junctions: &[Junction],
    index: usize,
    settings: &RoundingSettings,
) -> (AxisVector, f64) {
    let here = junctions.get(index).filter(|of| of.is_between_chords);
    let moved = here.and_then(|here| moved::<AXES>(junctions, (index, here), settings));
    match (here, moved) {
        (Some(here), Some(moved)) => (moved, here.size(&moved, settings)),
        _ => (AxisVector::zeros(), 0.0),
    }
}

/// The slope that the moves of its ends give to the line between two junctions.
pub(super) fn slope<const AXES: usize>(before: &Junction, behind: &Junction) -> SVector<f64, AXES> {
    let length_mm = behind.at_mm - before.at_mm;
    if length_mm > 0.0 {
        (first_axes(&behind.moved) - first_axes(&before.moved)) / length_mm
    } else {
        SVector::zeros()
    }
}

/// How far the point at a junction moves.
fn moved<const AXES: usize>(
    junctions: &[Junction],
    (index, here): (usize, &Junction),
    settings: &RoundingSettings,
) -> Option<AxisVector> {
    let mut turn: SVector<f64, AXES> = first_axes(&here.programmed_kink);
    let mut fitted = None;
    for away in 1..=FITTED {
        let before = junctions.get(index.checked_sub(away)?);
        let (Some(before), Some(behind)) = (before, junctions.get(index + away)) else {
            break;
        };
        let span_mm = (here.at_mm - before.at_mm).min(behind.at_mm - here.at_mm);
        if norm(&turn) * span_mm > SPAN_TURN * here.tolerance_mm {
            break;
        }
        fitted = Some((away, span_mm));
        if !(before.is_between_chords && behind.is_between_chords) {
            break;
        }
        turn += first_axes::<AXES>(&before.programmed_kink) + first_axes(&behind.programmed_kink);
    }
    let (away, span_mm) = fitted.filter(|(away, _)| *away >= FITTED_MIN)?;
    let near = junctions.get(index - away..=index + away)?;
    let moved = of_all(&parabola::<AXES>(near, here, span_mm)?);
    let size = here.size(&moved, settings);
    Some(moved * (SHARE / size).min(1.0))
}

/// From a point to the parabola through those near it.
fn parabola<const AXES: usize>(
    near: &[Junction],
    here: &Junction,
    span_mm: f64,
) -> Option<SVector<f64, AXES>> {
    let from: SVector<f64, AXES> = first_axes(&here.point);
    let share = |of: &Junction| (of.at_mm - here.at_mm) / span_mm;
    let weight = |u: f64| {
        let v = 1.0 - u.abs() * u * u;
        if v > 0.0 { v * v * v } else { 0.0 }
    };
    let mut moments = [0.0; 5];
    let mut sums = [SVector::<f64, AXES>::zeros(); 3];
    for of in near {
        let u = share(of);
        let mut power = weight(u);
        let away = first_axes(&of.point) - from;
        for (moment, sum) in moments.iter_mut().zip(&mut sums) {
            *moment += power;
            *sum += away * power;
            power *= u;
        }
        let [.., third, fourth] = &mut moments;
        *third += power;
        *fourth += power * u;
    }
    let [m0, m1, m2, m3, m4] = moments;
    let [c0, c1, c2] = [m2 * m4 - m3 * m3, m2 * m3 - m1 * m4, m1 * m3 - m2 * m2];
    let determinant = m0 * c0 + m1 * c1 + m2 * c2;
    let [s0, s1, s2] = sums;
    (determinant > SINGULAR).then(|| (s0 * c0 + s1 * c1 + s2 * c2) / determinant)
}

/// Determinant of the moments below which points do not tell a parabola.
const SINGULAR: f64 = 1e-3;

/// Length of a vector, added up as that of all axes is: so it does not depend on how many of them are looked at.
fn norm<const AXES: usize>(vector: &SVector<f64, AXES>) -> f64 {
    if AXES > 4 {
        return vector.norm();
    }
    let squares = vector.iter().map(|component| component * component);
    squares.sum::<f64>().sqrt()
}
