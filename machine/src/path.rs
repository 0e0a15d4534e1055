//! `[path]`: how far the path that is travelled may leave the programmed one.

use schemars::JsonSchema;
use serde::Deserialize;

/// How far the path that is travelled may leave the programmed one ([method](../methods/rounding.md)).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct PathSettings {
    /// Tolerance of G64 without P. Above 0 programs begin in G64 with it, at 0 in G61: exact.
    #[schemars(extend("unit" = "mm", "minimum" = 0, "maximum" = 5, "default" = 0.0))]
    pub tolerance_mm: f64,
    /// Kinks of a larger angle are corners, for which P of G64 counts; Q counts for smaller ones, those of chords.
    #[schemars(extend("unit" = "°", "exclusiveMinimum" = 0, "maximum" = 180, "default" = 30.0))]
    pub corner_angle_deg: f64,
    /// Tolerance of rotary axes wherever the path is rounded.
    #[schemars(extend("unit" = "°", "exclusiveMinimum" = 0, "maximum" = 5, "default" = 0.05))]
    pub rotary_tolerance_deg: f64,
    /// Highest override of feeds that the order `override` takes. Above 100 % feeds go as far above what the program asks for as the axes bear;
    /// rapids never do.
    #[schemars(extend("unit" = "%", "minimum" = 100, "maximum" = bus::sample::OVERRIDE_MAX_PERCENT, "default" = 100))]
    pub feed_override_max_percent: u32,
    /// Frequency of the machine that a program's motion does not excite ([method](../methods/smooth-motion.md)). Without it none is spared.
    #[schemars(extend("unit" = "Hz", "minimum" = 2, "maximum" = 1000))]
    pub vibration_hz: Option<f64>,
}
