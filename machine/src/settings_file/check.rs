//! A document against the schema: unknown and missing keys, types, ranges and words, all of them in one go.

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::settings_file::document::Document;
use crate::settings_file::error::SettingsFileError;
use crate::settings_file::problems::{Place, Problems};
use crate::settings_file::range::spaced;
use crate::settings_file::schema::{KeySchema, Kind};

/// Longest name of an axis that is shown, in bytes.
const AXIS_NAME_SHOWN_MAX: usize = 8;
/// Longest value that is shown, in characters.
const VALUE_SHOWN_MAX: usize = 40;

/// A key or a word that an earlier version of a file had under another name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Renamed {
    /// Path of the key, `axis.reversal.method`; of a word followed by it, `axis.reversal.method = word`.
    pub old: &'static str,
    /// The present name of the key or word.
    pub new: &'static str,
}

/// Checks a document against the schema of its file; what is wrong with values, where all of them can be read.
///
/// # Errors
/// Everything that is wrong, where a key is missing or unknown or a value is of another type.
pub fn check(
    document: &Document<'_>,
    schema: KeySchema<'_>,
    renamed: &[Renamed],
) -> Result<Problems, SettingsFileError> {
    let mut check = Check {
        document,
        renamed,
        problems: Problems::of(document.name()),
        readable: true,
    };
    let file = Place {
        axis: None,
        path: String::new(),
        line: 1,
    };
    check.table(schema, document.root(), &file);
    if check.readable {
        Ok(check.problems)
    } else {
        Err(check.problems.into_error())
    }
}

struct Check<'d> {
    document: &'d Document<'d>,
    renamed: &'d [Renamed],
    problems: Problems,
    /// Whether every key that must be there is, and every value is of its type.
    readable: bool,
}

