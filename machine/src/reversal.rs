//! `[axis.reversal]`: what is done where an axis reverses (docs/methods/backlash-acceleration.md).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reversal compensation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Reversal {
    /// How far reversal errors are compensated.
    pub method: ReversalMethod,
    /// Position backlash compensation: the lost motion.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub backlash_um: f64,
    /// What starts the friction pulse ([method](../methods/backlash-acceleration.md)).
    #[schemars(extend("default" = "command-acceleration"))]
    pub trigger: Trigger,
    /// How much of Kp·ε the start by `command-acceleration` is judged by, beside the speed of the command.
    #[schemars(extend("default" = "none"))]
    pub position_error_part: PositionErrorPart,
    /// Form of the friction pulse; its area is the same whatever the form.
    #[schemars(extend("default" = "constant"))]
    pub shape: PulseShape,
    /// Height of the friction pulse.
    #[schemars(extend("unit" = "mm/s", "minimum" = 0, "maximum" = 100, "default" = 0.0))]
    pub pulse_mm_s: f64,
    /// Length Tb of the friction pulse; of a decaying one its decay time τ.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub pulse_ms: f64,
    /// Distance on which friction turns round by 63 %; 0 turns it at once. Of decaying pulses only.
    #[schemars(extend("unit" = "µm", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub presliding_um: f64,
    /// How long before the reversal of the command the friction pulse starts; K = lead/(2·Ts²). At most what the look-ahead
    /// guarantees, (`look_ahead_periods` − ½) interpolation periods.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub lead_ms: f64,
}

/// How far reversal errors are compensated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ReversalMethod {
    /// Not at all.
    None,
    /// Position backlash step only.
    Backlash,
    /// Position backlash step and friction pulse (backlash acceleration).
    FrictionPulse,
    /// Backlash traversed when the contact force that `[axis.model]` predicts changes sign.
    ContactForce,
}

/// What starts the friction pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Trigger {
    /// Change of sign of the position error.
    PositionError,
    /// Change of sign of the feed-forward.
    FeedForward,
    /// Change of sign of the velocity command, Kp·ε + FF.
    VelocityCommand,
    /// The source's own: the speed command within A = K·|R2 − R0| of its sign change.
    CommandAcceleration,
}

/// How much of Kp·ε the start of a friction pulse by [`Trigger::CommandAcceleration`] is judged by, beside the speed of the command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PositionErrorPart {
    /// None: the start depends on the command alone.
    None,
    /// As much as moves the start by half the lead at most.
    Clamped,
    /// All of it, as in the source.
    Full,
}

/// Form of the friction pulse; the same area whatever the form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PulseShape {
    /// The source's own: `pulse_mm_s` for `pulse_ms`.
    Constant,
    /// Follows friction as it turns round over `presliding_um`, from at most `pulse_mm_s` decaying with `pulse_ms`.
    Decaying,
}

impl Trigger {
    /// The word in machine files and reports.
    pub fn word(self) -> &'static str {
        match self {
            Trigger::PositionError => "position-error",
            Trigger::FeedForward => "feed-forward",
            Trigger::VelocityCommand => "velocity-command",
            Trigger::CommandAcceleration => "command-acceleration",
        }
    }
}

impl PulseShape {
    /// The word in machine files and reports.
    pub fn word(self) -> &'static str {
        match self {
            PulseShape::Constant => "constant",
            PulseShape::Decaying => "decaying",
        }
    }
}
