//! A TOML document that knows where its keys stand.

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue, Error};

use crate::settings_file::error::SettingsFileError;
use crate::settings_file::problems::Place;

/// A TOML document with the positions of its keys.
#[derive(Debug)]
pub struct Document<'a> {
    name: &'a str,
    text: &'a str,
    root: DeTable<'a>,
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

    /// Name of the file.
    pub fn name(&self) -> &'a str {
        self.name
    }

    /// Its tables.
    pub fn root(&self) -> &DeTable<'a> {
        &self.root
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
        for key in path {
            let value = if let Some(list) = list {
                let Some(value) = listed(list, key) else {
                    break;
                };
                line = self.line(value.span().start);
                value
            } else {
                let Some((found, value)) = table.and_then(|table| table.get_key_value(*key)) else {
                    break;
                };
                line = self.line_of(found, value);
                value
            };
            table = value.get_ref().as_table();
            list = value.get_ref().as_array();
        }
        Place {
            line,
            ..Place::unknown(axis, path)
        }
    }

    /// Line of a key and its value: of a table its header.
    pub fn line_of<K>(&self, key: &Spanned<K>, value: &Spanned<DeValue<'_>>) -> usize {
        let byte = match value.get_ref() {
            DeValue::Table(_) => value.span().start,
            _ => key.span().start,
        };
        self.line(byte)
    }
}

/// A value of a list by its number, counted from 1.
fn listed<'l, 'a>(list: &'l DeArray<'a>, number: &str) -> Option<&'l Spanned<DeValue<'a>>> {
    let number: usize = number.parse().ok()?;
    list.get(number.checked_sub(1)?)
}
