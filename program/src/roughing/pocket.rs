//! Roughing in levels, on a profile that runs to smaller Z and larger X.

use super::segment::{Cut, NEAR, Segment};
use super::{Cuts, Pockets, Profile, Roughing};
use crate::flat::Flat;
use crate::refusal::{Refusal, wrong};

/// An arc shorter than this is not cut, in mm.
const ARC_MIN_MM: f64 = 1e-3;

/// A level below every profile.
const BOTTOM_MM: f64 = -1e9;

/// The most pockets in pockets, and the most steps without a cut.
const ROUNDS_MAX: usize = 200_000;

/// How a piece goes on where the tool is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Course {
    /// The tool went on along it.
    Followed,
    /// It does not lead this way (any more).
    Turns,
}

/// A roughing on its way.
struct Rough<'a> {
    segments: &'a [Segment],
    depth_mm: f64,
    /// From the end of a cut; back at its beginning the first component turns round.
    escape: Flat,
    tool: Flat,
    cuts: &'a mut Cuts,
}

impl Profile {
    /// Roughs it.
    pub(super) fn rough(&mut self, words: &Roughing, cuts: &mut Cuts) -> Result<(), Refusal> {
        let right = "the profile must run one way along the cuts: G71 along Z, G72 along X";
        if !self.segments.iter().skip(1).all(Segment::is_monotonic) {
            return wrong("a profile that turns back", right);
        }
        let (Some(first), Some(last)) = (self.segments.first(), self.segments.last()) else {
            return Ok(());
        };
        let (start, end) = (first.from, last.to);
        cuts.push(Cut::Rapid(start))?;
        if end.v < start.v {
            self.segments.push(Segment {
                from: end,
                to: Flat::new(end.u, start.v),
                arc: None,
            });
        }
        Rough {
            segments: &self.segments,
            depth_mm: words.depth_mm,
            escape: Flat::new(words.retract_mm, words.retract_mm),
            tool: start,
            cuts,
        }
        .levels(words.pockets)
    }
}

