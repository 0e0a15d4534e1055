//! Lines of JSON, one for each seed.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, bail};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Campaign;

/// One of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Line {
    /// What it is a part of.
    pub campaign: Campaign,
    /// Number of the seed.
    pub number: u64,
    /// What became of it, as its bench has it.
    pub found: Value,
}

/// A file of them, or none where nobody wants one.
pub(crate) struct Lines<'a> {
    campaign: &'a Campaign,
    file: Option<(Mutex<File>, PathBuf)>,
}

impl<'a> Lines<'a> {
    /// Creates the file; one of that name is emptied.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn create(campaign: &'a Campaign, path: Option<&Path>) -> anyhow::Result<Lines<'a>> {
        let file = path.map(|path| {
            let file = File::create(path).with_context(|| path.display().to_string())?;
            Ok::<_, anyhow::Error>((Mutex::new(file), path.to_path_buf()))
        });
        Ok(Lines {
            campaign,
            file: file.transpose()?,
        })
    }

    /// Writes a line, whole or not at all.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, number: u64, found: &impl Serialize) -> anyhow::Result<()> {
        let Some((file, path)) = &self.file else {
            return Ok(());
        };
        let line = Line {
            campaign: self.campaign.clone(),
            number,
            found: serde_json::to_value(found)?,
        };
        let text = serde_json::to_string(&line)? + "\n";
        let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
        let written = file.write_all(text.as_bytes());
        written.with_context(|| path.display().to_string())
    }
}

/// All lines of some files, in the order of their numbers.
///
/// # Errors
/// A line that is none, lines of different campaigns, or two of one number.
pub(super) fn read(files: &[PathBuf]) -> anyhow::Result<Vec<Line>> {
    let mut all: Vec<Line> = Vec::new();
    for path in files {
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        for (index, line) in text.lines().enumerate() {
            let named = || format!("{}:{}", path.display(), index + 1);
            let line: Line = serde_json::from_str(line).with_context(named)?;
            if let Some(first) = all.first()
                && first.campaign != line.campaign
            {
                bail!(
                    "{}: is of another campaign than {}",
                    named(),
                    files_first(files)
                );
            }
            all.push(line);
        }
    }
    all.sort_by_key(|line| line.number);
    let mut neighbours = all.windows(2);
    if let Some([twice, _]) = neighbours.find(|pair| matches!(pair, [a, b] if a.number == b.number))
    {
        bail!("number {} is there twice", twice.number);
    }
    Ok(all)
}

fn files_first(files: &[PathBuf]) -> String {
    let first = files.first().map(|path| path.display().to_string());
    first.unwrap_or_default()
}
