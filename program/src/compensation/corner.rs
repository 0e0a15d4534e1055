//! The moves in the plane: lead-ins, and how each move joins the one before.

use super::*;
use crate::flat::{circles_meet, line_meets_circle};

/// What lies between two moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Joint {
    /// They go on in one direction.
    Tangent,
    /// The tool goes round the corner.
    Outside,
    /// The paths of the centre meet before the corner.
    Inside,
}

impl<T: Clone, E> Compensation<T, E> {
    /// The lead-in by a line: more than a radius long, ending beside its end.
    pub(super) fn lead_in(&mut self, next: Move<T>, to: Flat) -> Result<(), Refusal> {
        let start = Flat::of(&self.centre, self.plane);
        let length_mm = (to - start).length();
        let right = "begin with a straight move in the plane that is longer than the tool radius";
        let too_short = || {
            let (length, radius) = (shown(length_mm), shown(self.radius_mm));
            let found = format!("a lead-in of {length} mm for a tool radius of {radius} mm");
            Refusal::new(0, found, right)
        };
        if length_mm <= self.radius_mm {
            return Err(too_short());
        }
        let tangent = (to - start).unit().ok_or_else(too_short)?;
        let end = to + self.beside(tangent) * self.radius_mm;
        let last = Last::of(start, next.way, tangent);
        self.go_on(next, end, last)
    }

    /// The lead-in by an arc: the programmed arc leads from the tool's centre to the contour; the tool takes the one
    /// that ends beside its end, tangent to it.
    pub(super) fn arc_in(
        &mut self,
        mut next: Move<T>,
        bow: Bow,
        to: Flat,
        out: &mut Vec<Step<T, E>>,
    ) -> Result<(), Refusal> {
        let start = Flat::of(&self.centre, self.plane);
        let right =
            "a lead-in arc reaches farther than the tool radius, and the tool fits inside it";
        let refuse = |what: &str| {
            let radius = shown(self.radius_mm);
            let found = format!("a lead-in arc {what} for a tool radius of {radius} mm");
            Refusal::new(0, found, right)
        };
        if (to - start).length() <= self.radius_mm {
            return Err(refuse("too short"));
        }
        let inward = (bow.centre - to).unit();
        let inward = inward.ok_or_else(|| refuse("without a radius"))?;
        if self.inside(bow.clockwise) && (bow.centre - start).length() <= self.radius_mm {
            return Err(refuse("too tight"));
        }
        let end = to + inward * self.inward_mm(bow.clockwise);
        let centre = tangent_centre(start, end, inward);
        let centre = centre.ok_or_else(|| refuse("that cannot be tangent there"))?;
        let bow = Bow { centre, ..bow };
        next.way = Way::Arc(bow);
        if self.tip != Flat::default() {
            // The controlled point of a lathe tool first goes where the nose is as the arc needs it.
            let mut first = next.clone();
            first.way = Way::Line;
            first.to = start.put_into(next.to, self.plane);
            self.keep_across(&mut first.to);
            out.push(Step::Move(self.with_tip(first)));
        }
        let last = Last {
            sweep_rad: bow.sweep_rad(start, end),
            ..Last::of(start, next.way, around(-inward, bow.clockwise))
        };
        self.go_on(next, end, last)
    }

    /// A move without motion in the plane: it stays behind the move before, wherever that will end.
    pub(super) fn move_across(&mut self, mut next: Move<T>) -> Result<(), Refusal> {
        next.to = Flat::of(&self.centre, self.plane).put_into(next.to, self.plane);
        self.centre = next.to;
        self.wait(Step::Move(next))
    }

    /// A straight move behind another.
    pub(super) fn line(
        &mut self,
        next: Move<T>,
        last: Last,
        from: Flat,
        to: Flat,
        out: &mut Vec<Step<T, E>>,
    ) -> Result<(), Refusal> {
        let too_short = || Refusal::new(0, "a move that is too short", "leave it out");
        let along = (to - from).unit().ok_or_else(too_short)?;
        let beside = self.beside(along) * self.radius_mm;
        let joint = self.joint(&last, along, None);
        let start = match joint {
            Joint::Tangent => self.join(&last, None, out)?,
            Joint::Outside => self.go_round(&last, [from, from + beside], &next, true, out)?,
            Joint::Inside => {
                let meeting = self.line_meeting(&last, from, along);
                let meeting = meeting.ok_or_else(|| self.does_not_reach("line"))?;
                self.join(&last, Some(meeting), out)?
            }
        };
        let last = Last {
            along: Some(along),
            turned_rad: self.turned_rad(&last, along),
            behind_corner: joint == Joint::Inside,
            ..Last::of(start, next.way, along)
        };
        self.go_on(next, to + beside, last)
    }

