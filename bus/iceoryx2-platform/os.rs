// What iceoryx2 asks of the operating system (`iceoryx2-pal-posix` 0.10 includes this file: `.cargo/config.toml`): Linux as it comes
// with it, except that a file in shared memory has its memory from the moment it has its size.
//
// A file in `/dev/shm` takes memory page by page, when a page is touched first, and a process that touches one where none is left
// is killed by SIGBUS, in mid-motion if need be. iceoryx2 gives a segment its size with `ftruncate` and touches it later.

pub mod linux {
    include!(concat!(env!("CARGO_MANIFEST_DIR"), "/src/linux/os.rs"));
}

pub mod posix {
    extern crate std;

    pub use super::linux::posix::*;

    std::thread_local! {
        /// Bytes of the last segment that this thread was refused, 0 for none.
        pub static REFUSED_BYTES: core::cell::Cell<u64> = const { core::cell::Cell::new(0) };
    }

    /// Gives a file its size; in shared memory with all the memory that this takes (`fallocate`).
    pub unsafe fn ftruncate(fd: int, length: off_t) -> int {
        // SAFETY: plain structures of integers, filled by the calls below before they are read.
        let (mut file, mut system) = unsafe { core::mem::zeroed::<(libc::stat, libc::statfs)>() };
        // SAFETY: the calls judge the descriptor themselves; the structures outlive them.
        if unsafe { libc::fstat(fd, &mut file) } != 0
            || unsafe { libc::fstatfs(fd, &mut system) } != 0
        {
            return -1;
        }
        if length <= file.st_size || system.f_type != libc::TMPFS_MAGIC {
            // SAFETY: as above.
            return unsafe { libc::ftruncate(fd, length) };
        }
        loop {
            // SAFETY: as above.
            if unsafe { libc::fallocate(fd, 0, 0, length) } == 0 {
                return 0;
            }
            // SAFETY: the address of this thread's own variable.
            let error = unsafe { *libc::__errno_location() };
            if error != libc::EINTR {
                REFUSED_BYTES.set(length as u64);
                if file.st_size == 0 {
                    remove_new(fd, &file);
                }
                // SAFETY: as above.
                unsafe { *libc::__errno_location() = error };
                return -1;
            }
        }
    }

    /// Removes a new segment by its name: a process that opened it would wait for its size without end (iceoryx2 0.10).
    fn remove_new(fd: int, opened: &libc::stat) {
        use std::os::unix::fs::MetadataExt;
        let Ok(name) = std::fs::read_link(std::format!("/proc/self/fd/{fd}")) else {
            return;
        };
        let is_it = std::fs::symlink_metadata(&name)
            .is_ok_and(|found| (found.dev(), found.ino()) == (opened.st_dev, opened.st_ino));
        if is_it {
            let _ = std::fs::remove_file(name);
        }
    }
}
