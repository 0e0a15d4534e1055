//! The table of bad inputs (`bad_inputs.toml`): each is refused with its exit status, by a message that says what is wrong, where, and what
//! would be right. From it comes the page of the book; a change for the worse fails here. `RENEW=bad-inputs` writes the page.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Stdio;

use serde::Deserialize;

use crate::support::{quadrant, root, traces_of, unique_cell};

const TABLE: &str = "tests/bad_inputs.toml";
const PAGE: &str = "docs/reference/bad-inputs.md";
/// Fewest inputs that the table has.
const INPUTS_MIN: usize = 150;
/// Longest message that the page shows, in lines.
const LINES_MAX: usize = 4;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    input: Vec<Input>,
}

/// One input: how it is made, and what has to come of it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Input {
    /// Heading on the page.
    group: String,
    /// What is wrong, for the page.
    what: String,
    /// The command; {cell} stands for the name of a cell that does not run.
    run: String,
    /// Machine folder of the product that lies in `machine`.
    machine: Option<String>,
    /// Text of `part.ngc`.
    program: Option<String>,
    /// File of the machine folder, what is replaced in it, and by what.
    edit: Option<[String; 3]>,
    /// Another file and its text.
    file: Option<[String; 2]>,
    /// An empty folder.
    folder: Option<String>,
    /// File that is taken away.
    without: Option<String>,
    /// A variable of the environment and its value.
    env: Option<[String; 2]>,
    /// Where standard output goes.
    stdout: Option<String>,
    /// Exit status.
    exit: i32,
    /// Pieces of what is printed.
    says: Vec<String>,
}

impl Input {
    /// Makes the files.
    fn lay_down(&self, folder: &Path) {
        if let Some(machine) = &self.machine {
            copy(
                &root().join("machines").join(machine),
                &folder.join("machine"),
            );
        }
        if let Some([file, what, by]) = &self.edit {
            let path = folder.join("machine").join(file);
            let text = fs::read_to_string(&path).expect("a file of the machine");
            assert!(text.contains(what), "{}: {file} has no {what:?}", self.what);
            fs::write(&path, text.replacen(what, by, 1)).expect("writing");
        }
        if let Some(program) = &self.program {
            fs::write(folder.join("part.ngc"), program).expect("writing");
        }
        if let Some([file, text]) = &self.file {
            fs::write(folder.join(file), text).expect("writing");
        }
        if let Some(name) = &self.folder {
            fs::create_dir(folder.join(name)).expect("a folder");
        }
        if let Some(file) = &self.without {
            fs::remove_file(folder.join(file)).expect("a file");
        }
    }

    /// What the command prints for it, after a look at status and pieces.
    fn judge(&self) -> Result<String, String> {
        let folder = tempfile::tempdir().expect("a folder");
        self.lay_down(folder.path());
        let cell = unique_cell();
        let mut command = quadrant();
        let words = self.run.split_whitespace();
        command.args(words.map(|word| word.replace("{cell}", &cell)));
        command.current_dir(folder.path()).stderr(Stdio::piped());
        if let Some([name, value]) = &self.env {
            command.env(name, value);
        }
        if let Some(stdout) = &self.stdout {
            let file = fs::File::options().write(true).open(stdout);
            command.stdout(file.expect("a file to write to"));
        }
        let output = command.output().expect("running quadrant");
        let printed = [output.stdout, output.stderr].concat();
        let printed = String::from_utf8_lossy(&printed).replace(&cell, "CELL");
        let status = output.status.code().unwrap_or(-1);
        if status != self.exit {
            return Err(format!(
                "ended with {status}, not {}:\n{printed}",
                self.exit
            ));
        }
        if let Some(piece) = self.says.iter().find(|piece| !printed.contains(*piece)) {
            return Err(format!("says no {piece:?}:\n{printed}"));
        }
        if folder.path().join("run").exists() || !traces_of(&cell).is_empty() {
            return Err("left something behind".into());
        }
        Ok(printed)
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a machine").flatten() {
        let path = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &path);
        } else {
            fs::copy(entry.path(), path).expect("copying");
        }
    }
}

/// A message as the page has it: not the words of every message, not all names of a long list.
fn shown(printed: &str) -> String {
    let lines = printed.lines().map(|line| {
        let line = line.strip_prefix("quadrant: ").unwrap_or(line).trim_end();
        match line.split_once("expected one of ") {
            Some((before, _)) => format!("{before}expected one of …"),
            None => line.to_string(),
        }
    });
    let kept = |line: &String| !line.is_empty() && !line.starts_with("For more information");
    let mut lines: Vec<String> = lines.filter(kept).collect();
    if lines.len() > LINES_MAX {
        lines.truncate(LINES_MAX);
        lines.push("…".into());
    }
    lines.join("\n")
}

/// The page of the book.
fn page(inputs: &[(&Input, String)]) -> String {
    let mut page = "# Bad input\n\n\
        What is refused, with which [exit status](exit-status.md), and what is printed. Nothing is started, and nothing is left\n\
        behind. Made by `RENEW=bad-inputs` from `tests/bad_inputs.toml`; a test compares it with what the command prints.\n"
        .to_string();
    let mut group = "";
    for (input, printed) in inputs {
        if input.group != group {
            group = &input.group;
            let _ = write!(page, "\n## {group}\n");
        }
        let _ = write!(
            page,
            "\n**{}**\n\n```text\n$ quadrant {}\n{}\n(exit status {})\n```\n",
            input.what,
            input.run,
            shown(printed),
            input.exit
        );
    }
    page
}

#[test]
fn every_bad_input_is_refused_with_what_is_wrong_where_and_what_would_be_right() {
    let text = fs::read_to_string(root().join(TABLE)).expect("the table");
    let table: Table = toml::from_str(&text).expect("a table of inputs");
    assert!(table.input.len() >= INPUTS_MIN, "{}", table.input.len());
    let judged: Vec<_> = table.input.iter().map(|of| (of, of.judge())).collect();
    let mut good = Vec::new();
    let mut bad = String::new();
    for (input, judged) in judged {
        match judged {
            Ok(printed) => good.push((input, printed)),
            Err(why) => {
                let _ = writeln!(bad, "{}, {}: {why}", input.group, input.what);
            }
        }
    }
    assert!(bad.is_empty(), "{bad}");
    let page = page(&good);
    let file = root().join(PAGE);
    if std::env::var("RENEW").is_ok_and(|what| what == "bad-inputs") {
        fs::write(&file, page).expect("writing the page");
        return;
    }
    let now = fs::read_to_string(&file).unwrap_or_default();
    let differ = page.lines().zip(now.lines()).find(|(a, b)| a != b);
    assert!(
        page == now,
        "{PAGE} is not what is printed now: {differ:?}; where the message is no worse, RENEW=bad-inputs writes it"
    );
}
