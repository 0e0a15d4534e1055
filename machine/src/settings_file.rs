//! Settings files (`machine.toml`, `plant.toml`): read whole, checked whole, refused with file, line, axis, key, value,
//! unit and rule.

use std::fmt::Write as _;
use std::io::Read;
use std::path::Path;

use serde::de::DeserializeOwned;
use toml_edit::{Document, Item};

/// Longest settings file that is read, in bytes.
pub const SETTINGS_FILE_BYTES_MAX: u64 = 1 << 20;

/// A settings file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SettingsFileError {
    /// It cannot be read at all.
    #[error("{path}: {what}")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        what: String,
    },
    /// It breaks rules: one line each, with file, line, value, unit and rule.
    #[error("{}", .0.join("\n"))]
    Broken(Vec<String>),
}

/// Reads a settings file.
///
/// # Errors
/// It is no file, too long, not to be read, or not UTF-8.
pub fn read_text(path: &Path) -> Result<String, SettingsFileError> {
    read(path).map_err(|what| SettingsFileError::Unreadable {
        path: path.display().to_string(),
        what,
    })
}

fn read(path: &Path) -> Result<String, String> {
    let cannot_be_read = |e: std::io::Error| format!("cannot be read: {e}");
    // Looked at before it is opened: opening a pipe would wait for its writer.
    if !std::fs::metadata(path).map_err(cannot_be_read)?.is_file() {
        return Err("is not a file".into());
    }
    let file = std::fs::File::open(path).map_err(cannot_be_read)?;
    let mut bytes = Vec::new();
    file.take(SETTINGS_FILE_BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(cannot_be_read)?;
    if bytes.len() as u64 > SETTINGS_FILE_BYTES_MAX {
        return Err(format!(
            "is longer than {SETTINGS_FILE_BYTES_MAX} bytes: no settings file is"
        ));
    }
    String::from_utf8(bytes).map_err(|e| {
        let good = e.utf8_error().valid_up_to();
        format!("is not UTF-8 text (byte {good} is the first that is not)")
    })
}

/// Reads TOML text into settings whose keys are all known and all there; `name` stands in the message.
///
/// # Errors
/// [`SettingsFileError::Broken`] with line and axis.
pub fn parse<T: DeserializeOwned>(name: &str, text: &str) -> Result<T, SettingsFileError> {
    toml::from_str(text).map_err(|error| {
        let mut message = name.to_string();
        if let Some(span) = error.span() {
            let _ = write!(message, ":{}", line_of(text, span.start));
            if let Some(axis) = axis_at(text, span.start) {
                let _ = write!(message, ": axis {axis}");
            }
        }
        let _ = write!(message, ": {}", error.message());
        SettingsFileError::Broken(vec![message])
    })
}

/// Line of a byte of the text, from 1.
fn line_of(text: &str, byte: usize) -> usize {
    text.get(..byte)
        .map_or(1, |before| before.matches('\n').count() + 1)
}

/// Name of the `[[axis]]` that a byte of the text lies in.
fn axis_at(text: &str, byte: usize) -> Option<String> {
    // The text may be no settings file at all: look for the last name line above, within the axis.
    let end = text
        .get(byte..)?
        .find('\n')
        .map_or(text.len(), |n| byte + n);
    let start = text.get(..end)?.rfind("[[axis]]")?;
    let table = text.get(start..)?;
    let body = table.get("[[axis]]".len()..)?;
    let body = body.get(..body.find("[[axis]]").unwrap_or(body.len()))?;
    let line = body
        .lines()
        .map(str::trim_start)
        .find(|line| line.starts_with("name"))?;
    let name = line.split('"').nth(1)?;
    (name.len() <= 8).then(|| name.to_string())
}

/// One axis in the file: its index and name.
pub type At<'a> = Option<(usize, &'a str)>;

/// The lower end of a range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum From {
    /// This value and what is above it.
    AtLeast(f64),
    /// Only what is above this value.
    Above(f64),
}

/// Checks values one by one and collects what breaks a rule.
#[derive(Debug)]
pub struct Rules<'a> {
    name: &'a str,
    text: &'a str,
    document: Option<Document<String>>,
    broken: Vec<(usize, String)>,
}

impl<'a> Rules<'a> {
    /// For a file of this name and text.
    pub fn of(name: &'a str, text: &'a str) -> Rules<'a> {
        Rules {
            name,
            text,
            document: Document::parse(text.to_string()).ok(),
            broken: Vec::new(),
        }
    }

    /// Line of a key, found by its path; of the nearest table if the key itself is absent.
    fn line(&self, path: &[&str], axis: At) -> usize {
        let Some(document) = &self.document else {
            return 1;
        };
        let mut item: &Item = document.as_item();
        let mut start = 0;
        if let Some((index, _)) = axis {
            let Some(next) = item.get("axis").and_then(|axes| axes.get(index)) else {
                return 1;
            };
            item = next;
            start = item.span().map_or(start, |span| span.start);
        }
        for key in path {
            let Some(next) = item.get(*key) else { break };
            item = next;
            start = item.span().map_or(start, |span| span.start);
        }
        line_of(self.text, start)
    }

    /// A rule is broken: says so of the key at `path`.
    pub fn say(&mut self, path: &[&str], axis: At, what: &str) {
        let line = self.line(path, axis);
        let whose = axis.map_or(String::new(), |(_, name)| format!("axis {name} "));
        self.broken.push((
            line,
            format!("{}:{line}: {whose}{} {what}", self.name, path.join(".")),
        ));
    }

    /// The value must lie between `from` and `high`; NaN does not.
    pub fn range(
        &mut self,
        path: &[&str],
        axis: At,
        value: f64,
        unit: &str,
        from: From,
        high: f64,
    ) {
        let (fits, words, low) = match from {
            From::AtLeast(low) => (value >= low, "at least", low),
            From::Above(low) => (value > low, "above", low),
        };
        if !(fits && value <= high) {
            let unit = spaced(unit);
            self.say(
                path,
                axis,
                &format!("= {value}{unit}: must be {words} {low} and at most {high}{unit}"),
            );
        }
    }

    /// The value must lie between `low` and `high`, both included; NaN does not.
    pub fn between(
        &mut self,
        path: &[&str],
        axis: At,
        value: f64,
        unit: &str,
        low: f64,
        high: f64,
    ) {
        self.range(path, axis, value, unit, From::AtLeast(low), high);
    }

    /// `low_key <= value` of two keys of one table.
    pub fn at_least(
        &mut self,
        path: &[&str],
        axis: At,
        value: f64,
        unit: &str,
        low_key: &str,
        low: f64,
    ) {
        if value < low {
            let unit = spaced(unit);
            self.say(
                path,
                axis,
                &format!("= {value}{unit}: must be at least {low_key} = {low}{unit}"),
            );
        }
    }

    /// Whether no rule is broken so far.
    pub fn all_kept(&self) -> bool {
        self.broken.is_empty()
    }

    /// Everything that breaks a rule, in the order of the file.
    ///
    /// # Errors
    /// [`SettingsFileError::Broken`] if anything does.
    pub fn judge(mut self) -> Result<(), SettingsFileError> {
        if self.broken.is_empty() {
            return Ok(());
        }
        self.broken.sort_by_key(|(line, _)| *line);
        let lines = self.broken.into_iter().map(|(_, text)| text);
        Err(SettingsFileError::Broken(lines.collect()))
    }
}

fn spaced(unit: &str) -> String {
    if unit.is_empty() {
        String::new()
    } else {
        format!(" {unit}")
    }
}
