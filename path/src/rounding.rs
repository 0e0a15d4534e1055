//! Rounding: a path of lines and arcs becomes one of continuous curvature, within a tolerance (G64 P Q).
//!
//! A path is `q(s)` over its own length `s`. At the junction `i` of two elements, at `s_i`, its tangent jumps by `Δt_i` (a kink) and its
//! curvature by `Δκ_i` (a bend). The rounded path adds a correction of compact support at each of them,
//!
//! ```text
//! q̄(s) = q(s) + Σ Δt_i·b(s − s_i; h_i) + Σ Δκ_i·c(s − s_i; h_i)        b(d; h) = (h − |d|)³ / 6h²  for |d| < h
//! ```
//!
//! whose first (second) derivative jumps by −1 at d = 0, so that what jumped is continuous. `b` is what the average of a kink under a tent
//! of half width `h` adds to it (the linear B-spline as a filter, as in Tajima, Sencer, Shamoto, Precision Engineering 52, 2018); corners alone become
//! curves of continuous curvature as in Sencer, Ishizaki, Shamoto, Int. J. Adv. Manuf. Technol. 76, 2015, and overlapping corrections of short chords add up
//! to the average over the chords, so that one mechanism serves both. Each term is a cubic in `s` for every axis: any number
//! of axes takes part, straight parts away from junctions stay to the bit, and the end points of rapids and of the program are exact.
//!
//! `s` stays the length of the programmed path: the same place has the same (element, distance) with and without rounding.
//!
//! **Deviation.** At the same `s` the two paths are `Σ|Δt_i|·b` and `Σ|Δκ_i|·|c|` apart at most, and thus nowhere further from each other,
//! either way. `b` is greatest at its junction, `h/6`; a sum of them has its maxima at junctions, since each falls in a
//! convex curve to both sides; `|c|` is below `h²/120`. The half widths `h_i` are the largest for which that sum keeps the tolerance
//! (`half_widths`).
//!
//! What is made of an element depends on elements within `REACH_ELEMENTS` alone.
mod correction;
mod evening;
mod half_widths;
mod junctions;
#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests;

use nalgebra::SVector;

use crate::geometry::{AxisVector, Element, Feed, PATH_AXES, RotaryAxes, Shape};

pub(crate) use half_widths::NEIGHBOURS;
pub(crate) use junctions::Junctions;

/// Elements to either side that have a part in what is made of one.
pub(crate) const REACH_ELEMENTS: u32 = 256;
const _: () =
    assert!(REACH_ELEMENTS as usize > half_widths::REACH_JUNCTIONS + NEIGHBOURS + evening::FITTED);

/// Kinks below this are rounding of coordinates: no junctions.
const NEGLIGIBLE_KINK: f64 = 1e-9;
/// Bends below this, in 1/mm, are none.
const NEGLIGIBLE_BEND_PER_MM: f64 = 1e-9;

/// Lines of up to so many tolerances stand for a curve.
const CHORD_OVER_TOLERANCE_MAX: f64 = 100.0;

/// What rounding needs to know of a machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoundingSettings {
    /// Kinks of a larger angle are corners, which keep the first tolerance; smaller ones are those of chords, which keep the second. In rad.
    pub corner_angle_rad: f64,
    /// How far rotary axes may be from the programmed place, in degrees.
    pub rotary_tolerance_deg: f64,
    /// Which axes are.
    pub rotary: RotaryAxes,
}

impl Default for RoundingSettings {
    /// Corners from 30°; 0.05° for rotary axes, of which there are none.
    fn default() -> Self {
        Self {
            corner_angle_rad: std::f64::consts::FRAC_PI_6,
            rotary_tolerance_deg: 0.05,
            rotary: [false; PATH_AXES],
        }
    }
}

/// Where two elements meet, or the path begins or ends.
#[derive(Debug, Clone, PartialEq)]
struct Junction {
    /// Length of the path before it, in mm.
    at_mm: f64,
    /// Where it is programmed.
    point: AxisVector,
    /// How far it is moved (`evening`).
    moved: AxisVector,
    /// The size of that over what it may deviate.
    taken: f64,
    /// How far it may deviate, in mm.
    tolerance_mm: f64,
    /// How far rotary axes may deviate, in degrees.
    rotary_deg: f64,
    /// Two short lines meet there that stand for a curve.
    is_between_chords: bool,
    /// Jump of the tangent as it is programmed.
    programmed_kink: AxisVector,
    /// Jump of the tangent between points that are evened out.
    kink: AxisVector,
    /// Jump of the curvature, in 1/mm.
    bend_per_mm: AxisVector,
    /// Size of the kink over what it may deviate, in 1/mm.
    kink_weight_per_mm: f64,
    /// Size of the bend over what it may deviate, in 1/mm².
    bend_weight_per_mm2: f64,
    /// The path goes exactly through it, and no correction reaches beyond it.
    is_exact: bool,
}

