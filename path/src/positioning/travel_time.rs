//! How long a move must take so that its motor stays within its continuous rating.
use thiserror::Error;

use super::profile::{Profile, minimum_travel_time_s};

/// The source's search for the travel time by successive halving, turn by turn (Okuma, JP S59-13044 B2, Table 1).
///
/// `r = 0`, step `n = d`; each turn: stop with r if `n ≤ tolerance`, else add n to r where `r⁴ + c·r³ < K·b²`, subtract it
/// where not, and halve n. The result is off by up to twice the tolerance to either side, so it may overload the motor; the
/// product uses [`MotorLoad::travel_time_s`].
///
/// Each item is one r, the first 0, the last the result. Units are the caller's, as in the source. A tolerance not above
/// 0, or a step that is no number, gives 0 alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Halving {
    law: TravelTimeLaw,
    travel_time: f64,
    step: f64,
    tolerance: f64,
    started: bool,
}

/// The source's law of the travel time: `r⁴ + c·r³ = K·b²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TravelTimeLaw {
    /// Rest until the next move, c.
    pub rest_s: f64,
    /// `K·b²`, with `K = 12/A²` and A the acceleration at rated torque.
    pub k_b_squared: f64,
}

impl TravelTimeLaw {
    /// `r⁴ + c·r³ − K·b²`: below 0 where the motor would be overloaded.
    fn excess(&self, r: f64) -> f64 {
        r * r * r * (r + self.rest_s) - self.k_b_squared
    }

    /// The exact root, by Newton's method from `(K·b²)^(1/4)`. That is at or above the root, and the left side is convex
    /// and rising, so every step falls towards the root and none goes past it. In s; 0 for nothing to move, NaN for NaN.
    ///
    /// Stops where a step no longer falls, a few units of the last place from the root.
    pub fn travel_time_s(&self) -> f64 {
        let mut r = self.k_b_squared.sqrt().sqrt();
        // Newton halves the error at the very least; at most 60 halvings are left of any start.
        for _ in 0..200 {
            let slope = r * r * (4.0 * r + 3.0 * self.rest_s);
            let next = r - self.excess(r) / slope;
            // Also ends on NaN.
            if !(next < r && next > 0.0) {
                break;
            }
            r = next;
        }
        r
    }
}

/// Starts [`Halving`] with a first step `d` and a tolerance.
pub fn halve(law: TravelTimeLaw, first_step: f64, tolerance: f64) -> Halving {
    Halving {
        law,
        travel_time: 0.0,
        step: first_step,
        tolerance,
        started: false,
    }
}

impl Iterator for Halving {
    type Item = f64;

    fn next(&mut self) -> Option<f64> {
        if !self.started {
            self.started = true;
            return Some(self.travel_time);
        }
        let goes_on = self.tolerance > 0.0 && self.step > self.tolerance && self.step.is_finite();
        if !goes_on {
            return None;
        }
        if self.law.excess(self.travel_time) < 0.0 {
            self.travel_time += self.step;
        } else {
            self.travel_time -= self.step;
        }
        self.step *= 0.5;
        Some(self.travel_time)
    }
}

/// What one motor has to move and what it may bear, all at the table: N, kg, N·s/m. (Rotary axes: with a thousand degrees
/// in place of the metre.)
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorLoad {
    rated_force_n: f64,
    mass_kg: f64,
    coulomb_n: f64,
    viscous_n_s_per_m: f64,
}

/// A load that no travel time keeps within its rating, or that is no load.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum RatingError {
    /// Friction alone takes the whole rated force.
    #[error(
        "Coulomb friction of {coulomb_n} N at a rated force of {rated_force_n} N: nothing is left to move with"
    )]
    Friction {
        /// Friction found.
        coulomb_n: f64,
        /// Rated force it must be below.
        rated_force_n: f64,
    },
    /// Not a number, or not of a sign that makes sense.
    #[error("{name} of {value}: must be finite and {right}")]
    Value {
        /// What it is.
        name: &'static str,
        /// What was found.
        value: f64,
        /// What would be right.
        right: &'static str,
    },
}

/// Relative accuracy of a travel time that has no closed form.
const ACCURACY: f64 = 1e-12;

