//! How wide each junction is rounded.
//!
//! Alone, a kink is rounded as wide as its tolerance allows: `h = 6P/|Δt|`. Where corrections overlap, their deviations add up; the widths
//! are then reduced until the sum keeps the tolerance everywhere: by the square root of the excess, which is exact for evenly dense
//! kinks (a sum of n = h/l of them, each ∝ h), and at last by all of it, which suffices: dividing `h` by `e` divides `b` by `e` at least,
//! at every place. All rules are symmetric, so that a path and its reverse are rounded alike.

use super::Junction;

/// A correction reaches over so many junctions to either side at most.
pub(crate) const NEIGHBOURS: usize = 16;
/// Rounds of the square root.
const ROUNDS: usize = 3;
/// Junctions to either side that have a part in the width of one: its own reach, and in each round that of the sums it has a part in
/// and of their parts.
pub(crate) const REACH_JUNCTIONS: usize = NEIGHBOURS + 2 * NEIGHBOURS * (ROUNDS + 1);

/// The widest correction, in mm: more than any tolerance of cutting asks for.
const HALF_WIDTH_MAX_MM: f64 = 5.0;
/// Excess that is none.
const NEGLIGIBLE_EXCESS: f64 = 1e-9;

/// The half width of the correction at each junction, in mm; 0: none. Nothing is rounded at the first and the last of them.
pub(super) fn of_junctions_mm(junctions: &[Junction]) -> Vec<f64> {
    let count = junctions.len();
    if junctions.iter().all(|junction| junction.is_exact) {
        return vec![0.0; count];
    }
    let rooms = rooms_mm(junctions);
    let mut corrections: Vec<Width> = junctions
        .iter()
        .zip(rooms)
        .map(|(junction, room_mm)| Width::alone(junction, room_mm))
        .collect();
    let places_mm: Vec<f64> = junctions.iter().map(|of| of.at_mm).collect();
    let left: Vec<f64> = (0..count)
        .map(|index| 1.0 - taken(junctions, index))
        .collect();
    let mut excesses = vec![0.0; count];
    // All rounds, also where none is needed: which junctions are looked at together must not matter.
    for round in 0..=ROUNDS {
        add_deviations(&mut corrections, &places_mm, &mut excesses);
        for (excess, left) in excesses.iter_mut().zip(&left) {
            *excess /= left;
        }
        for width in &mut corrections {
            let by = worst(&excesses, width, &places_mm);
            if by > 1.0 {
                width.set(width.half_mm / if round < ROUNDS { by.sqrt() } else { by });
            }
        }
    }
    corrections.iter().map(|width| width.half_mm).collect()
}

/// What its moved ends take of what the lines at a junction may deviate.
fn taken(junctions: &[Junction], index: usize) -> f64 {
    let near = junctions.get(index.saturating_sub(1)..(index + 2).min(junctions.len()));
    let taken = near.unwrap_or_default().iter().map(|of| of.taken);
    taken.fold(0.0, f64::max)
}

/// The correction at a junction, as its width changes.
#[derive(Debug, Clone, Copy)]
struct Width {
    at_mm: f64,
    half_mm: f64,
    /// Of what is left to the end of the correction, cubed: the kink's deviation over what is allowed.
    of_cube_per_mm3: f64,
    /// The bend's deviation over what is allowed.
    of_bend: f64,
    kink_per_mm: f64,
    bend_per_mm2: f64,
    /// The junctions that it reaches: from … to, not including `to`.
    from: usize,
    to: usize,
}

impl Width {
    /// Of a junction that nothing else deviates beside, with so much room to both sides.
    fn alone(junction: &Junction, room_mm: f64) -> Self {
        let mut width = Self {
            at_mm: junction.at_mm,
            half_mm: 0.0,
            of_cube_per_mm3: 0.0,
            of_bend: 0.0,
            kink_per_mm: junction.kink_weight_per_mm,
            bend_per_mm2: junction.bend_weight_per_mm2,
            from: 0,
            to: 0,
        };
        let (kink, bend) = (width.kink_per_mm / 6.0, width.bend_per_mm2);
        if !junction.is_exact && (kink > 0.0 || bend > 0.0) {
            // kink·h + bend·h² = 1, in the form that is exact for small terms.
            let own_mm = 2.0 / (kink + (kink * kink + 4.0 * bend).sqrt());
            width.set(own_mm.min(room_mm).min(HALF_WIDTH_MAX_MM));
        }
        width
    }

