//! Friction with presliding: generalized Maxwell slip (GMS) with four elements.
//!
//! Inside, everything is SI: N, m, s, kg.

use bytemuck::{Pod, Zeroable};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::sliding_curve::SlidingCurve;
use crate::variation::Conditions;

/// Elements of one contact.
pub const ELEMENTS: usize = 4;

/// Beyond this square of `v/vs` the Stribeck term is below the last bit of the Coulomb force (e⁻⁵⁰ = 2·10⁻²²) and is
/// not computed.
const STRIBECK_EXPONENT_MAX: f64 = 50.0;

/// By which law a contact rubs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PlantLaw {
    /// Generalised Maxwell slip.
    MaxwellSlip,
    /// LuGre: one spring, as stiff as Coulomb friction over the mean of the break distances.
    Lugre,
}

/// What is true of one contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionParameters {
    /// Its law.
    pub law: PlantLaw,
    /// Force in steady sliding well above the Stribeck velocity, without the viscous part, in N.
    pub coulomb_n: f64,
    /// Break-away force, in N; not below `coulomb_n`.
    pub static_n: f64,
    /// Velocity at which the rise to `static_n` has fallen to 1/e, in m/s.
    pub stribeck_velocity_m_s: f64,
    /// Viscous friction, in N·s/m.
    pub viscous_n_s_per_m: f64,
    /// Share of the force each element carries; the sum is 1.
    pub share: [f64; ELEMENTS],
    /// Distance at which each element breaks on the virgin curve, in m.
    pub break_distance_m: [f64; ELEMENTS],
    /// Damping while all elements stick, in N·s/m.
    pub presliding_damping_n_s_per_m: f64,
    /// Time constant with which a slipping element reaches the Stribeck curve, in s.
    pub attraction_s: f64,
    /// Friction in sliding as measured, viscous part included, in place of the Stribeck curve.
    pub measured: Option<SlidingCurve>,
}

/// The constants of [`FrictionSettings::update`] for one microstep length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionSettings {
    law: PlantLaw,
    step_s: f64,
    /// LuGre's σ0, in N/m.
    bristle_n_per_m: f64,
    coulomb_n: f64,
    stribeck_rise_n: f64,
    per_stribeck_velocity_s_per_m: f64,
    viscous_n_s_per_m: f64,
    presliding_damping_n_s_per_m: f64,
    share: [f64; ELEMENTS],
    coulomb_share_n: [f64; ELEMENTS],
    /// Stiffness times microstep, in N·s/m.
    spring_step_n_s_per_m: [f64; ELEMENTS],
    attraction_decay: f64,
    measured: Option<SlidingCurve>,
}

/// Memory of one contact.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct FrictionState {
    /// Force of each element, in N.
    pub force_n: [f64; ELEMENTS],
    /// 1 where an element slips, 0 where it sticks.
    pub slipping: [f64; ELEMENTS],
    /// Velocity of the last microstep, in m/s: a change of its sign makes every element stick.
    pub velocity_m_s: f64,
}

impl FrictionSettings {
    /// Prepares a contact for microsteps of `step_s`.
    pub fn new(parameters: &FrictionParameters, step_s: f64) -> Self {
        let coulomb_share_n = parameters.share.map(|share| share * parameters.coulomb_n);
        let mut spring_step_n_s_per_m = coulomb_share_n;
        for (spring, distance) in spring_step_n_s_per_m
            .iter_mut()
            .zip(parameters.break_distance_m)
        {
            *spring *= step_s / distance;
        }
        let mean_m: f64 = parameters
            .share
            .iter()
            .zip(parameters.break_distance_m)
            .map(|(share, distance_m)| share * distance_m)
            .sum();
        FrictionSettings {
            law: parameters.law,
            step_s,
            bristle_n_per_m: parameters.coulomb_n / mean_m,
            coulomb_n: parameters.coulomb_n,
            stribeck_rise_n: parameters.static_n - parameters.coulomb_n,
            per_stribeck_velocity_s_per_m: 1.0 / parameters.stribeck_velocity_m_s,
            viscous_n_s_per_m: parameters.viscous_n_s_per_m,
            presliding_damping_n_s_per_m: parameters.presliding_damping_n_s_per_m,
            share: parameters.share,
            coulomb_share_n,
            spring_step_n_s_per_m,
            attraction_decay: libm::exp(-step_s / parameters.attraction_s),
            measured: parameters.measured,
        }
    }

