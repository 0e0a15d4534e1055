//! How a run ended.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use bus::files::open_to_read;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// How a run ended, in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutcomeKind {
    /// The program is done and the machine in position.
    Completed,
    /// Stopped for a reason.
    Stopped,
    /// Stopped by the operator.
    Interrupted,
}

/// How the launcher saw a run end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ended {
    /// The last scan.
    pub scan: u64,
    /// How; none if it did not say so.
    pub kind: Option<OutcomeKind>,
    /// Why, in words.
    pub text: String,
}

/// The last events of a run that are read, in bytes.
const TAIL_BYTES: u64 = 64 << 10;

/// The end of the run, as the launcher noted it among the events.
pub fn ended(run_dir: &Path) -> Option<Ended> {
    let mut file = open_to_read(&run_dir.join("events.jsonl")).ok()?;
    let length = file.metadata().ok()?.len();
    let mut tail = Vec::new();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL_BYTES)))
        .and_then(|_| file.read_to_end(&mut tail))
        .ok()?;
    let events = String::from_utf8_lossy(&tail);
    let events = events.lines().rev();
    let mut events = events.filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let ended = events.find(|event| event["event"] == "ended")?;
    let kind = ended.get("outcome").cloned();
    Some(Ended {
        scan: ended["scan"].as_u64()?,
        kind: kind.and_then(|kind| serde_json::from_value(kind).ok()),
        text: ended["text"].as_str().unwrap_or_default().to_string(),
    })
}
