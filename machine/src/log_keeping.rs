//! `[log]`: what is recorded of a run, and how much of the logs of earlier runs is kept.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::Deserialize;

/// What is recorded of a run: each level has all of those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum LogLevel {
    /// Nothing.
    Off,
    /// What happened to the processes; no samples, so no report.
    Events,
    /// Feedback and command of every axis in every scan: position, velocity, torque, errors, compensation.
    Axes,
    /// Also windows, planner and measuring instruments; a standby where it differs; a servo's whole state where something happens.
    #[default]
    Control,
    /// Every sample whole, with the state of every servo in every scan.
    Full,
}

impl LogLevel {
    /// All of them, from the least on, with their names.
    pub const ALL: [(LogLevel, &str); 5] = [
        (LogLevel::Off, "off"),
        (LogLevel::Events, "events"),
        (LogLevel::Axes, "axes"),
        (LogLevel::Control, "control"),
        (LogLevel::Full, "full"),
    ];

    /// Whether samples are recorded.
    pub fn has_samples(self) -> bool {
        self >= LogLevel::Axes
    }
}

impl fmt::Display for LogLevel {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = LogLevel::ALL.iter().find(|(level, _)| level == self);
        out.write_str(named.map_or("", |(_, name)| name))
    }
}

impl FromStr for LogLevel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = LogLevel::ALL.iter().find(|(_, name)| *name == text);
        named
            .map(|(level, _)| *level)
            .ok_or_else(|| format!("{text:?} is no level of a log"))
    }
}

/// What is recorded of a run, and how much of the logs of earlier runs is kept.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, JsonSchema)]
pub struct LogKeeping {
    /// What is recorded where `--log` does not say.
    #[serde(default)]
    #[schemars(extend("default" = "control"))]
    pub level: LogLevel,
    /// Run directories of this machine below `runs/` take at most so much, the oldest go first; those that `up --out DIR` writes to DIR
    /// too. Without it `run` removes nothing, and `up` keeps at most 20 GB, or a tenth of the disk where that is less, of the runs of
    /// cells that stay up. What was named by `--out` of a `run` is never removed, nor is a run that is marked or under way.
    #[schemars(extend("unit" = "MB", "minimum" = 10, "maximum" = 100_000_000))]
    pub keep_mb: Option<u32>,
    /// The same by age: older ones go.
    #[schemars(extend("unit" = "days", "exclusiveMinimum" = 0, "maximum" = 36_500))]
    pub keep_days: Option<f64>,
}