    /// The Stribeck curve `s(v) = Fc + (Fs − Fc)·exp(−(v/vs)²)`, in N, without the viscous part.
    #[inline]
    pub fn stribeck_n(&self, velocity_m_s: f64) -> f64 {
        let ratio = velocity_m_s * self.per_stribeck_velocity_s_per_m;
        let exponent = ratio * ratio;
        if exponent > STRIBECK_EXPONENT_MAX {
            self.coulomb_n
        } else {
            self.coulomb_n + self.stribeck_rise_n * libm::exp(-exponent)
        }
    }

    /// One microstep: the force that opposes `velocity_m_s`, in N, positive against positive velocity.
    ///
    /// ```text
    /// stick: F_i += k_i·v·h;   slips from F_i·sgn(v) > α_i·s(v) on
    /// slip:  L = sgn(v)·α_i·s(v);  F_i = L + (F_i − L)·exp(−h/τ_a);   sticks when v changes sign or is zero
    /// F = Σ F_i + σ1·(Σ α_i of the sticking)·v + σ2·v
    /// ```
    ///
    /// Source: Lampaert, Al-Bender, Swevers 2003, with exponential attraction (docs/methods/physics.md §2). An element slips only in the
    /// direction of its force: one that is being unloaded stays on its spring although s(v) falls below its force.
    /// A velocity of exactly zero sticks, so that nothing relaxes at standstill. First call: all elements without force.
    #[inline]
    pub fn update(&self, state: &mut FrictionState, velocity_m_s: f64) -> f64 {
        let v = velocity_m_s;
        if v * state.velocity_m_s <= 0.0 {
            state.slipping = [0.0; ELEMENTS];
        }
        state.velocity_m_s = v;
        let direction = if v < 0.0 { -1.0 } else { 1.0 };

        // Sliding and presliding, the two common cases, do the same as the general one below, in less time.
        let [s0, s1, s2, s3] = state.slipping;
        if (s0 + s1) + (s2 + s3) == 4.0 {
            let level_n = direction * self.stribeck_n(v);
            for (force, share) in state.force_n.iter_mut().zip(self.share) {
                let attractor_n = share * level_n;
                *force = attractor_n + (*force - attractor_n) * self.attraction_decay;
            }
            return sum(&state.force_n) + self.viscous_n_s_per_m * v;
        }
        let mut loaded_n = state.force_n;
        let mut presliding = true;
        for (((loaded, spring), slipping), coulomb) in loaded_n
            .iter_mut()
            .zip(&self.spring_step_n_s_per_m)
            .zip(&state.slipping)
            .zip(&self.coulomb_share_n)
        {
            *loaded += spring * v;
            // The Stribeck curve never lies below the Coulomb force: below that nothing can start to slip.
            presliding &= (*slipping == 0.0) & (*loaded * direction <= *coulomb);
        }
        if presliding {
            state.force_n = loaded_n;
            return sum(&loaded_n)
                + (self.presliding_damping_n_s_per_m + self.viscous_n_s_per_m) * v;
        }

        let level_n = self.stribeck_n(v);
        let mut sticking_share = 0.0;
        for (((force, slipping), loaded), share) in state
            .force_n
            .iter_mut()
            .zip(&mut state.slipping)
            .zip(loaded_n)
            .zip(self.share)
        {
            let limit_n = share * level_n;
            let attractor_n = direction * limit_n;
            let slipped_n = attractor_n + (*force - attractor_n) * self.attraction_decay;
            let sticks = *slipping == 0.0;
            *force = if sticks { loaded } else { slipped_n };
            let breaks = loaded * direction > limit_n;
            *slipping = if sticks & !breaks { 0.0 } else { 1.0 };
            sticking_share += if sticks & !breaks { share } else { 0.0 };
        }
        sum(&state.force_n)
            + (self.presliding_damping_n_s_per_m * sticking_share + self.viscous_n_s_per_m) * v
    }
}

