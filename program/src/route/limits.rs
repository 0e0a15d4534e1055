//! The travel of the axes: which of them shapes would lead out of it.

use super::{AxisVector, Cause, Shape, State};
use path::travel::Travel;

use crate::refusal::Refusal;
use crate::straight::TRAVEL_ROUNDING;

/// The places between which a motion keeps.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    from: AxisVector,
    low: AxisVector,
    high: AxisVector,
}

impl Bounds {
    /// The bounds of a straight line: its end is the place that counts.
    pub fn of_line(from: AxisVector, to: AxisVector) -> Self {
        let (low, high) = (to, to);
        Self { from, low, high }
    }

    /// The bounds of shapes. Those of an arc cost more than all the rest here: they are made once for all axes.
    pub fn of(shapes: &[Shape]) -> Vec<Self> {
        shapes.iter().map(Self::of_shape).collect()
    }

    /// The bounds of one.
    pub fn of_shape(shape: &Shape) -> Self {
        match shape {
            Shape::Line { from, to } => Self::of_line(*from, *to),
            other => {
                let (low, high) = other.bounds();
                let from = shape.start();
                Self { from, low, high }
            }
        }
    }
}

/// The axes that blocks were refused for.
#[derive(Debug, Clone, Default)]
pub struct Limits {
    /// A bit for each axis, as long as it is outside its travel.
    told: u32,
}

impl Limits {
    /// The axes that would leave their travel, and where. One that a block before was refused for and that this block does not name is
    /// not told again.
    pub fn outside(&mut self, state: &State, cause: Cause, ways: &[Bounds]) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        for (index, axis) in state.equipment().axes.iter().enumerate() {
            let bit = 1 << index;
            let was_told = self.told & bit != 0;
            let travel = Travel {
                min: axis.travel_min - TRAVEL_ROUNDING,
                max: axis.travel_max + TRAVEL_ROUNDING,
            };
            let mut outside = ways.iter().flat_map(|way| {
                let [from, low, high] =
                    [&way.from, &way.low, &way.high].map(|place| place.get(index).copied());
                // A block that was refused leaves an axis where it is not.
                let from = from.filter(|_| !was_told);
                let reach = from.map_or(travel, |from| travel.from_place(from));
                [low, high]
                    .into_iter()
                    .flatten()
                    .filter(move |place| !reach.holds(*place))
            });
            let Some(value) = outside.next() else {
                self.told &= !bit;
                continue;
            };
            if was_told && cause.words.value(axis.letter).is_none() {
                continue;
            }
            self.told |= bit;
            let unit = if axis.rotary { "degrees" } else { "mm" };
            let zero = state.offsets().zero().get(index).copied().unwrap_or(0.0);
            let mut found = format!("axis {} would reach {value:.4} {unit}", axis.letter);
            if zero != 0.0 && !state.controls_tool_centre() {
                let place = value - zero;
                found += &format!(" in machine coordinates ({place:.4} in the program's)");
            }
            let (low, high) = (axis.travel_min, axis.travel_max);
            let right = format!("the travel is {low} to {high} {unit}");
            let mut refusal = Refusal::new(cause.place(axis.letter), found, right);
            refusal.state_stays_known = true;
            refusals.push(refusal);
        }
        refusals
    }
}
