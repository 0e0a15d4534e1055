//! A program with the subroutines of other files that it calls: one text, so that nobody's edits reach a run.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::io::Write;
use std::path::{Path, PathBuf};

use machine::Dialect;

use crate::error::{ProgramError, refuse_file};
use crate::fanuc;
use crate::file::{FILE_BYTES_MAX, open_text, read_text};
use crate::flow::{Keyword, called_by_number, flow_at};
use crate::refusal::Refusal;
use crate::source::{FILE_MARK, LABELS_MAX};
use crate::text::{dialect_mark, marked_dialect, text_of};

/// The most files of one program.
const FILES_MAX: usize = 1000;

/// The text of a program, behind it the subroutines that it calls and does not hold: files of their names beside the program, or in
/// one of the folders (`pocket.ngc` for `O<pocket> call`, `100.ngc` for `O100 call` and `M98 P100`).
///
/// A call whose file is not there is left to whoever executes it: it may never be reached.
///
/// # Errors
/// A file that cannot be read, or all together larger than 64 MiB.
pub fn read_program(
    file: &Path,
    folders: &[PathBuf],
    dialect: Dialect,
) -> Result<String, ProgramError> {
    let name = &file.display().to_string();
    let mut text = read_text(file)?;
    let (marked, _) = marked_dialect(text.as_bytes());
    let mut calls = Calls::of(marked.unwrap_or(dialect));
    text.lines().for_each(|line| calls.read(line));
    let folders = Folders::of(file, folders);
    while let Some(path) = calls.next_file(name, &folders)? {
        let of_file = read_text(&path)?;
        if (text.len() + of_file.len()) as u64 > FILE_BYTES_MAX {
            let mib = FILE_BYTES_MAX >> 20;
            let found = format!("with its subroutines is larger than {mib} MiB");
            return refuse_file(name, found, "fewer, or smaller ones");
        }
        of_file.lines().for_each(|line| calls.read(line));
        if !text.ends_with('\n') {
            text.push('\n');
        }
        text += &mark_of(&path);
        text += &of_file;
    }
    Ok(text)
}

/// Writes what `read_program` gives, of any length: a small part of it is in memory at a time. The text says from then on that it is
/// written in this dialect, unless it did so before, or both are LinuxCNC's, also that which `by_machine` would take it for.
///
/// # Errors
/// A file that cannot be read or is not text, or what is written to.
pub fn bundle_to(
    file: &Path,
    folders: &[PathBuf],
    dialect: Dialect,
    by_machine: Dialect,
    to: &mut impl Write,
) -> Result<(), ProgramError> {
    let name = &file.display().to_string();
    let unwritten = |error: std::io::Error| {
        let found = format!("cannot be copied ({error})");
        ProgramError::of_file(name, found, "room for a copy")
    };
    let marked = open_text(file)?.dialect();
    let dialect = marked.unwrap_or(dialect);
    if marked.is_some() || [dialect, by_machine] != [Dialect::LinuxCnc; 2] {
        let mark = dialect_mark(dialect);
        to.write_all(mark.as_bytes()).map_err(unwritten)?;
    }
    let mut calls = Calls::of(dialect);
    let mut ended = copy(file, &mut calls, to)?.map_err(unwritten)?;
    let folders = Folders::of(file, folders);
    while let Some(path) = calls.next_file(name, &folders)? {
        if !ended {
            to.write_all(b"\n").map_err(unwritten)?;
        }
        let mark = mark_of(&path);
        to.write_all(mark.as_bytes()).map_err(unwritten)?;
        ended = copy(&path, &mut calls, to)?.map_err(unwritten)?;
    }
    to.flush().map_err(unwritten)
}

/// The line that begins another file.
fn mark_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    format!("{FILE_MARK}{}\n", name.to_string_lossy())
}

/// Copies a file by its lines; whether it ends with a line end.
fn copy(
    file: &Path,
    calls: &mut Calls,
    to: &mut impl Write,
) -> Result<std::io::Result<bool>, ProgramError> {
    let mut text = open_text(file)?;
    let (mut byte, mut number) = (0, 0);
    let mut ended = false;
    loop {
        number += 1;
        let refused = |error: Refusal| {
            let place = Some((number, error.offset as u32 + 1));
            ProgramError::at(&file.display().to_string(), place, error)
        };
        let Some((line, behind)) = text.bytes(byte).map_err(refused)? else {
            return Ok(Ok(ended));
        };
        let as_text = text_of(line).map_err(refused)?;
        calls.read(as_text);
        let before = if byte == 0 { &b""[..] } else { b"\n" };
        if let Err(error) = to.write_all(before).and_then(|()| to.write_all(line)) {
            return Ok(Err(error));
        }
        ended = byte > 0 && line.is_empty();
        byte = behind;
    }
}

