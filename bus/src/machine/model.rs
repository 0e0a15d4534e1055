//! What the controller knows of an axis's mechanics: `[axis.model]`.

use serde::Deserialize;

/// Most slip elements of a friction curve.
pub const SLIP_ELEMENTS_MAX: usize = 6;

/// Mass, friction and elasticity of an axis as identified, at the table side of the screw.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisModel {
    /// All that moves: motor, screw and table, in kg.
    pub mass_kg: f64,
    /// Coulomb friction of motor and table, in N.
    pub coulomb_n: f64,
    /// Viscous friction of motor and table, in N·s/m.
    pub viscous_n_s_per_m: f64,
    /// The table's part, and how it is coupled.
    pub table: Option<TableModel>,
    /// How friction turns round over distance.
    pub friction: Option<FrictionCurve>,
}

/// The table behind the screw.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableModel {
    /// Mass of the table, in kg.
    pub mass_kg: f64,
    /// Coulomb friction of the table, in N.
    pub coulomb_n: f64,
    /// Viscous friction of the table, in N·s/m.
    pub viscous_n_s_per_m: f64,
    /// Stiffness of screw and nut, in N/µm.
    pub stiffness_n_per_um: f64,
    /// Gap between motor and table, in µm.
    pub gap_um: f64,
    /// Time in which the gap is crossed, in ms.
    pub crossing_ms: f64,
    /// Its own curve.
    pub friction: Option<FrictionCurve>,
}

/// Maxwell slip elements.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrictionCurve {
    /// Share of each element in Coulomb friction; the sum is 1.
    pub share: [f64; SLIP_ELEMENTS_MAX],
    /// Distance over which each winds up from rest until it slips, in µm.
    pub break_um: [f64; SLIP_ELEMENTS_MAX],
    /// Break-away over Coulomb friction.
    pub static_ratio: f64,
    /// Stribeck velocity, in mm/s.
    pub stribeck_mm_s: f64,
}

/// Torque that is fed forward, part by part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub struct TorqueFeedForward {
    /// Mass times acceleration.
    #[serde(default)]
    pub acceleration: bool,
    /// Viscous friction.
    #[serde(default)]
    pub viscous: bool,
    /// Friction over the distance since the reversal.
    #[serde(default)]
    pub friction: bool,
}

impl Default for TableModel {
    /// No table apart from the motor: what is known of the axis is taken as one mass on a stiff screw.
    fn default() -> Self {
        TableModel {
            mass_kg: 0.0,
            coulomb_n: 0.0,
            viscous_n_s_per_m: 0.0,
            stiffness_n_per_um: 1e6,
            gap_um: 0.0,
            crossing_ms: 3.0,
            friction: None,
        }
    }
}

impl Default for FrictionCurve {
    /// Friction that turns round at once.
    fn default() -> Self {
        FrictionCurve {
            share: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            break_um: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
            static_ratio: 1.0,
            stribeck_mm_s: 1.0,
        }
    }
}

impl TorqueFeedForward {
    /// Whether any part is on.
    pub fn any(&self) -> bool {
        self.acceleration || self.viscous || self.friction
    }
}

/// Disturbance observer.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub struct DisturbanceObserver {
    /// Bandwidth g, in rad/s; 0 switches it off.
    pub bandwidth_rad_s: f64,
}
