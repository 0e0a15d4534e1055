//! User M-codes (M100 to M199) between the planner, which wants one to be run, and the launcher, which runs it: two small files in the cell's folder.
//!
//! The planner writes the call once the machine rests before it. The launcher runs each call once, however often it is read, and writes how it
//! ended. So whoever is killed meanwhile, the code runs at most once; a planner that comes later finds its end.

use std::fs;
use std::io;
use std::path::Path;

use crate::cell::{CellPaths, if_there};

/// Which event of which run a call is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CallId {
    /// Number of the program in the cell.
    pub load: u32,
    /// Number of the run.
    pub run: u32,
    /// Number of the event.
    pub event: u32,
}

/// A user M-code that is to be run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UserCall {
    /// Which it is.
    pub id: CallId,
    /// 100 to 199.
    pub code: u32,
    /// P of its block; −1 without it.
    pub p: f64,
    /// Q of its block; −1 without it.
    pub q: f64,
    /// Line of the program.
    pub line: u32,
}

/// How a call has ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CallEnd {
    /// Which it is.
    pub id: CallId,
    /// Why the program must not go on; none if it was good.
    pub failed: Option<String>,
}

impl UserCall {
    /// As it is in the file: f64 reads what it has shown to the bit.
    fn text(&self) -> String {
        let CallId { load, run, event } = self.id;
        let UserCall {
            code, p, q, line, ..
        } = self;
        format!("{load} {run} {event} {code} {p} {q} {line}\n")
    }

    fn parse(text: &str) -> Option<UserCall> {
        let words: Vec<&str> = text.split_whitespace().collect();
        let [load, run, event, code, p, q, line] = words.try_into().ok()?;
        Some(UserCall {
            id: CallId {
                load: load.parse().ok()?,
                run: run.parse().ok()?,
                event: event.parse().ok()?,
            },
            code: code.parse().ok()?,
            p: p.parse().ok()?,
            q: q.parse().ok()?,
            line: line.parse().ok()?,
        })
    }
}

/// Writes a call for the launcher; the same again changes nothing.
///
/// # Errors
/// The cell's folder cannot be written.
pub fn call(paths: &CellPaths, call: &UserCall) -> io::Result<()> {
    if called(paths)?.as_ref() == Some(call) {
        return Ok(());
    }
    write(&paths.user_code_call(), &call.text())
}

/// The last call; none if there is none.
///
/// # Errors
/// The cell's folder cannot be read.
pub fn called(paths: &CellPaths) -> io::Result<Option<UserCall>> {
    let text = if_there(fs::read_to_string(paths.user_code_call()))?;
    Ok(text.as_deref().and_then(UserCall::parse))
}

/// Writes how a call has ended.
///
/// # Errors
/// The cell's folder cannot be written.
pub fn end(paths: &CellPaths, end: &CallEnd) -> io::Result<()> {
    let CallId { load, run, event } = end.id;
    let failed = end.failed.as_deref().unwrap_or_default();
    let text = format!("{load} {run} {event}\n{failed}");
    write(&paths.user_code_end(), &text)
}

/// How this call has ended; none as long as it has not.
///
/// # Errors
/// The cell's folder cannot be read.
pub fn ended(paths: &CellPaths, id: CallId) -> io::Result<Option<CallEnd>> {
    let CallId { load, run, event } = id;
    let text = if_there(fs::read_to_string(paths.user_code_end()))?.unwrap_or_default();
    let end = text.strip_prefix(&format!("{load} {run} {event}\n"));
    Ok(end.map(|failed| CallEnd {
        id,
        failed: (!failed.is_empty()).then(|| failed.to_owned()),
    }))
}

/// A reader finds all of it or nothing.
fn write(file: &Path, text: &str) -> io::Result<()> {
    let new = file.with_extension("new");
    fs::write(&new, text)?;
    fs::rename(&new, file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_and_its_end_are_read_as_they_were_written() {
        let paths = CellPaths::new(&format!("codes-{}", std::process::id())).expect("a name");
        fs::create_dir(paths.folder()).expect("the folder");
        let id = CallId {
            load: 3,
            run: 2,
            event: 7,
        };
        let (p, q, code, line) = (0.1 + 0.2, -1.0, 101, 12);
        let asked = UserCall {
            id,
            code,
            p,
            q,
            line,
        };
        assert_eq!(called(&paths).expect("readable"), None);
        for _ in 0..2 {
            call(&paths, &asked).expect("written");
            assert_eq!(called(&paths).expect("readable"), Some(asked));
        }
        assert_eq!(ended(&paths, id).expect("readable"), None);
        for failed in [
            None,
            Some("M101 ended with status 3\nand a second line".to_owned()),
        ] {
            let with = CallEnd { id, failed };
            end(&paths, &with).expect("written");
            assert_eq!(ended(&paths, id).expect("readable"), Some(with));
        }
        let other = CallId { event: 8, ..id };
        assert_eq!(ended(&paths, other).expect("readable"), None);
        fs::remove_dir_all(paths.folder()).expect("removed");
    }
}
