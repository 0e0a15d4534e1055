//! Friction that is not the same everywhere and always: by place, direction, temperature and rest.

use bytemuck::{Pod, Zeroable};
use schemars::JsonSchema;
use serde::Deserialize;

/// Slower than this an axis rests, in m/s.
const REST_M_S: f64 = 1e-6;

/// Friction that is not the same everywhere and always.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantVariation {
    /// Share by which friction is higher in positive direction and lower in negative.
    #[schemars(extend("minimum" = -0.9, "maximum" = 0.9, "default" = 0.0))]
    pub direction_share: f64,
    /// Amplitude of a wave with each turn of the screw, as a share of friction.
    #[schemars(extend("minimum" = 0, "maximum" = 0.45, "default" = 0.0))]
    pub screw_share: f64,
    /// Amplitude of a long wave over the travel, as a share of friction.
    #[schemars(extend("minimum" = 0, "maximum" = 0.45, "default" = 0.0))]
    pub wave_share: f64,
    /// Length of that wave.
    #[schemars(extend("unit" = "mm", "minimum" = 1, "maximum" = 100_000, "default" = 300.0))]
    pub wave_length_mm: f64,
    /// What is left of friction once the machine is warm.
    #[schemars(extend("minimum" = 0.1, "maximum" = 3, "default" = 1.0))]
    pub warm_share: f64,
    /// Time constant of the warming up, from the first scan on.
    #[schemars(extend("unit" = "s", "minimum" = 0.1, "maximum" = 100_000, "default" = 600.0))]
    pub warm_time_constant_s: f64,
    /// Share of the rise to break-away friction that rest adds at most (Stribeck of the first motion after a stop).
    #[schemars(extend("minimum" = 0, "maximum" = 10, "default" = 0.0))]
    pub rest_share: f64,
    /// Time constant of that.
    #[schemars(extend("unit" = "s", "minimum" = 0.01, "maximum" = 10_000, "default" = 5.0))]
    pub rest_time_constant_s: f64,
}

/// How friction of an axis differs by place, direction, temperature and rest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Variation {
    /// As the plant file has it; none where it says nothing of it.
    pub of: Option<PlantVariation>,
    /// Travel in one turn of the screw, in m.
    pub lead_m: f64,
}

/// What [`Variation`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct VariationState {
    /// Since the machine was switched on, in s.
    pub on_s: f64,
    /// At rest until now, in s.
    pub rest_s: f64,
}

/// What friction is now, as a part of what its contact's keys say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// All of it, springs included.
    pub level: f64,
    /// Sliding in positive and in negative direction, beside that.
    pub sides: [f64; 2],
    /// Break-away friction beside that.
    pub at_rest: f64,
}

impl Conditions {
    /// As the keys say.
    pub const PLAIN: Conditions = Conditions {
        level: 1.0,
        sides: [1.0, 1.0],
        at_rest: 1.0,
    };
}

impl Variation {
    /// `time_s` pass at a place and a speed; what friction is then. Place, temperature and rest change slowly beside that time.
    pub fn update(
        &self,
        state: &mut VariationState,
        time_s: f64,
        place_m: f64,
        velocity_m_s: f64,
    ) -> Conditions {
        state.on_s += time_s;
        if velocity_m_s.abs() < REST_M_S {
            state.rest_s += time_s;
        } else {
            // What rest has built up is worn off over the first tenth of a second of motion.
            state.rest_s *= libm::exp(-time_s / 0.1);
        }
        let Some(of) = &self.of else {
            return Conditions::PLAIN;
        };
        let wave = |length_m: f64| libm::sin(2.0 * std::f64::consts::PI * place_m / length_m);
        let place =
            of.screw_share * wave(self.lead_m) + of.wave_share * wave(of.wave_length_mm * 1e-3);
        let cold = libm::exp(-state.on_s / of.warm_time_constant_s);
        let warm = of.warm_share + (1.0 - of.warm_share) * cold;
        let rested = 1.0 - libm::exp(-state.rest_s / of.rest_time_constant_s);
        Conditions {
            level: (1.0 + place) * warm,
            sides: [1.0 + of.direction_share, 1.0 - of.direction_share],
            at_rest: 1.0 + of.rest_share * rested,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: PlantVariation = PlantVariation {
        direction_share: 0.0,
        screw_share: 0.0,
        wave_share: 0.0,
        wave_length_mm: 1000.0,
        warm_share: 1.0,
        warm_time_constant_s: 1.0,
        rest_share: 0.0,
        rest_time_constant_s: 1.0,
    };

    #[test]
    fn friction_falls_to_its_warm_share_and_waves_with_the_screw() {
        let of = PlantVariation {
            warm_share: 0.7,
            warm_time_constant_s: 200.0,
            screw_share: 0.1,
            ..NONE
        };
        let variation = Variation {
            of: Some(of),
            lead_m: 0.01,
        };
        let mut state = VariationState::default();
        let cold = variation.update(&mut state, 1e-3, 0.0, 0.1);
        assert!((cold.level - 1.0).abs() < 1e-4, "{cold:?}");
        let quarter = variation.update(&mut state, 1e-3, 0.0025, 0.1);
        assert!((quarter.level - 1.1).abs() < 1e-4, "{quarter:?}");
        let warm = variation.update(&mut state, 2000.0, 0.0, 0.1);
        assert!((warm.level - 0.7).abs() < 1e-3, "{warm:?}");
    }

    #[test]
    fn rest_raises_break_away_friction_and_motion_wears_it_off() {
        let of = PlantVariation {
            rest_share: 0.5,
            rest_time_constant_s: 2.0,
            ..NONE
        };
        let variation = Variation {
            of: Some(of),
            lead_m: 0.01,
        };
        let mut state = VariationState::default();
        let rested = variation.update(&mut state, 20.0, 0.0, 0.0);
        assert!((rested.at_rest - 1.5).abs() < 1e-3, "{rested:?}");
        for _ in 0..1000 {
            variation.update(&mut state, 1e-3, 0.0, 0.01);
        }
        let moved = variation.update(&mut state, 1e-3, 0.0, 0.01);
        assert!(moved.at_rest < 1.001, "{moved:?}");
    }
}
