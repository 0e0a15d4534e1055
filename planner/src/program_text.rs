//! Where the text of a program is.

use std::path::PathBuf;
use std::sync::Arc;

use path::geometry::AxisVector;
use program::{ProgramError, Reading, Setup};

/// The text of a program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ProgramText {
    /// Here: its name, and the text.
    Here(String, Arc<str>),
    /// In a file that nobody writes to, read as it is needed.
    File(PathBuf),
}

impl ProgramText {
    /// Its name, for people.
    pub fn name(&self) -> String {
        match self {
            ProgramText::Here(name, _) => name.clone(),
            ProgramText::File(path) => path.display().to_string(),
        }
    }

    /// Reads it from its start.
    pub(crate) fn read(
        &self,
        setup: &Arc<Setup>,
        start: AxisVector,
    ) -> Result<Reading, ProgramError> {
        match self {
            ProgramText::Here(name, text) => Reading::of_text(name, text, setup, start),
            ProgramText::File(path) => Reading::open(path, setup, start),
        }
    }
}
