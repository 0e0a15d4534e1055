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
pub(super) const REACH_JUNCTIONS: usize = NEIGHBOURS + 2 * NEIGHBOURS * (ROUNDS + 1);

/// The widest correction, in mm: more than any tolerance of cutting asks for.
const HALF_WIDTH_MAX_MM: f64 = 5.0;
/// Excess that is none.
const NEGLIGIBLE_EXCESS: f64 = 1e-9;

/// Gives each junction its half width.
pub(super) fn assign(junctions: &mut [Junction]) {
    if junctions.iter().all(|junction| junction.is_exact) {
        return;
    }
    let alone: Vec<f64> = (0..junctions.len())
        .map(|index| alone_mm(junctions, index))
        .collect();
    for (junction, alone_mm) in junctions.iter_mut().zip(alone) {
        junction.half_width_mm = alone_mm;
    }
    for round in 0..=ROUNDS {
        let excesses: Vec<f64> = (0..junctions.len())
            .map(|index| deviation(junctions, index))
            .collect();
        if excesses
            .iter()
            .all(|excess| *excess <= 1.0 + NEGLIGIBLE_EXCESS)
        {
            return;
        }
        let factors: Vec<f64> = (0..junctions.len())
            .map(|index| worst(junctions, &excesses, index))
            .collect();
        for (junction, worst) in junctions.iter_mut().zip(factors) {
            if worst > 1.0 {
                junction.half_width_mm /= if round < ROUNDS { worst.sqrt() } else { worst };
            }
        }
    }
}

/// Half width of a junction that nothing else deviates beside, in mm.
fn alone_mm(junctions: &[Junction], index: usize) -> f64 {
    let Some(junction) = junctions.get(index) else {
        return 0.0;
    };
    let (kink, bend) = (junction.kink_weight_per_mm, junction.bend_weight_per_mm2);
    if junction.is_exact || (kink <= 0.0 && bend <= 0.0) {
        return 0.0;
    }
    // kink·h/6 + bend·h² = 1, in the form that is exact for small terms.
    let kink = kink / 6.0;
    let own_mm = 2.0 / (kink + (kink * kink + 4.0 * bend).sqrt());
    let last = |mut others: Box<dyn Iterator<Item = &Junction> + '_>| {
        let mut furthest_mm = 0.0;
        for other in others.by_ref().take(NEIGHBOURS) {
            furthest_mm = (other.at_mm - junction.at_mm).abs();
            if other.is_exact {
                break;
            }
        }
        furthest_mm
    };
    let before = junctions.get(..index).unwrap_or_default();
    let behind = junctions.get(index + 1..).unwrap_or_default();
    let room_mm = last(Box::new(before.iter().rev())).min(last(Box::new(behind.iter())));
    own_mm.min(room_mm).min(HALF_WIDTH_MAX_MM)
}

/// The junctions whose corrections may reach a junction, itself among them, with their indices.
fn around(junctions: &[Junction], index: usize) -> impl Iterator<Item = (usize, &Junction)> {
    let from = index.saturating_sub(NEIGHBOURS);
    let to = (index + NEIGHBOURS + 1).min(junctions.len());
    let near = junctions.get(from..to).unwrap_or_default();
    near.iter().enumerate().map(move |(at, of)| (from + at, of))
}

/// Deviation at a junction over what is allowed.
fn deviation(junctions: &[Junction], index: usize) -> f64 {
    let Some(here) = junctions.get(index) else {
        return 0.0;
    };
    let mut sum = 0.0;
    for (_, other) in around(junctions, index) {
        let (half_mm, away_mm) = (other.half_width_mm, (other.at_mm - here.at_mm).abs());
        if away_mm < half_mm {
            let left_mm = half_mm - away_mm;
            let squared = half_mm * half_mm;
            sum += other.kink_weight_per_mm * left_mm * left_mm * left_mm / (6.0 * squared)
                + other.bend_weight_per_mm2 * squared;
        }
    }
    sum
}

/// The highest deviation that a junction has a part in.
fn worst(junctions: &[Junction], excesses: &[f64], index: usize) -> f64 {
    let Some(here) = junctions.get(index).filter(|of| of.half_width_mm > 0.0) else {
        return 1.0;
    };
    let mut worst = 1.0f64;
    for (at, other) in around(junctions, index) {
        if (other.at_mm - here.at_mm).abs() < here.half_width_mm {
            worst = worst.max(excesses.get(at).copied().unwrap_or(1.0));
        }
    }
    worst
}