impl Junction {
    fn exact(at_mm: f64) -> Self {
        Self {
            at_mm,
            point: AxisVector::zeros(),
            moved: AxisVector::zeros(),
            taken: 0.0,
            tolerance_mm: 0.0,
            rotary_deg: 0.0,
            is_between_chords: false,
            programmed_kink: AxisVector::zeros(),
            kink: AxisVector::zeros(),
            bend_per_mm: AxisVector::zeros(),
            kink_weight_per_mm: 0.0,
            bend_weight_per_mm2: 0.0,
            is_exact: true,
        }
    }

    /// Between two elements; `before` ends at `at_mm`.
    fn between(before: &Element, after: &Element, at_mm: f64, settings: &RoundingSettings) -> Self {
        let mut junction = Self::exact(at_mm);
        junction.point = after.start();
        let stops = |element: &Element| element.is_dwell() || element.length_mm <= 0.0;
        if stops(before) || stops(after) || after.rests_before {
            return junction;
        }
        if before.feed == Feed::Rapid || after.feed == Feed::Rapid {
            return junction;
        }
        let corner_mm = before.tolerance.corner_mm.min(after.tolerance.corner_mm);
        let chord_mm = before.tolerance.chord_mm.min(after.tolerance.chord_mm);
        if corner_mm <= 0.0 {
            return junction;
        }
        junction.is_exact = false;
        let (incoming, outgoing) = (
            before.shape.tangent(before.length_mm, before.length_mm),
            after.shape.tangent(0.0, after.length_mm),
        );
        let kink = outgoing - incoming;
        let bend_per_mm = after.shape.curvature_per_mm(0.0, after.length_mm)
            - before
                .shape
                .curvature_per_mm(before.length_mm, before.length_mm);
        // |Δt| of unit vectors is twice the sine of half the angle between them.
        let is_corner = kink.norm() > 2.0 * libm::sin(0.5 * settings.corner_angle_rad);
        junction.tolerance_mm = if is_corner || chord_mm <= 0.0 {
            corner_mm
        } else {
            chord_mm.min(corner_mm)
        };
        let of_both = [before, after].map(|element| element.tolerance.rotary_deg);
        let own_deg = of_both.into_iter().filter(|degrees| *degrees > 0.0);
        junction.rotary_deg = own_deg.fold(settings.rotary_tolerance_deg, f64::min);
        let is_chord = |element: &Element| {
            matches!(element.shape, Shape::Line { .. })
                && element.length_mm <= CHORD_OVER_TOLERANCE_MAX * junction.tolerance_mm
        };
        junction.is_between_chords = !is_corner && is_chord(before) && is_chord(after);
        junction.programmed_kink = kink;
        junction.bend_per_mm = bend_per_mm;
        junction
    }

    /// Takes the size of its jumps, or drops them.
    fn weigh(&mut self, settings: &RoundingSettings) {
        if self.is_exact {
            return;
        }
        if self.kink.norm() > NEGLIGIBLE_KINK {
            self.kink_weight_per_mm = self.size(&self.kink, settings);
        }
        if self.bend_per_mm.norm() > NEGLIGIBLE_BEND_PER_MM {
            self.bend_weight_per_mm2 =
                self.size(&self.bend_per_mm, settings) / correction::BEND_SHARE;
        }
    }

    /// Size of a vector over what slides and rotary axes may deviate.
    fn size(&self, vector: &AxisVector, settings: &RoundingSettings) -> f64 {
        let [mut linear, mut rotary] = [0.0, 0.0];
        for (component, is_rotary) in vector.iter().zip(&settings.rotary) {
            let squares = if *is_rotary { &mut rotary } else { &mut linear };
            *squares += component * component;
        }
        (linear.sqrt() / self.tolerance_mm).max(rotary.sqrt() / self.rotary_deg)
    }
}

/// Whether a path may leave an element for a rounded one.
pub(crate) fn is_rounded(element: &Element) -> bool {
    element.tolerance.corner_mm > 0.0 && element.feed != Feed::Rapid
}

/// A vector of all axes, where the others have nothing.
fn of_all<const AXES: usize>(vector: &SVector<f64, AXES>) -> AxisVector {
    let mut all = AxisVector::zeros();
    all.fixed_rows_mut::<AXES>(0).copy_from(vector);
    all
}
