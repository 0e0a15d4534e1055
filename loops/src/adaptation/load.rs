//! The force that something else than friction puts on the table.

use bytemuck::{Pod, Zeroable};

/// Time constant with which a force that comes or goes is followed, in s.
const FOLLOW_S: f64 = 0.03;
/// Part of the table's Coulomb friction below which what comes and goes is cogging and noise.
const DEAD_PART: f64 = 0.15;
/// Most that counts, as a part of the table's Coulomb friction: the gap is crossed all the same.
const PART_MAX: f64 = 0.6;

/// Follows the force that friction does not explain, while the axis slides.
///
/// ```text
/// quick   q ← q + (e − q)·(1 − exp(−T/30 ms))        e: force that the model lacks, friction as it is believed taken off
/// load    L = (q − c) less 15 % of F2 + c·F2/F        c: the constant force of all the last strokes
/// ```
///
/// What has lasted for strokes is friction that differs by direction, and the table has its share of it. What comes and goes faster
/// is a tool that cuts, and acts on the table alone. A weight on the table is taken for the former: its load is taken for smaller than
/// it is. Units: N. At a reversal `q` stays as it was, for there the force that is lacking is that of the reversal itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Scan period, in s.
    pub scan_s: f64,
    /// Coulomb friction of the table, in N.
    pub table_coulomb_n: f64,
    /// Coulomb friction of the whole axis, in N.
    pub coulomb_n: f64,
}

/// What [`Load`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LoadState {
    /// In N.
    quick_n: f64,
}

impl Load {
    /// A scan in which the axis slid; `lacking_n` is the force that friction does not explain.
    pub fn update(&self, state: &mut LoadState, lacking_n: f64) {
        let keep = libm::exp(-self.scan_s / FOLLOW_S);
        state.quick_n = lacking_n + (state.quick_n - lacking_n) * keep;
    }

    /// Force on the table, in N; `constant_n` is what has lasted for strokes.
    pub fn on_table_n(&self, state: &LoadState, constant_n: f64) -> f64 {
        if self.coulomb_n <= 0.0 {
            return 0.0;
        }
        let share = self.table_coulomb_n / self.coulomb_n;
        let quick_n = state.quick_n - constant_n;
        let dead_n = DEAD_PART * self.table_coulomb_n;
        let seen_n = quick_n - quick_n.max(-dead_n).min(dead_n);
        let load_n = seen_n + share * constant_n;
        let most_n = PART_MAX * self.table_coulomb_n;
        load_n.max(-most_n).min(most_n)
    }
}

impl LoadState {
    /// Nothing comes or goes beside what has lasted.
    pub fn rest(&mut self, constant_n: f64) {
        self.quick_n = constant_n;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOAD: Load = Load {
        scan_s: 1e-3,
        table_coulomb_n: 200.0,
        coulomb_n: 450.0,
    };

    fn after(scans: u32, lacking_n: f64) -> LoadState {
        let mut state = LoadState::default();
        for _ in 0..scans {
            LOAD.update(&mut state, lacking_n);
        }
        state
    }

    #[test]
    fn a_cut_acts_on_the_table_alone_and_what_lasts_by_its_share() {
        let state = after(300, 90.0);
        let cut_n = LOAD.on_table_n(&state, 0.0);
        assert!((cut_n - (90.0 - 30.0)).abs() < 0.1, "{cut_n}");
        let lasting_n = LOAD.on_table_n(&state, 90.0);
        assert!((lasting_n - 40.0).abs() < 0.1, "{lasting_n}");
    }

    #[test]
    fn a_load_that_would_never_let_the_gap_be_crossed_does_not_count_in_full() {
        assert_eq!(LOAD.on_table_n(&after(500, 1e4), 0.0), 120.0);
        assert_eq!(LOAD.on_table_n(&after(500, -1e4), 0.0), -120.0);
    }
}
