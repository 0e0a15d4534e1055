//! Connections, so many at a time: where another one comes the oldest goes.
//!
//! One that is silent, sends a byte a second or takes nothing keeps no other waiting, however many there are. One that has shown what
//! it may stays: what it takes then bounds those.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::task::AbortHandle;

/// Connections that may go.
#[derive(Clone)]
pub struct Guests {
    most: usize,
    came: Arc<AtomicU64>,
    /// By the order in which they came.
    waiting: Arc<Mutex<BTreeMap<u64, AbortHandle>>>,
}

/// One of them.
#[derive(Clone)]
pub struct Guest {
    number: u64,
    guests: Guests,
}

impl Guests {
    /// So many at a time.
    pub fn at_most(most: usize) -> Guests {
        Guests {
            most,
            came: Arc::default(),
            waiting: Arc::default(),
        }
    }

    /// Serves a connection that has come, in a task of its own.
    pub fn serve<F>(&self, connection: impl FnOnce(Guest) -> F)
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let number = self.came.fetch_add(1, Ordering::Relaxed);
        let guest = Guest {
            number,
            guests: self.clone(),
        };
        // A task that ends at once is noted before.
        let mut waiting = self.waiting();
        let served = connection(guest.clone());
        let task = tokio::spawn(async move {
            served.await;
            guest.stays();
        });
        if waiting.len() >= self.most
            && let Some((_, oldest)) = waiting.pop_first()
        {
            oldest.abort();
        }
        waiting.insert(number, task.abort_handle());
    }

    fn waiting(&self) -> MutexGuard<'_, BTreeMap<u64, AbortHandle>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Guest {
    /// It stays, whoever comes.
    pub fn stays(&self) {
        self.guests.waiting().remove(&self.number);
    }
}
