//! What rounding adds to one element: cubics in its distance.

use crate::path::AxisVector;

use super::{Junction, NEIGHBOURS};

/// `|c(d; h)|` is at most this share of `h²`: 0.0083.
pub(super) const BEND_SHARE: f64 = 120.0;

/// A cubic from a place on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubicPiece {
    /// Where it begins, in mm on its element.
    pub from_mm: f64,
    /// What is added there, and its first, second and third derivative with respect to the distance.
    pub derivatives: [AxisVector; 4],
}

impl CubicPiece {
    /// What is added at a distance on the element.
    pub fn value_at(&self, distance_mm: f64) -> AxisVector {
        let [value, first, second, third] = &self.derivatives;
        let y = distance_mm - self.from_mm;
        value + (first + (second + third * (y / 3.0)) * (y / 2.0)) * y
    }

    /// The same, and the first and second derivative of it.
    pub fn at(&self, distance_mm: f64) -> [AxisVector; 3] {
        let [_, first, second, third] = &self.derivatives;
        let y = distance_mm - self.from_mm;
        [
            self.value_at(distance_mm),
            first + (second + third * (y / 2.0)) * y,
            second + third * y,
        ]
    }
}

/// What rounding adds to an element.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    pieces: Vec<CubicPiece>,
}

/// Where a piece lies in a correction.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// From the outer end of the correction to the beginning of the piece, in half widths; the middle of the correction is at 1 from
    /// either side.
    from_end: f64,
    half_width_mm: f64,
    /// Right of the junction.
    is_right: bool,
    /// The piece lies in the outer half of its side.
    is_outer: bool,
}

impl Place {
    /// Of a piece that begins at `at_mm`; none if the correction begins later.
    fn of(junction: &Junction, at_mm: f64, is_right: bool) -> Option<Place> {
        let half_width_mm = junction.half_width_mm;
        let sign = if is_right { -1.0 } else { 1.0 };
        let from_end = 1.0 + sign * (at_mm - junction.at_mm) / half_width_mm;
        // Told from the jumps at its knots by the very same numbers.
        let is_beyond = if is_right {
            junction.at_mm + half_width_mm <= at_mm
        } else {
            junction.at_mm - half_width_mm > at_mm
        };
        let middle_mm = junction.at_mm - sign * 0.5 * half_width_mm;
        let is_outer = if is_right {
            middle_mm <= at_mm
        } else {
            middle_mm > at_mm
        };
        (!is_beyond).then(|| Place {
            from_end: from_end.max(0.0),
            half_width_mm,
            is_right,
            is_outer,
        })
    }

    /// `b` and its derivatives with respect to `d`, up to the third.
    fn of_kink(&self) -> [f64; 4] {
        let (y, h) = (self.from_end, self.half_width_mm);
        let sign = if self.is_right { -1.0 } else { 1.0 };
        [
            y * y * y * h / 6.0,
            sign * y * y / 2.0,
            y / h,
            sign / (h * h),
        ]
    }

    /// `c` and its derivatives with respect to `d`, up to the third.
    ///
    /// `c''` is the difference between a ramp over the whole width and the step it replaces, and a zigzag of a third that takes
    /// back what the ramp would move: so `c` and its slope vanish at both ends. `c` is odd.
    fn of_bend(&self) -> [f64; 4] {
        let (y, h) = (self.from_end, self.half_width_mm);
        let sign = if self.is_right { -1.0 } else { 1.0 };
        let [value, first, second, third] = if self.is_outer {
            // y/2 − (2/3)·y
            [-y * y * y / 36.0, -y * y / 12.0, -y / 6.0, -1.0 / 6.0]
        } else {
            // y/2 − (2/3)·(1 − y)
            let z = y - 0.5;
            let [value, first, second] = [-1.0 / 288.0, -1.0 / 48.0, -1.0 / 12.0];
            [
                value + z * (first + z * (second / 2.0 + z * 7.0 / 36.0)),
                first + z * (second + z * 7.0 / 12.0),
                second + z * 7.0 / 6.0,
                7.0 / 6.0,
            ]
        };
        [sign * value * h * h, first * h, sign * second, third / h]
    }
}

/// A place inside an element where the third derivative jumps.
struct Knot {
    /// On the path.
    at_mm: f64,
    jump: AxisVector,
    /// A correction begins there (1), or ends (−1).
    begins: i32,
}

fn add(derivatives: &mut [AxisVector; 4], jump: &AxisVector, factors: Option<[f64; 4]>) {
    for (sum, factor) in derivatives.iter_mut().zip(factors.into_iter().flatten()) {
        *sum += jump * factor;
    }
}

