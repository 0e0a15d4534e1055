//! The motion of least ∫a²dt over a distance in a time, from rest to rest, within a speed and an acceleration.
/// The motion from rest to rest over a distance in a time that has the least ∫a²dt of all that keep to a speed and an
/// acceleration.
///
/// Without limits it is the parabola of speed (Okuma, JP S59-13044 B2): `v = (6b/r³)·t·(r − t)`, `∫a² = 12b²/r³`. With
/// limits the optimum follows from the calculus of variations: where no limit binds, `d²a/dt² = 0` (the costate of the
/// speed is a straight line in time), so the acceleration is a straight line, cut off at ±a_max, and 0 where the speed is
/// at its limit. It is the same forward and backward in time, so the first half says all:
///
/// ```text
/// a(t) = a_p                            0 ≤ t ≤ t_c     (t_c > 0 only at the acceleration limit, a_p = a_max)
///        a_p·(t_r − t)/(t_r − t_c)    t_c ≤ t ≤ t_r
///        0                            t_r ≤ t ≤ r/2     (t_r < r/2 only at the speed limit)
/// v_p = a_p·(t_r + t_c)/2        ∫a²dt = 2·a_p²·(t_c + (t_r − t_c)/3)
/// ```
///
/// | binds | parameters |
/// |---|---|
/// | nothing | t_c = 0, t_r = r/2, a_p = 6b/r² |
/// | speed, `1.5·b/r > v_max` | t_c = 0, t_r = 1.5·(r − b/v_max), a_p = 2·v_max/t_r; ∫a² = (16/9)·v_max²/(r − b/v_max) |
/// | acceleration, `6b/r² > a_max` | t_r = r/2, u = t_r − t_c = √(3·(r²/4 − b/a_max)); ∫a² = a_max²·(r − 4u/3) |
/// | both | t_r + t_c = 2·v_max/a_max, t_r − t_c = √(12·(v_max/a_max)·(r − b/v_max − v_max/a_max)) |
///
/// At the least time that the limits allow, this is the triangle or trapezoid of constant acceleration. Units: mm (degrees
/// of rotary axes) and s. At and beyond the ends it is at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    /// Distance from rest to rest, in mm.
    pub distance_mm: f64,
    /// Time from rest to rest, in s.
    pub travel_time_s: f64,
    /// Highest acceleration, at both ends, in mm/s².
    pub peak_acceleration_mm_s2: f64,
    /// Until when the acceleration is at its peak (t_c).
    clip_s: f64,
    /// Until when it accelerates (t_r).
    ramp_s: f64,
    /// Speed and place at the end of the ramp.
    pub peak_velocity_mm_s: f64,
    ramp_mm: f64,
}

/// Relative shortfall of a time, excess of a speed or an acceleration against its limit that is rounding.
const ROUNDING: f64 = 1e-9;

/// The least time from rest to rest over a distance within a speed and an acceleration: the triangle's 2·√(b/a), or the
/// trapezoid's b/v + v/a where the triangle would be too fast. In s.
pub fn minimum_travel_time_s(
    distance_mm: f64,
    velocity_limit_mm_s: f64,
    acceleration_limit_mm_s2: f64,
) -> f64 {
    let ramp_s = velocity_limit_mm_s / acceleration_limit_mm_s2;
    if distance_mm <= velocity_limit_mm_s * ramp_s {
        2.0 * (distance_mm / acceleration_limit_mm_s2).sqrt()
    } else {
        distance_mm / velocity_limit_mm_s + ramp_s
    }
}

