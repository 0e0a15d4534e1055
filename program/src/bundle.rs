//! A program with the subroutines of other files that it calls: one text, so that nobody's edits reach a run.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::error::ProgramError;
use crate::expression::{Cursor, Lookup};
use crate::file::{FILE_BYTES_MAX, read_text};
use crate::flow::{Keyword, flow_at, label_of};
use crate::source::FILE_MARK;

/// The most files of one program.
const FILES_MAX: usize = 1000;

/// The text of a program, behind it the subroutines that it calls and does not hold: files of their names beside the program, or in
/// one of the folders (`pocket.ngc` for `O<pocket> call`, `100.ngc` for `O100 call` and `M98 P100`).
///
/// A call whose file is not there is left to whoever executes it: it may never be reached.
///
/// # Errors
/// A file that cannot be read, or all together larger than 64 MiB.
pub fn read_program(file: &Path, folders: &[PathBuf]) -> Result<String, ProgramError> {
    let mut text = read_text(file)?;
    let beside = file.parent().unwrap_or(Path::new("")).to_path_buf();
    let folders: Vec<&PathBuf> = [&beside].into_iter().chain(folders).collect();
    let mut known = HashSet::new();
    let mut called = vec![];
    collect(&text, &mut known, &mut called);
    let mut files = 0;
    while let Some(label) = called.pop() {
        if !known.insert(label.clone()) {
            continue;
        }
        let Some(path) = find(&label, &folders) else {
            continue;
        };
        let of_file = read_text(&path)?;
        files += 1;
        if files > FILES_MAX || (text.len() + of_file.len()) as u64 > FILE_BYTES_MAX {
            let found = format!(
                "with its subroutines is larger than {} MiB, or more than {FILES_MAX} files",
                FILE_BYTES_MAX >> 20
            );
            return Err(ProgramError::of_file(
                &file.display().to_string(),
                found,
                "fewer, or smaller ones",
            ));
        }
        collect(&of_file, &mut known, &mut called);
        if !text.ends_with('\n') {
            text.push('\n');
        }
        text.push(FILE_MARK);
        text += &path.file_name().unwrap_or_default().to_string_lossy();
        text.push('\n');
        text += &of_file;
    }
    Ok(text)
}

/// Collects the subroutines that a text defines, and those that it calls.
fn collect(text: &str, known: &mut HashSet<String>, called: &mut Vec<String>) {
    for line in text.lines() {
        match flow_at(line) {
            Some((label, Keyword::Sub | Keyword::Number)) => {
                known.insert(label);
            }
            Some((label, Keyword::Call)) => called.push(label),
            Some(_) => {}
            None => called.extend(called_by_number(line)),
        }
    }
}

/// The number in `M98 P…`.
fn called_by_number(line: &str) -> Option<String> {
    let lower = line.to_ascii_lowercase();
    let behind = lower.split_once("m98")?.1;
    let at = line.len() - behind.len() + behind.find('p')? + 1;
    label_of(Cursor::new(line, at).value(&Plain).ok()?)
}

/// The file of a subroutine. Names are compared in lower case, since labels are.
fn find(label: &str, folders: &[&PathBuf]) -> Option<PathBuf> {
    let wanted = format!("{label}.ngc");
    for folder in folders {
        let folder = if folder.as_os_str().is_empty() {
            Path::new(".")
        } else {
            folder.as_path()
        };
        let direct = folder.join(&wanted);
        if direct.is_file() {
            return Some(direct);
        }
        let Ok(entries) = std::fs::read_dir(folder) else {
            continue;
        };
        let mut same: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                name.to_lowercase() == wanted && path.is_file()
            })
            .collect();
        same.sort();
        if let Some(path) = same.into_iter().next() {
            return Some(path);
        }
    }
    None
}

/// A call that is looked for before anything runs: parameters have no value yet.
struct Plain;

impl Lookup for Plain {
    fn numbered(&self, number: u32) -> Result<f64, (String, String)> {
        Err((format!("#{number}"), String::new()))
    }

    fn named(&self, _: &str) -> Option<f64> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Setup;
    use crate::program::AxisSetup;
    use control::path::AxisVector;

    #[test]
    fn subroutines_beside_the_program_and_in_folders_come_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        std::fs::create_dir(folder.path().join("subs")).unwrap();
        write(
            "main.ngc",
            "o<Hole Row> call [3]\nM98 P200\no<not-there> call\nM2",
        );
        write(
            "subs/holerow.ngc",
            "o<holerow> sub\no<deep> call [#1]\no<holerow> endsub\nM2\n",
        );
        write("DEEP.NGC", "o<deep> sub\nG0 X#1\no<deep> endsub");
        write("subs/200.ngc", "O200\nG0 X9\nM99\n");
        let text = read_program(
            &folder.path().join("main.ngc"),
            &[folder.path().join("subs")],
        )
        .unwrap();
        let setup = Setup {
            axes: vec![AxisSetup {
                letter: 'X',
                travel_min: -10.0,
                travel_max: 10.0,
                rotary: false,
            }],
            ..Setup::default()
        };
        let text = text.replace("o<not-there> call\n", "");
        let program = crate::interpret("main", &text, &setup, AxisVector::zeros()).unwrap();
        let ends: Vec<f64> = program
            .path
            .elements
            .iter()
            .map(|element| element.end()[0])
            .collect();
        assert_eq!(ends, [3.0, 9.0]);
        // What is bundled is whole: bundling it again adds nothing.
        let copy = folder.path().join("copy.ngc");
        std::fs::write(&copy, &text).unwrap();
        assert_eq!(read_program(&copy, &[]).unwrap(), text);
    }
}
