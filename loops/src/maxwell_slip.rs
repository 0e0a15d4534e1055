//! Friction as a function of distance: Maxwell slip elements.
/// Elements of one curve.
pub const ELEMENTS: usize = 6;

/// Springs that are wound up over more than this turn round late, in mm.
pub const LATE_MM: f64 = 5e-3;

/// How high friction is, as a part of that of the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Of springs that turn round early.
    pub early: f64,
    /// Of springs that turn round late.
    pub late: f64,
}

/// One spring that slips.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlipElement {
    /// Force at which it slips in steady sliding, in N.
    pub slip_n: f64,
    /// Distance over which it is wound up to that from rest, in mm.
    pub break_distance_mm: f64,
}

/// Springs side by side, each of which slips at its own force: after a reversal friction turns round over a distance, and a
/// short way back is remembered.
///
/// `F = Σ F_i`, `F_i ← clamp(F_i + (S_i/Δ_i)·Δx, ±S_i·s(v))`, `s(v) = 1 + r·exp(−(v/v_s)²)`. Rate-independent but for the Stribeck
/// factor s. Source: Maxwell slip (Iwan 1966), with the Stribeck curve of docs/methods/physics.md §2. Units: mm, mm/s, N. First call:
/// no spring is wound. A change of position that is not a number changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MaxwellSlip {
    /// The springs; those with `slip_n` = 0 do nothing.
    pub elements: [SlipElement; ELEMENTS],
    /// r: break-away over Coulomb friction, less 1.
    pub static_excess: f64,
    /// v_s, in mm/s.
    pub stribeck_velocity_mm_s: f64,
}

impl Default for Level {
    fn default() -> Self {
        Level::TUNED
    }
}

impl Level {
    /// As tuned.
    pub const TUNED: Level = Level::all(1.0);

    /// The same for all springs.
    pub const fn all(level: f64) -> Level {
        Level {
            early: level,
            late: level,
        }
    }

    fn of(&self, element: &SlipElement) -> f64 {
        if element.break_distance_mm > LATE_MM {
            self.late
        } else {
            self.early
        }
    }
}

impl MaxwellSlip {
    /// Friction in steady sliding, beyond the Stribeck velocity, in N.
    pub fn coulomb_n(&self) -> f64 {
        self.elements.iter().map(|element| element.slip_n).sum()
    }

    /// The same at a level, in N.
    pub fn coulomb_at_n(&self, level: &Level) -> f64 {
        let elements = self.elements.iter();
        elements
            .map(|element| level.of(element) * element.slip_n)
            .sum()
    }

    /// Forces as they would be at the level 1, in N: of all springs, and of those that turn round late.
    pub fn at_level_1_n(&self, state: &[f64; ELEMENTS], level: &Level) -> [f64; 2] {
        let (mut all_n, mut late_n) = (0.0, 0.0);
        for (force_n, element) in state.iter().zip(&self.elements) {
            let of_element = level.of(element);
            let force_n = if of_element > 0.0 {
                force_n / of_element
            } else {
                0.0
            };
            all_n += force_n;
            if element.break_distance_mm > LATE_MM {
                late_n += force_n;
            }
        }
        [all_n, late_n]
    }

