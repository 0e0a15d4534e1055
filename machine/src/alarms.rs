//! `[[alarm]]`: what the operator is told of inputs, and what the machine does then (docs/howto/signals.md).

use schemars::JsonSchema;
use serde::Deserialize;

/// An alarm of the machine: by a signal, or raised by the logic.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Alarm {
    /// Number of the alarm; numbers below 100 are kept for the controller.
    #[schemars(extend("minimum" = 100, "maximum" = 999_999))]
    pub number: u32,
    /// What is wrong, in a few words.
    #[schemars(length(min = 1, max = 200))]
    pub text: String,
    /// What to do about it.
    #[schemars(length(max = 400), extend("default" = ""))]
    pub remedy: String,
    /// Signal that it comes by. Without one the logic raises it.
    pub signal: Option<String>,
    /// It comes while the signal shows this value; the default is for a switch that is on while all is well.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000, "default" = 0.0))]
    pub when: f64,
    /// Of a number: it comes while the signal is below this, in place of `when`.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000))]
    pub below: Option<f64>,
    /// Of a number: it comes while the signal is above this, in place of `when`.
    #[schemars(extend("minimum" = -1_000_000_000, "maximum" = 1_000_000_000))]
    pub above: Option<f64>,
    /// It comes only after this has lasted so long.
    #[schemars(extend("unit" = "s", "minimum" = 0, "maximum" = 3600, "default" = 0.0))]
    pub after_s: f64,
    /// What the machine does while it is there.
    #[schemars(extend("default" = "nothing"))]
    pub reaction: AlarmReaction,
}

/// What the machine does while an alarm is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AlarmReaction {
    /// It goes on.
    Nothing,
    /// No program is started or resumed.
    NoStart,
    /// The program is held, and not started or resumed.
    Hold,
    /// It brakes at its limits and trips; drives stay off.
    Trip,
}

impl Alarm {
    /// Whether the value of its signal brings it.
    pub fn comes_by(&self, value: f64) -> bool {
        match (self.below, self.above) {
            (None, None) => value == self.when,
            (below, above) => {
                below.is_some_and(|below| value < below) || above.is_some_and(|above| value > above)
            }
        }
    }
}
