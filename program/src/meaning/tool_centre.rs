//! G43.4: places of the program are those of the tool's tip on the work, which rotary axes turn. G68.2, G53.1 and G69: they lie in a
//! plane that stands askew on it.

use std::sync::Arc;

use machine::TURN_DEG;
use path::geometry::{AxisVector, Element, Feed, PathTolerance, Shape};
use path::tool_centre::{PIECES_MAX, ToolCentre};

use super::{Cause, Group, Motion, Refusal, State, is_turning, refuse};
use crate::codes::shown_code;
use crate::reader::Word;
use crate::tilted_plane::TiltedPlane;
use crate::words::Words;

/// How far the lines of the axes may leave the programmed path where it is travelled exactly, and at least, in mm.
const CHORD_EXACT_MM: f64 = 0.000_25;
/// The same in rapids, and at most, in mm.
const CHORD_MOST_MM: f64 = 0.002;
/// Shares of a tolerance: what lines may leave the programmed path by, what rounding may take of the slides, and of the rotary axes at the
/// distance of the tip. Two rotary axes together take up to √2 of theirs; all of it is within the tolerance.
const CHORD_SHARE: f64 = 1.0 / 4.0;
const SLIDES_SHARE: f64 = 1.0 / 2.0;
const ROTARY_SHARE: f64 = 1.0 / 6.0;
/// The tool stands along a direction if it is nearer to it, as the sine of the angle.
const ALONG: f64 = 1e-6;

/// What cannot be done while the tool's centre point is controlled.
const NOT_THEN: &str = "while the tool's centre point is controlled (G43.4)";
/// What to do about it.
const END_IT: &str = "G49 before it ends the control";
const NO_LINES: &str =
    "this machine does not say how its rotary axes turn: [[rotary_line]] in the machine file";

impl State {
    /// Where the axes are: where the program is, unless the tool's centre point is controlled.
    pub fn axes_place(&self) -> AxisVector {
        self.axes.unwrap_or_else(|| self.tool_place())
    }

    /// Whether the tool's centre point is controlled.
    pub fn controls_tool_centre(&self) -> bool {
        self.axes.is_some()
    }

    /// How the machine turns tool and work, while the tool's centre point is controlled.
    pub fn tool_centre(&self) -> Option<&Arc<ToolCentre>> {
        let of_machine = self.equipment.tool_centre.as_ref();
        of_machine.filter(|_| self.controls_tool_centre())
    }

    /// Controls the tool's centre point from here on.
    pub(super) fn begin_tool_centre(&mut self, word: Word) -> Result<(), Refusal> {
        if self.equipment.tool_centre.is_none() {
            return word.refuse(NO_LINES);
        }
        if self.in_force.surface.is_some() {
            return refuse(word.offset, format!("{word} in G96"), "G97 before it");
        }
        self.control_tool_centre();
        Ok(())
    }

    /// The same where nothing is in its way.
    pub(super) fn control_tool_centre(&mut self) {
        let axes = self.tool_place();
        self.stands = None;
        self.axes = Some(axes);
        self.find_tip(&axes);
    }

    /// The tool's centre point is controlled no more: the program is where the axes are.
    pub(super) fn end_tool_centre(&mut self) {
        if let Some(axes) = self.axes.take() {
            self.position = axes;
        }
    }

    /// The program is where the tip is with the axes at a place.
    fn find_tip(&mut self, axes: &AxisVector) {
        let Some(tool_centre) = self.tool_centre() else {
            return;
        };
        let on_work = tool_centre.programmed(axes, self.offsets.tool());
        let plane = self.plane.as_ref();
        let in_plane = plane.map(|plane| plane.in_plane(&on_work, self.offsets.zero()));
        self.position = in_plane.unwrap_or(on_work);
    }

    /// G68.2: the plane, with its zero at X Y Z of the program and turned by I, J and K.
    pub(super) fn tilt_plane(&mut self, cause: Cause) -> Result<(), Refusal> {
        let slides = ['X', 'Y', 'Z'].map(|letter| self.equipment.slide(letter));
        let (Some(_), [Some(x), Some(y), Some(z)]) = (&self.equipment.tool_centre, slides) else {
            return cause.refuse("G68.2", NO_LINES);
        };
        if self.offsets.is_turned() {
            let right = "a work offset without a rotation (G10 L2 R0): the plane turns it";
            return cause.refuse("G68.2 where the work offset is turned", right);
        }
        let slides = [x, y, z];
        let origin_mm = slides.map(|index| self.axis_value(cause.words, index).unwrap_or_default());
        let angles_deg =
            ['I', 'J', 'K'].map(|letter| cause.words.value(letter).map_or(0.0, |word| word.value));
        let plane = TiltedPlane::of_euler_angles(slides, origin_mm, angles_deg);
        self.change_plane(Some(plane));
        Ok(())
    }

    /// Whether a tilted plane is in force.
    pub fn is_tilted(&self) -> bool {
        self.plane.is_some()
    }

