//! The force of the cut on the table.

use bytemuck::{Pod, Zeroable};
use schemars::JsonSchema;
use serde::Deserialize;

/// The force of the cut on the table.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantCutting {
    /// Mean force while the tool is in the material, positive in positive direction.
    #[schemars(extend("unit" = "N", "minimum" = -100_000, "maximum" = 100_000))]
    pub force_n: f64,
    /// Amplitude of the force of the teeth beside it.
    #[schemars(extend("unit" = "N", "minimum" = 0, "maximum" = 100_000, "default" = 0.0))]
    pub tooth_n: f64,
    /// Teeth that pass in a second.
    #[schemars(extend("unit" = "Hz", "minimum" = 0.1, "maximum" = 10_000, "default" = 133.0))]
    pub tooth_hz: f64,
    /// Time in the material.
    #[schemars(extend("unit" = "s", "minimum" = 0.001, "maximum" = 10_000, "default" = 1.0))]
    pub on_s: f64,
    /// Time out of it; with 0 the tool never leaves it.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 10_000, "default" = 0.0))]
    pub off_s: f64,
}

/// What [`PlantCutting`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct CuttingState {
    /// Since the last entry, in s.
    pub phase_s: f64,
}

impl PlantCutting {
    /// The force on the table, in N; `time_s` pass.
    pub fn update(&self, state: &mut CuttingState, time_s: f64) -> f64 {
        state.phase_s += time_s;
        let period_s = self.on_s + self.off_s;
        if state.phase_s >= period_s {
            state.phase_s -= period_s;
        }
        if self.off_s > 0.0 && state.phase_s >= self.on_s {
            return 0.0;
        }
        let turns = self.tooth_hz * state.phase_s;
        self.force_n + self.tooth_n * libm::sin(2.0 * std::f64::consts::PI * turns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tool_is_in_the_material_for_its_part_of_the_time() {
        let cutting = PlantCutting {
            force_n: 120.0,
            tooth_n: 40.0,
            tooth_hz: 133.0,
            on_s: 0.3,
            off_s: 0.1,
        };
        let mut state = CuttingState::default();
        let all: Vec<f64> = (0..8000)
            .map(|_| cutting.update(&mut state, 1e-3))
            .collect();
        let on = all.iter().filter(|force_n| **force_n != 0.0).count();
        assert!((5990..=6010).contains(&on), "{on}");
        let mean_n = all.iter().sum::<f64>() / on as f64;
        assert!((mean_n - 120.0).abs() < 2.0, "{mean_n}");
        let peak_n = all.iter().copied().fold(0.0, f64::max);
        assert!((peak_n - 160.0).abs() < 2.0, "{peak_n}");
    }
}