impl Check<'_> {
    fn table(&mut self, schema: KeySchema<'_>, table: &DeTable<'_>, place: &Place) {
        let mut replaced = Vec::new();
        for (key, value) in table {
            let name = key.get_ref().as_ref();
            let at = place.key(name, self.document.line_of(key, value));
            match (schema.key(name), self.new_name(&at.full_path())) {
                (Some(of_key), _) => self.value(of_key, value, at),
                (None, Some(new)) => {
                    replaced.push(new);
                    self.unreadable(at, &format!(": is now called {new}"));
                }
                (None, None) => {
                    let known: Vec<&str> = schema.keys().map(|(key, _)| key).collect();
                    let place = Place {
                        line: at.line,
                        ..place.clone()
                    };
                    let words = format!(": unknown field `{name}`, {}", expected(&known));
                    self.unreadable(place, &words);
                }
            }
        }
        for key in schema.required() {
            if !table.contains_key(key) && !replaced.contains(&key) {
                self.missing(schema.key(key), key, place);
            }
        }
    }

    /// A key that must be there is not; of a table, all that must be in it.
    fn missing(&mut self, schema: Option<KeySchema<'_>>, key: &str, place: &Place) {
        let needed = schema.map(|schema| needed(schema)).unwrap_or_default();
        let words = match needed.as_slice() {
            [] => format!(": missing field `{key}`"),
            keys => format!(": missing field `{key}`, with {}", keys.join(", ")),
        };
        self.unreadable(place.clone(), &words);
    }

    /// What an old name is called now.
    fn new_name(&self, old: &str) -> Option<&'static str> {
        let mut list = self.renamed.iter();
        list.find(|renamed| renamed.old == old)
            .map(|renamed| renamed.new)
    }

    fn value(&mut self, schema: KeySchema<'_>, value: &Spanned<DeValue<'_>>, place: Place) {
        match (schema.kind(), value.get_ref()) {
            (Kind::Table, DeValue::Table(table)) => self.table(schema, table, &place),
            (Kind::List, DeValue::Array(list)) => self.list(schema, list, place),
            (Kind::Text, DeValue::String(text)) => self.text(schema, text, place),
            (Kind::Flag, DeValue::Boolean(_)) => {}
            (Kind::Whole | Kind::Number, DeValue::Integer(number)) => {
                let number = i64::from_str_radix(number.as_str(), number.radix());
                self.number(
                    schema,
                    number.ok().map(|number| number as f64),
                    value,
                    place,
                );
            }
            (Kind::Number, DeValue::Float(number)) => {
                self.number(schema, number.as_str().parse().ok(), value, place);
            }
            (kind, _) => {
                let words = match kind {
                    Kind::Table => "a table",
                    Kind::List => "a list",
                    Kind::Text => "text in quotes",
                    Kind::Flag => "true or false",
                    Kind::Whole => "a whole number",
                    Kind::Number => "a number",
                };
                let found = self.shown(value);
                self.unreadable(place, &format!("{found}: must be {words}"));
            }
        }
    }

    /// A value as the file has it, if it is short.
    fn shown(&self, value: &Spanned<DeValue<'_>>) -> String {
        let source = self.document.source(value);
        let short = !source.contains('\n') && source.chars().count() <= VALUE_SHOWN_MAX;
        match value.get_ref() {
            DeValue::Table(_) => String::new(),
            _ if short => format!(" = {source}"),
            _ => String::new(),
        }
    }

    fn list(&mut self, schema: KeySchema<'_>, list: &DeArray<'_>, place: Place) {
        let (fewest, most) = schema.length();
        let count = list.len() as u64;
        if !(fewest..=most).contains(&count) {
            let words = if fewest == most {
                format!(" has {count} values: must have {fewest}")
            } else {
                format!(" has {count} values: must have {fewest} to {most}")
            };
            self.unreadable(place.clone(), &words);
        }
        let Some(of_item) = schema.items() else {
            return;
        };
        for (index, item) in list.iter().enumerate() {
            let line = self.document.line(item.span().start);
            let at = match item.get_ref() {
                DeValue::Table(table) if place.path == "axis" => Place {
                    axis: Some((index, axis_name(table, index))),
                    path: String::new(),
                    line,
                },
                _ => Place {
                    line,
                    ..place.clone()
                },
            };
            self.value(of_item, item, at);
        }
    }

    fn number(
        &mut self,
        schema: KeySchema<'_>,
        number: Option<f64>,
        value: &Spanned<DeValue<'_>>,
        place: Place,
    ) {
        let Some(number) = number else {
            let found = self.shown(value);
            return self.unreadable(place, &format!("{found}: has too many digits"));
        };
        let range = schema.range();
        if !range.contains(number) {
            let unit = spaced(schema.unit());
            let words = format!(" = {number}{unit}: must be {range}{unit}");
            self.problems.add(place, &words);
        }
    }

    fn text(&mut self, schema: KeySchema<'_>, text: &str, place: Place) {
        let words = schema.words();
        if words.is_empty() || words.iter().any(|word| word.word == text) {
            return;
        }
        let old = format!("{} = {text}", place.full_path());
        let what = match self.new_name(&old) {
            Some(new) => format!(" = {text:?}: is now called {new:?}"),
            None => {
                let known: Vec<&str> = words.iter().map(|word| word.word).collect();
                format!(": unknown variant `{text}`, {}", expected(&known))
            }
        };
        self.unreadable(place, &what);
    }

    fn unreadable(&mut self, place: Place, what: &str) {
        self.readable = false;
        self.problems.add(place, what);
    }
}

/// The name of an axis, or its number from 1 where it has no good one.
fn axis_name(table: &DeTable<'_>, index: usize) -> String {
    match table.get("name").map(Spanned::get_ref) {
        Some(DeValue::String(name)) if name.len() <= AXIS_NAME_SHOWN_MAX => name.to_string(),
        _ => (index + 1).to_string(),
    }
}

/// Keys that must be in a table, or in each table of a list, those of the tables in it among them.
fn needed(schema: KeySchema<'_>) -> Vec<String> {
    let table = match schema.kind() {
        Kind::Table => Some(schema),
        Kind::List => schema.items().filter(|items| items.kind() == Kind::Table),
        _ => None,
    };
    let Some(table) = table else {
        return Vec::new();
    };
    let of_key = |key| {
        let inner = table.key(key).map(needed).unwrap_or_default();
        let inner = inner.iter().map(|inner| format!("{key}.{inner}"));
        let inner: Vec<String> = inner.collect();
        if inner.is_empty() {
            vec![key.to_string()]
        } else {
            inner
        }
    };
    table.required().flat_map(of_key).collect()
}

/// What would be right.
fn expected(words: &[&str]) -> String {
    match words {
        [] => "there are no fields here".into(),
        [one] => format!("expected `{one}`"),
        [one, two] => format!("expected `{one}` or `{two}`"),
        more => format!("expected one of `{}`", more.join("`, `")),
    }
}
