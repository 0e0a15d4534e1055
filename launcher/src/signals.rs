//! Ctrl-C and SIGTERM, as a count that the supervising loop reads and a descriptor that wakes it.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::event::{EventfdFlags, eventfd};

/// Interruptions so far.
#[derive(Debug)]
pub struct Signals {
    count: Arc<AtomicU32>,
    wake: Arc<OwnedFd>,
}

impl Signals {
    /// Catches SIGINT, SIGTERM and SIGHUP from now on.
    pub fn catch() -> anyhow::Result<Signals> {
        let count = Arc::new(AtomicU32::new(0));
        let wake = Arc::new(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?);
        let (counted, woken) = (Arc::clone(&count), Arc::clone(&wake));
        ctrlc::set_handler(move || {
            counted.fetch_add(1, Ordering::Release);
            let _ = rustix::io::write(&*woken, &1u64.to_ne_bytes());
        })?;
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
