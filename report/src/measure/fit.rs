//! Least-squares circle: centre offset and radius error.

use nalgebra::{Matrix3, Vector3};

/// Smallest eigenvalue of the normal matrix (unit weights, mean over the points) with which centre and radius can be
/// told apart: a full circle has 0.5, a half circle 0.06.
const EIGENVALUE_MIN: f64 = 0.05;

/// What could be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitKind {
    /// Centre and radius by least squares.
    LeastSquares,
    /// The arc is too short to tell centre from radius: mean radial deviation only.
    RadiusOnly,
    /// Not enough points: the programmed circle stands.
    None,
}

impl FitKind {
    /// The word in reports.
    pub fn word(self) -> &'static str {
        match self {
            FitKind::LeastSquares => "least-squares",
            FitKind::RadiusOnly => "radius only",
            FitKind::None => "none",
        }
    }
}

/// A fitted circle, relative to the programmed one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// What could be fitted.
    pub kind: FitKind,
    /// Offset of the centre, in mm.
    pub centre_mm: [f64; 2],
    /// Radius minus programmed radius, in mm.
    pub radius_error_mm: f64,
    /// Root mean square of what remains at the points of the fit, in mm.
    pub residual_rms_mm: f64,
}

impl Fit {
    /// Fits points relative to the programmed centre: least Σ(|p − c| − R − δ)² by Gauss–Newton from the programmed
    /// circle, the second step of which already moves by less than offset³/R² (nothing, at µm).
    pub fn to_points(points: impl Iterator<Item = [f64; 2]> + Clone, radius_mm: f64) -> Fit {
        let mut fit = Fit {
            kind: FitKind::LeastSquares,
            centre_mm: [0.0; 2],
            radius_error_mm: 0.0,
            residual_rms_mm: 0.0,
        };
        for step in 0..4 {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            let mut count = 0.0;
            for [x, y] in points.clone() {
                let (x, y) = (x - fit.centre_mm[0], y - fit.centre_mm[1]);
                let r = (x * x + y * y).sqrt();
                if r > 0.0 {
                    let row = Vector3::new(x / r, y / r, 1.0);
                    normal += row * row.transpose();
                    right += row * (r - radius_mm - fit.radius_error_mm);
                    count += 1.0;
                }
            }
            if count < 30.0 {
                fit.kind = FitKind::None;
                return fit;
            }
            if step == 0 {
                let smallest = (normal / count).symmetric_eigenvalues().min();
                if smallest.is_nan() || smallest < EIGENVALUE_MIN {
                    fit.kind = FitKind::RadiusOnly;
                    fit.radius_error_mm = right[2] / count;
                    break;
                }
            }
            let Some(change) = normal.cholesky().map(|cholesky| cholesky.solve(&right)) else {
                break;
            };
            fit.centre_mm[0] += change[0];
            fit.centre_mm[1] += change[1];
            fit.radius_error_mm += change[2];
        }
        let (mut sum, mut count) = (0.0, 0.0);
        for point in points {
            let e = fit.residual_mm(point, radius_mm);
            sum += e * e;
            count += 1.0;
        }
        fit.residual_rms_mm = (sum / f64::max(count, 1.0)).sqrt();
        fit
    }

    /// Whether both centre and radius were fitted.
    pub fn is_whole(&self) -> bool {
        self.kind == FitKind::LeastSquares
    }

    /// Distance of a point from the fitted circle, outward positive, in mm.
    pub fn residual_mm(&self, [x, y]: [f64; 2], radius_mm: f64) -> f64 {
        let (x, y) = (x - self.centre_mm[0], y - self.centre_mm[1]);
        (x * x + y * y).sqrt() - radius_mm - self.radius_error_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn arc(from_deg: f64, to_deg: f64, radius_mm: f64, centre: [f64; 2]) -> Vec<[f64; 2]> {
        (0..=1000)
            .map(|i| {
                let a = (from_deg + (to_deg - from_deg) * f64::from(i) / 1000.0).to_radians();
                [
                    centre[0] + radius_mm * libm::cos(a),
                    centre[1] + radius_mm * libm::sin(a),
                ]
            })
            .collect()
    }

    proptest! {
        #[test]
        fn centre_and_radius_come_out_exactly(
            x in -0.1..0.1f64, y in -0.1..0.1f64, dr in -0.1..0.1f64, r in 5.0..100.0f64, from in 0.0..360.0f64,
        ) {
            let points = arc(from, from + 200.0, r + dr, [x, y]);
            let fit = Fit::to_points(points.iter().copied(), r);
            prop_assert_eq!(fit.kind, FitKind::LeastSquares);
            prop_assert!((fit.centre_mm[0] - x).abs() < 1e-9 && (fit.centre_mm[1] - y).abs() < 1e-9);
            prop_assert!((fit.radius_error_mm - dr).abs() < 1e-9 && fit.residual_rms_mm < 1e-9);
        }
    }

    #[test]
    fn a_short_arc_gives_its_mean_deviation_and_a_few_points_give_nothing() {
        let points = arc(0.0, 40.0, 10.005, [0.0; 2]);
        let fit = Fit::to_points(points.iter().copied(), 10.0);
        assert_eq!(fit.kind, FitKind::RadiusOnly);
        assert!((fit.radius_error_mm - 0.005).abs() < 1e-12);
        let fit = Fit::to_points(points.iter().take(10).copied(), 10.0);
        assert_eq!((fit.kind, fit.radius_error_mm), (FitKind::None, 0.0));
    }
}