impl Profile {
    /// The best profile over `distance_mm` in `travel_time_s`. `None` where the limits do not allow that time, and for
    /// numbers that are not above 0; the limits may be infinite.
    pub fn new(
        distance_mm: f64,
        travel_time_s: f64,
        velocity_limit_mm_s: f64,
        acceleration_limit_mm_s2: f64,
    ) -> Option<Self> {
        let (b, r) = (distance_mm, travel_time_s);
        let (v_max, a_max) = (velocity_limit_mm_s, acceleration_limit_mm_s2);
        let usable = b > 0.0 && b.is_finite() && r > 0.0 && r.is_finite();
        if !(usable && v_max > 0.0 && a_max > 0.0) {
            return None;
        }
        if r < minimum_travel_time_s(b, v_max, a_max) * (1.0 - ROUNDING) {
            return None;
        }
        let half_s = 0.5 * r;
        let parabola = (6.0 * b / (r * r), 0.0, half_s);
        let clipped = || {
            let u = (3.0 * (half_s * half_s - b / a_max)).max(0.0).sqrt();
            (a_max, (half_s - u).max(0.0), half_s)
        };
        let flat_top = || {
            let ramp_s = (1.5 * (r - b / v_max)).min(half_s);
            (2.0 * v_max / ramp_s, 0.0, ramp_s)
        };
        let both = || {
            let sum_s = 2.0 * v_max / a_max;
            let spare_s = (r - b / v_max - v_max / a_max).max(0.0);
            let difference_s = (6.0 * sum_s * spare_s).sqrt().min(sum_s);
            let ramp_s = (0.5 * (sum_s + difference_s)).min(half_s);
            (a_max, (sum_s - ramp_s).clamp(0.0, ramp_s), ramp_s)
        };
        let over = 1.0 + ROUNDING;
        let too_fast =
            |(a, clip_s, ramp_s): (f64, f64, f64)| 0.5 * a * (clip_s + ramp_s) > v_max * over;
        let too_hard = |(a, ..): (f64, f64, f64)| a > a_max * over;
        // The both-limits form is the one left when neither limit alone gives a profile within the other.
        let chosen = [parabola]
            .into_iter()
            .chain(std::iter::once_with(flat_top).filter(|_| too_fast(parabola)))
            .chain(std::iter::once_with(clipped).filter(|_| too_hard(parabola)))
            .find(|shape| !too_fast(*shape) && !too_hard(*shape))
            .unwrap_or_else(both);
        let (peak_acceleration_mm_s2, clip_s, ramp_s) = chosen;
        let mut profile = Self {
            distance_mm,
            travel_time_s,
            peak_acceleration_mm_s2,
            clip_s,
            ramp_s,
            peak_velocity_mm_s: 0.0,
            ramp_mm: 0.0,
        };
        (profile.ramp_mm, profile.peak_velocity_mm_s) = profile.on_ramp(ramp_s);
        Some(profile)
    }

    /// ∫a²dt over the whole time, in mm²/s³: what an inertial load costs in copper heat.
    pub fn acceleration_square_integral(&self) -> f64 {
        let line_s = self.ramp_s - self.clip_s;
        2.0 * self.peak_acceleration_mm_s2
            * self.peak_acceleration_mm_s2
            * (self.clip_s + line_s / 3.0)
    }

    /// ∫v²dt over the whole time, in mm²/s: what viscous friction costs.
    pub fn velocity_square_integral(&self) -> f64 {
        let half_s = 0.5 * self.travel_time_s;
        let pieces = [
            (0.0, self.clip_s),
            (self.clip_s, self.ramp_s),
            (self.ramp_s, half_s),
        ];
        // Gauss-Legendre with three points: exact for the fourth powers of time that v² has.
        let outer = 0.6f64.sqrt();
        let of_piece = |(from_s, to_s): (f64, f64)| {
            let (middle_s, reach_s) = (0.5 * (from_s + to_s), 0.5 * (to_s - from_s));
            let square = |share: f64| {
                let (_, v) = self.at(middle_s + share * reach_s);
                v * v
            };
            reach_s * (5.0 * square(-outer) + 8.0 * square(0.0) + 5.0 * square(outer)) / 9.0
        };
        2.0 * pieces.into_iter().map(of_piece).sum::<f64>()
    }

    /// Distance in mm and speed in mm/s at a time from the start, in s.
    pub fn at(&self, time_s: f64) -> (f64, f64) {
        let left_s = self.travel_time_s - time_s;
        if time_s <= 0.0 {
            (0.0, 0.0)
        } else if left_s <= 0.0 {
            (self.distance_mm, 0.0)
        } else if time_s <= left_s {
            self.first_half(time_s)
        } else {
            let (left_mm, velocity_mm_s) = self.first_half(left_s);
            (self.distance_mm - left_mm, velocity_mm_s)
        }
    }

    /// Acceleration at a time from the start, in mm/s²; 0 outside the move.
    pub fn acceleration_mm_s2(&self, time_s: f64) -> f64 {
        let left_s = self.travel_time_s - time_s;
        let of_first_half = |time_s: f64| {
            if time_s < 0.0 || time_s >= self.ramp_s {
                0.0
            } else if time_s <= self.clip_s {
                self.peak_acceleration_mm_s2
            } else {
                self.peak_acceleration_mm_s2 * (self.ramp_s - time_s) / (self.ramp_s - self.clip_s)
            }
        };
        if time_s <= left_s {
            of_first_half(time_s)
        } else {
            -of_first_half(left_s)
        }
    }

