//! The launcher's hold on its cell: what it made there, whether that is still there, and what it takes away at the end.

use std::fs::{self, DirEntry, File, OpenOptions};
use std::os::fd::AsFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};

use crate::name::Name;
use crate::paths::{CellPaths, MEMBERS_LOCK, OWNER_LOCK, SHARED_MEMORY};
use crate::room;

const SPARE_FILE: &str = "spare";
/// How the name of a folder ends that its owner is removing.
pub(crate) const GONE: &str = ".gone";
pub(crate) const SPARE_BYTES: u64 = 128 << 10;

/// The launcher's hold on its cell. Dropping it removes the cell's files if nobody of it lives any more.
#[derive(Debug)]
pub struct Ownership {
    place: CellPaths,
    /// The owner's and the members'; let go of when nobody can find them any more.
    locks: Option<[File; 2]>,
    /// Files of a crashed run that were removed.
    pub leftovers: usize,
    /// Files that are there as long as the cell runs, with their inodes.
    made: Vec<(PathBuf, u64)>,
    /// Room that is kept for whoever takes the place of a dead process.
    spare: Option<File>,
    /// Goes last: until then nobody else has the cell.
    _name: Name,
}

impl Ownership {
    pub(crate) fn new(
        place: &CellPaths,
        locks: [File; 2],
        name: Name,
        leftovers: usize,
    ) -> Ownership {
        Ownership {
            place: place.clone(),
            locks: Some(locks),
            leftovers,
            made: Vec::new(),
            spare: None,
            _name: name,
        }
    }

    /// The cell's place.
    pub fn place(&self) -> &CellPaths {
        &self.place
    }

    /// Keeps room for whoever takes the place of a dead process: it needs a little more than the dead one leaves, while what that
    /// one has told is still being read. A shortage is no error: then there is none to keep.
    pub fn keep_spare_room(&mut self) {
        let file = self.spare.take().or_else(|| {
            let mut options = OpenOptions::new();
            let options = options.write(true).create_new(true).mode(0o600);
            options.open(self.place.folder().join(SPARE_FILE)).ok()
        });
        self.spare = file.inspect(|file| {
            let _ = room::resize(file.as_fd(), SPARE_BYTES);
            room::forget_refused();
        });
    }

    /// Gives that room away.
    pub fn give_spare_room(&self) {
        if let Some(file) = &self.spare {
            let _ = room::resize(file.as_fd(), 0);
        }
    }

    /// Notes the cell's folder, locks, page and services: all of it stays as long as the cell runs. What clients have there comes
    /// and goes with them.
    pub fn note_made(&mut self) {
        let place = &self.place;
        let prefix = place.segment_prefix();
        let is_service = |entry: &DirEntry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            name.starts_with(&prefix) && (name.ends_with(".dynamic") || name.ends_with(".service"))
        };
        let services = [SHARED_MEMORY.into(), place.folder().join("iox/services")];
        let services = services
            .into_iter()
            .flat_map(|folder: PathBuf| fs::read_dir(folder).into_iter().flatten().flatten())
            .filter(is_service)
            .map(|entry| entry.path());
        let folder = place.folder();
        let files = [OWNER_LOCK, MEMBERS_LOCK].map(|name| folder.join(name));
        let mut paths = vec![
            folder,
            place.page(),
            place.drive_page(),
            place.machine_file(),
        ];
        paths.extend(files);
        paths.extend(services);
        let noted = paths.into_iter();
        self.made = noted
            .filter_map(|path| Some((inode(&path)?, path)))
            .map(|(inode, path)| (path, inode))
            .collect();
    }

    /// One of the noted files that somebody has removed or replaced, if so.
    pub fn removed(&self) -> Option<&Path> {
        let is_gone = |(path, number): &&(PathBuf, u64)| inode(path) != Some(*number);
        self.made
            .iter()
            .find(is_gone)
            .map(|(path, _)| path.as_path())
    }

    /// Whether the cell's folder is still the one that this launcher has locked.
    fn folder_is_ours(&self) -> bool {
        let mut locks = self.locks.iter().flatten().zip([OWNER_LOCK, MEMBERS_LOCK]);
        locks.all(|(file, name)| self.place.is_in_place(file, name).unwrap_or(false))
    }
}

fn inode(path: &Path) -> Option<u64> {
    Some(fs::symlink_metadata(path).ok()?.ino())
}

impl Drop for Ownership {
    fn drop(&mut self) {
        let cell = self.place.name();
        let members = self.locks.iter().flatten().last();
        let lock = FlockOperation::NonBlockingLockExclusive;
        if members.is_some_and(|members| flock(members, lock).is_err()) {
            tracing::warn!(
                cell,
                "members still live: their files stay until the next start"
            );
            return;
        }
        if !self.folder_is_ours() {
            tracing::warn!(
                cell,
                "the cell's folder was removed: what is there now stays"
            );
            let _ = self.place.remove_segments();
            return;
        }
        if let Err(error) = self.place.remove_leftovers() {
            tracing::warn!(%error, "the cell's files could not all be removed");
        }
        // The folder goes at once, by its name, while both locks are held: whoever comes next finds none and makes a new one.
        let folder = self.place.folder();
        let gone = folder.with_extension(format!("{}{GONE}", std::process::id()));
        let renamed = fs::rename(&folder, &gone);
        // Removing takes as many descriptors as folders are in each other: where none was left, these are.
        (self.locks, self.spare) = (None, None);
        let _ = renamed.and_then(|()| fs::remove_dir_all(&gone));
    }
}
