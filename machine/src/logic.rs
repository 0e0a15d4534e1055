//! `[logic]`: a process of the machine builder that does the machine's own logic (docs/howto/logic.md).

use schemars::JsonSchema;
use serde::Deserialize;

/// The machine's own logic: a program in any language, asked again and again, that reads all signals and sets its own.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Logic {
    /// The program and its arguments; a path with a slash counts from the folder of this file. It is run there, and speaks by its
    /// standard input and output.
    #[schemars(length(min = 1, max = 64))]
    pub command: Vec<String>,
    /// Folder that it is run in, from the folder of this file. Copies of a machine file name it in full.
    #[schemars(extend("default" = ""))]
    pub folder: String,
    /// It is asked once in so many interpolation periods.
    #[schemars(extend("unit" = "periods", "minimum" = 1, "maximum" = 100, "default" = 1))]
    pub every_periods: u32,
    /// Longest time from a question to its answer in realtime; later it is lost, as if it had died. An ordinary PC may stall for 50 ms, a busy one
    /// for more: give it what the machine can bear, as `watchdog_scans` of the servos. In lockstep it is waited for.
    #[schemars(extend("unit" = "ms", "minimum" = 1, "maximum" = 60_000, "default" = 50.0))]
    pub deadline_ms: f64,
    /// What the machine does when it is lost: its outputs have their `lost` values then, whatever this says.
    #[schemars(extend("default" = "hold"))]
    pub on_loss: OnLogicLoss,
}

/// What the machine does when its logic is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OnLogicLoss {
    /// It comes to rest on the path; nothing is started or resumed before the logic answers again.
    Hold,
    /// It brakes at its limits and trips; the drives stay off until the logic answers again.
    Trip,
    /// It goes on.
    GoOn,
}
