//! A lock in shared memory that is passed on at once when its holder dies.
//!
//! The kernel lets go of a robust mutex (`pthread_mutexattr_setrobust`, POSIX.1-2008) first of all when a thread exits, before it takes
//! the memory and the descriptors of the process: a pidfd tells of the death milliseconds later where a packet socket is to be closed.
//! It does so only where the lock is still mapped then: a holder that lives gives it back before it unmaps it.

use std::cell::UnsafeCell;
use std::io;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

unsafe extern "C" {
    /// Of the GNU C library, from 2.30 on: `pthread_mutex_timedlock` by a clock that nobody sets.
    fn pthread_mutex_clocklock(
        mutex: *mut libc::pthread_mutex_t,
        clock: libc::clockid_t,
        until: *const libc::timespec,
    ) -> libc::c_int;
}

/// The lock. Its holder gives it back, or dies.
#[repr(C, align(64))]
pub(crate) struct RobustLock(UnsafeCell<libc::pthread_mutex_t>);

// SAFETY: it is touched by the functions of the C library for shared mutexes alone.
unsafe impl Sync for RobustLock {}

/// Bits of a futex word that name the thread that holds it; the kernel clears them when that dies (robust futex ABI).
const HOLDER: u32 = 0x3FFF_FFFF;

fn checked(result: libc::c_int) -> io::Result<()> {
    match result {
        0 => Ok(()),
        error => Err(io::Error::from_raw_os_error(error)),
    }
}

impl RobustLock {
    /// Makes it in fresh memory that nobody else uses yet.
    pub fn make(&self) -> io::Result<()> {
        // SAFETY: attributes are initialised before they are used, and the memory is ours and large enough.
        unsafe {
            let mut attributes = std::mem::zeroed::<libc::pthread_mutexattr_t>();
            checked(libc::pthread_mutexattr_init(&raw mut attributes))?;
            checked(libc::pthread_mutexattr_setpshared(
                &raw mut attributes,
                libc::PTHREAD_PROCESS_SHARED,
            ))?;
            checked(libc::pthread_mutexattr_setrobust(
                &raw mut attributes,
                libc::PTHREAD_MUTEX_ROBUST,
            ))?;
            let made = checked(libc::pthread_mutex_init(
                self.0.get(),
                &raw const attributes,
            ));
            libc::pthread_mutexattr_destroy(&raw mut attributes);
            made
        }
    }

    /// Takes it for the calling thread, waiting at most so long; false if another holds it.
    pub fn take(&self, limit: Duration) -> io::Result<bool> {
        let mut until = libc::timespec {
            tv_sec: 0,
            tv_nsec: 0,
        };
        // SAFETY: the time lives over the call.
        unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut until) };
        let ns = until.tv_nsec + i64::from(limit.subsec_nanos());
        until.tv_sec += limit.as_secs() as i64 + ns / 1_000_000_000;
        until.tv_nsec = ns % 1_000_000_000;
        // SAFETY: the mutex was made before anybody could open the page.
        let taken = unsafe {
            pthread_mutex_clocklock(self.0.get(), libc::CLOCK_MONOTONIC, &raw const until)
        };
        match taken {
            0 => Ok(true),
            libc::ETIMEDOUT => Ok(false),
            libc::EOWNERDEAD => {
                // SAFETY: this thread holds it since the holder before died.
                checked(unsafe { libc::pthread_mutex_consistent(self.0.get()) })?;
                Ok(true)
            }
            error => Err(io::Error::from_raw_os_error(error)),
        }
    }

    /// Gives it back; for the thread that holds it.
    pub fn release(&self) {
        // SAFETY: the mutex was made; one that this thread does not hold is left as it is.
        unsafe { libc::pthread_mutex_unlock(self.0.get()) };
    }

    /// The thread that holds it; 0 if none that lives does.
    pub fn holder(&self) -> u32 {
        // SAFETY: a mutex begins with its futex word, aligned, and is changed atomically.
        let word = unsafe { AtomicU32::from_ptr(self.0.get().cast()) };
        word.load(Ordering::Acquire) & HOLDER
    }
}