impl MotorLoad {
    /// Checks and takes a load: force at the rated torque, total moved mass (motor, screw and table), Coulomb and viscous
    /// friction in all.
    ///
    /// # Errors
    /// [`RatingError`].
    pub fn new(
        rated_force_n: f64,
        mass_kg: f64,
        coulomb_n: f64,
        viscous_n_s_per_m: f64,
    ) -> Result<Self, RatingError> {
        let check = |name, value: f64, fits: bool, right| {
            if fits && value.is_finite() {
                Ok(())
            } else {
                Err(RatingError::Value { name, value, right })
            }
        };
        check("rated force", rated_force_n, rated_force_n > 0.0, "above 0")?;
        check("moved mass", mass_kg, mass_kg > 0.0, "above 0")?;
        check(
            "Coulomb friction",
            coulomb_n,
            coulomb_n >= 0.0,
            "not below 0",
        )?;
        check(
            "viscous friction",
            viscous_n_s_per_m,
            viscous_n_s_per_m >= 0.0,
            "not below 0",
        )?;
        if coulomb_n >= rated_force_n {
            return Err(RatingError::Friction {
                coulomb_n,
                rated_force_n,
            });
        }
        Ok(Self {
            rated_force_n,
            mass_kg,
            coulomb_n,
            viscous_n_s_per_m,
        })
    }

    /// ∫F²dt of a move in N²·s: inertia, Coulomb and viscous friction. The mixed terms of acceleration and friction are
    /// zero, since the profile is the same forward and backward.
    pub fn force_square_integral(&self, profile: &Profile) -> f64 {
        let mm = 1e-3;
        let (inertia, viscous) = (self.mass_kg * mm, self.viscous_n_s_per_m * mm);
        inertia * inertia * profile.acceleration_square_integral()
            + self.coulomb_n * self.coulomb_n * profile.travel_time_s
            + 2.0 * self.coulomb_n * viscous * profile.distance_mm
            + viscous * viscous * profile.velocity_square_integral()
    }

    /// Root mean square of the force over a move and the rest after it, as a share of the rated force.
    pub fn rms_share(&self, profile: &Profile, rest_s: f64) -> f64 {
        let mean = self.force_square_integral(profile) / (profile.travel_time_s + rest_s);
        mean.sqrt() / self.rated_force_n
    }

    /// How much of a second of feed at this speed counts as rest: `1 − (F/F_N)²`, with F the friction then; at least 0.
    pub fn rest_share_at(&self, velocity_mm_s: f64) -> f64 {
        let force_n = self.coulomb_n + self.viscous_n_s_per_m * 1e-3 * velocity_mm_s;
        let share = force_n / self.rated_force_n;
        (1.0 - share * share).max(0.0)
    }

    /// The source's law with Coulomb friction, in its form: `r³·[(T_N² − Tf²)·r + T_N²·c] = 12·J²·b²`.
    fn law(&self, distance_mm: f64, rest_s: f64) -> TravelTimeLaw {
        let rated = self.rated_force_n * self.rated_force_n;
        let left = rated - self.coulomb_n * self.coulomb_n;
        let momentum = self.mass_kg * 1e-3 * distance_mm;
        TravelTimeLaw {
            rest_s: rest_s * rated / left,
            k_b_squared: 12.0 * momentum * momentum / left,
        }
    }

    /// The shortest time in s for a distance, with a rest after it, within the limits and the rating: [`travel_time_s`]
    /// for this load alone.
    pub fn travel_time_s(
        &self,
        distance_mm: f64,
        rest_s: f64,
        velocity_limit_mm_s: f64,
        acceleration_limit_mm_s2: f64,
    ) -> f64 {
        let least_s =
            minimum_travel_time_s(distance_mm, velocity_limit_mm_s, acceleration_limit_mm_s2);
        // Limits and viscous friction only ever add heat, so the time without them is a lower bound.
        let low_s = least_s.max(self.law(distance_mm, rest_s).travel_time_s());
        let fits = |r: f64| {
            let limits = (velocity_limit_mm_s, acceleration_limit_mm_s2);
            let profile = Profile::new(distance_mm, r, limits.0, limits.1);
            profile.is_some_and(|profile| self.rms_share(&profile, rest_s) <= 1.0)
        };
        if fits(low_s) {
            return low_s;
        }
        // Just above the least time there is a profile; from there on heat falls as the time grows.
        let (mut low_s, mut high_s) = (low_s, low_s * (1.0 + ACCURACY));
        for _ in 0..200 {
            if fits(high_s) {
                break;
            }
            (low_s, high_s) = (high_s, high_s + 2.0 * (high_s - low_s));
        }
        while high_s - low_s > ACCURACY * high_s {
            let middle_s = 0.5 * (low_s + high_s);
            if middle_s <= low_s || middle_s >= high_s {
                break;
            }
            if fits(middle_s) {
                high_s = middle_s;
            } else {
                low_s = middle_s;
            }
        }
        high_s
    }
}