    fn set(&mut self, half_mm: f64) {
        self.half_mm = half_mm;
        if half_mm > 0.0 {
            self.of_cube_per_mm3 = self.kink_per_mm / (6.0 * half_mm * half_mm);
            self.of_bend = self.bend_per_mm2 * half_mm * half_mm;
        }
    }
}

/// Distance of each junction from the nearest one that is exact, or from the last one that its correction may reach.
fn rooms_mm(junctions: &[Junction]) -> Vec<f64> {
    let count = junctions.len();
    let mut rooms_mm = vec![0.0; count];
    let at = |index: usize| junctions.get(index).map_or(0.0, |of| of.at_mm);
    let is_end = |index: usize| index == 0 || index + 1 == count;
    let is_exact =
        |index: usize| is_end(index) || junctions.get(index).is_none_or(|of| of.is_exact);
    let mut exact_before = 0;
    for (index, room_mm) in rooms_mm.iter_mut().enumerate() {
        let from = exact_before.max(index.saturating_sub(NEIGHBOURS));
        *room_mm = at(index) - at(from);
        if is_exact(index) {
            exact_before = index;
        }
    }
    let mut exact_behind = count.saturating_sub(1);
    for (index, room_mm) in rooms_mm.iter_mut().enumerate().rev() {
        let to = exact_behind.min(index + NEIGHBOURS);
        *room_mm = room_mm.min(at(to) - at(index));
        if is_exact(index) {
            exact_behind = index;
        }
    }
    rooms_mm
}

/// From where to where corrections may reach a junction.
fn around(index: usize, count: usize) -> std::ops::Range<usize> {
    index.saturating_sub(NEIGHBOURS)..(index + NEIGHBOURS + 1).min(count)
}

/// The deviation at each junction over what is allowed: of all corrections that reach it, added in the order of the path.
fn add_deviations(widths: &mut [Width], places_mm: &[f64], deviations: &mut [f64]) {
    deviations.fill(0.0);
    let count = places_mm.len();
    for (index, width) in widths.iter_mut().enumerate() {
        let half_mm = width.half_mm;
        if half_mm <= 0.0 {
            continue;
        }
        let (at_mm, near) = (width.at_mm, around(index, count));
        let before = places_mm.get(near.start..index).unwrap_or_default();
        let behind = places_mm.get(index..near.end).unwrap_or_default();
        width.from = near.start + before.partition_point(|place| half_mm - (at_mm - place) <= 0.0);
        width.to = index + behind.partition_point(|place| half_mm - (place - at_mm) > 0.0);
        let reached = width.from..width.to;
        let (cube, bend) = (width.of_cube_per_mm3, width.of_bend);
        let places = places_mm.get(reached.clone()).unwrap_or_default();
        let sums = deviations.get_mut(reached).unwrap_or_default();
        for (sum, place_mm) in sums.iter_mut().zip(places) {
            let left_mm = half_mm - (at_mm - place_mm).abs();
            *sum += left_mm * left_mm * left_mm * cube + bend;
        }
    }
}

/// The highest excess of those that a correction has a part in; at least 1.
fn worst(excesses: &[f64], width: &Width, places_mm: &[f64]) -> f64 {
    if width.half_mm <= 0.0 {
        return 1.0;
    }
    // What the end of a correction just touches does not depend on rounding.
    let reach_mm = width.half_mm * (1.0 - NEGLIGIBLE_EXCESS);
    let places = places_mm.get(width.from..width.to).unwrap_or_default();
    let touches = |place_mm: &&f64| (*place_mm - width.at_mm).abs() >= reach_mm;
    let first = places.iter().take_while(touches).count();
    let last = places.iter().skip(first).rev().take_while(touches).count();
    let reached = width.from + first..width.to - last;
    let mut worst = 1.0f64;
    for excess in excesses.get(reached).unwrap_or_default() {
        // No number is above one that is none.
        if *excess > worst {
            worst = *excess;
        }
    }
    worst
}
