//! Moves beside a contour: the codes of cutter radius compensation, and what becomes of moves while it is on.

use super::*;
use crate::codes::shown_code;
use crate::compensation::{Move, Side, Start, Step as BesideStep, Way};

/// How far the radii of an arc of the tool's centre may differ: more than tangent joints make of it.
const BESIDE_ARC_TOLERANCE: ArcTolerance = ArcTolerance {
    short_mm: 0.0,
    radii_mm: 0.1,
    radii_most_mm: 0.1,
};

type Beside = Compensation<Carried, Happening>;
type BesideSteps = Vec<BesideStep<Carried, Happening>>;

impl Interpreter {
    /// Where the tool stands: beside the programmed place while a compensation is on, and until the first move behind it.
    pub(super) fn tool_place(&self) -> AxisVector {
        self.stands.unwrap_or(self.position)
    }

    /// The code of the compensation in force, ten times.
    pub(super) fn compensation_code(&self) -> u32 {
        match self.beside.as_ref().map(|beside| beside.side()) {
            None => 400,
            Some(Side::Left) => 410,
            Some(Side::Right) => 420,
        }
    }

    /// G40, G41, G42, G41.1 and G42.1.
    pub(super) fn compensation_words(
        &mut self,
        line: u32,
        words: &Words,
    ) -> Result<(), Vec<Refusal>> {
        let Some((number, word)) = words.code(Group::CutterCompensation) else {
            return Ok(());
        };
        if number == 400 {
            return self.leave_contour(words, word.offset);
        }
        let code = shown_code(number);
        if self.beside.is_some() {
            let found = format!("G{code} while the radius compensation is on");
            return refuse(word.offset, found, "G40 before it");
        }
        let Some((radius_mm, orientation)) = self.tool_radius(line, words, number, word.offset)?
        else {
            return Ok(());
        };
        let (plane, _, _) = self.modes.plane;
        if plane == 19 {
            let right = "the radius compensation works in G17 and G18";
            return refuse(word.offset, format!("G{code} in G19"), right);
        }
        if plane != 18 && !matches!(orientation, 0 | 9) {
            let found = format!("G{code} with a turning tool in G17");
            let right = "a tool with an orientation (Q in the tool table) cuts in G18";
            return refuse(word.offset, found, right);
        }
        if plane == 18 && self.offsets.turn.is_some() {
            let found = format!("G{code} in G18 with a turned work offset");
            let right = "a work offset without R: G10 L2 P1 R0";
            return refuse(word.offset, found, right);
        }
        let axes = self.plane_axes(word.offset)?;
        let left = matches!(number, 410 | 411);
        let start = Start {
            side: if left { Side::Left } else { Side::Right },
            radius_mm,
            plane: axes,
            across: self.setup.axis_index(if plane == 18 { 'Y' } else { 'Z' }),
            tip: Start::tip_of_orientation(orientation),
        };
        if radius_mm != 0.0 {
            // From here on the program is ahead of the tool.
            self.stands = Some(self.tool_place());
            self.beside = Some(Box::new(Beside::start(start, self.position)));
        }
        Ok(())
    }

    /// Radius in mm and orientation of the tool that the block names; none where no tool has a radius.
    fn tool_radius(
        &mut self,
        line: u32,
        words: &Words,
        number: u32,
        offset: usize,
    ) -> Result<Option<(f64, u32)>, Refusal> {
        let code = shown_code(number);
        let d = words.value('D');
        if matches!(number, 411 | 421) {
            let Some(d) = d else {
                let right = "the diameter of the tool, such as G41.1 D6";
                return refuse(offset, format!("G{code} without D"), right);
            };
            let orientation = match words.value('L') {
                None => 0,
                Some(l) if self.modes.plane.0 == 18 && (0.0..=9.0).contains(&l.value) => {
                    l.value as u32
                }
                Some(l) => {
                    let right = "L is the orientation of a turning tool, 0 to 9, in G18";
                    return refuse(l.offset, format!("G{code} {l}"), right);
                }
            };
            return Ok(Some((d.value * self.unit_mm() / 2.0, orientation)));
        }
        if let Some(d) = d.filter(|d| d.value < 0.0 || d.value.fract() != 0.0) {
            let right = "D is the number of a tool; G41.1 and G42.1 take a diameter";
            return refuse(d.offset, format!("G{code} {d}"), right);
        }
        let named = d.map_or(0.0, |d| d.value) as u32;
        let number = if named == 0 { self.tool.number } else { named };
        if let Some(tool) = self.tool_of(number) {
            return Ok(Some((tool.diameter / 2.0, tool.orientation)));
        }
        if named == 0 && self.setup.answers_assumed {
            let text = "G41 or G42 without a tool that has a radius: the tool's centre follows the programmed path";
            self.note(line, text);
            return Ok(None);
        }
        let found = format!("G{code} with a tool whose radius nobody knows");
        let right = "name a tool table in the machine file ([program] tool_table), or write the diameter: G41.1 D6";
        refuse(words.place('D', offset), found, right)
    }

