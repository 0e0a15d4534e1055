//! Friction that is not the same everywhere and always: by place, direction, temperature and rest.

use bytemuck::{Pod, Zeroable};

/// Slower than this an axis rests, in m/s.
const REST_M_S: f64 = 1e-6;

/// By how much friction differs from what its contact's own keys say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variation {
    /// Share by which friction is higher in positive direction, and lower in negative.
    pub direction_share: f64,
    /// Amplitude of a wave with the turn of the screw, as a share.
    pub screw_share: f64,
    /// Length of a turn, in m.
    pub lead_m: f64,
    /// Amplitude of a long wave over the travel, as a share.
    pub wave_share: f64,
    /// Its length, in m.
    pub wave_length_m: f64,
    /// What is left of friction once the machine is warm.
    pub warm_share: f64,
    /// Time constant of the warming up, in s.
    pub warm_time_constant_s: f64,
    /// Share of break-away friction that rest adds at most.
    pub rest_share: f64,
    /// Time constant of that, in s.
    pub rest_time_constant_s: f64,
}

impl Default for Variation {
    /// None.
    fn default() -> Self {
        Variation {
            direction_share: 0.0,
            screw_share: 0.0,
            lead_m: 1.0,
            wave_share: 0.0,
            wave_length_m: 1.0,
            warm_share: 1.0,
            warm_time_constant_s: 1.0,
            rest_share: 0.0,
            rest_time_constant_s: 1.0,
        }
    }
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
        let wave = |length_m: f64| libm::sin(2.0 * std::f64::consts::PI * place_m / length_m);
        let place =
            self.screw_share * wave(self.lead_m) + self.wave_share * wave(self.wave_length_m);
        let cold = libm::exp(-state.on_s / self.warm_time_constant_s);
        let warm = self.warm_share + (1.0 - self.warm_share) * cold;
        let rested = 1.0 - libm::exp(-state.rest_s / self.rest_time_constant_s);
        Conditions {
            level: (1.0 + place) * warm,
            sides: [1.0 + self.direction_share, 1.0 - self.direction_share],
            at_rest: 1.0 + self.rest_share * rested,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn friction_falls_to_its_warm_share_and_waves_with_the_screw() {
        let variation = Variation {
            warm_share: 0.7,
            warm_time_constant_s: 200.0,
            screw_share: 0.1,
            lead_m: 0.01,
            ..Variation::default()
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
        let variation = Variation {
            rest_share: 0.5,
            rest_time_constant_s: 2.0,
            ..Variation::default()
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
