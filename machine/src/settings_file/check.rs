//! A document against the schema: unknown and missing keys, types, ranges and words, all of them in one go.

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::settings_file::document::Document;
use crate::settings_file::error::SettingsFileError;
use crate::settings_file::own_units::OwnUnit;
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
        rotary_axes: document.rotary_axes(),
        problems: Problems::of(document.name),
        readable: true,
    };
    let file = Place {
        axis: None,
        path: String::new(),
        line: 1,
    };
    check.table(schema, &document.root, &file);
    if check.readable {
        Ok(check.problems)
    } else {
        Err(check.problems.into_error())
    }
}

struct Check<'d> {
    document: &'d Document<'d>,
    renamed: &'d [Renamed],
    rotary_axes: Vec<bool>,
    problems: Problems,
    /// Whether every key that must be there is, and every value is of its type.
    readable: bool,
}

impl Check<'_> {
    fn table(&mut self, schema: KeySchema<'_>, table: &DeTable<'_>, place: &Place) {
        let mut replaced = Vec::new();
        let is_rotary = self.is_rotary(place);
        for (key, value) in table {
            let name = key.get_ref().as_ref();
            let at = place.key(name, self.document.line_of(key, value));
            let of_slide = schema.slide_key(name);
            match (schema.key(name), self.new_name(&at.full_path()), of_slide) {
                (Some(of_key), _, _) => self.value(of_key, None, value, at),
                (None, Some(new), _) => {
                    replaced.push(new);
                    self.unreadable(at, &format!(": is now called {new}"));
                }
                (None, None, Some((key, of_key, unit))) if is_rotary => {
                    replaced.push(key);
                    if table.contains_key(key) {
                        let words = format!(": is there as `{key}` too: one of them");
                        self.unreadable(at.clone(), &words);
                    }
                    self.value(of_key, Some(unit), value, at);
                }
                (None, None, Some((key, ..))) if place.axis.is_some() => {
                    let words = format!(
                        ": is a key of a rotary axis (kind = \"rotary\"); of this one it is `{key}`"
                    );
                    self.unreadable(at, &words);
                }
                (None, None, _) => {
                    let known = shown_keys(schema, schema.keys().map(|(key, _)| key), is_rotary);
                    let place = Place {
                        line: at.line,
                        ..place.clone()
                    };
                    let words = format!(": unknown field `{name}`, {}", expected(&known));
                    self.unreadable(place, &words);
                }
            }
        }
        self.missing(schema, table, place, &replaced);
    }

    /// Keys that must be there and are not.
    fn missing(
        &mut self,
        schema: KeySchema<'_>,
        table: &DeTable<'_>,
        place: &Place,
        replaced: &[&str],
    ) {
        for key in schema.required() {
            let unless = schema.key(key).and_then(KeySchema::unless);
            let flag = unless.filter(|other| schema.is_flag(other));
            let is_set = |other: &str| match table.get(other).map(Spanned::get_ref) {
                Some(DeValue::Boolean(set)) => *set,
                is_there => is_there.is_some() && flag.is_none(),
            };
            if table.contains_key(key) || replaced.contains(&key) || unless.is_some_and(is_set) {
                continue;
            }
            let unless = unless.filter(|_| flag.is_none());
            let is_rotary = self.is_rotary(place);
            let shown = shown_keys(schema, [key].into_iter(), is_rotary).concat();
            let needed = schema.key(key).map(|of_key| needed(of_key, is_rotary));
            let with = match needed.unwrap_or_default().as_slice() {
                [] => String::new(),
                keys => format!(", with {}", keys.join(", ")),
            };
            let or = unless.map_or(String::new(), |other| format!(", or a table `{other}`"));
            let words = format!(": missing field `{shown}`{or}{with}");
            self.unreadable(place.clone(), &words);
        }
    }

    /// Whether a place is one of a rotary axis.
    fn is_rotary(&self, place: &Place) -> bool {
        let index = place.axis.as_ref().map(|(index, _)| *index);
        index.is_some_and(|index| self.rotary_axes.get(index) == Some(&true))
    }

    /// What an old name is called now.
    fn new_name(&self, old: &str) -> Option<&'static str> {
        let mut list = self.renamed.iter();
        list.find(|renamed| renamed.old == old)
            .map(|renamed| renamed.new)
    }

    fn value(
        &mut self,
        schema: KeySchema<'_>,
        unit: Option<&OwnUnit>,
        value: &Spanned<DeValue<'_>>,
        place: Place,
    ) {
        match (schema.kind(), value.get_ref()) {
            (Kind::Table, DeValue::Table(table)) => self.table(schema, table, &place),
            (Kind::List, DeValue::Array(list)) => self.list(schema, unit, list, place),
            (Kind::Text, DeValue::String(text)) => self.text(schema, text, place),
            (Kind::Flag, DeValue::Boolean(_)) => {}
            (Kind::Whole | Kind::Number, DeValue::Integer(number)) => {
                let number = i64::from_str_radix(number.as_str(), number.radix());
                let number = number.ok().map(|number| number as f64);
                self.number(schema, unit, number, value, place);
            }
            (Kind::Number, DeValue::Float(number)) => {
                self.number(schema, unit, number.as_str().parse().ok(), value, place);
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

    fn list(
        &mut self,
        schema: KeySchema<'_>,
        unit: Option<&OwnUnit>,
        list: &DeArray<'_>,
        place: Place,
    ) {
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
            self.value(of_item, unit, item, at);
        }
    }

    fn number(
        &mut self,
        schema: KeySchema<'_>,
        own_unit: Option<&OwnUnit>,
        number: Option<f64>,
        value: &Spanned<DeValue<'_>>,
        place: Place,
    ) {
        let Some(number) = number else {
            let found = self.shown(value);
            return self.unreadable(place, &format!("{found}: has too many digits"));
        };
        let (range, unit) = match own_unit {
            Some(own) => (schema.range().divided(own.factor), own.unit),
            None => (schema.range(), schema.unit()),
        };
        if !range.contains(number) {
            let unit = spaced(unit);
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
fn needed(schema: KeySchema<'_>, is_rotary: bool) -> Vec<String> {
    let table = match schema.kind() {
        Kind::Table => Some(schema),
        Kind::List => schema.items().filter(|items| items.kind() == Kind::Table),
        _ => None,
    };
    let Some(table) = table else {
        return Vec::new();
    };
    let of_key = |key: &str| {
        let inner = table.key(key).map(|inner| needed(inner, is_rotary));
        let inner = inner.unwrap_or_default();
        let inner = inner.iter().map(|inner| format!("{key}.{inner}"));
        let inner: Vec<String> = inner.collect();
        if inner.is_empty() {
            shown_keys(table, [key].into_iter(), is_rotary)
        } else {
            inner
        }
    };
    table.required().flat_map(of_key).collect()
}

/// Keys as they are called on a slide or on a rotary axis.
fn shown_keys<'k>(
    schema: KeySchema<'_>,
    keys: impl Iterator<Item = &'k str>,
    is_rotary: bool,
) -> Vec<String> {
    let own = |key| schema.own_key(key).filter(|_| is_rotary);
    keys.map(|key| own(key).map_or(key.to_string(), |(own, _)| own))
        .collect()
}

/// What would be right.
fn expected<T: AsRef<str>>(words: &[T]) -> String {
    let words: Vec<&str> = words.iter().map(AsRef::as_ref).collect();
    match words.as_slice() {
        [] => "there are no fields here".into(),
        [one] => format!("expected `{one}`"),
        [one, two] => format!("expected `{one}` or `{two}`"),
        more => format!("expected one of `{}`", more.join("`, `")),
    }
}
