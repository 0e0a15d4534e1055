//! In which settings two runs differ, by the copies of the files in their run directories.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use crate::against::Setting;
use anyhow::Context;
use console::output::joined;
use machine::parse_parameters;
use toml_edit::{DocumentMut, Item, TableLike, Value};

use launcher::run_dir::SETTINGS_FILES;

/// Every key that one of them lacks or has with another value, file by file.
///
/// # Errors
/// A copy cannot be read or is no TOML.
pub fn between(a: &Path, b: &Path) -> anyhow::Result<Vec<Setting>> {
    let mut differences = Vec::new();
    for file in SETTINGS_FILES {
        let (of_a, of_b) = (keys_of(&a.join(file))?, keys_of(&b.join(file))?);
        let whole = |a: Option<&str>, b: Option<&str>| Setting {
            file: file.into(),
            key: "(the whole file)".into(),
            a: a.map(str::to_string),
            b: b.map(str::to_string),
        };
        match (of_a, of_b) {
            (Some(a), Some(b)) => differences.extend(differing(file, &a, &b)),
            (Some(_), None) => differences.push(whole(Some("there"), None)),
            (None, Some(_)) => differences.push(whole(None, Some("there"))),
            (None, None) => {}
        }
    }
    Ok(differences)
}

type Keys = BTreeMap<String, String>;

fn differing(file: &str, a: &Keys, b: &Keys) -> Vec<Setting> {
    let mut keys: Vec<&String> = a.keys().chain(b.keys()).collect();
    keys.sort_unstable();
    keys.dedup();
    let mut found: Vec<Setting> = Vec::new();
    for key in keys {
        let (of_a, of_b) = (a.get(key), b.get(key));
        if of_a == of_b {
            continue;
        }
        let whole = match (of_a, of_b) {
            (Some(_), None) => table_that_lacks(key, b),
            (None, Some(_)) => table_that_lacks(key, a),
            _ => None,
        };
        let side = |value: Option<&String>| {
            value.map(|value| match whole {
                Some(_) => "there".into(),
                None => value.clone(),
            })
        };
        let setting = Setting {
            file: file.into(),
            key: whole.unwrap_or(key).into(),
            a: side(of_a),
            b: side(of_b),
        };
        if found.last() != Some(&setting) {
            found.push(setting);
        }
    }
    found
}

/// The outermost table around a key of which a file has nothing at all.
fn table_that_lacks<'a>(key: &'a str, keys: &Keys) -> Option<&'a str> {
    let tables = key.match_indices('.').map(|(end, _)| &key[..end]);
    tables.into_iter().find(|table| {
        let prefix = format!("{table}.");
        !keys.keys().any(|other| other.starts_with(&prefix))
    })
}

/// All keys of a file with their values; none if there is no such file.
fn keys_of(path: &Path) -> anyhow::Result<Option<Keys>> {
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => {
            return Err(error).with_context(|| format!("{}: cannot be read", path.display()));
        }
    };
    let document: DocumentMut = text
        .parse()
        .with_context(|| format!("{}: is no TOML", path.display()))?;
    let mut keys = Keys::new();
    table(document.as_table(), "", &mut keys);
    spread_parameters(&document, &mut keys);
    Ok(Some(keys))
}

/// The parameters that a run began with are a text of many: each is a key of its own.
fn spread_parameters(document: &DocumentMut, keys: &mut Keys) {
    let text = document.get("program").and_then(|of| of.get("parameters"));
    let parameters = text
        .and_then(Item::as_str)
        .map(|text| parse_parameters("", text));
    if let Some(Ok(parameters)) = parameters {
        keys.remove("program.parameters");
        for (number, value) in parameters {
            keys.insert(format!("program.parameters.#{number}"), value.to_string());
        }
    }
}

fn table(from: &dyn TableLike, path: &str, keys: &mut Keys) {
    for (key, item) in from.iter() {
        let path = match path {
            "" => key.to_string(),
            path => format!("{path}.{key}"),
        };
        if let Some(inner) = item.as_table_like() {
            table(inner, &path, keys);
        } else if let Some(tables) = item.as_array_of_tables() {
            for (index, inner) in tables.iter().enumerate() {
                // An axis goes by its name, wherever it is in the file.
                let name = inner.get("name").and_then(Item::as_str);
                let name = name.map_or_else(|| (index + 1).to_string(), str::to_string);
                table(inner, &format!("{path} {name}"), keys);
            }
        } else if let Some(value) = item.as_value() {
            keys.insert(path, words(value));
        }
    }
}

/// A value without the blanks and comments around it.
fn words(value: &Value) -> String {
    if let Value::Array(array) = value {
        return format!("[{}]", joined(array.iter().map(words), ", "));
    }
    let mut bare = value.clone();
    bare.decor_mut().clear();
    bare.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_compared_by_key_and_axis_not_by_line_or_comment() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let machine = "name = \"xy\" # one\n[[axis]]\nname = \"X\"\nloop = { gain = 50.0 }\nmap = [1.0,\n 2.0, # two\n]\n[[axis]]\nname = \"Y\"\n[axis.model]\nmass = 3\nfriction = { share = 1 }\n";
        let other = "name = \"xy\"\n[[axis]]\nname = \"Y\"\nnew = true\n[[axis]]\nmap = [1.0, 2.0]\nname = \"X\"\nloop.gain = 60.0\n";
        fs::write(a.path().join("machine.toml"), machine).unwrap();
        fs::write(b.path().join("machine.toml"), other).unwrap();
        fs::write(b.path().join("learned.toml"), "a = 1\n").unwrap();
        let found = between(a.path(), b.path()).unwrap();
        let lines: Vec<String> = found
            .iter()
            .map(|s| {
                let side = |v: &Option<String>| v.clone().unwrap_or("-".into());
                format!("{} {} {} {}", s.file, s.key, side(&s.a), side(&s.b))
            })
            .collect();
        assert_eq!(
            lines,
            [
                "machine.toml axis X.loop.gain 50.0 60.0",
                "machine.toml axis Y.model there -",
                "machine.toml axis Y.new - true",
                "learned.toml (the whole file) - there",
            ]
        );
        assert_eq!(between(a.path(), a.path()).unwrap(), []);
        fs::write(b.path().join("machine.toml"), "= 1").unwrap();
        assert!(between(a.path(), b.path()).is_err());
    }

    #[test]
    fn of_kept_parameters_those_are_named_that_differ() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        for (folder, text) in [(&a, "100\t4\n5221\t0\n"), (&b, "100\t4\n5221\t2.5\n")] {
            let text = format!("[program]\nparameters = {text:?}\n");
            fs::write(folder.path().join("machine.toml"), text).unwrap();
        }
        let found = between(a.path(), b.path()).unwrap();
        let [only] = found.as_slice() else {
            panic!("{found:?}")
        };
        assert_eq!(only.key, "program.parameters.#5221");
        assert_eq!(
            (only.a.as_deref(), only.b.as_deref()),
            (Some("0"), Some("2.5"))
        );
    }
}
