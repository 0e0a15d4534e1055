//! From places of the tool, in the coordinates of programs, to places of the axes, and back.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic
)]

use crate::path::{AxisVector, Element, MAX_AXES, Shape};
use crate::pivot::{OutOfReach, PivotY};

/// How the axes carry the tool.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Kinematics {
    /// Every axis of the machine is one of the program's: places of tool and axes are the same.
    #[default]
    Cartesian,
    /// An arm stands in for Y.
    PivotY(PivotY),
}

/// Highest rates of change along a piece of path with the distance on it, as magnitudes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisRates {
    /// First derivative of each component, per mm.
    pub first: [f64; MAX_AXES],
    /// Second derivative of each component, per mm².
    pub second: [f64; MAX_AXES],
}

impl AxisRates {
    /// Those of the tool all along an element.
    pub fn of(element: &Element) -> Self {
        let mut rates = Self {
            first: [0.0; MAX_AXES],
            second: [0.0; MAX_AXES],
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

impl Kinematics {
    /// Where the axes stand for a place of the tool.
    pub fn axes(&self, tool: &AxisVector) -> AxisVector {
        match self {
            Kinematics::Cartesian => *tool,
            Kinematics::PivotY(pivot) => pivot.axes(tool),
        }
    }

    /// Where the tool stands for a place of the axes.
    pub fn tool(&self, axes: &AxisVector) -> AxisVector {
        match self {
            Kinematics::Cartesian => *axes,
            Kinematics::PivotY(pivot) => pivot.tool(axes),
        }
    }

    /// Derivative of the axes along a path of the tool with the tangent `tangent` at `tool`.
    pub fn axes_tangent(&self, tool: &AxisVector, tangent: &AxisVector) -> AxisVector {
        match self {
            Kinematics::Cartesian => *tangent,
            Kinematics::PivotY(pivot) => pivot.axes_tangent(tool, tangent),
        }
    }

    /// Bounds of the axes' derivatives all along an element; none where they are those of the tool.
    pub fn axes_rates(&self, element: &Element) -> Option<AxisRates> {
        match self {
            Kinematics::Cartesian => None,
            Kinematics::PivotY(pivot) => Some(pivot.element_rates(element)),
        }
    }

    /// At most how far apart the axes stand, per axis, where the tool's places on or beside an element are `gap` apart.
    pub fn axes_gap(&self, element: &Element, gap: &AxisVector) -> AxisVector {
        match self {
            Kinematics::Cartesian => gap.abs(),
            Kinematics::PivotY(pivot) => {
                let mut of_tool = AxisRates {
                    first: [0.0; MAX_AXES],
                    second: [0.0; MAX_AXES],
                };
                for (first, component) in of_tool.first.iter_mut().zip(gap) {
                    *first = component.abs();
                }
                AxisVector::from(pivot.rates_on(element, &of_tool).first)
            }
        }
    }

    /// Whether the axes can reach every place of an element, their travel apart.
    pub fn check_reach(&self, element: &Element) -> Result<(), OutOfReach> {
        match self {
            Kinematics::Cartesian => Ok(()),
            Kinematics::PivotY(pivot) => pivot.check_reach(element),
        }
    }
}
