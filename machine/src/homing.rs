//! `[axis.homing]`: how an axis without an absolute encoder finds its place (docs/howto/home.md).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How an axis without an absolute encoder finds its place.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Homing {
    /// What the axis looks for.
    pub method: HomingMethod,
    /// Number of the digital input of the home switch, of methods with a switch.
    #[schemars(extend("minimum" = 0, "maximum" = bus::sample::DIGITAL_INPUTS - 1))]
    pub switch_input: Option<u32>,
    /// The switch opens when it is actuated: its input shows 0 then, and also when its wire is broken.
    #[schemars(extend("default" = false))]
    pub switch_normally_closed: bool,
    /// Direction in which the switch, or without a switch the index, is looked for.
    #[schemars(extend("default" = "negative"))]
    pub direction: HomingDirection,
    /// Speed of the search for the switch. Also the highest speed of a jog as long as the axis is not homed.
    #[schemars(extend("unit" = "mm/s", "exclusiveMinimum" = 0, "maximum" = 1000, "default" = 10.0))]
    pub search_mm_s: f64,
    /// Speed at which the axis leaves the switch, comes back to its edge and goes on to the index.
    #[schemars(extend("unit" = "mm/s", "exclusiveMinimum" = 0, "maximum" = 1000, "default" = 1.0))]
    pub latch_mm_s: f64,
    /// Position of the machine where the reference point is: the index, or without an index the edge of the switch. A drive that homes
    /// by itself knows it itself.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000, "default" = 0.0))]
    pub position_mm: f64,
    /// Where the axis goes once it is homed, and stands then. Without it clear of switch and index: a lead and the braking way behind the
    /// reference point where that is a switch, two and a half leads where it is the index behind one, half a lead where it is an index
    /// alone; a drive that homes by itself leaves the axis where it is.
    #[schemars(extend("unit" = "mm", "minimum" = -100_000, "maximum" = 100_000))]
    pub rest_mm: Option<f64>,
    /// Longest way of each search; after it the axis stops. Without it 1.1 times the travel.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 200_000))]
    pub search_distance_mm: Option<f64>,
    /// Longest time for a drive that homes by itself; after it the machine trips.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0, "maximum" = 3600, "default" = 60.0))]
    pub patience_s: f64,
    /// Axes are homed one after another, the lowest number first; of equal ones the first in this file.
    #[schemars(extend("minimum" = 1, "maximum" = 8, "default" = 1))]
    pub order: u32,
}

/// What an axis looks for to find its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum HomingMethod {
    /// The edge of a switch; as exact as the switch, and as the way of one scan at `latch_mm_s`.
    Switch,
    /// The edge of a switch, then the next index of the motor encoder: exact to one count of the encoder.
    SwitchIndex,
    /// The next index of the motor encoder alone, for axes with less than a turn of travel.
    Index,
    /// The drive does it by itself (CiA 402 mode 6), as it is set up.
    Drive,
}

/// Direction of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum HomingDirection {
    /// Towards lower positions.
    Negative,
    /// Towards higher positions.
    Positive,
}

/// A motion by hand may use this share of the axis's acceleration: it is watched by eye and stops by hand.
pub const JOG_ACCELERATION_SHARE: f64 = 0.2;
/// The index must come within so many turns of the motor behind the edge of the switch.
pub const INDEX_TURNS: f64 = 1.5;

impl HomingMethod {
    /// Whether it has the index of the motor encoder.
    pub fn has_index(self) -> bool {
        matches!(self, HomingMethod::Index | HomingMethod::SwitchIndex)
    }

    /// Whether it has a switch.
    pub fn has_switch(self) -> bool {
        matches!(self, HomingMethod::Switch | HomingMethod::SwitchIndex)
    }
}

impl HomingDirection {
    /// −1 or 1.
    pub fn sign(self) -> i64 {
        match self {
            HomingDirection::Negative => -1,
            HomingDirection::Positive => 1,
        }
    }
}
