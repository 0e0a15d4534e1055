//! A cell's place on this PC: its name, its folder in shared memory, its locks, and how it is cleaned.
//!
//! Everything a cell owns lies in `/dev/shm/quadrant-<cell>/` and in segments `/dev/shm/qd-<cell>_*`. Cell names have no
//! underscore, so no cell's prefix is the beginning of another's: two cells never meet. Two locks say who lives: the
//! launcher holds `owner.lock` exclusively, every member holds `members.lock` shared. The kernel lets go of both when
//! the holder dies, however it dies. Locks are files, which anybody of this user can remove: the launcher also holds the
//! cell's name as a socket's address, which nobody can take from it.

use std::fs::{self, DirBuilder, File};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, Path as IoxPath, SemanticString};
use rustix::fs::{FlockOperation, flock};

pub use crate::error::{CELL_NAME_LENGTH_MAX, CellError};
use crate::files::{open_own, open_to_read, open_unlinked};
use crate::locks::{holders, named};
use crate::name::{Holder, Name, Taken};
use crate::ownership::GONE;
pub use crate::ownership::Ownership;
pub use crate::paths::{CellPaths, if_there, is_cell_name};
use crate::paths::{MEMBERS_LOCK, OWNER_LOCK, SHARED_MEMORY};
use crate::process::watch;

/// A segment without a size for so long is of a process that was killed over it.
const UNFINISHED_FOR: Duration = Duration::from_millis(5);
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

/// Attempts to remove a folder that somebody writes into meanwhile.
const REMOVALS_MAX: u32 = 20;
/// So long a child that is being started may hold the lock of a launcher that is dead.
const HALF_STARTED: Duration = Duration::from_millis(500);
/// So long somebody may have a cell's name who only removes what is left of it.
const CLEANING: Duration = Duration::from_millis(200);
const CLEANING_LOOK: Duration = Duration::from_millis(5);
const MEMBERS_LOOK: Duration = Duration::from_millis(20);

impl CellPaths {
    fn error(&self, what: &str, source: io::Error) -> CellError {
        CellError::System {
            cell: self.name().to_owned(),
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
            cell: self.name().to_owned(),
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
            self.name(),
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
            let owned = Ownership::new(self, [owner, members], name, removed);
            // What cannot be had is not kept: the folder of a cell that is refused goes again.
            return leftovers.map(|_| owned);
        }
    }

    /// The cell's name, which nobody else on this PC can hold in the same shared memory.
    fn take_name(&self) -> Result<Name, CellError> {
        let memory =
            fs::metadata(SHARED_MEMORY).map_err(|e| self.error("looking at /dev/shm", e))?;
        let user = rustix::process::geteuid().as_raw();
        let name = format!("quadrant/{user}/{}/{}", memory.dev(), self.name());
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
                    let named = |holder: Holder| named(&holder.pid.to_string());
                    let by = holder.map(|holder| format!(" under launcher pid {}", named(holder)));
                    return Err(CellError::Running {
                        cell: self.name().to_owned(),
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
                cell: self.name().to_owned(),
                by: match holders(&file).as_str() {
                    "" if pid.is_empty() => String::new(),
                    "" => format!(" under launcher pid {}", named(&pid)),
                    holders => format!(" under {holders}"),
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
                    self.name()
                );
            }
            if started.elapsed() >= patience {
                return Err(CellError::MembersLive {
                    cell: self.name().to_owned(),
                    which: match holders(&file).as_str() {
                        "" => String::new(),
                        holders => format!(" ({holders})"),
                    },
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
        match open_own(&self.folder().join(name)) {
            Ok(file) => Ok(Some(file)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => {
                // What was made for it alone does not stay: the first lock where there is no second, and the folder.
                if name == MEMBERS_LOCK && !self.folder().join(name).exists() {
                    let _ = fs::remove_file(self.folder().join(OWNER_LOCK));
                }
                let _ = fs::remove_dir(self.folder());
                Err(self.error(&format!("opening {name}"), error))
            }
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
            cell: self.name().to_owned(),
            path: path.display().to_string(),
            found,
        }
    }

    /// Holds the members' lock as one of them, for as long as the result lives.
    ///
    /// # Errors
    /// [`CellError::System`] if the cell does not exist.
    pub fn join(&self) -> Result<Membership, CellError> {
        let file = open_to_read(&self.folder().join(MEMBERS_LOCK))
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
            let file = open_unlinked(&path, File::options().read(true))
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

    /// Removes the cell's segments, and folders that owners were about to remove when they were killed. What is another user's stays,
    /// and is named once all else has gone.
    pub(crate) fn remove_segments(&self) -> Result<usize, CellError> {
        let mut removed = 0;
        let mut foreign = None;
        let prefix = self.segment_prefix();
        let entries = fs::read_dir(SHARED_MEMORY).map_err(|e| self.error("listing /dev/shm", e))?;
        for entry in entries.flatten() {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let is_segment = name.starts_with(&prefix);
            // A folder that an owner of any cell was about to remove: were it killed over that, nobody else would.
            let is_left = name.starts_with("quadrant-") && name.ends_with(GONE);
            if !is_segment && !is_left {
                continue;
            }
            let path = entry.path();
            if let Some(user) = entry.metadata().ok().and_then(|found| others(&found)) {
                if is_segment {
                    foreign.get_or_insert(self.foreign(&path, user));
                }
                continue;
            }
            if !is_segment {
                let _ = fs::remove_dir_all(&path);
                continue;
            }
            fs::remove_file(&path)
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
