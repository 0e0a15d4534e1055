//! `[axis.gantry]`: the second motor of an axis that two motors drive, one at each end of a bridge.

use schemars::JsonSchema;
use serde::Deserialize;

/// What stands behind the letter of an axis in the name of its second motor.
pub const SECOND_MOTOR: &str = "2";

/// The second motor of an axis. Programs and operators name the axis; this motor gets the same setpoints.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Gantry {
    /// The axis that this motor drives together with the axis's own motor: the letter in front of its name. Travel, speed,
    /// acceleration, jerk, quick stop, increment and changeover of both are the same; loops, model and drive are of each motor.
    pub leader: String,
    /// Largest skew, position of this motor less that of the leader's. The machine trips beyond it.
    #[schemars(extend("unit" = "mm", "exclusiveMinimum" = 0, "maximum" = 100))]
    pub skew_max_mm: f64,
    /// Largest lasting difference of the torques of the two motors, each in percent of its rated torque. Motors that share the work of an
    /// axis stay below 100 %; more means that they pull against each other over the bridge. The machine trips beyond it.
    #[schemars(extend("unit" = "%", "exclusiveMinimum" = 0, "maximum" = 600, "default" = 100.0))]
    pub torque_difference_max_percent: f64,
}
