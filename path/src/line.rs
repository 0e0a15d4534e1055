//! A straight line from one position pattern: one axis runs it, the others follow by division with a carried remainder.
use crate::geometry::PATH_AXES;

/// A straight line between two places in whole increments, of any number of axes up to [`PATH_AXES`].
///
/// The axis of the largest travel is the *master* (of equal ones the first): it alone runs the position pattern. Each scan
/// its increment δx drives every other axis through an integrator with a remainder of its own:
///
/// ```text
/// S = δx·|Δy| + B;   I ← I + S div |Δx|;   B = S mod |Δx|;   y = y_start + sign(Δy)·I        |Δx| ≥ |Δy|
/// ```
///
/// Source: Yaskawa, JP 3608587 B2 (docs/methods/straight-lines.md). Units: increments. Travels are mirrored so that every
/// remainder stays in [0, |Δx|) whatever the signs, and division rounds down for δx < 0 too: the motion may go back.
///
/// Nothing adds up: I = ⌊x·|Δy|/|Δx|⌋ whatever the steps that x, the master's travel so far, was made of. So at every scan
/// y lies less than one increment behind the exact line, never ahead of it, and the end is hit exactly. From one scan to the
/// next a slave moves no further than the master, and its change of speed exceeds the master's by at most one increment per
/// scan.
///
/// Products are formed in 128 bits: 10 m at 1 nm squared is 10²⁰, more than 64 bits hold. Places are held within ±2⁶²
/// increments, where nothing overflows. A line of no travel stays at its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StraightLine {
    from: [i64; PATH_AXES],
    /// Signed travel of each axis.
    travel: [i128; PATH_AXES],
    /// Index of the axis that runs the position pattern.
    pub master: usize,
}

/// Largest place of an axis, in increments: the square of a travel between two of them fits 128 bits.
const PLACE_MAX: i64 = 1 << 62;

impl StraightLine {
    /// The line from one place to another.
    pub fn new(from: [i64; PATH_AXES], to: [i64; PATH_AXES]) -> Self {
        let [from, to] = [from, to].map(|ends| ends.map(|end| end.clamp(-PLACE_MAX, PLACE_MAX)));
        let mut travel = [0; PATH_AXES];
        let (mut master, mut longest) = (0, 0);
        for (axis, ((travel, from), to)) in travel.iter_mut().zip(&from).zip(&to).enumerate() {
            *travel = i128::from(*to) - i128::from(*from);
            if travel.abs() > longest {
                (master, longest) = (axis, travel.abs());
            }
        }
        Self {
            from,
            travel,
            master,
        }
    }

    /// Δx: how far the master travels from start to end, in increments, not negative.
    pub fn master_travel(&self) -> i128 {
        self.travel
            .get(self.master)
            .map_or(0, |travel| travel.abs())
    }