impl FrictionSettings {
    /// As [`update`](Self::update), by the contact's own law and under conditions that change.
    pub fn update_at(&self, state: &mut FrictionState, velocity_m_s: f64, at: &Conditions) -> f64 {
        match self.law {
            PlantLaw::MaxwellSlip => self.maxwell_slip(state, velocity_m_s, at),
            PlantLaw::Lugre => self.lugre(state, velocity_m_s, at),
        }
    }

    /// Sliding friction in the direction of a speed, in N, at least 0.
    fn sliding_n(&self, velocity_m_s: f64, at: &Conditions) -> f64 {
        let [forward, backward] = at.sides;
        let side = if velocity_m_s < 0.0 {
            backward
        } else {
            forward
        };
        if let Some(measured) = &self.measured {
            return at.level * side * measured.force_n(velocity_m_s);
        }
        let risen_n = (self.stribeck_n(velocity_m_s) - self.coulomb_n) * at.at_rest;
        at.level * side * (self.coulomb_n + risen_n)
    }

    fn maxwell_slip(&self, state: &mut FrictionState, velocity_m_s: f64, at: &Conditions) -> f64 {
        let v = velocity_m_s;
        if v * state.velocity_m_s <= 0.0 {
            state.slipping = [0.0; ELEMENTS];
        }
        state.velocity_m_s = v;
        let direction = if v < 0.0 { -1.0 } else { 1.0 };
        let level_n = self.sliding_n(v, at);
        let mut sticking_share = 0.0;
        for (((force, slipping), spring), share) in state
            .force_n
            .iter_mut()
            .zip(&mut state.slipping)
            .zip(self.spring_step_n_s_per_m)
            .zip(self.share)
        {
            let limit_n = share * level_n;
            if *slipping == 0.0 {
                *force += at.level * spring * v;
                if *force * direction > limit_n {
                    *slipping = 1.0;
                } else {
                    sticking_share += share;
                }
            } else {
                let attractor_n = direction * limit_n;
                *force = attractor_n + (*force - attractor_n) * self.attraction_decay;
            }
        }
        sum(&state.force_n)
            + (self.presliding_damping_n_s_per_m * sticking_share + self.viscous_n_s_per_m) * v
    }

    /// LuGre: `ż = v − σ0·|v|/g(v)·z`, `F = σ0·z + σ1·ż + σ2·v`, g the Stribeck curve; σ0 is Coulomb friction over the mean break
    /// distance of the elements, and σ1 falls with speed as in `exp(−(v/vs)²)`, which keeps the contact passive. The bristles' force
    /// is kept in place of the first element's. Source: Canudas de Wit, Olsson, Åström, Lischinsky 1995; σ1(v): Olsson 1996.
    fn lugre(&self, state: &mut FrictionState, velocity_m_s: f64, at: &Conditions) -> f64 {
        let v = velocity_m_s;
        state.velocity_m_s = v;
        let [bristles_n, ..] = &mut state.force_n;
        let stiffness_n_per_m = at.level * self.bristle_n_per_m;
        let sliding_n = self.sliding_n(v, at);
        // Exact over a microstep of constant speed.
        let steady_n = if v < 0.0 { -sliding_n } else { sliding_n };
        let decay = libm::exp(-stiffness_n_per_m * v.abs() * self.step_s / sliding_n);
        let before_n = *bristles_n;
        *bristles_n = steady_n + (before_n - steady_n) * decay;
        let rate_m_s = (*bristles_n - before_n) / (stiffness_n_per_m * self.step_s);
        let ratio = v * self.per_stribeck_velocity_s_per_m;
        let damping = self.presliding_damping_n_s_per_m * libm::exp(-ratio * ratio);
        *bristles_n + damping * rate_m_s + self.viscous_n_s_per_m * v
    }
}

