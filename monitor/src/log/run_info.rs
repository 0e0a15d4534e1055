//! What is known of a run besides its samples.

use std::collections::BTreeMap;

use machine::LogLevel;

use super::layout::Extent;

/// Metadata record with which a log begins.
pub(super) const RUN_RECORD: &str = "quadrant.run";
/// Metadata record with which a whole log ends.
pub(super) const END_RECORD: &str = "quadrant.end";
/// Contract of topics and messages in the log.
const LOG_VERSION: &str = "5";

/// Setting of a log that begins later than its cell: scan in which its program was started.
pub const BEGINS_AT: &str = "begins_at_scan";

/// Setting of every log: what is recorded.
pub(super) const LEVEL: &str = "level";

/// What is known when a run begins.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunInfo {
    /// Version of the product.
    pub quadrant: String,
    /// Name of the cell.
    pub cell: String,
    /// `lockstep` or `realtime`.
    pub pace: String,
    /// File name of the program, without folder; its copy stands under this name in the run directory.
    pub program: String,
    /// Whatever else should be in the log, by name.
    pub settings: BTreeMap<String, String>,
    /// Files kept in the log: (name, content). Machine file and program at least.
    pub files: Vec<(String, Vec<u8>)>,
}

/// What is known when a run ends.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunEnd {
    /// Wall time from the first to the last scan, in s.
    pub wall_s: f64,
    /// Samples that the recorder's queues lost, in all.
    pub queue_losses: u64,
    /// A reason from outside that the samples do not tell (an environment failure, a lost launcher).
    pub reason: Option<String>,
    /// Digest of every sample that the recorder has had, whatever is in the log of them; set where the log ends.
    pub digest: Option<String>,
    /// The master's digest of the motion, as the recorder had it last; set where the log ends.
    pub motion_digest: Option<String>,
    /// Commands of standbys that said the same as the servo in force, and so are not in the log; set where the log ends.
    pub commands_alike: u64,
}

/// Something that happened to the process group; for people, not in the digest.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Event {
    /// Scan it belongs to.
    pub scan: u64,
    /// Process it happened to.
    pub process: String,
    /// What happened.
    pub text: String,
}

impl RunInfo {
    /// Scan in which the run began: 0, or in a cell that stays up the one in which its program was started.
    pub fn begins_at(&self) -> u64 {
        let scan = self.settings.get(BEGINS_AT);
        scan.and_then(|scan| scan.parse().ok()).unwrap_or(0)
    }

    /// What is recorded of it; all where the log does not say.
    pub fn level(&self) -> LogLevel {
        let level = self.settings.get(LEVEL).and_then(|text| text.parse().ok());
        level.unwrap_or(LogLevel::Full)
    }

    pub(super) fn to_record(
        &self,
        extent: &Extent,
        scan_period_us: u32,
    ) -> mcap::records::Metadata {
        let mut metadata = self.settings.clone();
        for (key, value) in [
            ("log_version", LOG_VERSION.to_string()),
            ("quadrant", self.quadrant.clone()),
            ("cell", self.cell.clone()),
            ("pace", self.pace.clone()),
            ("program", self.program.clone()),
            ("axes", extent.axes.join(" ")),
            ("subsamples", extent.subsamples.to_string()),
            ("scan_period_us", scan_period_us.to_string()),
        ] {
            metadata.insert(key.into(), value);
        }
        if !extent.signals.is_empty() {
            metadata.insert("signals".into(), extent.signals.join(" "));
        }
        mcap::records::Metadata {
            name: RUN_RECORD.into(),
            metadata,
        }
    }

    /// Back from the record: (info without files, extent, scan period in µs).
    pub(super) fn from_record(
        mut metadata: BTreeMap<String, String>,
    ) -> Result<(RunInfo, Extent, u32), String> {
        let signals = metadata.remove("signals").unwrap_or_default();
        let signals: Vec<String> = signals.split_whitespace().map(str::to_string).collect();
        if signals.len() > bus::sample::SIGNALS_MAX {
            return Err(format!(
                "names {} signals: must be at most {}",
                signals.len(),
                bus::sample::SIGNALS_MAX
            ));
        }
        let mut take = |key: &str| {
            metadata
                .remove(key)
                .ok_or_else(|| format!("metadata {RUN_RECORD} has no {key}"))
        };
        let version = take("log_version")?;
        if version != LOG_VERSION {
            return Err(format!(
                "is a log of version {version}: this program reads version {LOG_VERSION}"
            ));
        }
        let number = |key: &str, text: String, most: u32| match text.parse::<u32>() {
            Ok(value) if value > 0 && value <= most => Ok(value),
            _ => Err(format!(
                "{key} = {text:?}: must be a whole number from 1 to {most}"
            )),
        };
        let axes: Vec<String> = take("axes")?
            .split_whitespace()
            .map(str::to_string)
            .collect();
        if axes.is_empty() || axes.len() > bus::sample::MAX_AXES {
            return Err(format!(
                "names {} axes: must be 1 to {}",
                axes.len(),
                bus::sample::MAX_AXES
            ));
        }
        let subsamples = number(
            "subsamples",
            take("subsamples")?,
            bus::sample::MAX_SUBSAMPLES as u32,
        )?;
        let scan_period_us = number("scan_period_us", take("scan_period_us")?, 1_000_000)?;
        let info = RunInfo {
            quadrant: take("quadrant")?,
            cell: take("cell")?,
            pace: take("pace")?,
            program: take("program")?,
            files: Vec::new(),
            settings: metadata,
        };
        let extent = Extent {
            axes,
            subsamples: subsamples as usize,
            signals,
        };
        Ok((info, extent, scan_period_us))
    }
}

impl RunEnd {
    pub(super) fn to_record(&self) -> mcap::records::Metadata {
        let mut metadata = BTreeMap::from([
            ("wall_s".to_string(), self.wall_s.to_string()),
            ("queue_losses".to_string(), self.queue_losses.to_string()),
            (
                "commands_alike".to_string(),
                self.commands_alike.to_string(),
            ),
        ]);
        let texts = [
            ("reason", &self.reason),
            ("digest", &self.digest),
            ("motion_digest", &self.motion_digest),
        ];
        for (key, text) in texts {
            metadata.extend(text.clone().map(|text| (key.to_string(), text)));
        }
        mcap::records::Metadata {
            name: END_RECORD.into(),
            metadata,
        }
    }

    pub(super) fn from_record(metadata: &BTreeMap<String, String>) -> RunEnd {
        let number = |key: &str| metadata.get(key).and_then(|text| text.parse::<f64>().ok());
        let count = |key: &str| metadata.get(key).and_then(|text| text.parse().ok());
        let text = |key: &str| metadata.get(key).cloned();
        RunEnd {
            wall_s: number("wall_s")
                .filter(|wall_s| wall_s.is_finite() && *wall_s >= 0.0)
                .unwrap_or(0.0),
            queue_losses: count("queue_losses").unwrap_or(0),
            reason: text("reason"),
            digest: text("digest"),
            motion_digest: text("motion_digest"),
            commands_alike: count("commands_alike").unwrap_or(0),
        }
    }
}
