//! Where labels stand beside marked places of a picture: inside the frame, over no other label and over no mark, and if there
//! is room for it over nothing that is drawn.

/// Distances of a label from its mark, in pixels, from near to far.
const AWAY_PX: [f64; 7] = [22.0, 38.0, 58.0, 84.0, 118.0, 160.0, 220.0];
/// Directions in which a label may stand.
const DIRECTIONS: u32 = 24;
/// Free space about a label, in pixels.
const MARGIN_PX: f64 = 5.0;
/// How far a label may go, in pixels, to have one point less below it.
const PX_PER_POINT: f64 = 15.0;

/// A rectangle in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Left, top.
    pub low: (f64, f64),
    /// Right, bottom.
    pub high: (f64, f64),
}

/// A marked place and the size of its label, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// The place.
    pub at: (f64, f64),
    /// Width and height of the label.
    pub size: (f64, f64),
}

/// A label that found its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Where it stands.
    pub rect: Rect,
    /// Where its leader line ends, at its edge.
    pub leader_end: (f64, f64),
}

impl Rect {
    fn about((x, y): (f64, f64), (width, height): (f64, f64)) -> Rect {
        Rect {
            low: (x - 0.5 * width, y - 0.5 * height),
            high: (x + 0.5 * width, y + 0.5 * height),
        }
    }

    fn wider(&self, px: f64) -> Rect {
        Rect {
            low: (self.low.0 - px, self.low.1 - px),
            high: (self.high.0 + px, self.high.1 + px),
        }
    }

    fn holds(&self, (x, y): (f64, f64)) -> bool {
        (self.low.0..=self.high.0).contains(&x) && (self.low.1..=self.high.1).contains(&y)
    }

    fn is_within(&self, other: &Rect) -> bool {
        other.holds(self.low) && other.holds(self.high)
    }

    fn overlaps(&self, other: &Rect) -> bool {
        self.low.0 < other.high.0
            && other.low.0 < self.high.0
            && self.low.1 < other.high.1
            && other.low.1 < self.high.1
    }

    /// The place in it that is nearest to a point.
    fn nearest(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (
            x.clamp(self.low.0, self.high.0),
            y.clamp(self.low.1, self.high.1),
        )
    }

    /// Whether a straight line goes through it.
    fn is_crossed(&self, from: (f64, f64), to: (f64, f64)) -> bool {
        (0..=40).any(|step| {
            let share = f64::from(step) / 40.0;
            let along = |a: f64, b: f64| a + share * (b - a);
            self.holds((along(from.0, to.0), along(from.1, to.1)))
        })
    }
}

/// Places a label of each size beside its mark, one after the other; none where there is no room. `drawn` are points of what
/// the picture shows.
pub fn beside(frame: &Rect, labels: &[Mark], drawn: &[(f64, f64)]) -> Vec<Option<Placed>> {
    let mut placed: Vec<Option<Placed>> = Vec::new();
    for mark in labels {
        let mut best: Option<(f64, Placed)> = None;
        for (away_px, direction) in candidates() {
            let place = at(mark, away_px, direction);
            if !is_free(frame, labels, &placed, mark.at, &place) {
                continue;
            }
            let wide = place.rect.wider(0.5 * MARGIN_PX);
            let below = drawn.iter().filter(|point| wide.holds(**point)).count();
            let cost = away_px + PX_PER_POINT * below as f64;
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, place));
            }
        }
        placed.push(best.map(|(_, place)| place));
    }
    placed
}

fn candidates() -> impl Iterator<Item = (f64, f64)> {
    AWAY_PX.into_iter().flat_map(|away_px| {
        let turn = std::f64::consts::TAU / f64::from(DIRECTIONS);
        (0..DIRECTIONS).map(move |direction| (away_px, turn * f64::from(direction)))
    })
}

/// A label whose edge is so far from its mark.
fn at(mark: &Mark, away_px: f64, direction_rad: f64) -> Placed {
    let (x, y) = (libm::cos(direction_rad), libm::sin(direction_rad));
    let centre = (
        mark.at.0 + x * (away_px + 0.5 * mark.size.0),
        mark.at.1 + y * (away_px + 0.5 * mark.size.1),
    );
    let rect = Rect::about(centre, mark.size);
    Placed {
        rect,
        leader_end: rect.nearest(mark.at),
    }
}

fn is_free(
    frame: &Rect,
    labels: &[Mark],
    placed: &[Option<Placed>],
    mark: (f64, f64),
    place: &Placed,
) -> bool {
    let wide = place.rect.wider(MARGIN_PX);
    let others = placed.iter().zip(labels);
    let mut others = others.filter_map(|(other, mark)| Some((other.as_ref()?, mark.at)));
    place.rect.is_within(frame)
        && !labels.iter().any(|mark| wide.holds(mark.at))
        && !others.any(|(other, of_other)| {
            other.rect.overlaps(&wide)
                || other.rect.is_crossed(mark, place.leader_end)
                || wide.is_crossed(of_other, other.leader_end)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRAME: Rect = Rect {
        low: (0.0, 0.0),
        high: (800.0, 700.0),
    };

    fn mark(at: (f64, f64), width: f64) -> Mark {
        let size = (width, 30.0);
        Mark { at, size }
    }

    proptest! {
        #[test]
        fn labels_stand_in_the_frame_and_over_no_label_and_no_mark(
            marks in proptest::collection::vec((0.0..800.0f64, 0.0..700.0f64), 1..6),
            width in 40.0..220.0f64,
        ) {
            let labels: Vec<_> = marks.iter().map(|at| mark(*at, width)).collect();
            let placed = beside(&FRAME, &labels, &marks);
            prop_assert_eq!(placed.len(), labels.len());
            prop_assert!(placed[0].is_some(), "the first finds room anywhere");
            let known: Vec<&Placed> = placed.iter().flatten().collect();
            for (index, one) in known.iter().enumerate() {
                prop_assert!(one.rect.is_within(&FRAME));
                prop_assert!(marks.iter().all(|mark| !one.rect.holds(*mark)));
                prop_assert!(known[..index].iter().all(|other| !one.rect.overlaps(&other.rect)));
            }
        }
    }

    #[test]
    fn a_label_goes_where_nothing_is_drawn() {
        // Everything to the right of the mark is full.
        let full = (0..4000).map(|n| {
            let (column, row) = (f64::from(n % 80), f64::from(n / 80));
            (405.0 + 5.0 * column, 14.0 * row)
        });
        let full: Vec<(f64, f64)> = full.collect();
        let labels = [mark((400.0, 350.0), 120.0)];
        let placed = beside(&FRAME, &labels, &full)[0].expect("room");
        assert!(placed.rect.high.0 < 405.0, "{placed:?}");
    }

    #[test]
    fn where_there_is_no_room_there_is_no_label() {
        let labels = [mark((400.0, 350.0), 900.0)];
        assert_eq!(beside(&FRAME, &labels, &[]), [None]);
    }
}
