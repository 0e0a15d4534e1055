//! Moves beside a contour: what becomes of moves while a radius compensation is on.

use super::limits::Bounds;
use super::{AxisVector, Element, Route, Shape};
use crate::arc::{ArcBlock, ArcTolerance, Circle};
use crate::codes::shown_code;
use crate::compensation::{Compensation, Move, Side, Start, Step, Way};
use crate::meaning::{Cause, Leg, State};
use crate::refusal::{Done, Refusal, if_none, refuse};
use crate::state::{Carried, Happening, Motion};
use crate::words::{Group, Words};

/// Largest difference of the radii of an arc of the tool's centre: more than tangent joints make of it.
const BESIDE_ARC_TOLERANCE: ArcTolerance = ArcTolerance {
    short_mm: 0.0,
    radii_mm: 0.1,
    radii_most_mm: 0.1,
};

impl Route {
    /// Ten times the code of the compensation in force.
    pub fn compensation_code(&self) -> u32 {
        match self.beside.as_ref().map(|beside| beside.side) {
            None => 400,
            Some(Side::Left) => 410,
            Some(Side::Right) => 420,
        }
    }

    /// Whether a compensation is on.
    pub fn is_beside(&self) -> bool {
        self.beside.is_some()
    }

    /// Begins a compensation: from here on the program is ahead of the tool.
    pub fn begin_beside(&mut self, state: &mut State, start: Start) {
        state.stand(state.tool_place(), true);
        let compensation = Compensation::start(start, *state.position());
        self.beside = Some(Box::new(compensation));
    }

    /// Refuses codes that change what coordinates mean while the compensation is on.
    pub fn check_words(&self, state: &State, words: &Words) -> Result<(), Refusal> {
        if self.beside.is_none() {
            return Ok(());
        }
        let ends = matches!(words.code(Group::CutterCompensation), Some((400, _)));
        for (group, while_ending) in [
            (Group::Plane, true),
            (Group::ToolChange, true),
            (Group::Once, false),
            (Group::MachineCoordinates, false),
            (Group::ToolLength, false),
            (Group::WorkOffset, false),
            (Group::Motion, false),
        ] {
            let Some((number, word)) = words.code(group).filter(|_| while_ending || !ends) else {
                continue;
            };
            let is_harmless = match group {
                Group::Plane => number == state.in_force().plane.0 * 10,
                Group::Once => number == 40,
                Group::Motion => matches!(number, 0..=30 | 700 | 800),
                _ => false,
            };
            if !is_harmless {
                let code = shown_code(number);
                let found = format!("{}{code} while the radius compensation is on", word.letter);
                return refuse(word.offset, found, "end the compensation before it: G40");
            }
        }
        Ok(())
    }

    /// Refuses motions that cannot be beside a contour, or cannot lead back from there.
    pub fn check_motion(&self, state: &State, offset: usize) -> Result<(), Refusal> {
        let motion = state.in_force().motion();
        let is_long = matches!(motion, Motion::Spline(_) | Motion::InStep(_));
        let is_elsewhere = matches!(motion, Motion::Cycle(_) | Motion::Probe(_));
        if self.beside.is_some() && (is_long || is_elsewhere) {
            let found = "a cycle, spline, thread or probing while the radius compensation is on";
            let right = "end the compensation before it: G40";
            return refuse(offset, found, right);
        }
        if state.stands().is_some() && is_long {
            let found = "a spline or thread behind the radius compensation";
            let right = "the first move behind G40 is straight: G0 or G1";
            return refuse(offset, found, right);
        }
        Ok(())
    }

    /// Goes along a programmed motion: as it is, or beside itself.
    pub fn follow(&mut self, state: &mut State, cause: Cause, leg: Leg) -> Done {
        let Leg {
            to,
            shapes,
            way,
            feed,
        } = leg;
        let Some(beside) = &mut self.beside else {
            if state.stands().is_some() && matches!(way, Way::Arc(_)) {
                let right = "the first move behind G40 is straight: G0 or G1";
                return cause.refuse("an arc behind the radius compensation", right);
            }
            self.go(state, cause, shapes, feed)?;
            state.go_ahead(to);
            return Ok(());
        };
        let payload = Carried {
            line: cause.line,
            feed,
            per_turn: state.feed_per_turn(),
        };
        let mut steps = Vec::new();
        let pushed = beside.push(Move { to, way, payload }, &mut steps);
        pushed.map_err(|gouge| gouge.at(cause.offset))?;
        let plane = beside.plane;
        state.go_ahead(to);
        self.send(state, cause, plane, steps)
    }

    /// Ends the compensation, if one is on.
    pub fn leave_contour(&mut self, state: &mut State, cause: Cause) -> Done {
        let Some(beside) = self.beside.take() else {
            return Ok(());
        };
        let plane = beside.plane;
        let mut steps = Vec::new();
        let finished = beside.finish(&mut steps);
        finished.map_err(|gouge| gouge.at(cause.offset))?;
        let sent = self.send(state, cause, plane, steps);
        state.stand(state.tool_place(), false);
        sent
    }

    /// Something that happens at this place of the path: now, or behind the moves that still wait.
    pub(super) fn happen(&mut self, state: &State, happening: Happening) {
        let Some(beside) = &mut self.beside else {
            return self.happened(state, happening);
        };
        let mut steps = Vec::new();
        beside.push_event(happening, &mut steps);
        for step in steps {
            if let Step::Event(happening) = step {
                self.happened(state, happening);
            }
        }
    }

    fn happened(&mut self, state: &State, happening: Happening) {
        match happening {
            Happening::Event(line, kind) => self.output.happen(line, kind),
            Happening::Dwell(line, seconds) => {
                let dwell = Element::dwell(line, state.axes_place(), seconds);
                self.output.wait(dwell);
            }
        }
    }

    /// Adds moves of the tool's centre to the path; refuses those that leave the travel.
    fn send(
        &mut self,
        state: &mut State,
        cause: Cause,
        plane: [usize; 2],
        steps: Vec<Step<Carried, Happening>>,
    ) -> Done {
        let mut outside = vec![];
        for step in steps {
            let step = match step {
                Step::Event(happening) => {
                    self.happened(state, happening);
                    continue;
                }
                Step::Move(step) => step,
            };
            let shapes = centre_shapes(state.tool_place(), &step, plane)
                .map_err(|wrong| wrong.at(cause.offset))?;
            let (line, carried) = (step.payload.line, step.payload);
            if outside.is_empty() {
                outside = self.limits.outside(state, cause, &Bounds::of(&shapes));
                for refusal in &mut outside {
                    refusal.found += &format!(" with the tool beside the contour of line {line}");
                }
            }
            for shape in shapes {
                self.add(state, line, shape, carried.feed, carried.per_turn);
            }
            state.stand(step.to, self.beside.is_some());
        }
        self.output.check_room(0.0, cause.offset)?;
        if_none(outside)
    }
}

/// The shapes of a move of the tool's centre.
fn centre_shapes(
    from: AxisVector,
    step: &Move<Carried>,
    plane: [usize; 2],
) -> Result<Vec<Shape>, Refusal> {
    let to = step.to;
    let Way::Arc(bow) = step.way else {
        return Ok(vec![Shape::Line { from, to }]);
    };
    let arc = ArcBlock {
        from,
        to,
        plane,
        circle: Circle::Centre(bow.centre),
        clockwise: bow.clockwise,
        turns: bow.turns,
        tolerance: BESIDE_ARC_TOLERANCE,
    };
    arc.shapes().map_err(|Refusal { found, right, .. }| {
        Refusal::new(0, format!("{found}, with the tool beside it"), right)
    })
}
