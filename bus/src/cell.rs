//! A cell's place on this PC: its name, its folder in shared memory, its locks, and how it is cleaned.
//!
//! Everything a cell owns lies in `/dev/shm/quadrant-<cell>/` and in segments `/dev/shm/qd-<cell>_*`. Cell names have no
//! underscore, so no cell's prefix is the beginning of another's: two cells never meet. Two locks say who lives: the
//! launcher holds `owner.lock` exclusively, every member holds `members.lock` shared. The kernel lets go of both when
//! the holder dies, however it dies. Locks are files, which anybody of this user can remove: the launcher also holds the
//! cell's name as a socket's address, which nobody can take from it.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, Path as IoxPath, SemanticString};
use rustix::fs::{FlockOperation, OFlags, flock};

use crate::kept_parameters::KeptFile;
use crate::name::{Holder, Name, Taken};
pub use crate::ownership::Ownership;
use crate::process::watch;

/// Where all shared memory of this PC has its names.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// A segment without a size for so long is of a process that was killed over it.
const UNFINISHED_FOR: Duration = Duration::from_millis(5);
pub(crate) const OWNER_LOCK: &str = "owner.lock";
pub(crate) const MEMBERS_LOCK: &str = "members.lock";
/// Longest cell name: the socket path limit of iceoryx2 (68 characters for prefix and root) leaves no more.
pub const CELL_NAME_LENGTH_MAX: usize = 20;

/// Whether every process that a segment's name names lives. iceoryx2 0.10 names segments by the ports at their ends, as numbers of
/// 128 bits that hold the process id in bits 64 to 95. A name without such a number names nobody.
fn all_makers_live(segment: &Path) -> bool {
    let name = segment.file_name().unwrap_or_default().to_string_lossy();
    let mut makers = name
        .split(['_', '.'])
        .filter_map(|part| part.parse::<u128>().ok())
        .filter(|id| *id > u128::from(u64::MAX))
        .map(|id| (id >> 64) as u32)
        .peekable();
    let lives = |pid: u32| Path::new("/proc").join(pid.to_string()).exists();
    makers.peek().is_some() && makers.all(lives)
}

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

