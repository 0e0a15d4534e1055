//! What is wrong with a program, for the person who wrote it.

use control::pivot::OutOfReach;

/// The most problems reported at once; the rest is usually their echo.
pub const PROBLEMS_MAX: usize = 20;

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line and column, both counted from 1 (columns in characters); none if it concerns the file as a whole.
    pub place: Option<(u32, u32)>,
    /// What was found.
    pub found: String,
    /// What would be right.
    pub right: String,
}

/// Why a program is refused: all its problems in the order of its lines, at most twenty.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
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
        let problem = Problem {
            place: None,
            found: found.into(),
            right: right.into(),
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

impl Problem {
    fn text(&self, name: &str) -> String {
        let Problem {
            place,
            found,
            right,
        } = self;
        match place {
            Some((line, column)) => format!("{name}:{line}:{column}: {found}: {right}"),
            None => format!("{name}: {found}: {right}"),
        }
    }
}
