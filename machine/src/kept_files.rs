//! Which files of the user hold what outlives a run.

use std::path::PathBuf;

/// The files of the user that hold what outlives a run of a machine.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct KeptFiles {
    /// Numbered parameters; none where the machine file names no such file.
    pub parameters: Option<PathBuf>,
    /// Work offsets, which need not be there; none in a copy that holds what its run began with.
    pub offsets: Option<PathBuf>,
    /// The tool table, which need not be there: then the machine file's own tools are in force. None where it has the form of LinuxCNC.
    pub tools: Option<PathBuf>,
    /// The tool in the spindle, which need not be there; none in a copy that holds what its run began with.
    pub spindle: Option<PathBuf>,
}
