//! Cutter radius compensation (G41, G42, G41.1, G42.1, G40): the path of the tool's centre beside a programmed contour.
//!
//! By NIST RS274/NGC §3.5.10 and appendix B, and the chapter "Cutter Compensation" of the LinuxCNC manual, whose moves
//! these are:
//!
//! - The first move in the plane leads in: a line of more than a tool radius to the place beside its end, or an arc
//!   tangent to the contour there.
//! - Behind each further move the tool is beside its end. In an outside corner an arc about the corner comes first (a
//!   straight rapid before a rapid); rotary axes and U V W move on that arc, the axis across the plane on the move itself.
//! - In an inside corner the move before ends where both moves' paths of the centre meet. So a move is final only when the
//!   next one in the plane is known; moves across the plane and events between them wait with it.
//! - Moves whose directions differ by less than 0.05 rad join without either: there the tool may stand nearer than its
//!   radius by up to 0.00125 of it.
//! - G40 ends the last move beside its end. The program goes on from the programmed place, by a straight move.
//!
//! A contour that the tool does not fit is refused. So is an inside curve of short lines that is tighter than the tool,
//! which LinuxCNC follows without a word.

mod corner;
#[cfg(test)]
mod tests;

use path::geometry::AxisVector;
use serde::{Deserialize, Serialize};

use crate::flat::{Flat, sweep_rad};
use crate::refusal::{Refusal, wrong};

/// Directions that differ by less count as one: the interpreter's `TOLERANCE_CONCAVE_CORNER`.
const TANGENT_RAD: f64 = 0.05;

/// What of the tool radius may be lost at a tangent joint: 1 - cos 0.05.
const TANGENT_LOSS: f64 = 0.001_249_74;

/// A move that is shorter, or runs back by less, has rounded to nothing.
const ROUNDING_MM: f64 = 1e-9;

/// How much longer an arc may become by rounding, in rad, before it counts as one that went the other way round.
const SWEEP_ROUNDING_RAD: f64 = 0.001;

/// A coordinate beyond this is not one of a machine: 1,000,000 km.
const FARTHEST_MM: f64 = 1e12;

/// The most moves and events that wait for the next move in the plane.
pub(crate) const WAITING_MAX: usize = 1_000;

/// Where the tool is, seen along the contour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// G41.
    Left,
    /// G42.
    Right,
}

impl Side {
    /// The other side.
    pub fn other(self) -> Self {
        match self {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        }
    }
}

/// How a move leads to its end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Way {
    /// Straight, in rapid.
    Rapid,
    /// Straight, at feed.
    Line,
    /// Round a centre in the plane.
    Arc(Bow),
}

/// An arc in the plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bow {
    /// The centre, machine coordinates.
    pub centre: Flat,
    /// G2 rather than G3.
    pub clockwise: bool,
    /// Turns, the last included, at least 1.
    pub turns: u32,
}

/// A move: of the program into the compensation, of the tool's centre out of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Move<T> {
    /// End of all axes, machine coordinates.
    pub to: AxisVector,
    /// How it gets there.
    pub way: Way,
    /// What travels with it, such as its line and its feed.
    pub payload: T,
}

/// What comes out, in order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Step<T, E> {
    /// The tool's centre moves.
    Move(Move<T>),
    /// Something that was pushed between moves.
    Event(E),
}

/// What a compensation is started with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Which side.
    pub side: Side,
    /// Radius of the tool, above 0; the other side for a radius below 0.
    pub radius_mm: f64,
    /// First and second axis of the plane.
    pub plane: [usize; 2],
    /// The axis across the plane.
    pub across: Option<usize>,
    /// Place of the programmed point from the centre of the tool's nose, in tool radii: 0 for a mill
    /// ([`Start::tip_of_orientation`]).
    pub tip: Flat,
}