    /// Refuses codes that change what coordinates mean while the compensation is on.
    pub(super) fn check_beside(&self, words: &Words) -> Result<(), Refusal> {
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
                Group::Plane => number == self.modes.plane.0 * 10,
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
    pub(super) fn check_motion_beside(&self, offset: usize) -> Result<(), Refusal> {
        let is_long = matches!(self.motion, Motion::Spline(_) | Motion::InStep(_));
        let is_elsewhere = matches!(self.motion, Motion::Cycle(_) | Motion::Probe(_));
        if self.beside.is_some() && (is_long || is_elsewhere) {
            let found = "a cycle, spline, thread or probing while the radius compensation is on";
            let right = "end the compensation before it: G40";
            return refuse(offset, found, right);
        }
        if self.stands.is_some() && is_long {
            let found = "a spline or thread behind the radius compensation";
            let right = "the first move behind G40 is straight: G0 or G1";
            return refuse(offset, found, right);
        }
        Ok(())
    }

    /// Sends a programmed move on: as it is, or beside itself.
    pub(super) fn run_move(
        &mut self,
        line: u32,
        words: &Words,
        target: AxisVector,
        (shapes, way, feed): (Vec<Shape>, Way, Feed),
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let Some(mut beside) = self.beside.take() else {
            if self.stands.is_some() && matches!(way, Way::Arc { .. }) {
                let right = "the first move behind G40 is straight: G0 or G1";
                return refuse(offset, "an arc behind the radius compensation", right);
            }
            self.go(line, words, shapes, feed, offset)?;
            self.position = target;
            return Ok(());
        };
        let next = Move {
            to: target,
            way,
            payload: Carried {
                line,
                feed,
                per_turn: self.feed_per_turn(),
            },
        };
        let mut steps = Vec::new();
        let result = beside.push(next, &mut steps);
        let plane = beside.plane();
        self.beside = Some(beside);
        result.map_err(|gouge| gouge.at(offset))?;
        self.position = target;
        self.send(words, plane, steps, offset)
    }

    /// Ends the compensation, if one is on.
    pub(super) fn leave_contour(
        &mut self,
        words: &Words,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let Some(beside) = self.beside.take() else {
            return Ok(());
        };
        let plane = beside.plane();
        let mut steps = Vec::new();
        beside
            .finish(&mut steps)
            .map_err(|gouge| gouge.at(offset))?;
        let sent = self.send(words, plane, steps, offset);
        self.stands = self.stands.filter(|place| *place != self.position);
        sent
    }

    /// The same at the end of a program that does not say so.
    pub fn end_contour(&mut self) -> Result<(), Vec<Refusal>> {
        self.leave_contour(&Words::default(), 0)
    }

    /// Something that happens at this place of the path: now, or behind the moves that still wait.
    pub(super) fn happen(&mut self, happening: Happening) {
        let mut steps = Vec::new();
        match &mut self.beside {
            Some(beside) => beside.push_event(happening, &mut steps),
            None => steps.push(BesideStep::Event(happening)),
        }
        for step in steps {
            if let BesideStep::Event(happening) = step {
                self.happened(happening);
            }
        }
    }

    fn happened(&mut self, happening: Happening) {
        match happening {
            Happening::Event(line, kind) => self.output.happen(line, kind),
            Happening::Dwell(line, seconds) => {
                let dwell = Element::dwell(line, self.tool_place(), seconds);
                self.output.add(dwell);
            }
        }
    }

    /// Adds moves of the tool's centre to the path; refuses those that leave the travel.
    fn send(
        &mut self,
        words: &Words,
        plane: [usize; 2],
        steps: BesideSteps,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let mut outside = vec![];
        for step in steps {
            let step = match step {
                BesideStep::Event(happening) => {
                    self.happened(happening);
                    continue;
                }
                BesideStep::Move(step) => step,
            };
            let shapes = self.centre_shapes(&step, plane, offset)?;
            if outside.is_empty() {
                outside = self.outside(words, &shapes, offset);
                for refusal in &mut outside {
                    let line = step.payload.line;
                    refusal.found += &format!(" with the tool beside the contour of line {line}");
                }
            }
            let Carried {
                line,
                feed,
                per_turn,
            } = step.payload;
            for shape in shapes {
                self.add_shape(line, shape, feed, per_turn);
            }
            self.stands =
                Some(step.to).filter(|place| *place != self.position || self.beside.is_some());
        }
        self.output.check_room(0.0, offset)?;
        if_none(outside)
    }

    /// The shapes of a move of the tool's centre.
    fn centre_shapes(
        &self,
        step: &Move<Carried>,
        plane: [usize; 2],
        offset: usize,
    ) -> Result<Vec<Shape>, Refusal> {
        let (from, to) = (self.tool_place(), step.to);
        let Way::Arc {
            centre,
            clockwise,
            turns,
        } = step.way
        else {
            return Ok(vec![Shape::Line { from, to }]);
        };
        let arc = ArcBlock {
            from,
            to,
            plane,
            circle: Circle::Centre(centre),
            clockwise,
            turns,
            tolerance: BESIDE_ARC_TOLERANCE,
        };
        arc.shapes().map_err(|Refusal { found, right, .. }| {
            Refusal::new(offset, format!("{found}, with the tool beside it"), right)
        })
    }

    /// The way of an arc block.
    pub(super) fn way_of(block: &ArcBlock) -> Result<Way, Refusal> {
        Ok(Way::Arc {
            centre: block.centre()?,
            clockwise: block.clockwise,
            turns: block.turns,
        })
    }
}
