//! A TOML document that knows where its keys stand.

use toml::Spanned;
use toml::de::{DeArray, DeString, DeTable, DeValue, Error};

use crate::settings_file::error::SettingsFileError;
use crate::settings_file::own_units::{self, OwnUnit};
use crate::settings_file::problems::Place;

/// A TOML document with the positions of its keys.
#[derive(Debug)]
pub struct Document<'a> {
    /// Name of the file.
    pub name: &'a str,
    text: &'a str,
    /// Its tables.
    pub root: DeTable<'a>,
}

impl<'a> Document<'a> {
    /// Reads TOML; `name` is the file's, for messages.
    ///
    /// # Errors
    /// Every line that is no TOML.
    pub fn parse(name: &'a str, text: &'a str) -> Result<Document<'a>, SettingsFileError> {
        let (root, mut errors) = DeTable::parse_recoverable(text);
        let document = Document {
            name,
            text,
            root: root.into_inner(),
        };
        if errors.is_empty() {
            return Ok(document);
        }
        errors.sort_by_key(|error| error.span().map(|span| span.start));
        let lines = errors.iter().map(|error| document.message(error));
        Err(SettingsFileError::Broken(lines.collect()))
    }

    /// An error of the TOML library, with file and line.
    pub fn message(&self, error: &Error) -> String {
        let name = self.name;
        let what = match (error.message(), error.span()) {
            ("duplicate key", Some(span)) => {
                let key = self.text.get(span).unwrap_or_default();
                format!("{key} is there twice: each key and each table once")
            }
            (what, _) => what.to_string(),
        };
        match error.span() {
            Some(span) => format!("{name}:{}: {what}", self.line(span.start)),
            None => format!("{name}: {what}"),
        }
    }

    /// The text of a value as the file has it.
    pub fn source<T>(&self, value: &Spanned<T>) -> &'a str {
        self.text.get(value.span()).unwrap_or_default()
    }

    /// Line of a byte of the text, from 1.
    pub fn line(&self, byte: usize) -> usize {
        self.text
            .get(..byte)
            .map_or(1, |before| before.matches('\n').count() + 1)
    }

    /// The place of a key found by its path, with the line of the nearest table where it is absent; in a list a number, counted from 1,
    /// stands for one of its values.
    pub fn place(&self, axis: Option<(usize, &str)>, path: &[&str]) -> Place {
        let mut table = Some(&self.root);
        let mut list = None;
        let mut line = 1;
        if let Some((index, _)) = axis {
            let axes = self.root.get("axis").map(Spanned::get_ref);
            let value = axes.and_then(|axes| axes.get(index));
            line = value.map_or(line, |value| self.line(value.span().start));
            table = value.and_then(|value| value.get_ref().as_table());
        }
        let mut shown: Vec<String> = path.iter().map(|key| key.to_string()).collect();
        for (depth, key) in path.iter().enumerate() {
            let value = if let Some(list) = list {
                let Some(value) = listed(list, key) else {
                    break;
                };
                line = self.line(value.span().start);
                value
            } else {
                let Some((name, found, value)) = table.and_then(|table| entry(table, key)) else {
                    break;
                };
                line = self.line_of(found, value);
                if let Some(shown) = shown.get_mut(depth) {
                    *shown = name;
                }
                value
            };
            table = value.get_ref().as_table();
            list = value.get_ref().as_array();
        }
        let path: Vec<&str> = shown.iter().map(String::as_str).collect();
        Place {
            line,
            ..Place::unknown(axis, &path)
        }
    }

    /// By which unit of its own a rotary axis has a key, if it does.
    pub fn own_unit(&self, axis: Option<(usize, &str)>, path: &[&str]) -> Option<&'static OwnUnit> {
        let place = self.place(axis, path);
        let (key, shown) = (path.last()?, place.path.rsplit('.').next()?);
        own_units::names(key).find_map(|(name, unit)| (name == shown).then_some(unit))
    }

    /// Whether it has this key.
    pub fn has(&self, axis: Option<(usize, &str)>, path: &[&str]) -> bool {
        let mut table = Some(&self.root);
        if let Some((index, _)) = axis {
            let axes = self.root.get("axis").map(Spanned::get_ref);
            let value = axes.and_then(|axes| axes.get(index));
            table = value.and_then(|value| value.get_ref().as_table());
        }
        let (Some((key, tables)), true) = (path.split_last(), table.is_some()) else {
            return false;
        };
        for name in tables {
            table = table.and_then(|table| table.get(*name)?.get_ref().as_table());
        }
        table.is_some_and(|table| entry(table, key).is_some())
    }

    /// Line of a key and its value: of a table its header.
    pub fn line_of<K>(&self, key: &Spanned<K>, value: &Spanned<DeValue<'_>>) -> usize {
        let byte = match value.get_ref() {
            DeValue::Table(_) => value.span().start,
            _ => key.span().start,
        };
        self.line(byte)
    }

    /// Which of its axes are rotary, in order.
    pub fn rotary_axes(&self) -> Vec<bool> {
        let axes = self.root.get("axis").map(Spanned::get_ref);
        let axes = axes.and_then(DeValue::as_array).into_iter().flatten();
        axes.map(|axis| axis.get_ref().as_table().is_some_and(own_units::is_rotary))
            .collect()
    }
}

/// A key of a table with its value, and its name there: of a rotary axis also one of its own.
fn entry<'t, 'a>(
    table: &'t DeTable<'a>,
    key: &str,
) -> Option<(String, &'t Spanned<DeString<'a>>, &'t Spanned<DeValue<'a>>)> {
    let named = |name: String| {
        let (found, value) = table.get_key_value(name.as_str())?;
        Some((name, found, value))
    };
    named(key.to_string()).or_else(|| own_units::names(key).find_map(|(name, _)| named(name)))
}

/// A value of a list by its number, counted from 1.
fn listed<'l, 'a>(list: &'l DeArray<'a>, number: &str) -> Option<&'l Spanned<DeValue<'a>>> {
    let number: usize = number.parse().ok()?;
    list.get(number.checked_sub(1)?)
}