impl Start {
    /// Where the controlled point of a lathe tool lies from the centre of its nose in the plane ZX, in nose radii, by
    /// the tool orientation 1 to 9 of the tool table (LinuxCNC manual, "Lathe tool orientation").
    pub fn tip_of_orientation(orientation: u32) -> Flat {
        let first = match orientation {
            2 | 3 | 7 => -1.0,
            1 | 4 | 5 => 1.0,
            _ => 0.0,
        };
        let second = match orientation {
            1 | 2 | 6 => -1.0,
            3 | 4 | 8 => 1.0,
            _ => 0.0,
        };
        Flat::new(first, second)
    }
}

/// The last move in the plane, whose end may still be drawn back.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Last {
    /// Where the tool's centre starts it.
    start: Flat,
    way: Way,
    /// Direction of the programmed contour at its end.
    tangent: Flat,
    /// Direction of a line; none on a lead-in, which cannot be drawn back too far.
    along: Option<Flat>,
    /// Angle of an arc, in rad, as programmed.
    sweep_rad: f64,
    /// Angle by which the contour turned to the tool's side before it, since it last went forward, in rad.
    turned_rad: f64,
    /// An inside corner lies before it.
    behind_corner: bool,
}

/// A compensation that is on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Compensation<T, E> {
    /// The side that the tool is on.
    pub side: Side,
    radius_mm: f64,
    /// The plane it works in.
    pub plane: [usize; 2],
    across: Option<usize>,
    tip: Flat,
    /// End of the last programmed move.
    programmed: AxisVector,
    /// Centre of the tool behind all that waits.
    centre: AxisVector,
    last: Option<Last>,
    waiting: Vec<Step<T, E>>,
}

impl Bow {
    fn sweep_rad(&self, from: Flat, to: Flat) -> f64 {
        sweep_rad(from, to, self.centre, self.clockwise, self.turns)
    }
}

impl Last {
    /// A move that begins and goes on so, with nothing turned, swept or cut off by a corner so far.
    fn of(start: Flat, way: Way, tangent: Flat) -> Self {
        Last {
            start,
            way,
            tangent,
            along: None,
            sweep_rad: 0.0,
            turned_rad: 0.0,
            behind_corner: false,
        }
    }
}

impl<T: Clone, E> Compensation<T, E> {
    /// A compensation that begins with the tool at `at`.
    pub fn start(start: Start, at: AxisVector) -> Self {
        let side = if start.radius_mm < 0.0 {
            start.side.other()
        } else {
            start.side
        };
        let radius_mm = start.radius_mm.abs();
        Self {
            side,
            radius_mm,
            plane: start.plane,
            across: start.across,
            tip: start.tip * radius_mm,
            programmed: at,
            centre: at,
            last: None,
            waiting: Vec::new(),
        }
    }

    /// Takes the next programmed move; what is final by it goes to `out`.
    pub fn push(&mut self, next: Move<T>, out: &mut Vec<Step<T, E>>) -> Result<(), Refusal> {
        let (from, to) = (
            Flat::of(&self.programmed, self.plane),
            Flat::of(&next.to, self.plane),
        );
        self.check_range(&next)?;
        let programmed = next.to;
        match (next.way, self.last) {
            (Way::Rapid | Way::Line, None) => self.lead_in(next, to)?,
            (Way::Rapid | Way::Line, Some(_)) if (to - from).length() <= ROUNDING_MM => {
                self.move_across(next)?;
            }
            (Way::Rapid | Way::Line, Some(last)) => self.line(next, last, from, to, out)?,
            (Way::Arc(bow), None) => self.arc_in(next, bow, to, out)?,
            (Way::Arc(bow), Some(last)) => self.arc(next, bow, last, [from, to], out)?,
        }
        self.programmed = programmed;
        Ok(())
    }

    /// Takes something that happens between the moves.
    pub fn push_event(&mut self, event: E, out: &mut Vec<Step<T, E>>) {
        if self.waiting.is_empty() {
            out.push(Step::Event(event));
        } else {
            self.waiting.push(Step::Event(event));
        }
    }

    /// Ends the compensation (G40): what still waits goes to `out`. Gives the programmed place, which the program goes on
    /// from, while the tool stands where the last move of `out` ends.
    pub fn finish(mut self, out: &mut Vec<Step<T, E>>) -> Result<AxisVector, Refusal> {
        if let Some(last) = self.last {
            self.settle(&last, Flat::of(&self.centre, self.plane), true)?;
        }
        self.release(None, out);
        Ok(self.programmed)
    }

