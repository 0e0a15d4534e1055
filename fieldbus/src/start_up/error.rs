//! Why a segment could not be started up.

/// Why a segment could not be started up; nothing is enabled then.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct StartUpError(String);

impl StartUpError {
    /// At this slave or on this interface a step failed: what was being done, what was wrong, and what to do.
    pub fn at(place: &str, step: &str, what: &str) -> Self {
        StartUpError(format!("{place}: {step}: {what}"))
    }

    /// Other slaves are there than the machine file names.
    pub fn others(words: String) -> Self {
        StartUpError(words)
    }

    /// Nobody answers on this interface.
    pub fn nobody(interface: &str) -> Self {
        StartUpError(format!(
            "{interface}: no slave answers: is it the right interface, are the drives powered, and does the cable go into their IN port?"
        ))
    }
}
