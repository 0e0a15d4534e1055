//! The bridge of a gantry: a spring and a damper between the tables at its two ends.

use crate::mechanics::MechanicsState;

/// What joins the two ends (docs/methods/physics.md, "A bridge between two motors").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bridge {
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
}

impl Bridge {
    /// Of this stiffness in N/m, between tables of these masses in kg that swing against each other with this damping ratio:
    /// `c = 2·ζ·sqrt(k·m)`, with the reduced mass `m = m1·m2/(m1 + m2)`.
    pub fn new(stiffness_n_per_m: f64, damping_ratio: f64, masses_kg: [f64; 2]) -> Bridge {
        let [first_kg, second_kg] = masses_kg;
        let reduced_kg = first_kg * second_kg / (first_kg + second_kg);
        Bridge {
            stiffness_n_per_m,
            damping_n_s_per_m: 2.0 * damping_ratio * libm::sqrt(stiffness_n_per_m * reduced_kg),
        }
    }

    /// Force on the first table, in N; the other one gets as much the other way. The bridge is square where both are at one place.
    ///
    /// `F = k·(x2 − x1) + c·(v2 − v1)`.
    #[inline]
    pub fn force_n(&self, first: &MechanicsState, second: &MechanicsState) -> f64 {
        self.stiffness_n_per_m * (second.table_m - first.table_m)
            + self.damping_n_s_per_m * (second.table_m_s - first.table_m_s)
    }
}
