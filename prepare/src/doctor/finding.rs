//! What was found of one thing, how it is graded, and what would be better.

use serde::Serialize;

/// How well a thing is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Grade {
    /// Nothing to do.
    #[serde(rename = "ok")]
    Fine,
    /// Works; real time would be better with a change.
    #[serde(rename = "could-be-better")]
    Better,
    /// Real time does not work without a change.
    #[serde(rename = "must-be-changed")]
    Must,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The thing.
    pub what: &'static str,
    /// Its grade.
    pub grade: Grade,
    /// What was found.
    pub found: String,
    /// Why that matters; empty where nothing is to be reported.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub why: String,
    /// What to change: commands as they are typed, lines as they are in files; remarks begin with `#`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub change: Vec<String>,
}

impl Finding {
    /// Nothing to do.
    pub fn fine(what: &'static str, found: impl Into<String>) -> Self {
        Finding {
            what,
            grade: Grade::Fine,
            found: found.into(),
            why: String::new(),
            change: Vec::new(),
        }
    }

    /// Something could be better.
    pub fn better(
        what: &'static str,
        found: impl Into<String>,
        why: &str,
        change: &[&str],
    ) -> Self {
        Finding {
            grade: Grade::Better,
            why: why.into(),
            change: change.iter().map(|line| line.to_string()).collect(),
            ..Self::fine(what, found)
        }
    }

    /// Something must be changed.
    pub fn must(what: &'static str, found: impl Into<String>, why: &str, change: &[&str]) -> Self {
        Finding {
            grade: Grade::Must,
            ..Self::better(what, found, why, change)
        }
    }

    /// The same with a remark on what is well.
    pub fn because(mut self, why: &str) -> Self {
        self.why = why.into();
        self
    }
}
