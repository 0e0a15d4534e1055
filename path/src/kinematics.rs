//! From places of the tool, in the coordinates of programs, to places of the axes, and back.
use crate::axis_rates::AxisRates;
use crate::geometry::{AxisVector, Element, PATH_AXES};
use crate::pivot::{OutOfReach, PivotY};

/// How the axes carry the tool.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Kinematics {
    /// Every axis of the machine is one of the program's: places of tool and axes are the same.
    #[default]
    Cartesian,
    /// An arm is in for Y.
    PivotY(PivotY),
}

impl Kinematics {
    /// Where the axes are for a place of the tool.
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

    /// At most how far apart the axes are, per axis, where the tool's places on or beside an element are `gap` apart.
    pub fn axes_gap(&self, element: &Element, gap: &AxisVector) -> AxisVector {
        match self {
            Kinematics::Cartesian => gap.abs(),
            Kinematics::PivotY(pivot) => {
                let mut of_tool = AxisRates {
                    first: [0.0; PATH_AXES],
                    second: [0.0; PATH_AXES],
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