impl Rough<'_> {
    /// Level by level down the profile, and up again behind its lowest places.
    fn levels(mut self, mut pockets: Pockets) -> Result<(), Refusal> {
        let mut top = self.tool.v;
        let lowest = (self.segments.iter()).fold(top, |low, segment| low.min(segment.lowest()));
        if (top - lowest) / self.depth_mm > ROUNDS_MAX as f64 {
            let found = format!("a depth of cut I of {} mm", self.depth_mm);
            return wrong(found, "a depth that takes fewer cuts");
        }
        let mut level = top;
        let mut index = 0;
        if pockets == Pockets::Only {
            index = self.dive_to_bottom()?;
            let Some(pocket) = self.climb_to_pocket(index)? else {
                return Ok(());
            };
            index = pocket;
            top = self.tool.v;
            level = top;
            pockets = Pockets::Cut;
        }
        for _ in 0..ROUNDS_MAX {
            let Some(segment) = self.segments.get(index) else {
                return Ok(());
            };
            while level > self.tool.v {
                level -= self.depth_mm;
            }
            if self.dive(segment, level, index == 0)? == Course::Turns {
                if pockets == Pockets::Leave {
                    return self.climb_past_pockets(index);
                }
                let Some(pocket) = self.climb_to_pocket(index)? else {
                    return Ok(());
                };
                index = pocket;
                level = top;
            } else if (self.tool.v - level).abs() > NEAR {
                // The level lies below this piece.
                index += 1;
            } else {
                index = self.cut_level(index, &mut level)?;
            }
        }
        let right = "a profile whose pieces do not touch each other, or another depth of cut I";
        wrong("a profile whose cuts come to no end", right)
    }

    /// Follows the profile down to its first lowest place, without cuts; the piece that goes up from there.
    fn dive_to_bottom(&mut self) -> Result<usize, Refusal> {
        for (index, segment) in self.segments.iter().enumerate() {
            if self.dive(segment, BOTTOM_MM, index == 0)? == Course::Turns {
                return Ok(index);
            }
        }
        Ok(self.segments.len())
    }

    /// Follows a piece down to a level, or to its end if that is above the level. The way to the profile is free.
    fn dive(&mut self, segment: &Segment, level: f64, is_free: bool) -> Result<Course, Refusal> {
        let end = match segment.arc {
            None => {
                if segment.from.v <= segment.to.v {
                    return Ok(Course::Turns);
                }
                let end = if level < segment.to.v {
                    segment.to
                } else {
                    let crossing = segment.crossings(level).first().copied();
                    let no_place = || {
                        let right = "a profile that begins at the X of the start or below";
                        Refusal::new(0, "a cut above the profile", right)
                    };
                    Flat::new(crossing.ok_or_else(no_place)?, level)
                };
                self.cuts.push(if is_free {
                    Cut::Rapid(end)
                } else {
                    Cut::Feed(end)
                })?;
                end
            }
            Some((centre, counter_clockwise)) => {
                if (self.tool - segment.to).length() < ARC_MIN_MM {
                    return Ok(Course::Followed);
                }
                if (self.tool.u > centre.u) == counter_clockwise {
                    return Ok(Course::Turns);
                }
                let crossings = segment.crossings(level);
                let place = if counter_clockwise {
                    crossings.last().filter(|&&first| first <= centre.u)
                } else {
                    crossings.first().filter(|&&first| first >= centre.u)
                };
                match place {
                    None => {
                        self.cuts.push(segment.cut_to(segment.to))?;
                        segment.to
                    }
                    Some(&first) => self.cut_arc(segment, Flat::new(first, level))?,
                }
            }
        };
        self.tool = end;
        Ok(Course::Followed)
    }

    /// Cuts an arc up to a point on it, if there is something to cut.
    fn cut_arc(&mut self, segment: &Segment, to: Flat) -> Result<Flat, Refusal> {
        if (self.tool - to).length() > ARC_MIN_MM {
            self.cuts.push(segment.cut_to(to))?;
        }
        Ok(to)
    }

    /// Cuts at the level of the tool until the profile stops it, and returns; the piece to go on with.
    fn cut_level(&mut self, index: usize, level: &mut f64) -> Result<usize, Refusal> {
        for (ahead, segment) in self.segments.iter().enumerate().skip(index) {
            let crossings = segment.crossings(self.tool.v);
            let stop = if ahead == index {
                crossings.last()
            } else {
                crossings.first()
            };
            let Some(&stop) = stop else {
                continue;
            };
            let length_mm = (stop - self.tool.u).abs();
            if length_mm < NEAR {
                if ahead == index {
                    continue;
                }
                *level -= self.depth_mm;
                break;
            }
            let end = Flat::new(stop, self.tool.v);
            // A cut that is too short for the whole retract.
            let share = (length_mm / 2.0 / self.escape.u).min(1.0);
            let share = if share.is_nan() { 1.0 } else { share };
            let away = self.escape * share;
            self.cuts.push(Cut::Feed(end))?;
            self.cuts.push(Cut::Rapid(end + away))?;
            self.cuts
                .push(Cut::Rapid(self.tool + Flat::new(-away.u, away.v)))?;
            self.cuts.push(if index == 0 {
                Cut::Rapid(self.tool)
            } else {
                Cut::Feed(self.tool)
            })?;
            *level -= self.depth_mm;
            break;
        }
        Ok(index)
    }

    /// Follows the profile up to the next pocket: the piece that leads down into it.
    fn climb_to_pocket(&mut self, index: usize) -> Result<Option<usize>, Refusal> {
        for (ahead, segment) in self.segments.iter().enumerate().skip(index) {
            let Some((centre, counter_clockwise)) = segment.arc else {
                if segment.to.v < segment.from.v {
                    return Ok(Some(ahead));
                }
                if (self.tool - segment.from).length() > NEAR {
                    let right = "a profile whose arcs end at their lowest and highest places";
                    return wrong("a profile that is left beside its end", right);
                }
                self.cuts.push(Cut::Feed(segment.to))?;
                self.tool = segment.to;
                continue;
            };
            let ahead_mm = self.tool.u - centre.u;
            if (counter_clockwise && ahead_mm < 0.0) || (!counter_clockwise && ahead_mm > 0.0) {
                // Not in the quarter that leads up.
                return Ok(Some(ahead));
            }
            let top = segment.top(centre);
            if counter_clockwise {
                self.tool = self.cut_arc(segment, top)?;
                if top != segment.to {
                    return Ok(Some(ahead));
                }
            } else {
                self.tool = self.cut_arc(segment, segment.to)?;
            }
        }
        Ok(None)
    }

    /// Follows the profile up wherever it goes up from the level reached, over the pockets.
    fn climb_past_pockets(&mut self, index: usize) -> Result<(), Refusal> {
        for segment in self.segments.iter().skip(index) {
            let crossings = segment.crossings(self.tool.v);
            let place = match segment.arc {
                None if segment.to.v < segment.from.v => None,
                None => crossings.first(),
                Some((centre, false)) => crossings.last().filter(|&&first| first <= centre.u),
                Some((centre, true)) => crossings.first().filter(|&&first| first >= centre.u),
            };
            let Some(&first) = place else {
                continue;
            };
            self.tool.u = first;
            self.cuts.push(Cut::Feed(self.tool))?;
            self.tool = match segment.arc {
                None => {
                    self.cuts.push(Cut::Feed(segment.to))?;
                    segment.to
                }
                Some((_, false)) => self.cut_arc(segment, segment.to)?,
                Some((centre, true)) => self.cut_arc(segment, segment.top(centre))?,
            };
        }
        Ok(())
    }
}
