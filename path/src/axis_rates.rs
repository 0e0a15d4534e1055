//! How fast the axes change with the distance on a piece of path.
use crate::geometry::{AxisVector, Element, PATH_AXES, Shape};

/// Highest rates of change along a piece of path with the distance on it, as magnitudes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisRates {
    /// First derivative of each component, per mm.
    pub first: [f64; PATH_AXES],
    /// Second derivative of each component, per mm².
    pub second: [f64; PATH_AXES],
}

impl AxisRates {
    /// Those of the tool all along an element.
    pub fn of(element: &Element) -> Self {
        let mut rates = Self {
            first: [0.0; PATH_AXES],
            second: [0.0; PATH_AXES],
        };
        let straight = element.tangent(0.0);
        let of_axes = rates.first.iter_mut().zip(&mut rates.second);
        for (axis, (first, second)) in of_axes.enumerate() {
            *first = straight.get(axis).copied().unwrap_or(0.0).abs();
            if let Shape::Arc {
                radius_mm,
                u,
                v,
                sweep_rad,
                axial,
                ..
            } = &element.shape
                && element.length_mm > 0.0
            {
                let of = |vector: &AxisVector| vector.get(axis).copied().unwrap_or(0.0);
                let amplitude = libm::hypot(of(u), of(v));
                let around = (radius_mm * sweep_rad / element.length_mm).abs();
                *first = amplitude * around + of(axial).abs() / element.length_mm;
                *second = amplitude * element.curvature_magnitude_per_mm();
            }
        }
        rates
    }
}
