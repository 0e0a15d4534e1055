//! What an axis has to move: the controller's own model of its mechanics, and what is made of it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most slip elements of a friction curve.
pub const SLIP_ELEMENTS_MAX: usize = 6;

/// Mass, friction and elasticity of one axis as felt at the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AxisModel {
    /// Total moved mass: motor and screw (inertia · (2π/lead)²) and table.
    #[schemars(extend("unit" = "kg", "exclusiveMinimum" = 0, "maximum" = 1_000_000))]
    pub mass_kg: f64,
    /// Coulomb friction of motor and table together, below the force of the rated torque.
    #[schemars(extend("unit" = "N", "minimum" = 0, "maximum" = 1_000_000))]
    pub coulomb_n: f64,
    /// Viscous friction of motor and table together.
    #[schemars(extend("unit" = "N·s/m", "minimum" = 0, "maximum" = 10_000_000, "default" = 0.0))]
    pub viscous_n_s_per_m: f64,
    /// How the motor's friction turns round over distance; the table's as well where it has no curve of its own. Without this table it
    /// turns round at once.
    pub friction: Option<FrictionCurve>,
    /// The table's part of it all, and how it is coupled. Without this table the axis is one mass, with a screw that does not give.
    pub table: Option<TableModel>,
}

/// The table behind the screw.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TableModel {
    /// Its mass, at most that of the whole axis.
    #[schemars(extend("unit" = "kg", "exclusiveMinimum" = 0, "maximum" = 1_000_000))]
    pub mass_kg: f64,
    /// Its Coulomb friction, at most that of the whole axis.
    #[schemars(extend("unit" = "N", "minimum" = 0, "maximum" = 1_000_000))]
    pub coulomb_n: f64,
    /// Its viscous friction, at most that of the whole axis.
    #[schemars(extend("unit" = "N·s/m", "minimum" = 0, "maximum" = 10_000_000, "default" = 0.0))]
    pub viscous_n_s_per_m: f64,
    /// Stiffness of screw and nut.
    #[schemars(extend("unit" = "N/µm", "exclusiveMinimum" = 0, "maximum" = 1_000_000))]
    pub stiffness_n_per_um: f64,
    /// Gap between motor and table.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 1000))]
    pub gap_um: f64,
    /// Time in which the backlash is traversed, at least two scans.
    #[schemars(extend("unit" = "ms", "exclusiveMinimum" = 0, "maximum" = 100))]
    pub traversal_ms: f64,
    /// The table's own friction curve.
    pub friction: Option<FrictionCurve>,
}

/// Friction over distance: springs side by side that slip (Maxwell slip elements), and the Stribeck curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrictionCurve {
    /// Share of each element in Coulomb friction; the sum is 1.
    #[schemars(inner(range(min = 0, max = 1)))]
    pub share: [f64; SLIP_ELEMENTS_MAX],
    /// Distance over which each is wound up from rest until it slips; at least 0.01 where its share is not 0.
    #[schemars(inner(range(min = 0, max = 10_000)), extend("unit" = "µm"))]
    pub break_um: [f64; SLIP_ELEMENTS_MAX],
    /// Break-away friction over Coulomb friction.
    #[schemars(extend("minimum" = 1, "maximum" = 10))]
    pub static_ratio: f64,
    /// Stribeck velocity.
    #[schemars(extend("unit" = "mm/s", "exclusiveMinimum" = 0, "maximum" = 1000))]
    pub stribeck_mm_s: f64,
}

/// Torque that is fed forward, part by part.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TorqueFeedForward {
    /// Mass times acceleration.
    #[schemars(extend("default" = false))]
    pub acceleration: bool,
    /// Viscous friction.
    #[schemars(extend("default" = false))]
    pub viscous: bool,
    /// Friction over the distance since the reversal.
    #[schemars(extend("default" = false))]
    pub friction: bool,
    /// Time by which the force lags behind the torque command, at most 0.9 scans; 0.16 is 1/(2π · 1000 Hz) of a usual current loop.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 10, "default" = 0.16))]
    pub current_loop_ms: f64,
}

/// How the axis follows what friction becomes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Adaptation {
    /// Whether friction is followed, taken as tuned, or taken at `level`.
    #[schemars(extend("default" = "off"))]
    pub mode: AdaptationMode,
    /// Friction that the axis begins with, as a part of that of the model.
    #[schemars(extend("minimum" = 0.4, "maximum" = 1.8, "default" = 1.0))]
    pub level: f64,
}

/// What becomes of the model's friction while the machine runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AdaptationMode {
    /// It stays as it was tuned.
    Off,
    /// It is followed at every reversal, from the motor's torque and encoder.
    On,
    /// It stays at `level`.
    Frozen,
}

/// Disturbance observer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DisturbanceObserver {
    /// Bandwidth g; 0 switches it off. At most 0.2 rad in a scan.
    #[schemars(extend("unit" = "rad/s", "minimum" = 0, "maximum" = 1600, "default" = 0.0))]
    pub bandwidth_rad_s: f64,
}

impl Default for TableModel {
    /// No table apart from the motor: the axis is one mass, with a screw that does not give.
    fn default() -> Self {
        TableModel {
            mass_kg: 0.0,
            coulomb_n: 0.0,
            viscous_n_s_per_m: 0.0,
            stiffness_n_per_um: 1e6,
            gap_um: 0.0,
            traversal_ms: 3.0,
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
