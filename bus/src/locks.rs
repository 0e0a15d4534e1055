//! Locks on files: who holds one, and one that nobody can take who may only read the file.

use std::fs::{self, File};
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::MetadataExt;

use rustix::fs::{major, minor};

/// The most that are named.
const NAMED_MAX: usize = 4;

/// A process with the name of its program, such as `708 (quadrant)`.
pub fn named(pid: &str) -> String {
    let name = fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    match name.trim_end() {
        "" => pid.to_owned(),
        name => format!("{pid} ({name})"),
    }
}

/// Who holds a lock on a file, such as `process 708 (quadrant)`, for people; empty where the system does not tell (proc_locks(5)).
pub fn holders(file: &File) -> String {
    let Ok(found) = file.metadata() else {
        return String::new();
    };
    let (major, minor) = (major(found.dev()), minor(found.dev()));
    let place = format!(" {major:02x}:{minor:02x}:{} ", found.ino());
    let locks = fs::read_to_string("/proc/locks").unwrap_or_default();
    // Behind an arrow stands who waits.
    let held = locks.lines().filter(|line| !line.contains("->"));
    let held = held.filter(|line| line.contains(&place));
    let pids = held.filter_map(|line| line.split_whitespace().nth(4));
    let known = pids.filter(|pid| pid.parse::<u32>().is_ok_and(|pid| pid > 0));
    let names = known.map(|pid| format!("process {}", named(pid)));
    names.take(NAMED_MAX).collect::<Vec<_>>().join(", ")
}

/// A lock of the whole file that goes with its description (F_OFD_SETLK, fcntl_locking(2)).
fn lock(file: &File, command: libc::c_int, kind: libc::c_int) -> io::Result<libc::c_int> {
    // SAFETY: plain numbers, of which zero is one.
    let mut lock: libc::flock = unsafe { std::mem::zeroed() };
    lock.l_type = kind as libc::c_short;
    // SAFETY: the lock lives over the call.
    match unsafe { libc::fcntl(file.as_raw_fd(), command, &raw mut lock) } {
        0 => Ok(lock.l_type.into()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Notes that a file is being written, for as long as it is open. A process that may only read it cannot note that, as it could with flock(2).
///
/// # Errors
/// Somebody else has, or the file system has no locks.
pub fn hold(file: &File) -> io::Result<()> {
    lock(file, libc::F_OFD_SETLK, libc::F_WRLCK).map(|_| ())
}

/// Whether somebody has noted that he writes it.
pub fn is_held(file: &File) -> bool {
    lock(file, libc::F_OFD_GETLK, libc::F_RDLCK).is_ok_and(|found| found == libc::F_WRLCK)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_held_by_its_writer_alone_and_the_holder_of_a_lock_is_named() {
        let path = std::env::temp_dir().join(format!("quadrant-locks-{}", std::process::id()));
        let writer = File::create(&path).expect("a file");
        let reader = File::open(&path).expect("the file");
        reader.lock().expect("a lock");
        let name = fs::read_to_string("/proc/self/comm").expect("a name");
        let this = format!("process {} ({})", std::process::id(), name.trim_end());
        assert_eq!(holders(&writer), this);
        assert!(!is_held(&reader), "that is not its writer's");
        assert!(hold(&reader).is_err(), "who may only read it");
        hold(&writer).expect("its writer");
        assert!(is_held(&reader));
        drop(writer);
        assert!(!is_held(&reader));
        drop(reader);
        assert_eq!(holders(&File::open(&path).expect("the file")), "");
        let _ = fs::remove_file(&path);
    }
}