/// The cubics from the beginning of an element on, at `from` of the path, where so many corrections have their parts.
fn pieces(
    from: f64,
    derivatives: [AxisVector; 4],
    mut parts_here: i32,
    mut knots: Vec<Knot>,
) -> Vec<CubicPiece> {
    knots.sort_by(|a, b| a.at_mm.total_cmp(&b.at_mm));
    let mut pieces = Vec::with_capacity(knots.len() + 1);
    let mut piece = CubicPiece {
        from_mm: 0.0,
        derivatives,
    };
    for knot in knots {
        let at_mm = knot.at_mm - from;
        if at_mm > piece.from_mm {
            pieces.push(piece);
            let [value, first, second] = piece.at(at_mm);
            let [.., third] = piece.derivatives;
            piece = CubicPiece {
                from_mm: at_mm,
                derivatives: [value, first, second, third],
            };
        }
        parts_here += knot.begins;
        if parts_here == 0 {
            // Straight again, without what rounding has left.
            piece.derivatives = [AxisVector::zeros(); 4];
        } else {
            let [.., third] = &mut piece.derivatives;
            *third += knot.jump;
        }
    }
    pieces.push(piece);
    pieces
}

impl Correction {
    /// That of the element between the junctions `element` and `element + 1`; none if nothing is added there.
    pub(super) fn of(junctions: &[Junction], element: usize) -> Option<Self> {
        let (start, end) = (junctions.get(element)?, junctions.get(element + 1)?);
        let (from, to) = (start.at_mm, end.at_mm);
        let first = element.saturating_sub(NEIGHBOURS);
        let near = junctions.get(first..(element + NEIGHBOURS + 2).min(junctions.len()))?;
        let reaches = |of: &Junction| {
            of.is_round() && of.at_mm - of.half_width_mm < to && of.at_mm + of.half_width_mm > from
        };
        let parts = || near.iter().zip(first..).filter(|(of, _)| reaches(of));
        let length_mm = to - from;
        let moves = start.moved != end.moved || start.moved != AxisVector::zeros();
        if !moves && parts().next().is_none() {
            return None;
        }
        let mut knots: Vec<Knot> = Vec::new();
        let mut parts_here = 0i32;
        let mut derivatives = [AxisVector::zeros(); 4];
        for (of, index) in parts() {
            let half_mm = of.half_width_mm;
            let mut jump_at = |away_mm: f64, jump: AxisVector, begins: i32| {
                let at_mm = of.at_mm + away_mm;
                if at_mm > from && at_mm < to {
                    knots.push(Knot {
                        at_mm,
                        jump,
                        begins,
                    });
                }
            };
            // The third derivatives of `b` and `c` are constant but for these jumps.
            let place = Place::of(of, from, index <= element);
            if of.kink_weight_per_mm > 0.0 {
                add(
                    &mut derivatives,
                    &of.kink,
                    place.map(|place| place.of_kink()),
                );
                let jump = of.kink / (half_mm * half_mm);
                jump_at(-half_mm, jump, 1);
                jump_at(half_mm, jump, -1);
                parts_here += i32::from(place.is_some());
            }
            if of.bend_weight_per_mm2 > 0.0 {
                add(
                    &mut derivatives,
                    &of.bend_per_mm,
                    place.map(|place| place.of_bend()),
                );
                let sixth = of.bend_per_mm / (6.0 * half_mm);
                jump_at(-half_mm, -sixth, 1);
                jump_at(-0.5 * half_mm, sixth * 8.0, 0);
                jump_at(0.5 * half_mm, sixth * -8.0, 0);
                jump_at(half_mm, sixth, -1);
                parts_here += i32::from(place.is_some());
            }
        }
        let mut pieces = pieces(from, derivatives, parts_here, knots);
        if moves {
            let slope = (end.moved - start.moved) / length_mm;
            for piece in &mut pieces {
                let [value, first, ..] = &mut piece.derivatives;
                *value += start.moved + slope * piece.from_mm;
                *first += slope;
            }
        }
        Some(Self { pieces })
    }

    /// The cubics, in order; each holds up to the next, the last up to the end of the element.
    pub fn pieces(&self) -> &[CubicPiece] {
        &self.pieces
    }

    /// What is added at a distance on the element, and the first and second derivative of that.
    pub fn at(&self, distance_mm: f64) -> [AxisVector; 3] {
        let piece = self.piece_at(distance_mm);
        piece.map_or([AxisVector::zeros(); 3], |piece| piece.at(distance_mm))
    }

    /// What is added at a distance on the element.
    pub fn value_at(&self, distance_mm: f64) -> AxisVector {
        let piece = self.piece_at(distance_mm);
        piece.map_or_else(AxisVector::zeros, |piece| piece.value_at(distance_mm))
    }

    fn piece_at(&self, distance_mm: f64) -> Option<&CubicPiece> {
        let behind = self
            .pieces
            .partition_point(|piece| piece.from_mm <= distance_mm);
        self.pieces.get(behind.max(1) - 1)
    }
}
