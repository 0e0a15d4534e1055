//! What is wrong with a program, for the person who wrote it.

use path::pivot::OutOfReach;
use serde::{Deserialize, Serialize};

use crate::refusal::Refusal;

/// The most problems reported at once; the rest is usually their echo.
pub const PROBLEMS_MAX: usize = 20;

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// The file, if it is another one than the program's own.
    pub file: Option<String>,
    /// Line and column, both counted from 1 (columns in characters); none if it concerns the file as a whole.
    pub place: Option<(u32, u32)>,
    /// What was found.
    pub found: String,
    /// What would be right.
    pub right: String,
    /// The line as it stands, and how execution came to it: subroutines, from the innermost.
    pub shown: Option<Shown>,
}

/// The line of a problem, for showing it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shown {
    /// Its text.
    pub text: String,
    /// How many characters from the column on belong to the problem.
    pub length: u32,
    /// Where the subroutine that it is in was called, innermost first.
    pub trace: Vec<String>,
}

/// Why a program is refused: all its problems in the order of its lines, at most twenty.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
#[error("{}", self.text())]
pub struct ProgramError {
    /// Name of the program, as it was given.
    pub name: String,
    /// In the order of the lines.
    pub problems: Vec<Problem>,
    /// Whether reading stopped at the limit, with more problems possibly to come.
    pub more: bool,
}

/// Why a program cannot be expanded from where a machine's axes are.
#[derive(Debug, thiserror::Error)]
pub enum ResumeError {
    /// No program can start there.
    #[error(transparent)]
    OutOfReach(#[from] OutOfReach),
    /// The program.
    #[error(transparent)]
    Program(#[from] ProgramError),
}

impl ProgramError {
    /// One problem of the file as a whole.
    pub(crate) fn of_file(name: &str, found: impl Into<String>, right: impl Into<String>) -> Self {
        Self::at(name, None, Refusal::new(0, found, right))
    }

    /// What is wrong with a text as a whole.
    pub(crate) fn of_text(name: &str, refusal: Refusal) -> Self {
        Self::at(name, None, refusal)
    }

    /// What is wrong at a line and column, or with the whole.
    pub(crate) fn at(name: &str, place: Option<(u32, u32)>, refusal: Refusal) -> Self {
        let problem = Problem {
            file: None,
            shown: None,
            place,
            found: refusal.found,
            right: refusal.right,
        };
        Self {
            name: name.to_owned(),
            problems: vec![problem],
            more: false,
        }
    }

    fn text(&self) -> String {
        let mut lines: Vec<String> = self
            .problems
            .iter()
            .map(|problem| problem.text(&self.name))
            .collect();
        if self.more {
            lines.push(format!(
                "{}: more than {PROBLEMS_MAX} problems: the rest is not read",
                self.name
            ));
        }
        lines.join("\n")
    }
}

/// Refuses a program for what is wrong with it as a whole.
pub(crate) fn refuse_file<T>(
    name: &str,
    found: impl Into<String>,
    right: impl Into<String>,
) -> Result<T, ProgramError> {
    Err(ProgramError::of_file(name, found, right))
}

impl Problem {
    fn text(&self, name: &str) -> String {
        let Problem { found, right, .. } = self;
        let name = self.file.as_deref().unwrap_or(name);
        let Some((line, column)) = self.place else {
            return format!("{name}: {found}: {right}");
        };
        let mut text = format!("{name}:{line}:{column}: {found}: {right}");
        if let Some(shown) = &self.shown {
            let number = line.to_string();
            // Tabs before the place stay tabs, so that the mark stands below it.
            let before: String = shown
                .text
                .chars()
                .take(column.saturating_sub(1) as usize)
                .map(|character| if character == '\t' { '\t' } else { ' ' })
                .collect();
            let mark = "^".repeat(shown.length.max(1) as usize);
            text += &format!("\n {number} | {}", shown.text);
            text += &format!("\n {} | {before}{mark}", " ".repeat(number.len()));
            for call in &shown.trace {
                text += &format!("\n {}   in {call}", " ".repeat(number.len()));
            }
        }
        text
    }
}