    fn wait(&mut self, waiting: Step<T, E>) -> Result<(), Refusal> {
        if self.waiting.len() >= WAITING_MAX {
            let found =
                format!("more than {WAITING_MAX} moves and events without motion in the plane");
            let right = "end the compensation (G40) before such a stretch";
            return wrong(found, right);
        }
        self.waiting.push(waiting);
        Ok(())
    }

    /// Sends on what waits; the moves end at `end` in the plane if that is given.
    fn release(&mut self, end: Option<Flat>, out: &mut Vec<Step<T, E>>) {
        let waiting = std::mem::take(&mut self.waiting);
        out.extend(waiting.into_iter().map(|waiting| match waiting {
            Step::Event(event) => Step::Event(event),
            Step::Move(mut step) => {
                if let Some(end) = end {
                    step.to = end.put_into(step.to, self.plane);
                }
                Step::Move(self.with_tip(step))
            }
        }));
    }

    /// A move of the centre as one of the controlled point.
    fn with_tip(&self, mut step: Move<T>) -> Move<T> {
        let end = Flat::of(&step.to, self.plane) + self.tip;
        step.to = end.put_into(step.to, self.plane);
        if let Way::Arc(bow) = &mut step.way {
            bow.centre = bow.centre + self.tip;
        }
        step
    }

    /// The side of a direction on which the tool is.
    fn beside(&self, direction: Flat) -> Flat {
        match self.side {
            Side::Left => direction.left(),
            Side::Right => -direction.left(),
        }
    }

    /// Whether the tool is on the centre's side of an arc.
    fn inside(&self, clockwise: bool) -> bool {
        (self.side == Side::Left) != clockwise
    }

    /// Judges the last move with this end: that it does not run back, which would cut into the contour.
    fn settle(&self, last: &Last, end: Flat, strict: bool) -> Result<(), Refusal> {
        let does_not_fit = || {
            let found = format!(
                "the tool radius {} mm does not fit the inside corner before this block",
                shown(self.radius_mm)
            );
            let right = "a smaller tool, or a contour whose inside corners and curves are wider than the tool";
            wrong(found, right)
        };
        let fits = match last.way {
            Way::Arc(bow) => {
                let more_rad = bow.sweep_rad(last.start, end) - last.sweep_rad;
                let half_turn_rad = std::f64::consts::PI;
                more_rad
                    <= if strict {
                        SWEEP_ROUNDING_RAD
                    } else {
                        half_turn_rad
                    }
            }
            Way::Line | Way::Rapid => {
                let back_mm = self.back_mm(last, end);
                let lost_mm = back_mm * last.turned_rad / 2.0;
                match strict || last.behind_corner {
                    true => back_mm <= ROUNDING_MM,
                    false => lost_mm <= TANGENT_LOSS * self.radius_mm,
                }
            }
        };
        if fits { Ok(()) } else { does_not_fit() }
    }

    /// Refuses numbers whose products would overflow.
    fn check_range(&self, next: &Move<T>) -> Result<(), Refusal> {
        let centre = match next.way {
            Way::Arc(bow) => bow.centre,
            _ => Flat::default(),
        };
        let numbers = next.to.iter().copied();
        let fine = numbers
            .chain([centre.u, centre.v, self.radius_mm])
            .all(|number| number.abs() <= FARTHEST_MM);
        if fine {
            return Ok(());
        }
        let right = "coordinates must stay in the range of ordinary numbers";
        wrong("a place beyond all machines", right)
    }

    /// How far a line runs back if it ends here; 0 if it goes forward.
    fn back_mm(&self, last: &Last, end: Flat) -> f64 {
        last.along
            .map_or(0.0, |along| (-(end - last.start).dot(along)).max(0.0))
    }
}

/// A length for people: four decimals, without zeros at the end.
fn shown(value_mm: f64) -> String {
    let text = format!("{value_mm:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
