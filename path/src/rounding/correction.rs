//! What rounding adds to one element: cubics in its distance.

use nalgebra::SVector;

use crate::geometry::{Correction, CubicPiece, first_axes};

use super::{Junction, NEIGHBOURS, of_all};

/// `|c(d; h)|` is at most this share of `h²`: 0.0083.
pub(super) const BEND_SHARE: f64 = 120.0;

impl<const AXES: usize> CubicPiece<AXES> {
    fn of_all(&self) -> CubicPiece {
        CubicPiece {
            from_mm: self.from_mm,
            derivatives: self.derivatives.map(|of| of_all(&of)),
        }
    }
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
    fn of<const AXES: usize>(junction: &Round<AXES>, at_mm: f64, is_right: bool) -> Option<Place> {
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

/// A junction with what rounding adds there, of so many axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Round<const AXES: usize> {
    at_mm: f64,
    half_width_mm: f64,
    kink: Option<[SVector<f64, AXES>; 2]>,
    bend: Option<[SVector<f64, AXES>; 2]>,
    moved: SVector<f64, AXES>,
}

impl<const AXES: usize> Round<AXES> {
    /// With corrections of this half width. The third derivatives of `b` and `c` are constant but for jumps of these sizes.
    pub fn of(junction: &Junction, half_width_mm: f64) -> Self {
        let half_mm = half_width_mm;
        let is_round = half_mm > 0.0;
        let (kink, bend) = (
            first_axes(&junction.kink),
            first_axes(&junction.bend_per_mm),
        );
        let has_kink = is_round && junction.kink_weight_per_mm > 0.0;
        let has_bend = is_round && junction.bend_weight_per_mm2 > 0.0;
        Self {
            at_mm: junction.at_mm,
            half_width_mm,
            kink: has_kink.then(|| [kink, kink / (half_mm * half_mm)]),
            bend: has_bend.then(|| [bend, bend / (6.0 * half_mm)]),
            moved: first_axes(&junction.moved),
        }
    }

    fn reaches(&self, from_mm: f64, to_mm: f64) -> bool {
        self.half_width_mm > 0.0
            && self.at_mm - self.half_width_mm < to_mm
            && self.at_mm + self.half_width_mm > from_mm
    }
}

/// A place inside an element where the third derivative jumps.
struct Knot<const AXES: usize> {
    /// On the path.
    at_mm: f64,
    jump: SVector<f64, AXES>,
    /// A correction begins there (1), or ends (−1).
    begins: i32,
}

fn add<const AXES: usize>(
    derivatives: &mut [SVector<f64, AXES>; 4],
    jump: &SVector<f64, AXES>,
    factors: [f64; 4],
) {
    for (sum, factor) in derivatives.iter_mut().zip(factors) {
        *sum += jump * factor;
    }
}

/// The cubics of an element.
pub(super) struct Cubics<const AXES: usize> {
    knots: Vec<Knot<AXES>>,
    pieces: Vec<CubicPiece<AXES>>,
}

impl<const AXES: usize> Cubics<AXES> {
    /// Room for those of one element after the other.
    pub fn new() -> Self {
        Self {
            knots: Vec::new(),
            pieces: Vec::new(),
        }
    }

    /// Cuts them from the beginning of an element on, at `from` of the path, where so many corrections have their parts.
    fn cut(&mut self, from: f64, derivatives: [SVector<f64, AXES>; 4], mut parts_here: i32) {
        self.knots.sort_by(|a, b| a.at_mm.total_cmp(&b.at_mm));
        self.pieces.clear();
        let mut piece = CubicPiece {
            from_mm: 0.0,
            derivatives,
        };
        for knot in &self.knots {
            let at_mm = knot.at_mm - from;
            if at_mm > piece.from_mm {
                self.pieces.push(piece);
                let value = piece.value_at(at_mm);
                let [first, second] = piece.slopes_at(at_mm);
                let [.., third] = piece.derivatives;
                piece = CubicPiece {
                    from_mm: at_mm,
                    derivatives: [value, first, second, third],
                };
            }
            parts_here += knot.begins;
            if parts_here == 0 {
                // Straight again, without what rounding has left.
                piece.derivatives = [SVector::zeros(); 4];
            } else {
                let [.., third] = &mut piece.derivatives;
                *third += knot.jump;
            }
        }
        self.pieces.push(piece);
    }
}

impl Correction {
    /// That of the element between the junctions `element` and `element + 1`; none if nothing is added there.
    pub(super) fn of<const AXES: usize>(
        junctions: &[Round<AXES>],
        element: usize,
        cubics: &mut Cubics<AXES>,
    ) -> Option<Self> {
        let (start, end) = (junctions.get(element)?, junctions.get(element + 1)?);
        let (from, to) = (start.at_mm, end.at_mm);
        let first = element.saturating_sub(NEIGHBOURS);
        let near = junctions.get(first..(element + NEIGHBOURS + 2).min(junctions.len()))?;
        let moves = start.moved != end.moved || start.moved != SVector::<f64, AXES>::zeros();
        let mut is_straight = true;
        cubics.knots.clear();
        let mut parts_here = 0i32;
        let mut derivatives = [SVector::zeros(); 4];
        let parts = near.iter().zip(first..);
        for (of, index) in parts.filter(|(of, _)| of.reaches(from, to)) {
            is_straight = false;
            let half_mm = of.half_width_mm;
            let mut jump_at = |away_mm: f64, jump: SVector<f64, AXES>, begins: i32| {
                let at_mm = of.at_mm + away_mm;
                if at_mm > from && at_mm < to {
                    cubics.knots.push(Knot {
                        at_mm,
                        jump,
                        begins,
                    });
                }
            };
            let place = Place::of(of, from, index <= element);
            if let Some([kink, jump]) = &of.kink {
                if let Some(place) = place {
                    add(&mut derivatives, kink, place.of_kink());
                    parts_here += 1;
                }
                jump_at(-half_mm, *jump, 1);
                jump_at(half_mm, *jump, -1);
            }
            if let Some([bend, sixth]) = &of.bend {
                if let Some(place) = place {
                    add(&mut derivatives, bend, place.of_bend());
                    parts_here += 1;
                }
                jump_at(-half_mm, -sixth, 1);
                jump_at(-0.5 * half_mm, sixth * 8.0, 0);
                jump_at(0.5 * half_mm, sixth * -8.0, 0);
                jump_at(half_mm, *sixth, -1);
            }
        }
        if !moves && is_straight {
            return None;
        }
        cubics.cut(from, derivatives, parts_here);
        if moves {
            let slope = (end.moved - start.moved) / (to - from);
            for piece in &mut cubics.pieces {
                let [value, first, ..] = &mut piece.derivatives;
                *value += start.moved + slope * piece.from_mm;
                *first += slope;
            }
        }
        Some(Self {
            pieces: cubics.pieces.iter().map(CubicPiece::of_all).collect(),
        })
    }
}
