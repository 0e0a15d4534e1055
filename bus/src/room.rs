//! Room in shared memory: a segment has its memory from the moment it has its size.
//!
//! A file in `/dev/shm` takes memory page by page, when a page is touched first. Where there is none left, whoever touches the
//! page is killed by SIGBUS, in mid-motion if need be. iceoryx2 0.10 gives a segment its size with `ftruncate` and touches it
//! later. So the C library's `ftruncate` is replaced here for the whole program: what grows in shared memory takes all its
//! memory at once (`fallocate`), or is refused with an error.

use std::cell::Cell;
use std::ffi::{c_int, c_long};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};

use rustix::fs::{FallocateFlags, fallocate, fstat, fstatfs, ftruncate as plain_ftruncate};
use rustix::io::{Errno, retry_on_intr};

use crate::cell::{CellError, CellPaths, SHARED_MEMORY};
use crate::service::Services;

/// What is left is too little for any segment: one page each for a few files.
const NOTHING_LEFT: u64 = 64 << 10;

thread_local! {
    /// Size of the last segment that was refused to this thread, 0 for none.
    static REFUSED: Cell<u64> = const { Cell::new(0) };
}

/// In place of the C library's: a file that grows in shared memory has its memory from then on.
#[unsafe(no_mangle)]
extern "C" fn ftruncate(file: c_int, length: libc::off_t) -> c_int {
    if file < 0 {
        // SAFETY: the address of this thread's own variable.
        unsafe { *libc::__errno_location() = libc::EBADF };
        return -1;
    }
    // SAFETY: a descriptor of the caller's; one that is not open is refused by the system calls that it is given to.
    let file = unsafe { BorrowedFd::borrow_raw(file) };
    let resized = u64::try_from(length)
        .map_err(|_| Errno::INVAL)
        .and_then(|length| {
            let is_new = fstat(file)?.st_size == 0;
            resize(file, length).inspect_err(|_| {
                if is_new {
                    remove(file);
                }
            })
        });
    match resized {
        Ok(()) => 0,
        Err(error) => {
            // SAFETY: the address of this thread's own variable.
            unsafe { *libc::__errno_location() = error.raw_os_error() };
            -1
        }
    }
}

/// The same by its other name.
#[unsafe(no_mangle)]
extern "C" fn ftruncate64(file: c_int, length: libc::off64_t) -> c_int {
    ftruncate(file, length)
}

/// Makes this program's linker take `ftruncate` from here.
pub(crate) fn is_in_force() {
    std::hint::black_box(ftruncate as extern "C" fn(c_int, libc::off_t) -> c_int);
    std::hint::black_box(ftruncate64 as extern "C" fn(c_int, libc::off64_t) -> c_int);
}

/// Gives a file its size; in shared memory with all the memory that this takes.
pub(crate) fn resize(file: BorrowedFd<'_>, length: u64) -> rustix::io::Result<()> {
    let before = fstat(file)?.st_size as u64;
    let in_memory = fstatfs(file)?.f_type as c_long == libc::TMPFS_MAGIC as c_long;
    if length <= before || !in_memory {
        return plain_ftruncate(file, length);
    }
    let taken = retry_on_intr(|| fallocate(file, FallocateFlags::empty(), 0, length));
    if taken.is_err() {
        REFUSED.set(length);
    }
    taken
}

/// Removes a new segment by its name: whoever opened it would wait for its size without end (iceoryx2 0.10).
fn remove(file: BorrowedFd<'_>) {
    let link = format!("/proc/self/fd/{}", file.as_fd().as_raw_fd());
    let (Ok(name), Ok(own)) = (std::fs::read_link(link), fstat(file)) else {
        return;
    };
    let is_it = rustix::fs::lstat(&name)
        .is_ok_and(|found| (found.st_dev, found.st_ino) == (own.st_dev, own.st_ino));
    if is_it {
        let _ = std::fs::remove_file(name);
    }
}

/// Forgets what was refused to this thread.
pub(crate) fn forget_refused() {
    REFUSED.set(0);
}

/// The error for what was refused to this thread of late.
pub(crate) fn shortage_of_thread(cell: &str) -> Option<CellError> {
    match REFUSED.get() {
        0 => None,
        _ => shortage(cell),
    }
}

/// The same, or for shared memory that is full.
pub(crate) fn shortage(cell: &str) -> Option<CellError> {
    let refused = REFUSED.take();
    let (free, total) = room()?;
    let needed = match refused {
        0 if free >= NOTHING_LEFT => return None,
        bytes => bytes.max(NOTHING_LEFT),
    };
    Some(CellError::NoRoom {
        cell: cell.into(),
        needed: megabytes(needed),
        free: megabytes(free),
        total: megabytes(total),
    })
}

/// Bytes that are free in shared memory, and bytes in all; none where that is not limited.
fn room() -> Option<(u64, u64)> {
    let found = rustix::fs::statvfs(SHARED_MEMORY).ok()?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
    (found.f_blocks > 0).then(|| (bytes(found.f_bavail), bytes(found.f_blocks)))
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

/// Checks that there is room for a whole cell with these services.
///
/// # Errors
/// [`CellError::NoRoom`].
pub fn check(place: &CellPaths, services: &Services) -> Result<(), CellError> {
    let needed = services.room_bytes();
    match room() {
        Some((free, total)) if free < needed => Err(CellError::NoRoom {
            cell: place.name().into(),
            needed: megabytes(needed),
            free: megabytes(free),
            total: megabytes(total),
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_descriptor_that_is_none_is_refused_as_by_the_c_library() {
        // SAFETY: plain system calls.
        let refused = unsafe { [libc::ftruncate(-1, 5), libc::ftruncate64(-1, 5)] };
        assert_eq!(refused, [-1, -1]);
        let error = std::io::Error::last_os_error();
        assert_eq!(error.raw_os_error(), Some(libc::EBADF));
    }
}