    /// The time from the start at which it is at a distance, in s.
    pub fn time_at_s(&self, distance_mm: f64) -> f64 {
        let left_mm = self.distance_mm - distance_mm;
        if distance_mm <= left_mm {
            self.first_half_time_s(distance_mm)
        } else {
            self.travel_time_s - self.first_half_time_s(left_mm)
        }
    }

    /// The speed at a distance, in mm/s.
    pub fn velocity_at_mm_s(&self, distance_mm: f64) -> f64 {
        let nearer_mm = distance_mm.min(self.distance_mm - distance_mm);
        self.first_half(self.first_half_time_s(nearer_mm)).1
    }

    fn first_half(&self, time_s: f64) -> (f64, f64) {
        if time_s <= self.ramp_s {
            self.on_ramp(time_s)
        } else {
            let flat_s = time_s - self.ramp_s;
            (
                self.ramp_mm + self.peak_velocity_mm_s * flat_s,
                self.peak_velocity_mm_s,
            )
        }
    }

    fn on_ramp(&self, time_s: f64) -> (f64, f64) {
        let a = self.peak_acceleration_mm_s2;
        if time_s <= self.clip_s {
            return (0.5 * a * time_s * time_s, a * time_s);
        }
        let (u, line_s) = (time_s - self.clip_s, self.ramp_s - self.clip_s);
        let at_clip_mm_s = a * self.clip_s;
        (
            0.5 * at_clip_mm_s * self.clip_s
                + at_clip_mm_s * u
                + a * u * u * (0.5 - u / (6.0 * line_s)),
            at_clip_mm_s + a * u * (1.0 - u / (2.0 * line_s)),
        )
    }

