//! Reads a settings file into its struct, once it is found good.

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;
use toml::{Table, Value};

use crate::settings_file::check::{Renamed, check};
use crate::settings_file::document::Document;
use crate::settings_file::error::SettingsFileError;
use crate::settings_file::rules::Rules;
use crate::settings_file::schema::{KeySchema, Schema};
use crate::settings_file::slides::into_slides;

/// Reads TOML text into settings, with the defaults of the schema; `name` is the file's, for messages, `relations` are the rules that
/// relate several keys.
///
/// # Errors
/// Everything that is wrong, each with file, line, axis, key, value, unit and rule. Relations are judged only where every key is there
/// and of its type.
pub fn load<T: DeserializeOwned + JsonSchema>(
    name: &str,
    text: &str,
    renamed: &[Renamed],
    relations: impl FnOnce(&mut Rules<'_>, &T),
) -> Result<T, SettingsFileError> {
    load_with(name, text, renamed, |_| (), relations)
}

/// As [`load`]; `complete` adds what follows from other keys of a file whose keys are all known and of their type.
///
/// # Errors
/// As [`load`].
pub fn load_with<T: DeserializeOwned + JsonSchema>(
    name: &str,
    text: &str,
    renamed: &[Renamed],
    complete: impl FnOnce(&mut Table),
    relations: impl FnOnce(&mut Rules<'_>, &T),
) -> Result<T, SettingsFileError> {
    let document = Document::parse(name, text)?;
    let schema = Schema::of::<T>();
    let problems = check(&document, schema.root(), renamed)?;
    let broken = |error: &toml::de::Error| SettingsFileError::Broken(vec![document.message(error)]);
    let mut table: Table = toml::from_str(text).map_err(|error| broken(&error))?;
    into_slides(schema.root(), &mut table);
    complete(&mut table);
    add_defaults(schema.root(), &mut table);
    // What does not fit into its field breaks its range too, and that names the key.
    let settings = match table.try_into() {
        Ok(settings) => settings,
        Err(_) if !problems.none() => return Err(problems.into_error()),
        Err(error) => return Err(broken(&error)),
    };
    let mut rules = Rules::after(document, problems);
    relations(&mut rules, &settings);
    rules.judge()?;
    Ok(settings)
}

/// Reads TOML text that has no schema into settings whose keys are all known and all there; `name` is in the message.
///
/// # Errors
/// [`SettingsFileError::Broken`] with the line.
pub fn parse<T: DeserializeOwned>(name: &str, text: &str) -> Result<T, SettingsFileError> {
    let document = Document::parse(name, text)?;
    toml::from_str(text).map_err(|error| SettingsFileError::Broken(vec![document.message(&error)]))
}

/// Gives every key that is not there and has a default that value.
fn add_defaults(schema: KeySchema<'_>, table: &mut Table) {
    for (key, of_key) in schema.keys() {
        if let (false, Some(default)) = (table.contains_key(key), of_key.default()) {
            table.insert(key.to_string(), toml_value(default));
        }
        match table.get_mut(key) {
            Some(Value::Table(inner)) => add_defaults(of_key, inner),
            Some(Value::Array(list)) => {
                let tables = list.iter_mut().filter_map(Value::as_table_mut);
                if let Some(of_item) = of_key.items() {
                    tables.for_each(|inner| add_defaults(of_item, inner));
                }
            }
            _ => {}
        }
    }
}

/// A default as TOML has it: a word, a number, a flag, a list, an empty table.
fn toml_value(json: &Json) -> Value {
    match json {
        Json::String(word) => Value::String(word.clone()),
        Json::Bool(flag) => Value::Boolean(*flag),
        Json::Number(number) => number.as_i64().map_or_else(
            || Value::Float(number.as_f64().unwrap_or(f64::NAN)),
            Value::Integer,
        ),
        Json::Array(list) => Value::Array(list.iter().map(toml_value).collect()),
        _ => Value::Table(Table::new()),
    }
}