    /// Moves on by `travel_mm` at `velocity_mm_s`, at a level of friction; the friction, in N, positive in the direction of positive motion.
    pub fn update(
        &self,
        state: &mut [f64; ELEMENTS],
        travel_mm: f64,
        velocity_mm_s: f64,
        level: &Level,
    ) -> f64 {
        let ratio = velocity_mm_s / self.stribeck_velocity_mm_s;
        let factor = if self.static_excess > 0.0 {
            1.0 + self.static_excess * libm::exp(-ratio * ratio)
        } else {
            1.0
        };
        let mut sum_n = 0.0;
        for (force_n, element) in state.iter_mut().zip(&self.elements) {
            if travel_mm.is_finite() && element.break_distance_mm > 0.0 {
                let scale = level.of(element);
                let most_n = scale * element.slip_n * factor;
                let stiffness = scale * element.slip_n / element.break_distance_mm;
                *force_n = (*force_n + stiffness * travel_mm).max(-most_n).min(most_n);
            }
            sum_n += *force_n;
        }
        sum_n
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;

    fn curve() -> MaxwellSlip {
        let mut elements = [SlipElement::default(); ELEMENTS];
        for (element, (slip_n, break_um)) in
            elements
                .iter_mut()
                .zip([(70.0, 1.0), (60.0, 4.0), (40.0, 12.0), (30.0, 40.0)])
        {
            *element = SlipElement {
                slip_n,
                break_distance_mm: break_um * 1e-3,
            };
        }
        MaxwellSlip {
            elements,
            static_excess: 0.0,
            stribeck_velocity_mm_s: 3.0,
        }
    }

    /// Friction after travelling `mm` in steps of 0.1 µm.
    fn travel(curve: &MaxwellSlip, state: &mut [f64; ELEMENTS], mm: f64) -> f64 {
        let steps = (mm.abs() / 1e-4).round() as u32;
        let mut force_n = 0.0;
        for _ in 0..steps {
            force_n = curve.update(state, 1e-4 * mm.signum(), 10.0, &Level::TUNED);
        }
        force_n
    }

    #[test]
    fn after_a_long_way_it_is_coulomb_friction_in_the_direction_of_travel() {
        let (curve, mut state) = (curve(), [0.0; ELEMENTS]);
        assert!((travel(&curve, &mut state, 0.2) - 200.0).abs() < 1e-9);
        assert!((travel(&curve, &mut state, -0.2) + 200.0).abs() < 1e-9);
        assert_eq!(curve.coulomb_n(), 200.0);
    }

    #[test]
    fn the_curve_after_a_reversal_is_the_virgin_curve_doubled() {
        let curve = curve();
        for um in [0.5, 2.0, 6.0, 20.0] {
            let mut virgin = [0.0; ELEMENTS];
            let first_n = travel(&curve, &mut virgin, um * 1e-3);
            let mut state = [0.0; ELEMENTS];
            let steady_n = travel(&curve, &mut state, 0.2);
            let after_n = travel(&curve, &mut state, -2.0 * um * 1e-3);
            let turned_n = steady_n - after_n;
            assert!(
                (turned_n - 2.0 * first_n).abs() < 1e-6,
                "{um} µm: {turned_n} and {first_n}"
            );
        }
    }

    #[test]
    fn a_small_way_back_and_forth_closes_its_loop() {
        let (curve, mut state) = (curve(), [0.0; ELEMENTS]);
        travel(&curve, &mut state, 0.2);
        travel(&curve, &mut state, -0.010);
        let before_n = travel(&curve, &mut state, -0.001);
        travel(&curve, &mut state, 0.003);
        let again_n = travel(&curve, &mut state, -0.003);
        assert!((before_n - again_n).abs() < 1e-6, "{before_n} {again_n}");
    }

    #[test]
    fn slow_sliding_has_the_static_excess_and_a_scale_scales_it_all() {
        let curve = MaxwellSlip {
            static_excess: 0.3,
            ..curve()
        };
        let slide = |velocity_mm_s: f64, scale: f64| {
            let mut state = [0.0; ELEMENTS];
            let mut force_n = 0.0;
            for _ in 0..2000 {
                force_n = curve.update(&mut state, 1e-4, velocity_mm_s, &Level::all(scale));
            }
            force_n
        };
        assert!((slide(0.0, 1.0) - 260.0).abs() < 1e-9);
        assert!((slide(100.0, 1.0) - 200.0).abs() < 1e-9);
        assert!((slide(100.0, 1.3) - 260.0).abs() < 1e-9);
    }

    #[test]
    fn a_way_that_is_no_number_changes_nothing() {
        let (curve, mut state) = (curve(), [0.0; ELEMENTS]);
        let before_n = travel(&curve, &mut state, 0.003);
        assert_eq!(
            curve.update(&mut state, f64::NAN, 10.0, &Level::TUNED),
            before_n
        );
    }
}
