//! Why a segment could not be started up.

/// Why a segment could not be started up; nothing is enabled then.
#[derive(Debug, thiserror::Error)]
pub enum StartUpError {
    /// This program has no EtherCAT.
    #[error(
        "this quadrant was built without EtherCAT: build it with `cargo build --release --features ethercat`"
    )]
    NotBuilt,
    /// Nobody answers.
    #[error(
        "{interface}: no slave answers: is it the right interface, are the drives powered, and does the cable go into their IN port?"
    )]
    Nobody {
        /// The interface.
        interface: String,
    },
    /// More or fewer than the machine file names.
    #[error(
        "{found} slaves on the cable, {expected} in the machine file ({named}): {remedy}; `quadrant bus scan {interface}` lists them"
    )]
    Count {
        /// Slaves that answer.
        found: usize,
        /// Slaves that are named.
        expected: usize,
        /// Their names.
        named: String,
        /// What to do.
        remedy: &'static str,
        /// The interface.
        interface: String,
    },
    /// Another drive than its file says.
    #[error("{slave}: {found} is there, its drive file is of {expected}: {remedy}")]
    Identity {
        /// Which.
        slave: String,
        /// What is there.
        found: String,
        /// What is to be.
        expected: String,
        /// What to do.
        remedy: String,
    },
    /// A step failed.
    #[error("{slave}: {step}: {what}")]
    Step {
        /// Which.
        slave: String,
        /// What was being done.
        step: String,
        /// What was wrong, and what to do.
        what: String,
    },
}
