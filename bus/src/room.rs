//! Room in shared memory: what a cell needs, what is free, what was refused.
//!
//! A segment has its memory from the moment it has its size, or is refused: `bus/iceoryx2-platform`.

use std::os::fd::{AsRawFd, BorrowedFd};

use iceoryx2_pal_posix::posix;
use rustix::io::Errno;

use crate::error::{CellError, SHARED_MEMORY};

/// What is left is too little for any segment: one page each for a few files.
const NOTHING_LEFT: u64 = 64 << 10;

/// Gives a file its size; in shared memory with all the memory that this takes.
pub(crate) fn resize(file: BorrowedFd<'_>, length: u64) -> Result<(), Errno> {
    // SAFETY: a descriptor that is open for as long as it is borrowed.
    match unsafe { posix::ftruncate(file.as_raw_fd(), length as posix::off_t) } {
        0 => Ok(()),
        _ => Err(Errno::from_io_error(&std::io::Error::last_os_error()).unwrap_or(Errno::IO)),
    }
}

/// Forgets what was refused to this thread.
pub(crate) fn forget_refused() {
    // Not found: cargo was run outside the repository and has not read its `.cargo/config.toml`.
    posix::REFUSED_BYTES.set(0);
}

/// The error for what was refused to this thread of late.
pub(crate) fn shortage_of_thread(cell: &str) -> Option<CellError> {
    match posix::REFUSED_BYTES.get() {
        0 => None,
        _ => shortage(cell),
    }
}

/// The same, or for shared memory that is full.
pub(crate) fn shortage(cell: &str) -> Option<CellError> {
    let refused = posix::REFUSED_BYTES.take();
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
pub(crate) fn room() -> Option<(u64, u64)> {
    let found = rustix::fs::statvfs(SHARED_MEMORY).ok()?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
    (found.f_blocks > 0).then(|| (bytes(found.f_bavail), bytes(found.f_blocks)))
}

pub(crate) fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_descriptor_that_is_none_is_refused_as_by_the_c_library() {
        // SAFETY: plain system calls.
        let refused = unsafe {
            [
                libc::ftruncate(-1, 5),
                iceoryx2_pal_posix::posix::ftruncate(-1, 5),
            ]
        };
        assert_eq!(refused, [-1, -1]);
        let error = std::io::Error::last_os_error();
        assert_eq!(error.raw_os_error(), Some(libc::EBADF));
    }
}
