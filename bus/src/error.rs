//! Why a cell cannot be had.

use std::io;

/// Where all shared memory of this PC has its names.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// Longest cell name: the socket path limit of iceoryx2 (68 characters for prefix and root) leaves no more.
pub const CELL_NAME_LENGTH_MAX: usize = 20;

/// Why a cell cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum CellError {
    /// Not a name for a cell.
    #[error(
        "cell name {0:?}: must be 1 to {max} lower-case letters, digits or hyphens",
        max = CELL_NAME_LENGTH_MAX
    )]
    Name(String),
    /// Another launcher owns it.
    #[error(
        "cell {cell:?} is already running{by}: stop it first, or give this one another name with --cell"
    )]
    Running {
        /// The cell.
        cell: String,
        /// Its launcher, if known: " under launcher pid 123 (quadrant)".
        by: String,
    },
    /// Its launcher is gone, but members of it still live.
    #[error(
        "cell {cell:?} has no launcher but processes of it still live{which}: they stop by themselves; try again in a moment"
    )]
    MembersLive {
        /// The cell.
        cell: String,
        /// They, if known: " (process 123 (quadrant))".
        which: String,
    },
    /// What is in its place is not ours.
    #[error(
        "cell {cell:?}: {path} {found}: a cell is used as its own user only, and another one can be named with --cell"
    )]
    Foreign {
        /// The cell.
        cell: String,
        /// Its place, or a segment of its name.
        path: String,
        /// What is there.
        found: String,
    },
    /// Shared memory is full, or too small.
    #[error(
        "cell {cell:?}: {SHARED_MEMORY} has no room for {needed}: {free} of {total} are free. Make it larger (`mount -o remount,size=64m \
         {SHARED_MEMORY}`; for a container `--shm-size=64m`), or remove what fills it"
    )]
    NoRoom {
        /// The cell.
        cell: String,
        /// What is needed, with its unit.
        needed: String,
        /// What is free.
        free: String,
        /// What there is in all.
        total: String,
    },
    /// The operating system grants too little of something.
    #[error("cell {cell:?}: {needed} {what} are needed, {granted} are granted")]
    Limit {
        /// The cell.
        cell: String,
        /// Of what, and how that is changed.
        what: &'static str,
        /// So much is granted.
        granted: u64,
        /// So much is needed.
        needed: u64,
    },
    /// The operating system refused something.
    #[error("cell {cell:?}: {what}: {source}")]
    System {
        /// The cell.
        cell: String,
        /// What was tried.
        what: String,
        /// Why it failed.
        source: io::Error,
    },
    /// iceoryx2 refused something.
    #[error("cell {cell:?}: {what}")]
    Transport {
        /// The cell.
        cell: String,
        /// What was tried and why it failed.
        what: String,
    },
}
