//! Motion while the tool's centre point is controlled: its shapes are those of the tip, its elements those of the axes.

use path::geometry::{Feed, Shape};

use super::limits::Bounds;
use super::{Cause, Route, State};
use crate::refusal::{Done, Refusal, if_none};

impl Route {
    /// Goes along shapes of the tip; refuses those that lead an axis out of its travel.
    pub(super) fn go_by_axes(
        &mut self,
        state: &mut State,
        cause: Cause,
        shapes: &[Shape],
        feed: Feed,
    ) -> Done {
        let bounds = self.add_by_axes(state, cause, shapes, feed)?;
        let outside = self.limits.outside(state, cause, &bounds);
        self.output.check_room(0.0, cause.offset)?;
        if_none(outside)
    }

    /// Adds the elements of shapes of the tip; what the axes keep between.
    pub(super) fn add_by_axes(
        &mut self,
        state: &mut State,
        cause: Cause,
        shapes: &[Shape],
        feed: Feed,
    ) -> Result<Vec<Bounds>, Refusal> {
        let elements = state.in_axes(cause, shapes, feed)?;
        let bounds = elements.iter().map(|of| Bounds::of_shape(&of.shape));
        let bounds = bounds.collect();
        let axes = elements.last().map(|last| last.shape.end());
        if let Some((programmed, axes)) = shapes.last().map(Shape::end).zip(axes) {
            state.go_by_axes(programmed, axes);
        }
        let (_, stops) = state.exactness();
        let moves = elements.into_iter().filter(|of| of.length_mm > 0.0);
        for (index, mut element) in moves.enumerate() {
            element.rests_before = index == 0 && self.output.rests_before(stops);
            self.output.add(element);
        }
        Ok(bounds)
    }
}