    /// An arc behind another move.
    pub(super) fn arc(
        &mut self,
        next: Move<T>,
        bow: Bow,
        last: Last,
        [from, to]: [Flat; 2],
        out: &mut Vec<Step<T, E>>,
    ) -> Result<(), Refusal> {
        let Bow {
            centre, clockwise, ..
        } = bow;
        let right = "a centre away from its ends";
        let no_radius = || Refusal::new(0, "an arc of radius zero", right);
        let [spoke, end_spoke] = [from - centre, to - centre];
        let outward = spoke.unit().ok_or_else(no_radius)?;
        let end_outward = end_spoke.unit().ok_or_else(no_radius)?;
        let inside = self.inside(clockwise);
        let arc_radius_mm = end_spoke.length();
        if inside {
            self.check_fits_inside(arc_radius_mm)?;
        }
        let signed_mm = -self.inward_mm(clockwise);
        let tangent = around(outward, clockwise);
        let joint = self.joint(&last, tangent, Some(inside));
        let start = match joint {
            Joint::Tangent => self.join(&last, None, out)?,
            Joint::Outside => {
                let corner = [from, from + outward * signed_mm];
                self.go_round(&last, corner, &next, false, out)?
            }
            Joint::Inside => {
                let circle = Circle {
                    centre,
                    radius_mm: arc_radius_mm + signed_mm,
                    corner: centre + outward * arc_radius_mm,
                    clockwise,
                };
                let meeting = self.arc_meeting(&last, circle);
                let meeting = meeting.ok_or_else(|| self.does_not_reach("arc"))?;
                self.join(&last, Some(meeting), out)?
            }
        };
        let last = Last {
            sweep_rad: bow.sweep_rad(from, to),
            turned_rad: self.turned_rad(&last, tangent),
            behind_corner: joint == Joint::Inside,
            ..Last::of(start, next.way, around(end_outward, clockwise))
        };
        self.go_on(next, to + end_outward * signed_mm, last)
    }

    /// Refuses an arc that the tool does not fit inside.
    /// From a contour that turns so to the centre of the tool, towards the centre of the turn.
    fn inward_mm(&self, clockwise: bool) -> f64 {
        match self.inside(clockwise) {
            true => self.radius_mm,
            false => -self.radius_mm,
        }
    }

    fn check_fits_inside(&self, arc_radius_mm: f64) -> Result<(), Refusal> {
        if arc_radius_mm > self.radius_mm {
            return Ok(());
        }
        let found = format!(
            "the tool radius {} mm does not fit inside an arc of radius {} mm",
            shown(self.radius_mm),
            shown(arc_radius_mm)
        );
        wrong(found, "a smaller tool, or a larger arc")
    }

    /// Lets a move wait that ends here, for now.
    fn go_on(&mut self, mut next: Move<T>, end: Flat, last: Last) -> Result<(), Refusal> {
        next.to = end.put_into(next.to, self.plane);
        self.centre = next.to;
        self.last = Some(last);
        self.wait(Step::Move(next))
    }

    /// How the next move, in this direction at its start, joins the last; `arc_inside` says of an arc that the tool is
    /// inside it.
    fn joint(&self, last: &Last, tangent: Flat, arc_inside: Option<bool>) -> Joint {
        let to_tool_rad = self.turn_rad(last, tangent);
        if to_tool_rad.abs() <= TANGENT_RAD {
            return Joint::Tangent;
        }
        if to_tool_rad.abs() >= std::f64::consts::PI - TANGENT_RAD {
            // Straight back: round the end, but for arcs whose outside bars that way.
            let bars = match (arc_inside, last.way) {
                (Some(inside), _) => !inside,
                (None, Way::Arc(bow)) => !self.inside(bow.clockwise),
                (None, _) => false,
            };
            return if bars { Joint::Inside } else { Joint::Outside };
        }
        if to_tool_rad > 0.0 {
            Joint::Inside
        } else {
            Joint::Outside
        }
    }

    /// By how much the contour turns to the tool's side, in rad; negative away from it.
    fn turn_rad(&self, last: &Last, tangent: Flat) -> f64 {
        let left_rad = last.tangent.angle_to(tangent);
        match self.side {
            Side::Left => left_rad,
            Side::Right => -left_rad,
        }
    }

    /// The turn to the tool's side since the tool last went forward.
    fn turned_rad(&self, last: &Last, tangent: Flat) -> f64 {
        let ends = Flat::of(&self.centre, self.plane);
        // A line that runs back has not gone forward: its turn counts on, and tells how much of the contour is lost.
        let goes_back = self.back_mm(last, ends) > ROUNDING_MM;
        let before_rad = if goes_back { last.turned_rad } else { 0.0 };
        before_rad + self.turn_rad(last, tangent).max(0.0)
    }

    /// Ends the last move where the next begins: at the meeting of an inside corner, else beside its end.
    fn join(
        &mut self,
        last: &Last,
        meeting: Option<Flat>,
        out: &mut Vec<Step<T, E>>,
    ) -> Result<Flat, Refusal> {
        let end = meeting.unwrap_or_else(|| Flat::of(&self.centre, self.plane));
        self.settle(last, end, meeting.is_some())?;
        self.release(meeting, out);
        Ok(end)
    }

