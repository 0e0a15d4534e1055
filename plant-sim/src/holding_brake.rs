//! A spring-applied holding brake at the motor: opened by current, closed by springs when the current is gone
//! (docs/methods/physics.md, "Weight and holding brake").

use std::f64::consts::PI;

use bytemuck::{Pod, Zeroable};
use schemars::JsonSchema;
use serde::Deserialize;

/// Angle by which disc and hub are wound up at the torque at which the brake slips, in rad: a tenth of a degree, without the play of
/// some hubs.
const WIND_UP_RAD: f64 = 0.1 * PI / 180.0;
/// Damping ratio of the motor against the closed brake.
const DAMPING_RATIO: f64 = 0.3;

/// A holding brake at the motor. Who opens and closes it, the machine file says.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PlantBrake {
    /// From the current in its coil to a brake that is open.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 2000, "default" = 60.0))]
    pub opening_ms: f64,
    /// From the end of that current to a brake that holds.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 2000, "default" = 30.0))]
    pub closing_ms: f64,
    /// Torque at which it slips.
    #[schemars(extend("unit" = "N·m", "minimum" = 0.001, "maximum" = 100_000))]
    pub torque_nm: f64,
}

/// A brake, as it acts on the motor's travel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldingBrake {
    step_s: f64,
    opening_s: f64,
    closing_s: f64,
    limit_n: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
}

/// What it remembers. All zeros: it is closed, and nobody has opened it yet.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct HoldingBrakeState {
    /// Time since its current was last switched, in s.
    since_s: f64,
    /// How far disc and hub are wound up, in m of travel.
    wind_m: f64,
    /// 1 while there is current in its coil.
    current: u32,
    /// 1 while it does not hold.
    open: u32,
}

impl HoldingBrake {
    /// Of a motor whose inertia is this mass of travel.
    pub fn new(of: &PlantBrake, radius_m: f64, motor_mass_kg: f64, step_s: f64) -> HoldingBrake {
        let limit_n = of.torque_nm / radius_m;
        let stiffness_n_per_m = limit_n / (WIND_UP_RAD * radius_m);
        HoldingBrake {
            step_s,
            opening_s: of.opening_ms * 1e-3,
            closing_s: of.closing_ms * 1e-3,
            limit_n,
            stiffness_n_per_m,
            damping_n_s_per_m: 2.0 * DAMPING_RATIO * (stiffness_n_per_m * motor_mass_kg).sqrt(),
        }
    }

    /// Stiffness with which it holds, in N/m of travel.
    pub fn stiffness_n_per_m(&self) -> f64 {
        self.stiffness_n_per_m
    }

    /// Damping with which it does, in N·s/m.
    pub fn damping_n_s_per_m(&self) -> f64 {
        self.damping_n_s_per_m
    }

    /// So much time passes: a brake whose time has come opens or closes.
    pub fn wait(&self, state: &mut HoldingBrakeState, time_s: f64) {
        state.since_s += time_s;
        let opens = state.current == 1 && state.since_s >= self.opening_s;
        let closes = state.current == 0 && state.since_s >= self.closing_s;
        if opens && state.open == 0 {
            (state.open, state.wind_m) = (1, 0.0);
        } else if closes && state.open == 1 {
            (state.open, state.wind_m) = (0, 0.0);
        }
    }

    /// One microstep at this speed of the motor: the force against it, in N, 0 while it is open.
    ///
    /// `z' = v` as long as `k·|z| < F`, `f = k·z + c·v` within ±F: a spring that slips.
    #[inline]
    pub fn update(&self, state: &mut HoldingBrakeState, motor_m_s: f64) -> f64 {
        if state.open == 1 {
            return 0.0;
        }
        let most_m = self.limit_n / self.stiffness_n_per_m;
        state.wind_m = (state.wind_m + self.step_s * motor_m_s).clamp(-most_m, most_m);
        let force_n = self.stiffness_n_per_m * state.wind_m + self.damping_n_s_per_m * motor_m_s;
        force_n.clamp(-self.limit_n, self.limit_n)
    }
}

impl HoldingBrakeState {
    /// Current in its coil from now on, or none.
    pub fn switch(&mut self, current: bool) {
        let current = u32::from(current);
        if self.current != current {
            (self.current, self.since_s) = (current, 0.0);
        }
    }

    /// Whether there is current in its coil.
    pub fn has_current(&self) -> bool {
        self.current == 1
    }

    /// Whether it holds.
    pub fn holds(&self) -> bool {
        self.open == 0
    }

    /// Whether a brake can be in this state.
    pub fn is_possible(&self) -> bool {
        let finite = self.since_s.is_finite() && self.wind_m.is_finite();
        finite && self.current <= 1 && self.open <= 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 25e-6;

    fn brake() -> HoldingBrake {
        let of = PlantBrake {
            opening_ms: 60.0,
            closing_ms: 30.0,
            torque_nm: 16.0,
        };
        HoldingBrake::new(&of, 1.5915e-3, 758.0, STEP_S)
    }

    /// Switches it, and counts milliseconds until it is so.
    fn until(brake: &HoldingBrake, state: &mut HoldingBrakeState, current: bool) -> u32 {
        state.switch(current);
        let mut ms = 0;
        while state.holds() == current {
            brake.wait(state, 1e-3);
            ms += 1;
        }
        ms
    }

    #[test]
    fn it_is_closed_at_first_and_takes_its_time_to_open_and_to_close() {
        let (brake, mut state) = (brake(), HoldingBrakeState::default());
        brake.wait(&mut state, 10.0);
        assert!(state.holds());
        assert!(until(&brake, &mut state, true).abs_diff(60) <= 1);
        assert!(until(&brake, &mut state, false).abs_diff(30) <= 1);
    }

    #[test]
    fn one_that_is_called_back_on_the_way_stays_as_it_was() {
        let (brake, mut state) = (brake(), HoldingBrakeState::default());
        state.switch(true);
        brake.wait(&mut state, 0.05);
        state.switch(false);
        brake.wait(&mut state, 1.0);
        assert!(state.holds());
        until(&brake, &mut state, true);
        state.switch(false);
        brake.wait(&mut state, 0.02);
        state.switch(true);
        brake.wait(&mut state, 1.0);
        assert!(!state.holds());
    }

    #[test]
    fn closed_it_gives_by_micrometres_and_slips_beyond_its_torque() {
        let (brake, mut state) = (brake(), HoldingBrakeState::default());
        // 785 N on a motor of 758 kg.
        let (mut speed, mut place) = (0.0, 0.0);
        for _ in 0..40_000 {
            let held_n = brake.update(&mut state, speed);
            speed += STEP_S / 758.0 * (-785.0 - held_n);
            place += STEP_S * speed;
        }
        assert!((place * 1e6 + 785.0 / brake.stiffness_n_per_m() * 1e6).abs() < 0.01);
        assert!(place > -1e-6, "{place} m");
        let mut state = HoldingBrakeState::default();
        let held_n = (0..1000).map(|_| brake.update(&mut state, -0.1)).last();
        assert!(held_n.is_some_and(|held_n| (held_n + 16.0 / 1.5915e-3).abs() < 1e-6));
    }
}