    /// Another plane, or none (G69).
    pub fn change_plane(&mut self, plane: Option<TiltedPlane>) {
        self.plane = plane;
        if let Some(axes) = self.axes {
            self.find_tip(&axes);
        }
    }

    /// G53.1: where the rotary axes turn so that the tool stands along Z of the plane, by the least turns; the tip keeps its place if it is
    /// controlled.
    pub fn along_plane(&self, cause: Cause) -> Result<AxisVector, Refusal> {
        let Some((plane, tool_centre)) = self.plane.zip(self.equipment.tool_centre.as_ref()) else {
            return cause.refuse("G53.1 without a tilted plane", "G68.2 before it");
        };
        let solutions = tool_centre.orientations(plane.normal());
        if solutions.is_empty() {
            let found = "G53.1: the tool cannot stand along Z of the plane";
            let right = "a plane that two rotary axes of this machine can turn the tool to";
            return cause.refuse(found, right);
        }
        let mut best: Option<(f64, AxisVector)> = None;
        for solution in &solutions {
            let mut turned = self.position;
            let mut way_deg = 0.0;
            let mut fits = true;
            for (index, angle_deg) in solution {
                let (Some(place), Some(axis)) =
                    (turned.get_mut(*index), self.equipment.axes.get(*index))
                else {
                    continue;
                };
                let Some(angle_deg) = angle_deg else { continue };
                let whole = libm::round((*place - angle_deg) / TURN_DEG);
                let near = [0.0, -1.0, 1.0].map(|more| angle_deg + (whole + more) * TURN_DEG);
                let here = *place;
                let within = near
                    .into_iter()
                    .find(|to| axis.modulo || (axis.travel_min..=axis.travel_max).contains(to));
                fits &= within.is_some();
                *place = within.unwrap_or(here);
                way_deg += (*place - here).abs();
            }
            if fits && best.is_none_or(|(least_deg, _)| way_deg < least_deg) {
                best = Some((way_deg, turned));
            }
        }
        match best {
            Some((_, turned)) => Ok(turned),
            None => {
                let found = "G53.1: the rotary axes would leave their travel";
                cause.refuse(
                    found,
                    "a plane within their travel: see [[axis]] in the machine file",
                )
            }
        }
    }

    /// Refuses words that mean places of the axes, or a tool that is along Z where it may not be.
    pub fn check_tool_centre(&self, words: &Words) -> Result<(), Refusal> {
        let length = words.code(Group::ToolLength).map(|(number, _)| number);
        let begins = length == Some(434) || length == Some(430) && self.plane.is_some();
        self.check_plane(words, begins)?;
        if !(begins || self.controls_tool_centre()) {
            return Ok(());
        }
        let ends = !begins && length.is_some();
        for group in [
            Group::Once,
            Group::MachineCoordinates,
            Group::CutterCompensation,
            Group::ToolChange,
            Group::SpindleMode,
        ] {
            let Some((number, word)) = words.code(group) else {
                continue;
            };
            let by_place = words
                .value('L')
                .is_some_and(|l| ![2.0, 20.0].contains(&l.value));
            let is_harmless = match group {
                Group::Once if number == 100 => !by_place,
                Group::Once => matches!(number, 40 | 520 | 531 | 682 | 690 | 920..=923),
                Group::CutterCompensation => number == 400,
                Group::ToolChange => number == 610 || ends,
                Group::SpindleMode => number == 970,
                _ => false,
            };
            if !is_harmless {
                let code = shown_code(number);
                let found = format!("{}{code} {NOT_THEN}", word.letter);
                return refuse(word.offset, found, END_IT);
            }
        }
        let code = words.code(Group::Motion);
        let turns = code.is_some_and(|(number, _)| is_turning(number));
        let is_elsewhere = match self.motion_of(words) {
            Motion::Cycle(_) => !self.stands_along_plane(),
            Motion::Probe(_) | Motion::InStep(_) => true,
            Motion::None
            | Motion::Rapid
            | Motion::Line
            | Motion::Arc { .. }
            | Motion::Spline(_) => turns,
        };
        let word = code.map(|(_, word)| word).or(words.first_in(super::PLACES));
        match word.filter(|_| is_elsewhere) {
            Some(word) => {
                let found = format!("a cycle, a thread or probing {NOT_THEN}");
                let right = "G49 before it, or G80 and single moves; cycles also in a tilted plane, behind G68.2 and G53.1";
                refuse(word.offset, found, right)
            }
            None => Ok(()),
        }
    }