    /// Ends the last move beside its end and goes round the corner.
    fn go_round(
        &mut self,
        last: &Last,
        [centre, end]: [Flat; 2],
        next: &Move<T>,
        strict: bool,
        out: &mut Vec<Step<T, E>>,
    ) -> Result<Flat, Refusal> {
        // The last move is whole now: it ends beside the corner, and goes out before the arc round it.
        self.settle(last, Flat::of(&self.centre, self.plane), strict)?;
        self.release(None, out);
        let mut round = next.clone();
        round.to = end.put_into(next.to, self.plane);
        self.keep_across(&mut round.to);
        round.way = match next.way {
            Way::Rapid => Way::Rapid,
            _ => Way::Arc(Bow {
                centre,
                clockwise: self.side == Side::Left,
                turns: 1,
            }),
        };
        out.push(Step::Move(self.with_tip(round)));
        Ok(end)
    }

    /// Keeps the axis across the plane where it is.
    fn keep_across(&self, to: &mut AxisVector) {
        if let Some(across) = self.across
            && let (Some(component), Some(here)) = (to.get_mut(across), self.centre.get(across))
        {
            *component = *here;
        }
    }

    /// Where the centre's path along the last move meets that along a line from `from`.
    fn line_meeting(&self, last: &Last, from: Flat, along: Flat) -> Option<Flat> {
        match last.way {
            Way::Line | Way::Rapid => {
                // Two lines beside their contours meet on the bisector, radius · tan(half the turn) before the end of the first.
                let half_rad = self.turn_rad(last, along) / 2.0;
                let back_mm = self.radius_mm * libm::tan(half_rad);
                Some(Flat::of(&self.centre, self.plane) - last.tangent * back_mm)
            }
            Way::Arc(Bow {
                centre, clockwise, ..
            }) => {
                let radius_mm = (Flat::of(&self.centre, self.plane) - centre).length();
                let point = from + self.beside(along) * self.radius_mm;
                let meetings = line_meets_circle(point, along, centre, radius_mm)?;
                // With the tool inside the arc, the line turns into its circle: they meet where it enters; else where it comes out.
                Some(first_if(self.inside(clockwise), meetings))
            }
        }
    }

    /// Where the centre's path along the last move meets that round the next.
    fn arc_meeting(&self, last: &Last, circle: Circle) -> Option<Flat> {
        let Circle {
            centre,
            radius_mm,
            corner,
            clockwise,
        } = circle;
        match last.way {
            Way::Line | Way::Rapid => {
                let beside = corner + self.beside(last.tangent) * self.radius_mm;
                let meetings = line_meets_circle(beside, last.tangent, centre, radius_mm)?;
                // From inside its circle the line meets the arc where it comes out; else where it enters.
                Some(first_if(!self.inside(clockwise), meetings))
            }
            Way::Arc(before) => {
                let before_mm = (Flat::of(&self.centre, self.plane) - before.centre).length();
                let meetings = circles_meet(before.centre, before_mm, centre, radius_mm)?;
                // The meetings mirror each other across the line between the centres: side and direction choose.
                Some(first_if(
                    self.inside(before.clockwise) != clockwise,
                    meetings,
                ))
            }
        }
    }

    fn does_not_reach(&self, what: &str) -> Refusal {
        let found = format!(
            "the tool radius {} mm does not fit the inside corner before this {what}",
            shown(self.radius_mm)
        );
        Refusal::new(0, found, "a smaller tool, or a wider corner")
    }
}

fn first_if(first: bool, [one, other]: [Flat; 2]) -> Flat {
    if first { one } else { other }
}

/// The path round an arc that begins at an inside corner.
#[derive(Debug, Clone, Copy)]
struct Circle {
    centre: Flat,
    /// Of the path of the tool's centre.
    radius_mm: f64,
    /// The corner, on the radius of the arc's end, as LinuxCNC takes it where the ends' radii disagree by rounding.
    corner: Flat,
    clockwise: bool,
}

/// The centre of the arc from `start` that arrives at `end` across `inward`; none where it would come from ahead, against the
/// programmed direction (LinuxCNC makes that).
fn tangent_centre(start: Flat, end: Flat, inward: Flat) -> Option<Flat> {
    // On the normal of the contour at the end, as far from the start as from the end.
    let chord = start - end;
    let along = chord.dot(inward);
    let is_beside = along >= 1e-4 * chord.length() && along > 0.0;
    is_beside.then(|| end + inward * (chord.dot(chord) / (2.0 * along)))
}

/// The direction of travel round a centre that lies in the other direction than `outward`.
fn around(outward: Flat, clockwise: bool) -> Flat {
    if clockwise {
        -outward.left()
    } else {
        outward.left()
    }
}
