//! A profile beside a profile: what is left for finishing.

use super::Profile;
use super::segment::Segment;
use crate::flat::Flat;
use crate::refusal::{Refusal, wrong};

/// A piece smaller than this is left out, in mm.
const PIECE_MIN_MM: f64 = 1e-3;

/// Ends of pieces that part by more than this in Z are joined by an arc; nearer ones are extended, in mm.
const GAP_MIN_MM: f64 = 1e-2;

/// Circles that miss each other by this share of a radius touch.
const TOUCH: f64 = 1e-3;

/// The most steps of an offset; each takes at least half a smallest piece.
const STEPS_MAX: usize = 100_000;

impl Profile {
    /// Puts the profile, without the way to it, `distance_mm` beside itself, to the side from which the tool comes. It is
    /// done in steps of no more than half the smallest piece, so that pieces vanish one by one.
    pub(super) fn offset(&mut self, distance_mm: f64) -> Result<(), Refusal> {
        self.align();
        if !(distance_mm.is_finite() && distance_mm.abs() < 1e6) {
            return wrong("a distance to the profile", "a length");
        }
        let Some((&way, along)) = self.segments.split_first() else {
            return Ok(());
        };
        let Some(last) = along.last() else {
            return Ok(());
        };
        // Seen from the start, the profile's beginning lies to the left of its end: the tool comes from below.
        let from_below = (last.from - way.from).cross(way.to - way.from) < 0.0;
        let distance_mm = if from_below {
            -distance_mm
        } else {
            distance_mm
        };
        let mut along = along.to_vec();
        let mut done_mm = 0.0;
        for _ in 0..STEPS_MAX {
            if done_mm == distance_mm {
                break;
            }
            let half_mm = (along.iter()).fold(1e9, |least: f64, it| least.min(it.size_mm() / 2.0));
            let step_mm = half_mm
                .min((distance_mm - done_mm).abs())
                .copysign(distance_mm);
            step(&mut along, step_mm)?;
            done_mm += step_mm;
        }
        if done_mm != distance_mm {
            return Err(does_not_fit());
        }
        for index in 1..along.len() {
            if let [before, after] = &mut along[index - 1..=index] {
                let middle = (before.to + after.from) * 0.5;
                before.to = middle;
                after.from = middle;
            }
        }
        let Some(begin) = along.first().map(|segment| segment.from) else {
            return Err(does_not_fit());
        };
        self.segments = std::iter::once(Segment { to: begin, ..way })
            .chain(along)
            .collect();
        Ok(())
    }
}

fn does_not_fit() -> Refusal {
    let right = "a smaller D or E, or a profile with larger pieces";
    Refusal::new(0, "a distance that the profile has no room for", right)
}

/// One step: each piece beside itself, pieces that vanish left out, corners joined.
fn step(along: &mut Vec<Segment>, step_mm: f64) -> Result<(), Refusal> {
    for segment in along.iter_mut() {
        segment.offset(step_mm);
    }
    along.retain(|segment| segment.size_mm() >= PIECE_MIN_MM);
    round_corners(along, step_mm);
    let mut index = 0;
    while index + 1 < along.len() {
        let smaller = |a: usize, b: usize| along[a].size_mm() < along[b].size_mm();
        if !along[index].is_monotonic() {
            if index == 0 {
                return Err(does_not_fit());
            }
            let before = index - 1;
            along.remove(if smaller(index, before) {
                index
            } else {
                before
            });
            index = 0;
        } else if along[index].size_mm() < PIECE_MIN_MM {
            along.remove(index);
            index = 0;
        } else {
            if let [before, after] = &mut along[index..index + 2] {
                meet(before, after)?;
            }
            index += 1;
        }
    }
    if along.is_empty() {
        return Err(does_not_fit());
    }
    Ok(())
}

