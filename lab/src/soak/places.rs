//! A small `/dev/shm` and a small disk of the soak's own, which it can fill without anybody else's losing room.

use std::fs::{self, File};
use std::io;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rustix::fs::{FallocateFlags, fallocate};

/// Set in a soak that has a namespace of its own.
const MARK: &str = "QUADRANT_SOAK_NAMESPACE";
/// Becomes the soak once it has a small shared memory.
const ENTER: &str = "mount -t tmpfs -o size=64m,mode=1777 soak /dev/shm && exec \"$@\"";
/// Options of the small disk: the logs of a run with many recorders fit.
const DISK: &str = "size=512m,mode=700";
/// Sizes in which room is taken, in bytes, until not even the last one fits.
const TAKEN: [u64; 4] = [16 << 20, 1 << 20, 64 << 10, 4 << 10];

/// Starts this soak again in a mount namespace of its own; returns if it is in one already, or may not have one.
pub fn enter_namespace() {
    if std::env::var_os(MARK).is_some() || !may_mount() {
        return;
    }
    let error = Command::new("unshare")
        .args([
            "--mount",
            "--propagation",
            "private",
            "sh",
            "-c",
            ENTER,
            "sh",
        ])
        .arg(std::env::current_exe().unwrap_or_else(|_| "/proc/self/exe".into()))
        .args(std::env::args_os().skip(1))
        .env(MARK, "1")
        .exec();
    tracing::warn!(%error, "no namespace of its own");
}

fn may_mount() -> bool {
    let tried = Command::new("unshare")
        .args([
            "--mount",
            "--propagation",
            "private",
            "sh",
            "-c",
            ENTER,
            "sh",
        ])
        .arg("true")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    tried.is_ok_and(|status| status.success())
}

/// Places that may be filled.
#[derive(Debug)]
pub struct Places {
    /// The small disk.
    pub disk: PathBuf,
}

impl Places {
    /// Makes the small disk; none in a soak without a namespace of its own.
    pub fn make(scratch: &Path) -> Option<Places> {
        std::env::var_os(MARK)?;
        let disk = scratch.join("disk");
        fs::create_dir(&disk).ok()?;
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", DISK, "soak"]).arg(&disk);
        mount.status().ok()?.success().then_some(Places { disk })
    }

    /// Takes all room of the shared memory.
    pub fn fill_memory(&self) -> io::Result<Filler> {
        Filler::fill(Path::new("/dev/shm/filler"))
    }

    /// Takes all room of the disk.
    pub fn fill_disk(&self) -> io::Result<Filler> {
        Filler::fill(&self.disk.join("filler"))
    }
}

impl Drop for Places {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.disk).status();
    }
}

/// A file that takes all room; gives it back when it is dropped.
#[derive(Debug)]
pub struct Filler {
    path: PathBuf,
}

impl Filler {
    fn fill(path: &Path) -> io::Result<Filler> {
        let file = File::create(path)?;
        let filler = Filler { path: path.into() };
        let mut length = 0;
        for bytes in TAKEN {
            while fallocate(&file, FallocateFlags::empty(), length, bytes).is_ok() {
                length += bytes;
            }
        }
        Ok(filler)
    }
}

impl Drop for Filler {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}