fn sum(force_n: &[f64; ELEMENTS]) -> f64 {
    let [a, b, c, d] = force_n;
    (a + b) + (c + d)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::indexing_slicing)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP_S: f64 = 25e-6;

    /// The reference table X of docs/methods/physics.md §3.
    fn table_x() -> FrictionParameters {
        FrictionParameters {
            law: PlantLaw::MaxwellSlip,
            coulomb_n: 200.0,
            static_n: 260.0,
            stribeck_velocity_m_s: 3e-3,
            viscous_n_s_per_m: 1000.0,
            share: [0.35, 0.30, 0.20, 0.15],
            break_distance_m: [1e-6, 4e-6, 12e-6, 40e-6],
            presliding_damping_n_s_per_m: 6e3,
            attraction_s: 1e-3,
            measured: None,
        }
    }

    /// The elements alone, without any part that depends on velocity.
    fn elements_only() -> FrictionParameters {
        FrictionParameters {
            static_n: 200.0,
            viscous_n_s_per_m: 0.0,
            presliding_damping_n_s_per_m: 0.0,
            ..table_x()
        }
    }

    /// Goes to `to_m` at 50 µm/s and returns (position, force) per microstep.
    fn travel(
        settings: &FrictionSettings,
        state: &mut FrictionState,
        position_m: &mut f64,
        to_m: f64,
    ) -> Vec<(f64, f64)> {
        let distance_m = to_m - *position_m;
        let steps = (distance_m.abs() / (50e-6 * STEP_S)).round();
        let velocity_m_s = distance_m / steps / STEP_S;
        (0..steps as usize)
            .map(|_| {
                *position_m += velocity_m_s * STEP_S;
                (*position_m, settings.update(state, velocity_m_s))
            })
            .collect()
    }

    #[test]
    fn a_load_that_oscillates_below_break_away_moves_nothing_on_average() {
        let settings = FrictionSettings::new(&table_x(), STEP_S);
        let mut state = FrictionState::default();
        let (mut x_m, mut v_m_s) = (0.0, 0.0);
        let mut cycle_mean_m = Vec::new();
        let steps_per_cycle = 4_000; // 10 Hz
        for _ in 0..100 {
            let mut sum_m = 0.0;
            for step in 0..steps_per_cycle {
                let phase =
                    2.0 * std::f64::consts::PI * f64::from(step) / f64::from(steps_per_cycle);
                let load_n = 150.0 + 60.0 * libm::sin(phase);
                v_m_s += STEP_S / 100.0 * (load_n - settings.update(&mut state, v_m_s));
                x_m += STEP_S * v_m_s;
                sum_m += x_m;
            }
            cycle_mean_m.push(sum_m / f64::from(steps_per_cycle));
        }
        let drift_um_s = (cycle_mean_m[99] - cycle_mean_m[19]) * 1e6 / 8.0;
        println!("drift {drift_um_s:.2e} µm/s at {:.2} µm", x_m * 1e6);
        assert!(x_m > 5e-6 && x_m < 50e-6, "presliding {x_m} m");
        assert!(drift_um_s.abs() < 5e-4, "drift {drift_um_s} µm/s");
    }

    #[test]
    fn after_a_reversal_the_curve_is_the_virgin_curve_doubled() {
        let settings = FrictionSettings::new(&elements_only(), STEP_S);
        let virgin = {
            let (mut state, mut x_m) = (FrictionState::default(), 0.0);
            travel(&settings, &mut state, &mut x_m, 60e-6)
        };
        let virgin_at = |x_m: f64| {
            let index = (x_m / 60e-6 * virgin.len() as f64).round() as usize;
            if index == 0 { 0.0 } else { virgin[index - 1].1 }
        };
        let (mut state, mut x_m) = (FrictionState::default(), 0.0);
        let top = *travel(&settings, &mut state, &mut x_m, 60e-6)
            .last()
            .unwrap();
        let back = travel(&settings, &mut state, &mut x_m, -50e-6);
        for (x_m, force_n) in back.iter().step_by(1_000) {
            let expected_n = top.1 - 2.0 * virgin_at((top.0 - x_m) / 2.0);
            assert!(
                (force_n - expected_n).abs() < 0.2,
                "{force_n} N at {x_m} m, Masing says {expected_n} N"
            );
        }
    }

    #[test]
    fn an_inner_loop_closes_and_the_outer_curve_goes_on_as_if_it_had_not_been() {
        let settings = FrictionSettings::new(&elements_only(), STEP_S);
        let (mut plain, mut x_plain_m) = (FrictionState::default(), 0.0);
        travel(&settings, &mut plain, &mut x_plain_m, 10e-6);
        let (mut state, mut x_m) = (FrictionState::default(), 0.0);
        travel(&settings, &mut state, &mut x_m, 10e-6);
        let before_n: f64 = state.force_n.iter().sum();
        travel(&settings, &mut state, &mut x_m, 5e-6);
        travel(&settings, &mut state, &mut x_m, 8e-6);
        travel(&settings, &mut state, &mut x_m, 5e-6);
        travel(&settings, &mut state, &mut x_m, 10e-6);
        let after_n: f64 = state.force_n.iter().sum();
        assert!(
            (after_n - before_n).abs() < 0.05,
            "{before_n} → {after_n} N"
        );
        let plain = travel(&settings, &mut plain, &mut x_plain_m, 30e-6);
        let looped = travel(&settings, &mut state, &mut x_m, 30e-6);
        for (a, b) in plain.iter().zip(&looped) {
            assert!((a.1 - b.1).abs() < 0.05, "{a:?} {b:?}");
        }
    }

    #[test]
    fn steady_sliding_follows_the_stribeck_curve() {
        let parameters = table_x();
        let settings = FrictionSettings::new(&parameters, STEP_S);
        for velocity_mm_s in [-100.0, -5.0, -1.0, 0.2, 1.0, 3.0, 10.0, 30.0, 300.0] {
            let v: f64 = velocity_mm_s * 1e-3;
            let mut state = FrictionState::default();
            let mut force_n = 0.0;
            for _ in 0..40_000 {
                force_n = settings.update(&mut state, v);
            }
            let expected_n =
                v.signum() * (200.0 + 60.0 * libm::exp(-(v / 3e-3) * (v / 3e-3))) + 1000.0 * v;
            assert!(
                (force_n - expected_n).abs() < 1e-6,
                "{velocity_mm_s} mm/s: {force_n} N, curve {expected_n} N"
            );
        }
    }

    #[test]
    fn lugre_slides_by_the_stribeck_curve_and_is_a_spring_at_rest() {
        let parameters = FrictionParameters {
            law: PlantLaw::Lugre,
            ..table_x()
        };
        let settings = FrictionSettings::new(&parameters, STEP_S);
        for velocity_mm_s in [-100.0, -3.0, 1.0, 10.0] {
            let v: f64 = velocity_mm_s * 1e-3;
            let mut state = FrictionState::default();
            let mut force_n = 0.0;
            for _ in 0..40_000 {
                force_n = settings.update_at(&mut state, v, &Conditions::PLAIN);
            }
            let expected_n =
                v.signum() * (200.0 + 60.0 * libm::exp(-(v / 3e-3) * (v / 3e-3))) + 1000.0 * v;
            assert!(
                (force_n - expected_n).abs() < 1e-6,
                "{velocity_mm_s} mm/s: {force_n} N"
            );
        }
        let mut state = FrictionState::default();
        let mut force_n = 0.0;
        // 0.5 µm at 20 µm/s: 200 N over 9.95 µm of mean break distance.
        for _ in 0..1000 {
            force_n = settings.update_at(&mut state, 20e-6, &Conditions::PLAIN);
        }
        assert!((force_n - 200.0 / 9.95 * 0.5).abs() < 0.6, "{force_n} N");
    }

    #[test]
    fn under_plain_conditions_both_ways_to_compute_maxwell_slip_agree() {
        let settings = FrictionSettings::new(&table_x(), STEP_S);
        let (mut fast, mut general) = (FrictionState::default(), FrictionState::default());
        for step in 0..200_000 {
            let v = 0.004 * libm::sin(f64::from(step) * STEP_S * 7.0);
            let a = settings.update(&mut fast, v);
            let b = settings.update_at(&mut general, v, &Conditions::PLAIN);
            assert!((a - b).abs() < 1e-6, "{step}: {a} {b}");
        }
    }

    #[test]
    fn friction_by_direction_slides_as_high_as_its_side() {
        let settings = FrictionSettings::new(&elements_only(), STEP_S);
        let at = Conditions {
            sides: [1.2, 0.8],
            ..Conditions::PLAIN
        };
        for (v, expected_n) in [(0.05, 240.0), (-0.05, -160.0)] {
            let mut state = FrictionState::default();
            let mut force_n = 0.0;
            for _ in 0..4000 {
                force_n = settings.update_at(&mut state, v, &at);
            }
            assert!((force_n - expected_n).abs() < 1e-6, "{force_n}");
        }
    }

    #[test]
    fn measured_friction_slides_as_its_table_says_and_is_elastic_before() {
        let rows = [(-0.1, -300.0), (-0.01, -240.0), (0.01, 160.0), (0.1, 190.0)];
        let parameters = FrictionParameters {
            measured: SlidingCurve::new(rows.into_iter()),
            viscous_n_s_per_m: 0.0,
            ..table_x()
        };
        let settings = FrictionSettings::new(&parameters, STEP_S);
        for (v, expected_n) in [(0.1, 190.0), (0.055, 175.0), (-0.01, -240.0)] {
            let mut state = FrictionState::default();
            let mut force_n = 0.0;
            for _ in 0..40_000 {
                force_n = settings.update_at(&mut state, v, &Conditions::PLAIN);
            }
            assert!((force_n - expected_n).abs() < 1e-6, "{v} m/s: {force_n} N");
        }
        let mut state = FrictionState::default();
        let mut force_n = 0.0;
        // 0.5 µm at 20 µm/s: each element on its spring.
        for _ in 0..1000 {
            force_n = settings.update_at(&mut state, 20e-6, &Conditions::PLAIN);
        }
        let springs = 200.0 * 0.5 * (0.35 / 1.0 + 0.30 / 4.0 + 0.20 / 12.0 + 0.15 / 40.0);
        assert!((force_n - springs).abs() < 0.2, "{force_n} N, {springs} N");
    }

    #[test]
    fn break_away_needs_the_static_force() {
        let settings = FrictionSettings::new(&table_x(), STEP_S);
        let (mut state, mut x_m) = (FrictionState::default(), 0.0);
        let curve = travel(&settings, &mut state, &mut x_m, 200e-6);
        let peak_n = curve.iter().map(|c| c.1).fold(0.0, f64::max);
        assert!((peak_n - 260.0).abs() < 0.5, "{peak_n} N");
    }

    proptest! {
        #[test]
        fn a_closed_cycle_never_creates_energy(
            amplitude_um in 0.05_f64..500.0,
            lugre in any::<bool>(),
            direction in -0.3_f64..0.3,
            second in 0.0_f64..1.0,
            harmonic in 2_u32..7,
            steps in 400_u32..20_000,
        ) {
            let law = if lugre { PlantLaw::Lugre } else { PlantLaw::MaxwellSlip };
            let settings = FrictionSettings::new(&FrictionParameters { law, ..table_x() }, STEP_S);
            let at = Conditions { sides: [1.0 + direction, 1.0 - direction], ..Conditions::PLAIN };
            let mut state = FrictionState::default();
            let w = 2.0 * std::f64::consts::PI / (f64::from(steps) * STEP_S);
            let mut work_j = 0.0;
            for cycle in 0..3 {
                work_j = 0.0;
                for step in 0..steps {
                    let t = f64::from(step) * STEP_S;
                    let v = amplitude_um * 1e-6 * w
                        * (libm::cos(w * t) + second * libm::cos(f64::from(harmonic) * w * t));
                    work_j += settings.update_at(&mut state, v, &at) * v * STEP_S;
                }
                prop_assert!(work_j >= 0.0, "cycle {cycle}: {work_j} J");
            }
            prop_assert!(work_j >= 0.0);
        }
    }
}