/// The subroutines that texts define, and those that they call.
#[derive(Default)]
struct Calls {
    dialect: Dialect,
    known: HashSet<String>,
    /// Those that are called, by when that was said last.
    called: BTreeMap<u64, String>,
    said: HashMap<String, u64>,
    count: u64,
    files: usize,
}

impl Calls {
    fn of(dialect: Dialect) -> Self {
        Self {
            dialect,
            ..Self::default()
        }
    }

    /// Collects what a line defines or calls, up to more than there may be.
    fn read(&mut self, line: &str) {
        if self.known.len() + self.said.len() > LABELS_MAX {
            return;
        }
        let (led_to, called): (_, fn(&str) -> _) = match self.dialect {
            Dialect::LinuxCnc => (flow_at(line), called_by_number),
            Dialect::Fanuc => (fanuc::label_at(line), fanuc::called_by),
        };
        match led_to {
            Some((label, Keyword::Sub | Keyword::Number)) => {
                self.known.insert(label);
            }
            Some((label, Keyword::Call)) => self.call(label),
            Some(_) => {}
            None => {
                if let Some(label) = called(line) {
                    self.call(label);
                }
            }
        }
    }

    fn call(&mut self, label: String) {
        self.count += 1;
        if let Some(before) = self.said.insert(label.clone(), self.count) {
            self.called.remove(&before);
        }
        self.called.insert(self.count, label);
    }

    /// The file of the next subroutine that no text so far defines.
    fn next_file(
        &mut self,
        name: &str,
        folders: &Folders,
    ) -> Result<Option<PathBuf>, ProgramError> {
        if self.known.len() + self.said.len() > LABELS_MAX {
            let found = format!("has or calls more than {LABELS_MAX} subroutines");
            return refuse_file(name, found, "split the program");
        }
        while let Some((_, label)) = self.called.pop_last() {
            self.said.remove(&label);
            if !self.known.insert(label.clone()) {
                continue;
            }
            let Some(path) = folders.find(&label, self.dialect) else {
                continue;
            };
            self.files += 1;
            if self.files > FILES_MAX {
                let found = format!("calls subroutines of more than {FILES_MAX} files");
                return refuse_file(name, found, "fewer ones");
            }
            return Ok(Some(path));
        }
        Ok(None)
    }
}

/// Where subroutines are looked for.
struct Folders(Vec<PathBuf>);

impl Folders {
    /// The folder of a program, then others.
    fn of(file: &Path, others: &[PathBuf]) -> Self {
        let beside = file.parent().unwrap_or(Path::new("")).to_path_buf();
        Self([beside].into_iter().chain(others.iter().cloned()).collect())
    }

    /// The file of a subroutine. Names are compared in lower case, since labels are.
    fn find(&self, label: &str, dialect: Dialect) -> Option<PathBuf> {
        let wanted = format!("{label}.ngc");
        let is_wanted = |name: &str| match dialect {
            Dialect::LinuxCnc => name == wanted,
            Dialect::Fanuc => fanuc::is_file_of(name, label),
        };
        for folder in &self.0 {
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
                    is_wanted(&name.to_lowercase()) && path.is_file()
                })
                .collect();
            same.sort();
            if let Some(path) = same.into_iter().next() {
                return Some(path);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Setup;
    use crate::program::AxisSetup;
    use path::geometry::AxisVector;

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
        write(
            "DEEP.NGC",
            "o<deep> sub\n(print, line #<_line>)\nG0 X#1\no<deep> endsub",
        );
        write("subs/200.ngc", "O200\nG0 X9\nM99\n");
        let text = read_program(
            &folder.path().join("main.ngc"),
            &[folder.path().join("subs")],
            Dialect::LinuxCnc,
        )
        .unwrap();
        let mut streamed = vec![];
        let folders = [folder.path().join("subs")];
        let plain = Dialect::LinuxCnc;
        let main = folder.path().join("main.ngc");
        bundle_to(&main, &folders, plain, plain, &mut streamed).unwrap();
        assert_eq!(String::from_utf8(streamed).unwrap(), text);
        let setup = Setup {
            axes: vec![AxisSetup {
                letter: 'X',
                travel_min: -10.0,
                travel_max: 10.0,
                rotary: false,
                modulo: false,
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
        // A line is counted in its own file.
        assert_eq!(program.messages[0].text, "line 2.000000");
        // What is bundled is whole: bundling it again adds nothing.
        let copy = folder.path().join("copy.ngc");
        std::fs::write(&copy, &text).unwrap();
        assert_eq!(read_program(&copy, &[], plain).unwrap(), text);
    }
}