/// Travel time of a path move in whole scans: the shortest in which every limit is kept and no motor is above its rating.
///
/// `axes` are the moving axes that have a load: share of the path distance, rest after the move in s, load. Never rounded
/// down: a motor's rms over move and rest is at most its rating.
pub fn travel_time_s(
    distance_mm: f64,
    velocity_limit_mm_s: f64,
    acceleration_limit_mm_s2: f64,
    scan_period_s: f64,
    axes: impl Iterator<Item = (f64, f64, MotorLoad)>,
) -> f64 {
    let limit_s = minimum_travel_time_s(distance_mm, velocity_limit_mm_s, acceleration_limit_mm_s2);
    let mut scans = libm::ceil(limit_s / scan_period_s * (1.0 - 1e-12));
    for (share, rest_s, load) in axes {
        let needed_s = load.travel_time_s(
            share * distance_mm,
            rest_s,
            share * velocity_limit_mm_s,
            share * acceleration_limit_mm_s2,
        );
        scans = scans.max(libm::ceil(needed_s / scan_period_s));
    }
    scans.max(1.0) * scan_period_s
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The case of the source's Table 1: c = 1, b = 7, K = 54.
    const TABLE_1: TravelTimeLaw = TravelTimeLaw {
        rest_s: 1.0,
        k_b_squared: 54.0 * 7.0 * 7.0,
    };

    /// The same as a load without friction: A = √(12/54) mm/s² at the rated force.
    fn load_of_table_1() -> MotorLoad {
        MotorLoad::new(1e-3 * (12.0f64 / 54.0).sqrt(), 1.0, 0.0, 0.0).unwrap()
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!(
            (found - expected).abs() <= tolerance,
            "{found}, expected {expected}"
        );
    }

    #[test]
    fn halving_gives_table_1_of_the_source_to_the_digit() {
        assert_eq!(TABLE_1.k_b_squared, 2646.0);
        let turns: Vec<f64> = halve(TABLE_1, 16.0, 0.25).collect();
        assert_eq!(turns, [0.0, 16.0, 8.0, 4.0, 6.0, 7.0, 6.5]);
    }

    #[test]
    fn halving_ends_whatever_it_is_given() {
        for (step, tolerance) in [
            (16.0, 0.0),
            (f64::NAN, 0.25),
            (f64::INFINITY, 0.25),
            (16.0, -1.0),
            (16.0, f64::NAN),
        ] {
            assert_eq!(halve(TABLE_1, step, tolerance).collect::<Vec<_>>(), [0.0]);
        }
    }

    #[test]
    fn the_exact_travel_time_of_table_1_is_6_9346_where_the_sources_6_5_overloads_the_motor_to_113_percent()
     {
        let r = TABLE_1.travel_time_s();
        near(r, 6.9346, 5e-5);
        near(r * r * r * (r + 1.0), 2646.0, 1e-9);
        let load = load_of_table_1();
        let unlimited = f64::INFINITY;
        let profile = Profile::new(7.0, 6.5, unlimited, unlimited).unwrap();
        near(load.rms_share(&profile, 1.0), 1.13, 5e-3);
        near(load.travel_time_s(7.0, 1.0, unlimited, unlimited), r, 1e-9);
    }

    /// docs/methods/physics.md §6: b = 7, c = 1, K = 54.
    #[test]
    fn speed_limited_travel_times_are_those_of_the_closed_form() {
        let load = load_of_table_1();
        let rated_mm_s2 = (12.0f64 / 54.0).sqrt();
        for (v_max, expected) in [
            (1.3, 7.062),
            (1.0, 7.899),
            (0.8, 9.250),
            (1.515, 6.935),
            (3.0, 6.935),
        ] {
            let r = load.travel_time_s(7.0, 1.0, v_max, f64::INFINITY);
            near(r, expected, 5e-4);
            if v_max < 1.5 {
                let (q, big_q) = (7.0 / v_max, 16.0 / 9.0 * (v_max / rated_mm_s2).powi(2));
                let closed = 0.5 * ((q - 1.0) + ((q + 1.0) * (q + 1.0) + 4.0 * big_q).sqrt());
                near(r, closed, 1e-9);
            }
        }
    }

    #[test]
    fn coulomb_friction_adds_to_the_heat_as_the_source_of_the_law_says() {
        let load = MotorLoad::new(5000.0, 850.0, 900.0, 0.0).unwrap();
        let (b, c) = (100.0, 0.2);
        let r = load.travel_time_s(b, c, f64::INFINITY, f64::INFINITY);
        let (t_n, tf, j) = (5000.0f64, 900.0f64, 850.0 * 1e-3);
        let left = r.powi(3) * ((t_n * t_n - tf * tf) * r + t_n * t_n * c);
        near(left / (12.0 * j * j * b * b), 1.0, 1e-9);
    }

    #[test]
    fn a_load_without_sense_or_all_friction_is_refused() {
        assert!(matches!(
            MotorLoad::new(100.0, 1.0, 100.0, 0.0),
            Err(RatingError::Friction { .. })
        ));
        for [force, mass, coulomb, viscous] in [
            [0.0, 1.0, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0],
            [1.0, 1.0, -1.0, 0.0],
            [1.0, 1.0, 0.0, -1.0],
            [f64::NAN, 1.0, 0.0, 0.0],
            [1.0, f64::INFINITY, 0.0, 0.0],
        ] {
            assert!(matches!(
                MotorLoad::new(force, mass, coulomb, viscous),
                Err(RatingError::Value { .. })
            ));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 1000, ..ProptestConfig::default() })]

        #[test]
        fn newton_falls_on_the_root_from_above(rest_s in 0.0..100.0f64, k_b_squared in (1e-12f64.ln()..1e12f64.ln()).prop_map(f64::exp)) {
            let law = TravelTimeLaw { rest_s, k_b_squared };
            let r = law.travel_time_s();
            prop_assert!((law.excess(r) / k_b_squared).abs() < 1e-13, "{r}");
            // The source's halving comes as near as it says, from a step that holds the root.
            let coarse = halve(law, 2048.0, 1e-3).last().unwrap();
            prop_assert!((coarse - r).abs() <= 2e-3, "{coarse} {r}");
        }

        #[test]
        fn the_rms_is_never_above_the_rating_and_at_it_where_no_limit_binds(
            b in 0.01..1000.0f64,
            rest_s in 0.0..2.0f64,
            v_max in 10.0..1000.0f64,
            a_max in 500.0..50_000.0f64,
            coulomb in 0.0..0.9f64,
            viscous in 0.0..2000.0f64,
            scan_period_s in prop_oneof![Just(1e-3), Just(250e-6)],
        ) {
            // Viscous friction alone must not take up the rating at the fastest.
            prop_assume!(coulomb * 5000.0 + viscous * v_max * 1e-3 < 4900.0);
            let load = MotorLoad::new(5000.0, 850.0, coulomb * 5000.0, viscous).unwrap();
            let r = load.travel_time_s(b, rest_s, v_max, a_max);
            let profile = Profile::new(b, r, v_max, a_max).unwrap();
            let share = load.rms_share(&profile, rest_s);
            prop_assert!(share <= 1.0 + 1e-9, "{share}");
            prop_assert!(profile.peak_velocity_mm_s <= v_max * (1.0 + 1e-9));
            let least_s = minimum_travel_time_s(b, v_max, a_max);
            prop_assert!(r >= least_s);
            // Not slower than it must be: at the rating, or at the limits.
            prop_assert!(share > 1.0 - 1e-6 || r <= least_s * (1.0 + 1e-9), "{share} {r} {least_s}");
            let whole_s = travel_time_s(b, v_max, a_max, scan_period_s, [(1.0, rest_s, load)].into_iter());
            prop_assert!(whole_s >= r * (1.0 - 1e-12) && whole_s - r <= scan_period_s * (1.0 + 1e-9));
            let whole = Profile::new(b, whole_s, v_max, a_max).unwrap();
            prop_assert!(load.rms_share(&whole, rest_s) <= 1.0 + 1e-9);
            let scans = whole_s / scan_period_s;
            prop_assert!((scans - scans.round()).abs() < 1e-9 * scans);
        }
    }
}
