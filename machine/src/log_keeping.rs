//! `[log]`: how much of the logs of earlier runs is kept.

use schemars::JsonSchema;
use serde::Deserialize;

/// How much of the logs of earlier runs is kept. Without a key, all.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogKeeping {
    /// Run directories of this machine below `runs/` take at most so much, the oldest go first. What was named by `--out` elsewhere is
    /// never removed, nor is a run that is under way.
    #[schemars(extend("unit" = "MB", "minimum" = 10, "maximum" = 100_000_000))]
    pub keep_mb: Option<u32>,
    /// The same by age: older ones go.
    #[schemars(extend("unit" = "days", "exclusiveMinimum" = 0, "maximum" = 36_500))]
    pub keep_days: Option<f64>,
}
