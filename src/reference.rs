//! The pages of settings files in the reference of the book, made of their keys.

use std::fmt::Write as _;

use fieldbus::{drive_file, terminal_file};
use machine::settings_file::{KeySchema, Kind, Schema};
use plant_sim::plant_file;

/// Longest line of prose, in characters.
const COLUMNS: usize = 120;
/// What stands for a name that is free.
const ANY_NAME: &str = "NAME";
/// So many words of a key are listed at most.
const LISTED_MAX: usize = 22;

/// What a settings file may hold: its name in the commands and in the book, what stands before the keys, and its schema.
pub fn settings_files() -> [(&'static str, &'static str, Schema); 4] {
    [
        (
            "machine",
            include_str!("reference/machine-file.md"),
            machine::schema(),
        ),
        (
            "plant",
            include_str!("reference/plant-file.md"),
            plant_file::schema(),
        ),
        (
            "drive",
            include_str!("reference/drive-file.md"),
            drive_file::schema(),
        ),
        (
            "terminal",
            include_str!("reference/terminal-file.md"),
            terminal_file::schema(),
        ),
    ]
}

/// A page in Markdown: `introduction`, then a section for each table with a line for each key.
pub fn page(introduction: &str, schema: &Schema) -> String {
    let mut page = introduction.to_string();
    keys(&mut page, schema.root(), "");
    page
}

/// The keys of a table, and the tables in it after them.
fn keys(page: &mut String, schema: KeySchema<'_>, path: &str) {
    let any_key = schema.any_key().map(|of_key| (ANY_NAME, of_key));
    let (tables, values): (Vec<_>, Vec<_>) = schema
        .keys()
        .chain(any_key)
        .partition(|(_, of_key)| inner_table(*of_key).is_some());
    if !values.is_empty() {
        page.push_str("\n| key | unit | range | default | meaning |\n|---|---|---|---|---|\n");
    }
    for (key, of_key) in values {
        let own = schema.own_key(key).filter(|_| is_of_axis(path));
        let own = own.map_or(String::new(), |(own, unit)| {
            format!("; rotary `{own}`, {}", unit.unit)
        });
        let unless = of_key.unless();
        let may_be_left_out = schema.required().all(|needed| needed != key) && key != ANY_NAME;
        let _ = writeln!(
            page,
            "| `{key}`{own} | {} | {} | {} | {} |",
            of_key.unit(),
            range(of_key),
            match unless {
                Some(other) => format!("required without `{other}`"),
                None => default(of_key, may_be_left_out),
            },
            meaning(of_key)
        );
    }
    for (key, of_key) in tables {
        let path = if path.is_empty() {
            key.to_string()
        } else {
            format!("{path}.{key}")
        };
        let title = match of_key.kind() {
            Kind::List => format!("[[{path}]]"),
            _ => format!("[{path}]"),
        };
        let presence = match of_key.unless() {
            Some(other) => format!(" Is left out with `{other}`."),
            None if schema.required().any(|needed| needed == key) => String::new(),
            None => " May be left out.".into(),
        };
        let meaning = of_key.meaning();
        let _ = write!(page, "\n## `{title}`\n\n");
        paragraph(page, &format!("{meaning}{presence}"));
        if let Some(inner) = inner_table(of_key) {
            keys(page, inner, &path);
        }
    }
}

/// Whether a table is one of an axis, which may be rotary.
fn is_of_axis(path: &str) -> bool {
    path.split('.').next() == Some("axis")
}

/// A paragraph, broken into lines.
fn paragraph(page: &mut String, text: &str) {
    let mut length = 0;
    for word in text.split(' ') {
        let width = word.chars().count();
        if length > 0 && length + 1 + width > COLUMNS {
            page.push('\n');
            length = 0;
        } else if length > 0 {
            page.push(' ');
            length += 1;
        }
        page.push_str(word);
        length += width;
    }
    page.push('\n');
}

/// The table that stands under a key, once or in a list.
fn inner_table(of_key: KeySchema<'_>) -> Option<KeySchema<'_>> {
    let inner = match of_key.kind() {
        Kind::List => of_key.items()?,
        _ => of_key,
    };
    (inner.kind() == Kind::Table).then_some(inner)
}

fn range(of_key: KeySchema<'_>) -> String {
    match of_key.kind() {
        Kind::Number => of_key.range().short(),
        Kind::Whole => format!("{}, whole", of_key.range().short()),
        Kind::Flag => "`true` or `false`".into(),
        Kind::Text => {
            let words = of_key.words();
            let mut words: Vec<String> = words
                .iter()
                .map(|word| format!("`\"{}\"`", word.word))
                .collect();
            // Names that are counted are known by the first ones and the last.
            if words.len() > LISTED_MAX {
                words.splice(LISTED_MAX - 2..words.len() - 1, ["…".into()]);
            }
            words.join(", ")
        }
        Kind::List => {
            if of_key
                .items()
                .is_some_and(|items| items.kind() == Kind::Text)
            {
                return "texts".into();
            }
            let (fewest, most) = of_key.length();
            let count = if fewest == most || most == u64::MAX {
                fewest.to_string()
            } else {
                format!("{fewest} to {most}")
            };
            let each = of_key
                .items()
                .map_or(String::new(), |items| items.range().short());
            format!("{count} values, each {each}")
        }
        Kind::Table => String::new(),
    }
}

fn default(of_key: KeySchema<'_>, may_be_left_out: bool) -> String {
    match of_key.default() {
        Some(default) => format!("`{default}`"),
        None if may_be_left_out => "none".into(),
        None => "required".into(),
    }
}

/// The meaning of a key, and of each of its words.
fn meaning(of_key: KeySchema<'_>) -> String {
    let mut meaning = of_key.meaning();
    for word in of_key
        .words()
        .iter()
        .filter(|word| !word.meaning.is_empty())
    {
        let _ = write!(
            meaning,
            "<br>`{}`: {}",
            word.word,
            word.meaning.replace('\n', " ")
        );
    }
    meaning.replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    /// A file of the repository is what the keys in the code say. With `RENEW=1` it is written.
    fn assert_fresh(path: &str, text: &str) {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
        if std::env::var_os("RENEW").is_some() {
            fs::write(&file, text).unwrap_or_else(|e| panic!("{path}: {e}"));
        }
        let found = fs::read_to_string(&file).unwrap_or_default();
        assert!(
            found == text,
            "{path} is not what the keys in the code say. Write it again: RENEW=1 cargo test --release -p quadrant --lib"
        );
    }

    #[test]
    fn the_pages_and_schemas_of_settings_files_are_those_of_their_keys() {
        for (name, introduction, schema) in settings_files() {
            let text = page(introduction, &schema);
            assert_fresh(&format!("docs/reference/{name}-file.md"), &text);
            assert_fresh(&format!("machines/{name}.schema.json"), &schema.json());
        }
    }
}
