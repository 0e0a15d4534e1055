//! The route of the tool: what blocks make is done here, each move by one path, and becomes elements and events.

use path::geometry::{AxisVector, Element, Feed, PathTolerance, Shape, displacement_length_mm};
use serde::{Deserialize, Serialize};

use crate::act::{Act, Acts};
use crate::compensation::Compensation;
use crate::meaning::{Cause, State, StraightLeg};
use crate::program::EventKind;
use crate::refusal::{Done, if_none};
use crate::state::{Carried, Happening};
use crate::surface::FeedPerTurn;
use crate::words::Words;

mod beside;
mod limits;
mod output;
mod tool_centre;

use limits::{Bounds, Limits};
pub use output::{Bound, Counts, Output};

/// What was made so far, and what decides how the next move is made.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Route {
    /// The radius compensation that is on.
    beside: Option<Box<Compensation<Carried, Happening>>>,
    #[serde(skip)]
    limits: Limits,
    pub output: Output,
}

impl Route {
    /// Keeps a remark, once of a kind, for its first line.
    pub fn note(&mut self, line: u32, text: &'static str) {
        self.output.notes.keep(line, text);
    }

    /// Something beside the axes.
    pub fn event(&mut self, state: &State, line: u32, kind: EventKind) {
        self.happen(state, Happening::Event(line, kind));
    }

    /// Does what a block makes, in its order; the bounds of its moves.
    pub fn perform(&mut self, state: &mut State, line: u32, acts: Acts) -> Vec<Bounds> {
        let mut ways = Vec::new();
        if acts.0.is_empty() {
            return ways;
        }
        let per_turn = state.feed_per_turn();
        let mut acts = acts.0.into_iter();
        while let Some(act) = acts.next() {
            match act {
                Act::Note(text) => self.note(line, text),
                Act::Event(kind) => self.happen(state, Happening::Event(line, kind)),
                Act::Dwell(seconds) => self.happen(state, Happening::Dwell(line, seconds)),
                Act::Move(to, feed) => {
                    self.output.straight_feeds += u32::from(feed != Feed::Rapid);
                    let from = state.tool_place();
                    if state.controls_tool_centre() {
                        let no_words = Words::default();
                        let cause = Cause::new(line, &no_words, 0);
                        let shape = [Shape::Line { from, to }];
                        // Nothing turns in such a move: it is one line.
                        let bounds = self.add_by_axes(state, cause, &shape, feed);
                        ways.extend(bounds.unwrap_or_default());
                        continue;
                    }
                    ways.reserve(1 + acts.len());
                    ways.push(Bounds::of_line(from, to));
                    self.add(state, line, Shape::Line { from, to }, feed, per_turn);
                    state.go_to(to);
                }
            }
        }
        ways
    }

    /// The same; refuses axes that leave their travel, each for the first place of all the moves.
    pub fn perform_all(&mut self, state: &mut State, cause: Cause, acts: Acts) -> Done {
        let ways = self.perform(state, cause.line, acts);
        if_none(self.limits.outside(state, cause, &ways))
    }

    /// The same; refuses the axes of the first move that leaves the travel.
    pub fn perform_each(&mut self, state: &mut State, cause: Cause, acts: Acts) -> Done {
        let ways = self.perform(state, cause.line, acts);
        let outside = ways.iter().map(|way| {
            let way = std::slice::from_ref(way);
            self.limits.outside(state, cause, way)
        });
        // Limits are to hear of all moves, also behind the first that is refused.
        let outside: Vec<_> = outside.filter(|refusals| !refusals.is_empty()).collect();
        if_none(outside.into_iter().next().unwrap_or_default())?;
        Ok(self.output.check_room(0.0, cause.offset)?)
    }

    /// Goes along shapes; refuses those that leave the travel.
    pub fn go(&mut self, state: &mut State, cause: Cause, shapes: Vec<Shape>, feed: Feed) -> Done {
        if state.controls_tool_centre() {
            return self.go_by_axes(state, cause, &shapes, feed);
        }
        let outside = self.limits.outside(state, cause, &Bounds::of(&shapes));
        if let Some(last) = shapes.last() {
            state.go_to(last.end());
        }
        let per_turn = state.feed_per_turn();
        for shape in shapes {
            self.add(state, cause.line, shape, feed, per_turn);
        }
        self.output.check_room(0.0, cause.offset)?;
        if_none(outside)
    }

    /// The same in rapid, straight to a place.
    pub fn go_rapid(&mut self, state: &mut State, cause: Cause, to: AxisVector) -> Done {
        let shapes = state.straight_to(to);
        self.go(state, cause, shapes, Feed::Rapid)
    }

    /// Goes along a block of straight motion; false, and nothing done, where that needs more.
    #[inline]
    pub fn go_straight(&mut self, state: &mut State, line: u32, leg: &StraightLeg) -> bool {
        if self.beside.is_some() || self.output.check_room(1.0, 0).is_err() {
            return false;
        }
        let rotary = &state.equipment().rotary;
        let length_mm = displacement_length_mm(&(leg.to - state.position()), rotary);
        let from = state.go_straight(leg);
        self.output.straight_feeds += u32::from(leg.feed != Feed::Rapid);
        if length_mm > 0.0 {
            let (tolerance, rests_before) = self.exactness(state);
            self.output.add_finite(Element {
                line,
                shape: Shape::Line { from, to: leg.to },
                feed: leg.feed,
                length_mm,
                rests_before,
                tolerance,
                rounding: None,
            });
        }
        true
    }

    /// Adds a shape to the path, in pieces where its feed follows the speed of the spindle.
    fn add(
        &mut self,
        state: &State,
        line: u32,
        shape: Shape,
        feed: Feed,
        per_turn: Option<FeedPerTurn>,
    ) {
        let pieces = match per_turn.filter(|_| feed != Feed::Rapid) {
            Some(per_turn) => per_turn.along(shape),
            None => return self.add_piece(state, line, shape, feed),
        };
        for (shape, feed) in pieces {
            self.add_piece(state, line, shape, feed);
        }
    }

    fn add_piece(&mut self, state: &State, line: u32, shape: Shape, feed: Feed) {
        let mut element = Element::new(line, shape, feed, &state.equipment().rotary);
        if element.length_mm > 0.0 {
            (element.tolerance, element.rests_before) = self.exactness(state);
            self.output.add(element);
        }
    }

    /// How far a motion may leave the path, and whether the tool rests before it.
    #[inline]
    fn exactness(&mut self, state: &State) -> (PathTolerance, bool) {
        let (tolerance, stops) = state.exactness();
        (tolerance, self.output.rests_before(stops))
    }
}
