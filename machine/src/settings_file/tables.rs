//! A small file of tables and single values, whose keys are no fixed set: letters of axes, numbers of tools.

use toml_edit::{Document, Item, Value};

use crate::settings_file::error::SettingsFileError;

/// Largest number that is taken.
const NUMBER_MAX: f64 = 1e6;

/// Goes through a text of tables: `take` is called for each table, then for each of its keys (the table's name is empty for keys in front
/// of all tables), and says what is wrong with it. `name` is the file's, for messages.
///
/// # Errors
/// No TOML, or everything that `take` refuses, each with file and line.
pub fn each_entry(
    name: &str,
    text: &str,
    mut take: impl FnMut(&str, Option<(&str, &Value)>) -> Result<(), String>,
) -> Result<(), SettingsFileError> {
    let line_at = |at: usize| 1 + text.bytes().take(at).filter(|byte| *byte == b'\n').count();
    let document = Document::parse(text).map_err(|error| {
        let line = line_at(error.span().map_or(0, |span| span.start));
        SettingsFileError::Broken(vec![format!("{name}:{line}: {}", error.message())])
    })?;
    let mut wrong = vec![];
    let mut judge = |span: Option<std::ops::Range<usize>>, said: Result<(), String>| {
        if let Err(what) = said {
            let line = line_at(span.map_or(0, |span| span.start));
            wrong.push((line, format!("{name}:{line}: {what}")));
        }
    };
    for (key, item) in document.iter() {
        let span = document.key(key).and_then(toml_edit::Key::span);
        match item {
            Item::Value(value) if !value.is_inline_table() => {
                judge(span, take("", Some((key, value))));
            }
            Item::Table(table) => {
                judge(span, take(key, None));
                for (inner, item) in table.iter() {
                    let span = table.key(inner).and_then(toml_edit::Key::span);
                    let said = match item.as_value() {
                        Some(value) => take(key, Some((inner, value))),
                        None => Err(format!("[{key}] {inner}: a value, not a table")),
                    };
                    judge(span, said);
                }
            }
            _ => judge(span, Err(format!("{key}: a table such as [{key}]"))),
        }
    }
    wrong.sort();
    match wrong.is_empty() {
        true => Ok(()),
        false => Err(SettingsFileError::Broken(
            wrong.into_iter().map(|(_, what)| what).collect(),
        )),
    }
}

/// The number that a value is.
///
/// # Errors
/// None that is finite and of a size that machines have.
pub fn number_of(what: &str, value: &Value) -> Result<f64, String> {
    let number = value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64));
    number
        .filter(|number| number.abs() <= NUMBER_MAX)
        .ok_or_else(|| {
            let found = value.to_string();
            format!(
                "{what} = {}: a number from -{NUMBER_MAX} to {NUMBER_MAX}",
                found.trim()
            )
        })
}
