//! A cell's name, and where it keeps its things.

use std::fs;
use std::io;
use std::path::PathBuf;

pub(crate) use crate::error::SHARED_MEMORY;
use crate::error::{CELL_NAME_LENGTH_MAX, CellError};

pub(crate) const OWNER_LOCK: &str = "owner.lock";
pub(crate) const MEMBERS_LOCK: &str = "members.lock";

/// What was read of a file; none of one that is not there.
pub fn if_there<T>(read: io::Result<T>) -> io::Result<Option<T>> {
    match read {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        read => read.map(Some),
    }
}

/// Whether this can name a cell: lower-case letters, digits and hyphens.
pub fn is_cell_name(name: &str) -> bool {
    !name.is_empty()
        && !name.starts_with('-')
        && name.len() <= CELL_NAME_LENGTH_MAX
        && name
            .bytes()
            .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}

/// A file of the user that holds something which outlives a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeptFile {
    /// Numbered parameters.
    Parameters,
    /// Work offsets.
    Offsets,
    /// The tool table.
    Tools,
    /// The tool in the spindle.
    Spindle,
}

impl KeptFile {
    /// All of them.
    pub const ALL: [KeptFile; 4] = [
        KeptFile::Parameters,
        KeptFile::Offsets,
        KeptFile::Tools,
        KeptFile::Spindle,
    ];

    /// Name of the file in the cell's folder that names it.
    pub(crate) fn named_in(self) -> &'static str {
        match self {
            KeptFile::Parameters => "parameter-file",
            KeptFile::Offsets => "offsets-file",
            KeptFile::Tools => "tools-file",
            KeptFile::Spindle => "spindle-file",
        }
    }
}

/// Where a cell keeps its things.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellPaths {
    name: String,
}

impl CellPaths {
    /// The place of the cell of this name.
    ///
    /// # Errors
    /// [`CellError::Name`].
    pub fn new(name: &str) -> Result<Self, CellError> {
        if is_cell_name(name) {
            Ok(CellPaths { name: name.into() })
        } else {
            Err(CellError::Name(name.into()))
        }
    }

    /// The cell's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder.
    pub fn folder(&self) -> PathBuf {
        PathBuf::from(format!("{SHARED_MEMORY}/quadrant-{}", self.name))
    }

    /// Copy of the cell's machine file: what its clients know of it.
    pub fn machine_file(&self) -> PathBuf {
        self.folder().join("machine.toml")
    }

    /// File that names the folder of the machine file that the cell was started with.
    pub fn origin_file(&self) -> PathBuf {
        self.folder().join("origin")
    }

    /// Folder of the program that was loaded under this number: its one file keeps the program's own name.
    pub fn program_folder(&self, load: u32) -> PathBuf {
        self.programs().join(load.to_string())
    }

    /// File that names the folder of the run directories, in a cell that stays up.
    pub fn runs_file(&self) -> PathBuf {
        self.folder().join("runs")
    }

    /// Where loaded programs lie.
    pub fn programs(&self) -> PathBuf {
        self.folder().join("programs")
    }

    /// Where planners keep the places of a program that those after them go on from.
    pub fn places(&self) -> PathBuf {
        self.folder().join("places")
    }

    /// What the machine has answered in a run of a program.
    pub fn answers(&self, load: u32, run: u32) -> PathBuf {
        self.folder().join(format!("answers-{load}-{run}"))
    }

    /// Removes what the cell has kept of runs before the last two: a cell stays up for as many as somebody starts.
    pub fn forget_runs_before(&self, run: u32) {
        let is_behind = |name: &str| {
            let mut parts = name.split('-');
            let of_run = ["answers", "beginning", "modes", "parameters", "tools"];
            let known = parts.next().is_some_and(|what| of_run.contains(&what));
            let of = parts.next_back().and_then(|run| run.parse::<u32>().ok());
            known && of.is_some_and(|of| of.saturating_add(1) < run)
        };
        for entry in fs::read_dir(self.folder()).into_iter().flatten().flatten() {
            if entry.file_name().to_str().is_some_and(is_behind) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// File that names a file of the user; none where the cell has none.
    pub fn kept_file(&self, which: KeptFile) -> PathBuf {
        self.folder().join(which.named_in())
    }

    /// The parameters that a run of a program has begun with.
    pub fn parameters(&self, load: u32, run: u32) -> PathBuf {
        self.folder().join(format!("parameters-{load}-{run}"))
    }

    /// The tool table that a run of a program has begun with.
    pub fn tools(&self, load: u32, run: u32) -> PathBuf {
        self.folder().join(format!("tools-{load}-{run}"))
    }

    /// Tool, offset and modes that a run of a program has begun with.
    pub fn beginning(&self, load: u32, run: u32) -> PathBuf {
        self.folder().join(format!("beginning-{load}-{run}"))
    }

    /// The modes that a run has left at its end.
    pub fn modes(&self, run: u32) -> PathBuf {
        self.folder().join(format!("modes-{run}"))
    }

    /// The user M-code that the planner wants to be run.
    pub fn user_code_call(&self) -> PathBuf {
        self.folder().join("user-code")
    }

    /// How the user M-code that ran last has ended.
    pub fn user_code_end(&self) -> PathBuf {
        self.folder().join("user-code-end")
    }

    /// What the program says: the texts around the place that its path has come to.
    pub fn messages(&self) -> PathBuf {
        self.folder().join("messages")
    }

    /// The program that was loaded under this number.
    pub fn program(&self, load: u32) -> Option<PathBuf> {
        let mut entries = fs::read_dir(self.program_folder(load)).ok()?.flatten();
        entries.next().map(|entry| entry.path())
    }

    /// Names of the cells whose folders are on this PC; whether they run is reported by their page.
    pub fn names() -> Vec<String> {
        let entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries
            .filter_map(|entry| {
                let name = entry.file_name().into_string().ok()?;
                let cell = name.strip_prefix("quadrant-")?;
                is_cell_name(cell).then(|| cell.to_string())
            })
            .collect();
        names.sort();
        names
    }

    /// The signal page.
    pub fn page(&self) -> PathBuf {
        self.folder().join("page")
    }

    /// The drive page, of a cell with drives on a fieldbus.
    pub fn drive_page(&self) -> PathBuf {
        self.folder().join("drives")
    }

    pub(crate) fn iceoryx2_root(&self) -> String {
        format!("{SHARED_MEMORY}/quadrant-{}/iox", self.name)
    }

    pub(crate) fn segment_prefix(&self) -> String {
        format!("qd-{}_", self.name)
    }
}
