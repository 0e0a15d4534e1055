//! What an axis's command is corrected by along the path of one program: the value over the place on the path.
/// Difference of speed, as a part of the learned one, up to which a correction counts in full.
const SPEED_NEAR: f64 = 0.05;
/// … and from which on it does not count.
const SPEED_FAR: f64 = 0.25;
/// Below this speed in mm/s differences are taken as parts of it.
const SPEED_MIN_MM_S: f64 = 1.0;

/// One place of the path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Knot {
    /// Length of the path up to here, in mm.
    pub place_mm: f64,
    /// Speed along the path that it was learned at, in mm/s.
    pub speed_mm_s: f64,
    /// What is added to the axis's position command, in mm.
    pub correction_mm: f64,
}

/// The correction of one axis along the path of one program. Constant from before the first scan on.
///
/// Between knots it is linear in the place, as is the learned speed; before the first and beyond the last it is 0. Error of a
/// program that repeats depends on where the tool is and how fast, so the index is the place and the weight the speed: what was
/// learned at one speed is no correction at another.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PathCorrection {
    program_hash: u64,
    /// Element and length of the path before it, in mm; by elements.
    starts: Vec<(u32, f64)>,
    /// By places.
    knots: Vec<Knot>,
}

impl PathCorrection {
    /// Of the program of this hash, whose elements start there; both lists in order.
    pub fn new(program_hash: u64, starts: Vec<(u32, f64)>, knots: Vec<Knot>) -> PathCorrection {
        PathCorrection {
            program_hash,
            starts,
            knots,
        }
    }

    /// Whether it is of this program.
    pub fn is_of(&self, program_hash: u64) -> bool {
        self.program_hash == program_hash && !self.knots.is_empty()
    }

    /// Length of the path up to a place on one of its elements, in mm; none of an element that nothing was learned on.
    pub fn place_mm(&self, element: u32, distance_mm: f64) -> Option<f64> {
        let index = self.starts.binary_search_by_key(&element, |(of, _)| *of);
        let (_, start_mm) = self.starts.get(index.ok()?)?;
        Some(start_mm + distance_mm)
    }

    /// Correction at a place that is passed at a speed along the path, in mm; 0 where nothing was learned, or at another speed.
    pub fn value_mm(&self, place_mm: f64, speed_mm_s: f64) -> f64 {
        let next = self.knots.partition_point(|knot| knot.place_mm <= place_mm);
        let (Some(from), Some(to)) = (
            next.checked_sub(1)
                .and_then(|before| self.knots.get(before)),
            self.knots.get(next),
        ) else {
            return 0.0;
        };
        let part = (place_mm - from.place_mm) / (to.place_mm - from.place_mm);
        let between = |from: f64, to: f64| from + (to - from) * part;
        let learned_mm_s = between(from.speed_mm_s, to.speed_mm_s);
        let value_mm =
            between(from.correction_mm, to.correction_mm) * speed_weight(speed_mm_s, learned_mm_s);
        // A damaged table moves nothing.
        if value_mm.is_finite() { value_mm } else { 0.0 }
    }
}

/// How much of what was learned at one speed counts at another: `(0.25 − |v − v_l|/v_l)/0.2`, within 0 and 1.
pub fn speed_weight(speed_mm_s: f64, learned_mm_s: f64) -> f64 {
    let off = (speed_mm_s - learned_mm_s).abs() / learned_mm_s.max(SPEED_MIN_MM_S);
    let weight = (SPEED_FAR - off) / (SPEED_FAR - SPEED_NEAR);
    if weight.is_nan() {
        return 0.0;
    }
    weight.clamp(0.0, 1.0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ramp() -> PathCorrection {
        let knot = |place_mm: f64, correction_mm: f64| Knot {
            place_mm,
            speed_mm_s: 50.0,
            correction_mm,
        };
        let knots = vec![knot(10.0, 0.0), knot(12.0, 0.004), knot(13.0, -0.001)];
        PathCorrection::new(7, vec![(2, 8.0), (3, 11.5)], knots)
    }

    #[test]
    fn a_correction_is_linear_between_knots_and_nothing_outside_of_them() {
        let of = ramp();
        assert_eq!(of.place_mm(3, 0.5), Some(12.0));
        assert_eq!(of.place_mm(4, 0.5), None);
        assert!((of.value_mm(11.0, 50.0) - 0.002).abs() < 1e-12);
        assert!((of.value_mm(12.5, 50.0) - 0.0015).abs() < 1e-12);
        for (place_mm, speed_mm_s) in [(9.9, 50.0), (13.1, 50.0), (11.0, 0.0), (11.0, f64::NAN)] {
            assert_eq!(of.value_mm(place_mm, speed_mm_s), 0.0, "{place_mm}");
        }
        assert!(of.is_of(7) && !of.is_of(8));
        assert!(!PathCorrection::default().is_of(0));
    }

    #[test]
    fn what_was_learned_at_another_speed_fades_and_is_off_at_a_quarter() {
        assert_eq!(speed_weight(52.0, 50.0), 1.0);
        assert!((speed_weight(42.5, 50.0) - 0.5).abs() < 1e-12);
        assert_eq!(speed_weight(37.0, 50.0), 0.0);
        assert_eq!(speed_weight(0.0, 0.01), 1.0);
    }

    proptest! {
        #[test]
        fn no_place_and_speed_give_more_than_the_largest_knot(place_mm: f64, speed_mm_s: f64) {
            prop_assert!(ramp().value_mm(place_mm, speed_mm_s).abs() <= 0.004);
        }

        #[test]
        fn the_weight_is_within_0_and_1_and_falls_with_the_difference(learned in 0.0..500.0f64, near in 0.0..1.0f64, more in 0.0..1.0f64) {
            let weight = |off: f64| speed_weight(learned * (1.0 - off), learned);
            let (close, far) = (weight(near), weight((near + more).min(1.0)));
            prop_assert!((0.0..=1.0).contains(&close));
            prop_assert!(far <= close);
        }
    }
}