    /// Inverse of the distance over the first half: exact up to rounding, near the start too.
    fn first_half_time_s(&self, distance_mm: f64) -> f64 {
        let a = self.peak_acceleration_mm_s2;
        let at_clip_mm_s = a * self.clip_s;
        let clip_mm = 0.5 * at_clip_mm_s * self.clip_s;
        if distance_mm <= 0.0 {
            return 0.0;
        }
        if distance_mm <= clip_mm {
            return (2.0 * distance_mm / a).sqrt();
        }
        if distance_mm >= self.ramp_mm {
            return self.ramp_s + (distance_mm - self.ramp_mm) / self.peak_velocity_mm_s;
        }
        // With w = t_r − t the way left on the ramp is v_p·w − a_p·w³/(6·line): a cubic with three real roots, of which the
        // smallest positive one counts: w = 2·s·sin(⅓·asin(…)).
        let line_s = self.ramp_s - self.clip_s;
        let cube = 6.0 * line_s / a;
        let s = (cube * self.peak_velocity_mm_s / 3.0).sqrt();
        let sine = cube * (self.ramp_mm - distance_mm) / (2.0 * s * s * s);
        let w = 2.0 * s * libm::sin(libm::asin(sine.min(1.0)) / 3.0);
        let mut u = (line_s - w).clamp(0.0, line_s);
        // Near the start the arc sine is ill-conditioned, the polynomial is not.
        for _ in 0..2 {
            let way_mm = at_clip_mm_s * u + a * u * u * (0.5 - u / (6.0 * line_s));
            let speed_mm_s = at_clip_mm_s + a * u * (1.0 - u / (2.0 * line_s));
            if speed_mm_s > 0.0 {
                u = (u - (way_mm - (distance_mm - clip_mm)) / speed_mm_s).clamp(0.0, line_s);
            }
        }
        self.clip_s + u
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn close(found: f64, expected: f64, relative: f64) {
        assert!(
            (found - expected).abs() <= relative * expected.abs(),
            "{found}, expected {expected}"
        );
    }

    fn unlimited(b: f64, r: f64) -> Profile {
        Profile::new(b, r, f64::INFINITY, f64::INFINITY).unwrap()
    }

    /// ∫a² of a motion given by its acceleration as a function of τ = t/r, with the integrals done by the midpoint rule,
    /// scaled to the distance b in the time r.
    fn heat_of(b: f64, r: f64, acceleration: impl Fn(f64) -> f64) -> f64 {
        let steps = 20_000;
        let h = 1.0 / f64::from(steps);
        let (mut v, mut x, mut square) = (0.0, 0.0, 0.0);
        for step in 0..steps {
            let a = acceleration((f64::from(step) + 0.5) * h);
            x += (v + 0.5 * a * h) * h;
            v += a * h;
            square += a * a * h;
        }
        assert!(v.abs() < 1e-6, "ends at {v}");
        square / (x * x) * b * b / (r * r * r)
    }

    #[test]
    fn without_limits_it_is_the_parabola_of_the_source() {
        let (b, r) = (7.0, 6.5);
        let profile = unlimited(b, r);
        for step in 0..=100 {
            let t = r * f64::from(step) / 100.0;
            let tau = t / r;
            let (x, v) = profile.at(t);
            assert!((x - b * (3.0 - 2.0 * tau) * tau * tau).abs() < 1e-14 * b);
            assert!((v - 6.0 * b / (r * r * r) * t * (r - t)).abs() < 1e-14);
            assert!(
                (profile.acceleration_mm_s2(t) - 6.0 * b / (r * r * r) * (r - 2.0 * t)).abs()
                    < 1e-12
            );
        }
        close(profile.peak_velocity_mm_s, 1.5 * b / r, 1e-15);
        close(profile.peak_acceleration_mm_s2, 6.0 * b / (r * r), 1e-15);
        close(
            profile.acceleration_square_integral(),
            12.0 * b * b / (r * r * r),
            1e-15,
        );
        close(profile.velocity_square_integral(), 1.2 * b * b / r, 1e-14);
    }

    /// The factors h of ∫a²dt = h·b²/r³ that docs/methods/physics.md §6 gives.
    #[test]
    fn the_parabola_costs_12_and_every_other_shape_more() {
        use std::f64::consts::PI;
        let (b, r) = (3.0, 0.7);
        let unit = b * b / (r * r * r);
        close(
            unlimited(b, r).acceleration_square_integral() / unit,
            12.0,
            1e-12,
        );
        let sign = |tau: f64| if tau < 0.5 { 1.0 } else { -1.0 };
        let third = |tau: f64| {
            if tau < 1.0 / 3.0 {
                1.0
            } else if tau < 2.0 / 3.0 {
                0.0
            } else {
                -1.0
            }
        };
        let half_sine = |tau: f64| libm::cos(PI * tau);
        let quintic = |tau: f64| 60.0 * tau - 180.0 * tau * tau + 120.0 * tau * tau * tau;
        let raised_cosine = |tau: f64| libm::sin(2.0 * PI * tau);
        close(heat_of(b, r, sign) / unit, 16.0, 1e-3);
        close(heat_of(b, r, third) / unit, 13.5, 1e-3);
        close(heat_of(b, r, half_sine) / unit, 12.18, 1e-3);
        close(heat_of(b, r, quintic) / unit, 17.14, 1e-3);
        close(heat_of(b, r, raised_cosine) / unit, 19.74, 1e-3);
    }

    #[test]
    fn at_a_speed_limit_it_is_parabola_flat_parabola() {
        let (b, r, v_max) = (7.0, 7.062, 1.3);
        let profile = Profile::new(b, r, v_max, f64::INFINITY).unwrap();
        let t1 = 1.5 * (r - b / v_max);
        for step in 0..=50 {
            let t = t1 * f64::from(step) / 50.0;
            let share = t / t1;
            close(
                profile.at(t).1 + 1.0,
                v_max * share * (2.0 - share) + 1.0,
                1e-14,
            );
        }
        close(profile.peak_velocity_mm_s, v_max, 1e-14);
        close(
            profile.acceleration_square_integral(),
            16.0 / 9.0 * v_max * v_max / (r - b / v_max),
            1e-13,
        );
    }

    #[test]
    fn at_an_acceleration_limit_the_straight_line_is_cut_off() {
        let (b, r) = (7.0, 6.5);
        // 6b/r² = 0.994; the triangle needs 4b/r² = 0.663.
        for a_max in [0.67, 0.75, 0.85, 0.98] {
            let profile = Profile::new(b, r, f64::INFINITY, a_max).unwrap();
            let us = (3.0 * (r * r / 4.0 - b / a_max)).sqrt();
            close(profile.peak_acceleration_mm_s2, a_max, 1e-15);
            close(
                profile.acceleration_square_integral(),
                a_max * a_max * (r - 4.0 / 3.0 * us),
                1e-12,
            );
        }
        assert_eq!(Profile::new(b, r, f64::INFINITY, 0.66), None);
    }

    #[test]
    fn at_the_least_time_it_is_the_triangle_or_the_trapezoid_of_constant_acceleration() {
        for (b, v_max, a_max) in [
            (10.0, 250.0, 5000.0),
            (100.0, 250.0, 5000.0),
            (12.5, 250.0, 5000.0),
        ] {
            let r = minimum_travel_time_s(b, v_max, a_max);
            let profile = Profile::new(b, r, v_max, a_max).unwrap();
            let accelerating_s = (v_max / a_max).min(0.5 * r);
            close(
                profile.acceleration_square_integral(),
                2.0 * a_max * a_max * accelerating_s,
                1e-5,
            );
            assert_eq!(Profile::new(b, r * (1.0 - 1e-6), v_max, a_max), None);
        }
    }

    #[test]
    fn numbers_that_make_no_move_make_no_profile() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(Profile::new(bad, 1.0, 1e3, 1e4), None);
            assert_eq!(Profile::new(1.0, bad, 1e3, 1e4), None);
        }
        for bad in [0.0, -1.0, f64::NAN] {
            assert_eq!(Profile::new(1.0, 1.0, bad, 1e4), None);
            assert_eq!(Profile::new(1.0, 1.0, 1e3, bad), None);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

        #[test]
        fn it_is_continuous_keeps_its_limits_arrives_and_can_be_inverted(
            b in (1e-3f64.ln()..1e3f64.ln()).prop_map(f64::exp),
            v_max in 1.0..1000.0f64,
            a_max in 100.0..20_000.0f64,
            longer in prop_oneof![Just(1.0), 1.0..1.05f64, 1.0..4.0f64],
        ) {
            let r = minimum_travel_time_s(b, v_max, a_max) * longer;
            let profile = Profile::new(b, r, v_max, a_max).unwrap();
            prop_assert!(profile.peak_velocity_mm_s <= v_max * (1.0 + 1e-9));
            prop_assert!(profile.peak_acceleration_mm_s2 <= a_max * (1.0 + 1e-9));
            let steps = 2000;
            let h = r / f64::from(steps);
            let (mut x, mut v, mut square) = (0.0, 0.0, 0.0);
            for step in 0..=steps {
                let t = h * f64::from(step);
                let (x_now, v_now) = profile.at(t);
                // Speed is the integral of an acceleration within the limit, distance that of the speed.
                prop_assert!((v_now - v).abs() <= a_max * h * (1.0 + 1e-6) + 1e-9 * v_max, "{t}");
                prop_assert!((x_now - x) >= -1e-12 * b);
                prop_assert!((x_now - x - 0.5 * (v + v_now) * h).abs() <= a_max * h * h + 1e-9 * b);
                prop_assert!(v_now >= 0.0 && v_now <= v_max * (1.0 + 1e-9));
                let back_s = profile.time_at_s(x_now);
                prop_assert!((profile.at(back_s).0 - x_now).abs() <= 1e-13 * b.max(1.0), "{t} {back_s}");
                prop_assert!((profile.velocity_at_mm_s(x_now) - v_now).abs() <= 1e-6 * v_max);
                let a = profile.acceleration_mm_s2(t + 0.5 * h);
                square += if step < steps { a * a * h } else { 0.0 };
                (x, v) = (x_now, v_now);
            }
            prop_assert!((x - b).abs() <= 1e-12 * b && v <= 1e-9 * v_max);
            // Half a step at each of the jumps of the acceleration.
            let integral = profile.acceleration_square_integral();
            prop_assert!((square - integral).abs() <= 3.0 * profile.peak_acceleration_mm_s2.powi(2) * h);
        }

        /// Motions within the limits over the same distance and time are a convex set, so the cheapest of them is the one
        /// with ∫a·(a' − a)dt ≥ 0 for every other motion a'. Here a' speeds up and brakes at two rates of its own.
        #[test]
        fn no_other_motion_within_the_limits_is_cheaper(
            b in 1.0..500.0f64,
            v_max in 50.0..500.0f64,
            a_max in 500.0..10_000.0f64,
            longer in 1.01..3.0f64,
            up in 0.01..1.0f64,
            down in 0.01..1.0f64,
        ) {
            let r = minimum_travel_time_s(b, v_max, a_max) * longer;
            let profile = Profile::new(b, r, v_max, a_max).unwrap();
            let (up, down) = (up * a_max, down * a_max);
            // b = v·r − v²/2·(1/up + 1/down)
            let slowness = 0.5 / up + 0.5 / down;
            let root = r * r - 4.0 * slowness * b;
            prop_assume!(root >= 0.0);
            let v = 2.0 * b / (r + root.sqrt());
            prop_assume!(v <= v_max);
            let (until, from) = (v / up, r - v / down);
            let heat = profile.acceleration_square_integral();
            // ∫a·a' = a'·(change of speed) over each stretch of constant a'.
            let gain = up * profile.at(until).1 + down * profile.at(from).1 - heat;
            prop_assert!(gain >= -1e-9 * heat, "{gain} of {heat}");
            let others_heat = up * up * until + down * down * (r - from);
            prop_assert!(others_heat >= heat * (1.0 - 1e-9), "{others_heat} {heat}");
        }
    }
}
