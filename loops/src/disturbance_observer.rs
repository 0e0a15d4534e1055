//! The force that nobody planned, observed and taken out.
use bytemuck::{Pod, Zeroable};

/// Estimates the force that resists the axis beyond what was fed forward.
///
/// ```text
/// d̂ = Q·(F − F_ff) − Q·s·M·(v − v_c),   Q = g/(s + g)
///   = z − M·g·Δv,   z ← z + (1 − exp(−g·Tp))·[(F − F_ff) + M·g·Δv − z]
/// ```
///
/// Adding d̂ to the torque makes the velocity loop act as if it had the gain Kv + M·g and the integral gain Kv·g, at no cost
/// at the reversals that the feed-forward foresees. Source: Ohnishi's disturbance observer (Ohnishi, Shibata, Murakami 1996), on the
/// deviation from the feed-forward. Units: N, mm/s, kg; g in rad/s. First call: 0. Limit: the force it asks for is
/// bounded by `limit_n`; a number that is not one makes it start again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisturbanceObserver {
    /// g, in rad/s; 0 switches it off.
    pub bandwidth_rad_s: f64,
    /// M, in kg at the table.
    pub mass_kg: f64,
    /// Tp, in s.
    pub scan_s: f64,
    /// Most that it asks for, in N.
    pub limit_n: f64,
}

/// What [`DisturbanceObserver`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct DisturbanceObserverState {
    /// z, in N.
    pub filtered_n: f64,
}

impl DisturbanceObserver {
    /// One scan: the estimate in N. `force_n` acted beyond what was fed forward, `off_mm_s` is measured less commanded velocity.
    pub fn update(&self, state: &mut DisturbanceObserverState, force_n: f64, off_mm_s: f64) -> f64 {
        let momentum_n = self.mass_kg * self.bandwidth_rad_s * off_mm_s * 1e-3;
        let share = 1.0 - libm::exp(-self.bandwidth_rad_s * self.scan_s);
        let next_n = state.filtered_n + share * (force_n + momentum_n - state.filtered_n);
        if !next_n.is_finite() {
            state.filtered_n = 0.0;
            return 0.0;
        }
        state.filtered_n = next_n;
        (state.filtered_n - momentum_n)
            .max(-self.limit_n)
            .min(self.limit_n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBSERVER: DisturbanceObserver = DisturbanceObserver {
        bandwidth_rad_s: 100.0,
        mass_kg: 858.0,
        scan_s: 1e-3,
        limit_n: 5000.0,
    };

    #[test]
    fn a_force_that_moves_nothing_is_seen_whole_after_a_few_time_constants() {
        let (mut state, mut found) = (DisturbanceObserverState::default(), 0.0);
        for _ in 0..100 {
            found = OBSERVER.update(&mut state, 300.0, 0.0);
        }
        assert!((found - 300.0).abs() < 0.1, "{found}");
    }

    #[test]
    fn force_that_only_accelerates_the_mass_is_no_disturbance() {
        // 858 N accelerate 858 kg by 1 m/s²: 1 mm/s more each scan.
        let (mut state, mut largest) = (DisturbanceObserverState::default(), 0.0f64);
        for scan in 1..200 {
            let found = OBSERVER.update(&mut state, 858.0, f64::from(scan));
            largest = largest.max(found.abs());
        }
        assert!(largest < 0.1 * 858.0, "{largest}");
    }

    #[test]
    fn it_asks_for_no_more_than_its_limit_and_forgets_what_is_no_number() {
        let mut state = DisturbanceObserverState::default();
        for _ in 0..1000 {
            assert!(OBSERVER.update(&mut state, 1e6, 0.0) <= 5000.0);
        }
        assert_eq!(OBSERVER.update(&mut state, f64::NAN, 0.0), 0.0);
        assert_eq!(state.filtered_n, 0.0);
    }
}