/// Joins pieces that parted by arcs about the corner.
fn round_corners(along: &mut Vec<Segment>, step_mm: f64) {
    let mut index = 0;
    while index + 1 < along.len() {
        let (before, after) = (along[index], along[index + 1]);
        if before.to.u - after.from.u > GAP_MIN_MM {
            let (mut near, mut far) = (before, after);
            near.offset(-step_mm);
            far.offset(-step_mm);
            let corner = Segment {
                from: before.to,
                to: after.from,
                arc: Some(((near.to + far.from) * 0.5, step_mm > 0.0)),
            };
            index += 1;
            along.insert(index, corner);
        }
        index += 1;
    }
}

/// Ends one piece and begins the next where their lines or circles meet.
fn meet(before: &mut Segment, after: &mut Segment) -> Result<(), Refusal> {
    let ends = [before.to, after.from];
    let at = match (before.arc, after.arc) {
        (None, None) => {
            let (along, next) = (before.to - before.from, after.to - after.from);
            let across = along.cross(next);
            if across == 0.0 {
                let right = "a profile that does not go on straight: make one line of two";
                return wrong("two lines in one direction", right);
            }
            Some(before.from + along * ((after.from - before.from).cross(next) / across))
        }
        (Some((centre, _)), None) => line_and_circle(ends, *after, centre, before.to),
        (None, Some((centre, _))) => line_and_circle(ends, *before, centre, after.to),
        (Some((first, _)), Some((second, _))) => Some(circle_and_circle(
            (first, (before.from - first).length()),
            (second, (after.from - second).length()),
        )?),
    };
    if let Some(at) = at {
        before.to = at;
        after.from = at;
    }
    Ok(())
}

/// Where a line meets a circle through `on_circle`, nearest to `begin`, the beginning of the second piece; none where
/// both pieces already meet.
fn line_and_circle(
    [end, begin]: [Flat; 2],
    line: Segment,
    centre: Flat,
    on_circle: Flat,
) -> Option<Flat> {
    if (begin - end).length() < 1e-6 {
        return None;
    }
    let along = (line.from - line.to).unit()?;
    let away_mm = along.cross(centre - line.to);
    let radius_mm = (on_circle - centre).length();
    let half_mm = ((radius_mm - away_mm) * (radius_mm + away_mm))
        .max(0.0)
        .sqrt();
    let foot = line.to + along * along.dot(centre - line.to);
    let (far, near) = (foot + along * half_mm, foot - along * half_mm);
    let is_far = (begin - far).length() < (begin - near).length();
    Some(if is_far { far } else { near })
}

/// Where two circles, by centre and radius, meet: on the right of the way from the first centre to the second; where they
/// touch for circles that miss each other by rounding.
fn circle_and_circle(first: (Flat, f64), second: (Flat, f64)) -> Result<Flat, Refusal> {
    let back = first.0 - second.0;
    let along = back.unit().ok_or_else(does_not_fit)?;
    let (before_mm, after_mm, apart_mm) = (first.1, second.1, back.length());
    let cos = (apart_mm * apart_mm + after_mm * after_mm - before_mm * before_mm)
        / (2.0 * after_mm * apart_mm);
    if cos.is_nan() || cos.abs() > 1.0 + TOUCH {
        return Err(does_not_fit());
    }
    let sin = (1.0 - (cos * cos).min(1.0)).sqrt();
    Ok(second.0 + (along * cos + along.left() * sin) * after_mm)
}

impl Segment {
    /// Puts it beside itself, to larger X for a piece that runs to smaller Z; an arc about its centre.
    fn offset(&mut self, by_mm: f64) {
        match self.arc {
            None => {
                if let Some(back) = (self.from - self.to).unit() {
                    let shift = back.left() * by_mm;
                    self.from = self.from + shift;
                    self.to = self.to + shift;
                }
            }
            Some((centre, counter_clockwise)) => {
                let radius_mm = (self.from - centre).length();
                let more_mm = if counter_clockwise { by_mm } else { -by_mm };
                let factor = (radius_mm + more_mm) / radius_mm;
                self.from = centre + (self.from - centre) * factor;
                self.to = centre + (self.to - centre) * factor;
            }
        }
    }
}
