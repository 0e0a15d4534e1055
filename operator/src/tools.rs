//! `tool`: the tool table that the next program begins with.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use machine::tools_file::{TOOL_NUMBER_MAX, keys_of, set_key, tool_number};
use machine::{Tool, update_tools};
use serde_json::{Map, Value, json};

use super::kept::{Subject, pair, written};
use crate::options::{ToolChangeOptions, ToolOptions};
use console::exit::{Failure, Outcome};
use console::output::{joined, say};

/// `tool`.
pub fn tool(options: &ToolOptions) -> Outcome {
    let subject = Subject::of(options.machine.as_deref(), options.cell.as_deref())?;
    match &options.change {
        None | Some(ToolChangeOptions::List) if options.json => say(&json_of(&subject)),
        None | Some(ToolChangeOptions::List) => say(&table(&subject)),
        Some(ToolChangeOptions::Set { tool, values }) => {
            let number = number_of(tool)?;
            let file = file_of(&subject)?;
            let known = subject.machine.tools.iter();
            let mut known = known.filter(|tool| tool.number == number);
            let mut changed = known.next().cloned().unwrap_or(Tool {
                number,
                ..Tool::default()
            });
            for word in values {
                let (key, text) = pair(word)?;
                let value = value_of(key, text);
                set_key(&mut changed, key, &value).map_err(|what| Failure::Input(anyhow!(what)))?;
            }
            change(&subject, &file, |now| {
                now.retain(|tool| tool.number != number);
                now.push(changed.clone());
            })?;
            let keys = keys_of(&changed).into_iter();
            let keys = joined(keys.map(|(key, value)| format!("{key} {value}")), ", ");
            subject.say_changed(&format!("T{number} is {keys}"), &file);
        }
        Some(ToolChangeOptions::Remove { tool }) => {
            let number = number_of(tool)?;
            let file = file_of(&subject)?;
            let mut tools = subject.machine.tools.iter();
            if !tools.any(|tool| tool.number == number) {
                let known = known(&subject);
                return Err(Failure::input(format!(
                    "T{number}: the tool table has {known}"
                )));
            }
            change(&subject, &file, |now| {
                now.retain(|tool| tool.number != number)
            })?;
            subject.say_changed(&format!("T{number} is removed"), &file);
        }
    }
    Ok(())
}

fn known(subject: &Subject) -> String {
    match subject.machine.tools.as_slice() {
        [] => "no tools".into(),
        tools => joined(tools.iter().map(|tool| format!("T{}", tool.number)), " "),
    }
}

fn file_of(subject: &Subject) -> Result<PathBuf, Failure> {
    subject.files.tools.clone().ok_or_else(|| {
        Failure::Input(anyhow!(
            "{}: its tool table has the form of LinuxCNC, which is read and never written: edit it, or name a file in its place that ends with .toml ([program] tool_table = \"tools.toml\")",
            subject.name()
        ))
    })
}

fn number_of(name: &str) -> Result<u32, Failure> {
    tool_number(&name.to_uppercase()).ok_or_else(|| {
        Failure::Input(anyhow!(
            "{name:?}: a tool is one of T0 to T{TOOL_NUMBER_MAX}, such as T3"
        ))
    })
}

/// A value as it would stand in the file: a number, or a text.
fn value_of(key: &str, text: &str) -> toml_edit::Value {
    let number = text.parse::<toml_edit::Value>().ok();
    let number = number.filter(|value| key != "name" && (value.is_integer() || value.is_float()));
    number.unwrap_or_else(|| text.into())
}

fn change(
    subject: &Subject,
    file: &Path,
    change: impl FnOnce(&mut Vec<Tool>),
) -> Result<(), Failure> {
    subject.must_be_between_runs(file)?;
    let own = (!file.exists()).then(|| subject.machine.tools.clone());
    written(update_tools(file, |now| {
        if let Some(own) = own.filter(|_| now.is_empty()) {
            // Those of the machine file, which the file replaces from now on.
            *now = own;
        }
        change(now);
    }))
}

/// The tools, a line each.
fn table(subject: &Subject) -> String {
    let tools = &subject.machine.tools;
    let from = match &subject.files.tools {
        Some(file) if file.exists() => file.display().to_string(),
        _ if tools.is_empty() => "no tool table: every tool can be called, and none has a length; the first `tool set` makes one".into(),
        _ => "in the machine file".into(),
    };
    let mut text = format!("{}: tools ({from})", subject.name());
    if tools.is_empty() {
        return text;
    }
    text.push_str("\n   tool  pocket   length mm  diameter mm  name");
    for tool in tools {
        let [_, _, length_mm, ..] = tool.offset;
        text.push_str(&format!(
            "\n{:>7} {:>7} {length_mm:>11.4} {:>12.4}  {}",
            format!("T{}", tool.number),
            tool.pocket,
            tool.diameter,
            tool.comment
        ));
    }
    text
}

fn json_of(subject: &Subject) -> String {
    let tools = subject.machine.tools.iter().map(|tool| {
        let mut keys = Map::new();
        for (key, value) in keys_of(tool).into_iter().filter(|(key, _)| *key != "name") {
            let value: Value = serde_json::from_str(&value).unwrap_or_default();
            keys.insert(key.to_string(), value);
        }
        keys.insert("name".into(), json!(tool.comment));
        keys.insert("tool".into(), json!(tool.number));
        keys.insert("pocket".into(), json!(tool.pocket));
        Value::Object(keys)
    });
    let file = subject.files.tools.as_ref().filter(|file| file.exists());
    let all = json!({
        "machine": subject.machine.name,
        "file": file.map(|file| file.display().to_string()),
        "tools": tools.collect::<Vec<_>>(),
    });
    serde_json::to_string_pretty(&all).unwrap_or_default()
}