    /// Refuses what changes the zero of a tilted plane, and motion in it before the length of the tool counts.
    fn check_plane(&self, words: &Words, begins: bool) -> Result<(), Refusal> {
        if self.plane.is_none() {
            return Ok(());
        }
        let offset = words.code(Group::WorkOffset);
        let once = words.code(Group::Once);
        let shifts = once.filter(|(number, _)| matches!(number, 100 | 520 | 920..=923));
        if let Some((number, word)) = offset.or(shifts) {
            let found = format!("G{} in a tilted plane (G68.2)", shown_code(number));
            return refuse(word.offset, found, "G69 before it ends the plane");
        }
        let stays = self.controls_tool_centre() || begins;
        let is_arc = matches!(self.motion_of(words), Motion::Arc { .. });
        let places = if is_arc { "XYZ@^IJKR" } else { "XYZ@^" };
        let moves = words.first_of(places).filter(|_| !stays);
        let is_plane = once.is_some_and(|(number, _)| matches!(number, 682 | 690));
        match moves.filter(|_| !is_plane && words.code(Group::MachineCoordinates).is_none()) {
            Some(word) => {
                let found = format!("{word} in a tilted plane without the length of a tool");
                let right =
                    "G43 and the tool before it, such as G43 H1; or G69, which ends the plane";
                refuse(word.offset, found, right)
            }
            None => Ok(()),
        }
    }

    /// Whether the tool stands along Z of a tilted plane.
    fn stands_along_plane(&self) -> bool {
        let tool_centre = self.tool_centre().zip(self.axes).zip(self.plane);
        tool_centre.is_some_and(|((tool_centre, axes), plane)| {
            let apart = tool_centre
                .tool_direction(&axes)
                .into_iter()
                .zip(plane.normal());
            let apart = apart.map(|(tool, normal)| (tool - normal) * (tool - normal));
            apart.sum::<f64>() < ALONG * ALONG
        })
    }

    /// Shapes as the axes go along them, each piece as long as its share of the tip's way.
    pub fn in_axes(
        &self,
        cause: Cause,
        shapes: &[Shape],
        feed: Feed,
    ) -> Result<Vec<Element>, Refusal> {
        let Some((tool_centre, mut from)) = self.tool_centre().zip(self.axes) else {
            return Ok(Vec::new());
        };
        let length_mm = self.offsets.tool();
        let rotary = &self.equipment.rotary;
        let programmed = self.exactness().0;
        let chord_mm = match feed {
            Feed::Rapid => CHORD_MOST_MM,
            Feed::PathMmS(_) => {
                (least_of(programmed) * CHORD_SHARE).clamp(CHORD_EXACT_MM, CHORD_MOST_MM)
            }
        };
        let mut elements = Vec::new();
        for shape in shapes {
            let plane = self.plane.as_ref();
            let on_work = plane.map(|plane| plane.shape_on_work(shape, self.offsets.zero()));
            let shape = on_work.as_ref().unwrap_or(shape);
            let pieces = tool_centre.pieces(shape, from, length_mm, chord_mm);
            let Some(pieces) = pieces else {
                let found = format!("a motion of more than {PIECES_MAX} pieces");
                return cause.refuse(found, "split the block: rotary axes turn too far in it");
            };
            let length = shape.length_with_rotary_mm(rotary);
            let share_mm = length / pieces.len() as f64;
            let tolerance = self.tool_centre_tolerance(tool_centre, shape, programmed);
            for piece in pieces {
                from = piece.end();
                let mut element = Element::new(cause.line, piece, feed, rotary);
                // The way of the tip, along which the axes go evenly: their own may be none where a table makes it.
                element.length_mm = share_mm;
                element.tolerance = tolerance;
                elements.push(element);
            }
        }
        Ok(elements)
    }

    /// What rounding may take so that the tip keeps the tolerance all along a shape on the work.
    fn tool_centre_tolerance(
        &self,
        tool_centre: &ToolCentre,
        shape: &Shape,
        programmed: PathTolerance,
    ) -> PathTolerance {
        let PathTolerance {
            corner_mm,
            chord_mm,
            ..
        } = programmed;
        let length_mm = self.offsets.tool();
        let places = [0.0, 0.5, 1.0].map(|share| shape.at_share(share));
        let mm_per_degree = places
            .iter()
            .map(|place| tool_centre.mm_per_degree(place, length_mm));
        let mm_per_degree = mm_per_degree.fold(f64::MIN_POSITIVE, f64::max);
        let least_mm = least_of(programmed);
        PathTolerance {
            corner_mm: SLIDES_SHARE * corner_mm,
            chord_mm: SLIDES_SHARE * chord_mm,
            rotary_deg: ROTARY_SHARE * least_mm / mm_per_degree,
        }
    }

    /// The program is at the end of a motion, and the axes where that leads them.
    pub fn go_by_axes(&mut self, programmed: AxisVector, axes: AxisVector) {
        self.position = programmed;
        self.axes = Some(axes);
    }
}

/// The least that a path may be left by, in mm: at chords as at corners where nothing else is said.
fn least_of(tolerance: PathTolerance) -> f64 {
    match tolerance.chord_mm {
        0.0 => tolerance.corner_mm,
        chord_mm => tolerance.corner_mm.min(chord_mm),
    }
}
