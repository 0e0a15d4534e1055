//! Ctrl-C and SIGTERM, as a count that the supervising loop reads and a descriptor that wakes it.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context;
use rustix::event::{EventfdFlags, eventfd};

/// Interruptions so far.
#[derive(Debug, Clone)]
pub struct Signals {
    count: Arc<AtomicU32>,
    wake: Arc<OwnedFd>,
}

/// A process catches signals once; whoever asks again gets the same count.
static CAUGHT: Mutex<Option<Signals>> = Mutex::new(None);

impl Signals {
    /// Catches SIGINT, SIGTERM and SIGHUP from now on. Whoever starts it with SIGHUP ignored (`nohup`) wants it to outlive his
    /// terminal: that stays so. Where several runs follow one another, an interruption of one also keeps the next from starting.
    ///
    /// # Errors
    /// The system does not let it.
    pub fn catch() -> anyhow::Result<Signals> {
        let mut caught = CAUGHT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(signals) = &*caught {
            return Ok(signals.clone());
        }
        let signals = Self::catch_first()?;
        *caught = Some(signals.clone());
        Ok(signals)
    }

    fn catch_first() -> anyhow::Result<Signals> {
        let count = Arc::new(AtomicU32::new(0));
        let wake = Arc::new(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?);
        let (counted, woken) = (Arc::clone(&count), Arc::clone(&wake));
        let ignored = Ignored::look();
        ctrlc::set_handler(move || {
            counted.fetch_add(1, Ordering::Release);
            let _ = rustix::io::write(&*woken, &1u64.to_ne_bytes());
        })
        .map_err(|error| match error {
            ctrlc::Error::System(error) => anyhow::Error::from(error),
            error => error.into(),
        })
        .context("catching signals")?;
        ignored.keep();
        Ok(Signals { count, wake })
    }

    /// How many came.
    pub fn count(&self) -> u32 {
        let mut buffer = [0; 8];
        let _ = rustix::io::read(&*self.wake, &mut buffer);
        self.count.load(Ordering::Acquire)
    }

    /// Readable once one has come.
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.wake.as_fd()
    }
}

/// Where a file may not be larger, writing to it fails and says so; it does not end the process, nor one that this one starts.
pub fn survive_file_size_limit() {
    // SAFETY: a plain system call; ignoring a signal runs no code.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}

/// Whether SIGHUP was ignored when the program was started.
struct Ignored(bool);

impl Ignored {
    fn look() -> Ignored {
        // SAFETY: only reads the disposition of a signal, into a variable that lives over the call.
        let handler = unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            libc::sigaction(libc::SIGHUP, std::ptr::null(), &raw mut action);
            action.sa_sigaction
        };
        Ignored(handler == libc::SIG_IGN)
    }

    fn keep(&self) {
        if self.0 {
            // SAFETY: a plain system call; ignoring a signal runs no code.
            unsafe { libc::signal(libc::SIGHUP, libc::SIG_IGN) };
        }
    }
}