/// Attempts to remove a folder that somebody writes into meanwhile.
const REMOVALS_MAX: u32 = 20;
/// So long a child that is being started may hold the lock of a launcher that is dead.
const HALF_STARTED: Duration = Duration::from_millis(500);
/// So long somebody may have a cell's name who only removes what is left of it.
const CLEANING: Duration = Duration::from_millis(200);
const CLEANING_LOOK: Duration = Duration::from_millis(5);
const MEMBERS_LOOK: Duration = Duration::from_millis(20);

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
        /// Its launcher, if known: " (launcher pid 123)".
        by: String,
    },
    /// Its launcher is gone, but members of it still live.
    #[error(
        "cell {cell:?} has no launcher but processes of it still live: they stop by themselves; try again in a moment"
    )]
    MembersLive {
        /// The cell.
        cell: String,
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

    fn iceoryx2_root(&self) -> String {
        format!("{SHARED_MEMORY}/quadrant-{}/iox", self.name)
    }

    pub(crate) fn segment_prefix(&self) -> String {
        format!("qd-{}_", self.name)
    }

    fn error(&self, what: &str, source: io::Error) -> CellError {
        CellError::System {
            cell: self.name.clone(),
            what: what.into(),
            source,
        }
    }

    /// iceoryx2 configuration of this cell: nothing is shared with any other cell or with the user's own files.
    /// Only the launcher cleans up dead nodes (`cleaner`), see docs/developers/architecture.md.
    ///
    /// # Errors
    /// [`CellError::Transport`] if iceoryx2 refuses the names.
    pub fn config(&self, cleaner: bool) -> Result<Config, CellError> {
        let refuse = |error| CellError::Transport {
            cell: self.name.clone(),
            what: format!("iceoryx2 does not take the cell's name: {error:?}"),
        };
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.segment_prefix().as_bytes()).map_err(refuse)?;
        let root = IoxPath::new(self.iceoryx2_root().as_bytes()).map_err(refuse)?;
        config.global.set_root_path(&root);
        config.global.creation_timeout = Duration::from_millis(200);
        config.global.node.cleanup_dead_nodes_on_creation = cleaner;
        config.global.node.cleanup_dead_nodes_on_destruction = cleaner;
        config.global.service.cleanup_dead_nodes_on_open = cleaner;
        Ok(config)
    }

    /// The same as a file for iceoryx2's own tools and for programs in other languages (`[global]` of `iceoryx2.toml`): observers
    /// that find the cell's services, share nothing with other cells and clean nothing up.
    pub fn iceoryx2_toml(&self) -> String {
        format!(
            "# iceoryx2 0.10: how to enter cell {:?} as an observer.\n[global]\nroot-path = {:?}\nprefix = {:?}\n\n\
             [global.node]\ncleanup-dead-nodes-on-creation = false\ncleanup-dead-nodes-on-destruction = false\n\n\
             [global.service]\ncleanup-dead-nodes-on-open = false\n",
            self.name,
            self.iceoryx2_root(),
            self.segment_prefix(),
        )
    }

    /// Takes the cell for a launcher: locks it, waits up to `patience` for members of a dead launcher to leave, and
    /// removes whatever a crash left of it.
    ///
    /// # Errors
    /// [`CellError::Running`], [`CellError::MembersLive`] or [`CellError::System`].
    pub fn own(&self, patience: Duration) -> Result<Ownership, CellError> {
        let started = Instant::now();
        let name = loop {
            match self.take_name() {
                // An observer may be removing what it has left of a cell that is gone.
                Err(CellError::Running { .. }) if started.elapsed() < patience.min(CLEANING) => {
                    std::thread::sleep(CLEANING_LOOK);
                }
                taken => break taken?,
            }
        };
        loop {
            // An owner who leaves takes the folder away: locks of a folder that is gone are worth nothing.
            let Some(owner) = self.lock_owner()? else {
                continue;
            };
            let Some(members) = self.lock_members(patience.saturating_sub(started.elapsed()))?
            else {
                continue;
            };
            // For the message to whoever wants the cell meanwhile.
            let _ = owner.set_len(0);
            let _ = (&owner).write_all(std::process::id().to_string().as_bytes());
            let leftovers = self.remove_leftovers();
            flock(&members, FlockOperation::Unlock)
                .map_err(|e| self.error("unlocking members.lock", e.into()))?;
            let removed = *leftovers.as_ref().unwrap_or(&0);
            let owned = Ownership::new(self, (owner, members), name, removed);
            // What cannot be had is not kept: the folder of a cell that is refused goes again.
            return leftovers.map(|_| owned);
        }
    }

    /// The cell's name, which nobody else on this PC can hold in the same shared memory.
    fn take_name(&self) -> Result<Name, CellError> {
        let memory =
            fs::metadata(SHARED_MEMORY).map_err(|e| self.error("looking at /dev/shm", e))?;
        let user = rustix::process::geteuid().as_raw();
        let name = format!("quadrant/{user}/{}/{}", memory.dev(), self.name);
        let started = Instant::now();
        loop {
            let holder = match Name::take(&name) {
                Ok(name) => return Ok(name),
                Err(Taken::System(error)) => return Err(self.error("taking its name", error)),
                Err(Taken::By(holder)) => holder,
            };
            match holder {
                Some(holder) if holder.user != user => {
                    let found =
                        format!("is held by process {} of user {}", holder.pid, holder.user);
                    return Err(self.foreign(Path::new(&format!("@{name}")), found));
                }
                // As with its lock: a child that was about to be started holds it until it runs.
                Some(Holder { pid, .. })
                    if watch(pid).is_err() && started.elapsed() < HALF_STARTED =>
                {
                    std::thread::sleep(Duration::from_millis(1));
                }
                holder => {
                    let by = holder.map(|holder| format!(" (launcher pid {})", holder.pid));
                    return Err(CellError::Running {
                        cell: self.name.clone(),
                        by: by.unwrap_or_default(),
                    });
                }
            }
        }
    }

    /// The owner's lock, or nothing if its folder went meanwhile.
    fn lock_owner(&self) -> Result<Option<File>, CellError> {
        let Some(file) = self.open_lock(OWNER_LOCK)? else {
            return Ok(None);
        };
        let started = Instant::now();
        while flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            let pid = fs::read_to_string(self.folder().join(OWNER_LOCK)).unwrap_or_default();
            // A child that a launcher was about to start when it was killed holds its lock until it runs.
            let is_dead = pid.parse().is_ok_and(|pid| watch(pid).is_err());
            if is_dead && started.elapsed() < HALF_STARTED {
                std::thread::sleep(Duration::from_millis(1));
                continue;
            }
            return Err(CellError::Running {
                cell: self.name.clone(),
                by: if pid.is_empty() {
                    String::new()
                } else {
                    format!(" (launcher pid {pid})")
                },
            });
        }
        self.still_there(file, OWNER_LOCK)
    }

    /// The members' lock, once no member lives, or nothing if its folder went meanwhile.
    fn lock_members(&self, patience: Duration) -> Result<Option<File>, CellError> {
        let Some(file) = self.open_lock(MEMBERS_LOCK)? else {
            return Ok(None);
        };
        let started = Instant::now();
        let mut published = false;
        while flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            if !std::mem::replace(&mut published, true) && !patience.is_zero() {
                tracing::info!(
                    "processes of a cell {} whose launcher is gone still live: waiting for them to leave",
                    self.name
                );
            }
            if started.elapsed() >= patience {
                return Err(CellError::MembersLive {
                    cell: self.name.clone(),
                });
            }
            std::thread::sleep(MEMBERS_LOOK);
        }
        self.still_there(file, MEMBERS_LOCK)
    }

    /// The file, if it is the one of this name in the folder of today.
    fn still_there(&self, file: File, name: &str) -> Result<Option<File>, CellError> {
        let is_it = self
            .is_in_place(&file, name)
            .map_err(|e| self.error(&format!("reading {name}"), e))?;
        Ok(is_it.then_some(file))
    }

    /// Whether this file is the one of this name in the folder of today.
    pub(crate) fn is_in_place(&self, file: &File, name: &str) -> io::Result<bool> {
        let held = file.metadata()?;
        let found = fs::metadata(self.folder().join(name));
        Ok(found.is_ok_and(|found| found.ino() == held.ino()))
    }

    /// A lock file of the cell's folder, made if need be, or nothing if the folder went meanwhile.
    fn open_lock(&self, name: &str) -> Result<Option<File>, CellError> {
        DirBuilder::new()
            .mode(0o700)
            .recursive(true)
            .create(self.folder())
            .map_err(|e| self.error("making its folder in /dev/shm", e))?;
        self.must_be_ours()?;
        let opened = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(self.folder().join(name));
        match opened {
            Ok(file) => Ok(Some(file)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(self.error(&format!("opening {name}"), error)),
        }
    }

    /// Anybody can put something of this name into /dev/shm: only a folder of this user is the cell's. Nobody enters another user's
    /// cell, the superuser neither: what he opened there could stay in its owner's way.
    ///
    /// # Errors
    /// [`CellError::Foreign`].
    pub fn must_be_ours(&self) -> Result<(), CellError> {
        let folder = self.folder();
        let found = match fs::symlink_metadata(&folder) {
            // It went meanwhile: opening a lock in it will fail.
            Err(_) => None,
            Ok(metadata) if !metadata.is_dir() => Some("is not a folder".to_string()),
            Ok(metadata) => others(&metadata),
        };
        found.map_or(Ok(()), |found| Err(self.foreign(&folder, found)))
    }

    fn foreign(&self, path: &Path, found: String) -> CellError {
        CellError::Foreign {
            cell: self.name.clone(),
            path: path.display().to_string(),
            found,
        }
    }

    /// Holds the members' lock as one of them, for as long as the result lives.
    ///
    /// # Errors
    /// [`CellError::System`] if the cell does not exist.
    pub fn join(&self) -> Result<Membership, CellError> {
        let file = OpenOptions::new()
            .read(true)
            .open(self.folder().join(MEMBERS_LOCK))
            .map_err(|e| self.error("joining (does it run?)", e))?;
        flock(&file, FlockOperation::LockShared)
            .map_err(|e| self.error("locking members.lock", e.into()))?;
        Ok(Membership { _file: file })
    }

    /// Makes every segment of the cell, and its folder, their owner's alone: iceoryx2 leaves one segment
    /// (`…global_mgmt`) open to all and opens the folder to the group.
    pub(crate) fn close_to_others(&self) -> Result<(), CellError> {
        use std::os::unix::fs::PermissionsExt;
        let prefix = self.segment_prefix();
        let entries = fs::read_dir(SHARED_MEMORY).map_err(|e| self.error("listing /dev/shm", e))?;
        for entry in entries.flatten() {
            let path = entry.path();
            if !entry.file_name().to_string_lossy().starts_with(&prefix) {
                continue;
            }
            // Through the open file, and never through a link: its name may be another thing's by now.
            let file = OpenOptions::new()
                .read(true)
                .custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32)
                .open(&path)
                .map_err(|e| self.error(&format!("closing {} to others", path.display()), e))?;
            let closed = file.metadata().and_then(|found| match foreign(&found) {
                Some(found) => Ok(Some(found)),
                None => file
                    .set_permissions(fs::Permissions::from_mode(0o600))
                    .map(|()| None),
            });
            match closed {
                Ok(None) => {}
                Ok(Some(found)) => return Err(self.foreign(&path, found)),
                Err(e) => {
                    return Err(self.error(&format!("closing {} to others", path.display()), e));
                }
            }
        }
        fs::set_permissions(self.folder(), fs::Permissions::from_mode(0o700))
            .map_err(|e| self.error("closing its folder to others", e))
    }

    /// Whether anything of the cell is in shared memory.
    pub(crate) fn has_traces(&self) -> bool {
        let prefix = self.segment_prefix();
        let mut entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        let is_segment =
            |entry: fs::DirEntry| entry.file_name().to_string_lossy().starts_with(&prefix);
        self.folder().exists() || entries.any(is_segment)
    }

    /// Segments without a size, by inode. A process makes a segment and gives it its size in one go, within microseconds.
    fn unfinished(&self) -> Vec<(PathBuf, u64)> {
        let prefix = self.segment_prefix();
        let entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        entries
            .filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix))
            .filter_map(|entry| Some((entry.path(), entry.metadata().ok()?)))
            .filter(|(_, found)| foreign(found).is_none() && found.len() == 0)
            .map(|(path, found)| (path, found.ino()))
            .collect()
    }

    /// Removes segments that still have no size after [`UNFINISHED_FOR`] and whose maker is dead: it was killed over it, and
    /// whoever opens one would wait for its size without end (iceoryx2 0.10).
    pub(crate) fn remove_unfinished(&self) {
        let before = self.unfinished();
        if before.is_empty() {
            return;
        }
        std::thread::sleep(UNFINISHED_FOR);
        for (path, inode) in self.unfinished() {
            if before.contains(&(path.clone(), inode)) && !all_makers_live(&path) {
                let removed = fs::remove_file(&path);
                tracing::warn!(path = %path.display(), ?removed, "a segment that was never finished");
            }
        }
    }

    /// Removes all of the cell but its locks; to be called only while nobody lives. Returns how many files went.
    pub(crate) fn remove_leftovers(&self) -> Result<usize, CellError> {
        let segments = self.remove_segments();
        let files = self.remove_files()?;
        Ok(segments? + files)
    }

    /// Removes the cell's segments, and folders that an owner was about to remove when it was killed. What is another user's stays,
    /// and is named once all else has gone.
    pub(crate) fn remove_segments(&self) -> Result<usize, CellError> {
        let mut removed = 0;
        let mut foreign = None;
        let prefix = self.segment_prefix();
        // A folder that an owner was about to remove when it was killed.
        let left_folder = format!("quadrant-{}.", self.name);
        let entries = fs::read_dir(SHARED_MEMORY).map_err(|e| self.error("listing /dev/shm", e))?;
        for entry in entries.flatten() {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let is_segment = name.starts_with(&prefix);
            if !is_segment && !name.starts_with(&left_folder) {
                continue;
            }
            let path = entry.path();
            if let Some(user) = entry.metadata().ok().and_then(|found| others(&found)) {
                foreign.get_or_insert(self.foreign(&path, user));
                continue;
            }
            let result = if is_segment {
                fs::remove_file(&path)
            } else {
                fs::remove_dir_all(&path)
            };
            result
                .or_else(gone)
                .map_err(|e| self.error(&format!("removing {}", path.display()), e))?;
            removed += 1;
        }
        foreign.map_or(Ok(removed), Err)
    }

    /// Removes what is in the cell's folder, but its locks.
    fn remove_files(&self) -> Result<usize, CellError> {
        let mut removed = 0;
        let folder =
            fs::read_dir(self.folder()).map_err(|e| self.error("listing its folder", e))?;
        for entry in folder.flatten() {
            let name = entry.file_name();
            if name == OWNER_LOCK || name == MEMBERS_LOCK {
                continue;
            }
            let path = entry.path();
            let result = if path.is_dir() {
                remove_folder(&path)
            } else {
                fs::remove_file(&path)
            };
            result
                .or_else(gone)
                .map_err(|e| self.error("removing a leftover", e))?;
            removed += 1;
        }
        Ok(removed)
    }
}

/// What is gone already need not be removed.
fn gone(error: io::Error) -> io::Result<()> {
    match error.kind() {
        io::ErrorKind::NotFound => Ok(()),
        _ => Err(error),
    }
}

/// Whose it is, if it is another user's.
fn others(found: &fs::Metadata) -> Option<String> {
    let user = found.uid();
    (user != rustix::process::geteuid().as_raw()).then(|| format!("belongs to user {user}"))
}

/// Why it is no segment of ours, if so.
fn foreign(found: &fs::Metadata) -> Option<String> {
    if found.is_file() {
        others(found)
    } else {
        Some("is not a plain file".into())
    }
}

/// Removes a folder into which somebody who does not know yet that its cell has gone may still be writing.
fn remove_folder(path: &Path) -> io::Result<()> {
    for _ in 0..REMOVALS_MAX {
        match fs::remove_dir_all(path) {
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {
                std::thread::sleep(Duration::from_millis(1));
            }
            done => return done,
        }
    }
    fs::remove_dir_all(path)
}

/// A member's hold on its cell.
#[derive(Debug)]
pub struct Membership {
    _file: File,
}