    /// The closed form: the place at which the master is at `master_position`, in increments, held between start and end. A planner
    /// that starts again at any setpoint needs no remainder to go on with.
    pub fn at_master(&self, master_position: i64) -> [i64; PATH_AXES] {
        let whole = self.master_travel();
        let travel = self.travel.get(self.master).copied().unwrap_or(0);
        let from = self.from.get(self.master).copied().unwrap_or(0);
        if whole == 0 {
            return self.from;
        }
        let travelled = (i128::from(master_position) - i128::from(from)) * travel.signum();
        let travelled = travelled.clamp(0, whole);
        let mut place = self.from;
        for (place, travel) in place.iter_mut().zip(&self.travel) {
            let follows = (travelled * travel.abs()).div_euclid(whole) * travel.signum();
            *place = place.wrapping_add(follows as i64);
        }
        place
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Where the accumulating form is on a line; all zero at its start.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    struct LineState {
        /// I of the source, per axis: travel so far, counted in the direction of the axis' own travel.
        travelled: [i128; PATH_AXES],
        /// B of the source, per axis.
        remainder: [i128; PATH_AXES],
    }

    /// The accumulating form, which a planner that starts again at any setpoint could not go on with.
    impl StraightLine {
        /// The source's block: the master goes on by `step` increments in its own direction (back if negative), the others
        /// follow. The state then is at the new place.
        fn advance(&self, state: &mut LineState, step: i64) {
            let whole = self.master_travel();
            if whole == 0 {
                return;
            }
            let of_axes = state.travelled.iter_mut().zip(&mut state.remainder);
            for ((travelled, remainder), travel) in of_axes.zip(&self.travel) {
                // For the master itself |Δy| = |Δx|: the whole step, no remainder.
                let sum = i128::from(step) * travel.abs() + *remainder;
                *travelled += sum.div_euclid(whole);
                *remainder = sum.rem_euclid(whole);
            }
        }

        /// The place a state is at, in increments.
        fn place(&self, state: &LineState) -> [i64; PATH_AXES] {
            let mut place = self.from;
            let of_axes = place.iter_mut().zip(&state.travelled).zip(&self.travel);
            for ((place, travelled), travel) in of_axes {
                *place = place.wrapping_add((travelled * travel.signum()) as i64);
            }
            place
        }
    }

    fn line(travel: &[i64]) -> StraightLine {
        let mut to = [0; PATH_AXES];
        to.iter_mut().zip(travel).for_each(|(to, by)| *to = *by);
        StraightLine::new([0; PATH_AXES], to)
    }

    #[test]
    fn five_to_three_gives_the_steps_of_the_source() {
        let line = line(&[5, 3]);
        let mut state = LineState::default();
        let mut steps = Vec::new();
        for _ in 0..5 {
            line.advance(&mut state, 1);
            steps.push((line.place(&state)[1], state.remainder[1]));
        }
        // S = 3, 6, 4, 7, 5 over 5.
        assert_eq!(steps, [(0, 3), (1, 1), (1, 4), (2, 2), (3, 0)]);
    }

    #[test]
    fn the_axis_of_the_larger_travel_is_the_master_and_of_equal_ones_the_first() {
        assert_eq!(line(&[10, -30, 20]).master, 1);
        assert_eq!(line(&[-30, 10, 20]).master, 0);
        assert_eq!(line(&[20, -20]).master, 0);
        assert_eq!(line(&[0, 0, 1]).master, 2);
    }

    #[test]
    fn ten_metres_at_one_nanometre_do_not_overflow() {
        let far = 10_000_000_000;
        let line = line(&[far, -(far - 1)]);
        assert_eq!(line.at_master(far)[1], -(far - 1));
        // y = ⌊x·(1 − 1/far)⌋ = x − 1 for every x between.
        for x in [1, far / 3, far / 2, far - 1] {
            assert_eq!(line.at_master(x)[1], -(x - 1), "at {x}");
        }
        let ends = StraightLine::new([i64::MIN; PATH_AXES], [i64::MAX; PATH_AXES]);
        assert_eq!(ends.at_master(i64::MAX), [PLACE_MAX; PATH_AXES]);
        assert_eq!(ends.at_master(0), [0; PATH_AXES]);
    }

    #[test]
    fn a_line_of_no_travel_stays_where_it_is() {
        let line = StraightLine::new([7; PATH_AXES], [7; PATH_AXES]);
        let mut state = LineState::default();
        line.advance(&mut state, 3);
        assert_eq!(line.place(&state), [7; PATH_AXES]);
        assert_eq!(line.at_master(100), [7; PATH_AXES]);
    }

    /// A travel of any size up to 10 m at 1 nm, either sign, zero among them.
    fn any_travel() -> impl Strategy<Value = i64> {
        let of_size = |most: i64| -most..=most;
        prop_oneof![
            1 => Just(0),
            2 => of_size(20),
            2 => of_size(100_000),
            4 => of_size(10_000_000_000),
        ]
    }

    proptest! {
        #[test]
        fn the_closed_form_is_the_accumulating_form_whatever_the_steps(
            from in prop::array::uniform9(-5_000_000_000i64..5_000_000_000),
            travel in prop::array::uniform9(any_travel()),
            shares in prop::collection::vec(-0.2..1.0f64, 1..40),
        ) {
            let mut to = from;
            to.iter_mut().zip(&travel).for_each(|(to, by)| *to += by);
            let line = StraightLine::new(from, to);
            let (master, whole) = (line.master, line.master_travel() as i64);
            let direction = travel[master].signum();
            let mut state = LineState::default();
            let mut at = 0i64;
            for share in shares {
                // Forward and back, to any place of the line.
                let step = ((share * whole as f64) as i64).clamp(-at, whole - at);
                at += step;
                line.advance(&mut state, step);
                let place = line.place(&state);
                prop_assert_eq!(place, line.at_master(from[master] + direction * at));
                for remainder in state.remainder {
                    prop_assert!(remainder >= 0 && (remainder < i128::from(whole) || whole == 0));
                }
            }
            line.advance(&mut state, whole - at);
            prop_assert_eq!(line.place(&state), to);
        }
    }
}
