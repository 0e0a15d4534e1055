//! Lathe cycles G70 (finishing), G71 (roughing along Z) and G72 (roughing along X), as LinuxCNC's manual describes them:
//! from a profile to moves of the tool.
//!
//! A profile is turned and mirrored until it runs to smaller Z and larger X; there the cycles have one form:
//!
//! - *Offset*: every piece beside itself by the distance to leave, outside corners rounded, inside corners cut off where
//!   the pieces meet.
//! - *Roughing*: from the start level down in steps. At each level the tool cuts along until the profile stops it, draws
//!   back at 45 degrees by R, and returns. Past the lowest place it follows the profile up; where the profile falls again
//!   there is a pocket, cut in the same way (G71), left alone (G71.1), or cut on its own (G71.2).
//! - *Finishing*: along the profile, from the first distance to the last in equal passes.

mod offset;
mod pocket;
mod segment;
#[cfg(test)]
mod tests;

use crate::flat::Flat;
use crate::refusal::{Refusal, wrong};
use segment::Segment;

pub use segment::Cut;

/// The most moves of one cycle.
const CUTS_MAX: usize = 100_000;

/// The most pieces of a profile.
pub const PIECES_MAX: usize = 10_000;

/// One piece of a profile: Z is the first, X the second coordinate, in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Where it ends; it begins where the one before ends.
    pub to: Flat,
    /// Centre and direction (G3 rather than G2) if it is an arc.
    pub arc: Option<(Flat, bool)>,
}

/// What of a profile is roughed: the decimal of G71 and G72.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pockets {
    /// G71: as they come.
    Cut,
    /// G71.1: not at all.
    Leave,
    /// G71.2: they alone, behind a G71.1.
    Only,
}

/// The words of G71 and G72.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roughing {
    /// Where the cuts begin (Z and X words).
    pub start: Flat,
    /// D: how much is left for finishing, in mm.
    pub leave_mm: f64,
    /// I: depth of a cut, in mm.
    pub depth_mm: f64,
    /// R: how far the tool draws back, in mm.
    pub retract_mm: f64,
    /// W and U: shift of the profile along Z and X, in mm.
    pub shift: Flat,
    /// Which pockets.
    pub pockets: Pockets,
    /// G72: along X.
    pub facing: bool,
}

/// The words of G70.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finishing {
    /// Where the cuts begin (Z and X words).
    pub start: Flat,
    /// D: distance of the pass before the first, in mm.
    pub from_mm: f64,
    /// E: distance of the last pass, in mm.
    pub to_mm: f64,
    /// P: how many passes.
    pub passes: u32,
}

/// Moves of a cycle while it is made, given as the profile lies in the program.
struct Cuts {
    facing: Facing,
    cuts: Vec<Cut>,
}

impl Cuts {
    fn push(&mut self, cut: Cut) -> Result<(), Refusal> {
        if self.cuts.len() >= CUTS_MAX {
            let found = format!("a cycle of more than {CUTS_MAX} moves");
            return wrong(found, "a larger I, or a smaller profile");
        }
        let back = |point| self.facing.back(point);
        self.cuts.push(match cut {
            Cut::Rapid(to) => Cut::Rapid(back(to)),
            Cut::Feed(to) => Cut::Feed(back(to)),
            Cut::Arc {
                to,
                centre,
                counter_clockwise,
            } => Cut::Arc {
                to: back(to),
                centre: back(centre),
                counter_clockwise: counter_clockwise != self.facing.mirrored(),
            },
        });
        Ok(())
    }
}

/// How a profile was turned and mirrored: by a quarter turn clockwise first, then over each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Facing {
    turned: bool,
    first: bool,
    second: bool,
}

impl Facing {
    /// A point as it lay in the program.
    fn back(self, point: Flat) -> Flat {
        let first = if self.first { -point.u } else { point.u };
        let second = if self.second { -point.v } else { point.v };
        if self.turned {
            Flat::new(-second, first)
        } else {
            Flat::new(first, second)
        }
    }

    /// Whether arcs go the other way round.
    fn mirrored(self) -> bool {
        self.first != self.second
    }
}

/// A profile while it is worked on.
#[derive(Debug, Clone)]
struct Profile {
    segments: Vec<Segment>,
    facing: Facing,
}

impl Profile {
    /// A profile that begins at `start`, where the tool comes from.
    fn new(pieces: &[Piece], start: Flat) -> Result<Self, Refusal> {
        if pieces.len() < 2 || pieces.len() > PIECES_MAX {
            let found = format!("a profile of {} moves", pieces.len());
            let right =
                format!("a move to its beginning and at least one along it, at most {PIECES_MAX}");
            return wrong(found, right);
        }
        let finite = pieces.iter().all(|piece| {
            let centre = piece.arc.map_or(Flat::default(), |(centre, _)| centre);
            (piece.to.length() + centre.length()) < 1e9
        });
        if !finite {
            let right = "coordinates in the range of ordinary numbers";
            return wrong("a profile beyond all machines", right);
        }
        let mut from = start;
        let segments = pieces
            .iter()
            .map(|piece| {
                let segment = Segment {
                    from,
                    to: piece.to,
                    arc: piece.arc,
                };
                from = piece.to;
                segment
            })
            .collect();
        Ok(Self {
            segments,
            facing: Facing::default(),
        })
    }

    /// Turns it by a quarter.
    fn turn(&mut self) {
        for segment in &mut self.segments {
            segment.turn();
        }
        self.facing.turned = !self.facing.turned;
    }

    /// A tool that stands over the profile, not before its beginning, goes beside the beginning first: the way from there is free.
    fn begin_beside(&mut self) {
        if let Some(first) = self.segments.first_mut() {
            first.from.u = first.from.u.max(first.to.u);
        }
    }

    /// Mirrors it until it runs to smaller Z and larger X.
    fn align(&mut self) {
        let (Some(first), Some(last)) = (self.segments.first(), self.segments.last()) else {
            return;
        };
        let span = first.to - last.to;
        let (over_first, over_second) = (span.u < 0.0, span.v > 0.0);
        for segment in &mut self.segments {
            segment.mirror(over_first, over_second);
        }
        self.facing.first ^= over_first;
        self.facing.second ^= over_second;
    }
}

/// The moves of G71 and G72.
pub fn roughing(pieces: &[Piece], words: &Roughing) -> Result<Vec<Cut>, Refusal> {
    if !(words.depth_mm > 0.0 && words.depth_mm.is_finite()) {
        let found = format!("a depth of cut I of {} mm", words.depth_mm);
        return wrong(found, "I is above 0");
    }
    let mut profile = Profile::new(pieces, words.start)?;
    if words.facing {
        profile.turn();
    }
    profile.align();
    profile.begin_beside();
    profile.offset(words.leave_mm)?;
    for segment in &mut profile.segments {
        segment.shift(words.shift);
    }
    let mut cuts = Cuts {
        facing: profile.facing,
        cuts: Vec::new(),
    };
    profile.rough(words, &mut cuts)?;
    Ok(cuts.cuts)
}

/// The moves of G70.
pub fn finishing(pieces: &[Piece], words: &Finishing) -> Result<Vec<Cut>, Refusal> {
    let given = Profile::new(pieces, words.start)?;
    let mut profile = given.clone();
    profile.align();
    profile.begin_beside();
    if !profile.segments.iter().all(Segment::is_monotonic) {
        profile = given;
        profile.turn();
        profile.align();
        profile.begin_beside();
    }
    let mut cuts = Cuts {
        facing: profile.facing,
        cuts: Vec::new(),
    };
    for pass in (1..=words.passes).rev() {
        let share = f64::from(pass - 1) / f64::from(words.passes);
        let mut beside = profile.clone();
        beside.offset(share * (words.from_mm - words.to_mm) + words.to_mm)?;
        let Some((first, along)) = beside.segments.split_first() else {
            continue;
        };
        cuts.push(Cut::Rapid(first.from))?;
        cuts.push(Cut::Rapid(first.to))?;
        for segment in along {
            cuts.push(segment.cut_to(segment.to))?;
        }
    }
    Ok(cuts.cuts)
}
