//! Connections, so many at a time: where another one comes the oldest goes.
//!
//! One that is silent, sends a byte a second or takes nothing keeps no other waiting, however many there are. One that has shown what
//! it may stays: what it takes then bounds those.

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::net::TcpStream;
use tokio::task::AbortHandle;

/// Wait after an accept that failed, as when no descriptor is left.
const PAUSE: Duration = Duration::from_millis(100);

/// Serves at `listener` in a thread of this name, as long as the process lives: so many guests at a time, each in a task of its own.
///
/// # Errors
/// The thread cannot be started.
pub fn serve<F>(
    listener: TcpListener,
    thread: &str,
    most: usize,
    connection: impl Fn(TcpStream, Guest) -> F + Send + 'static,
) -> std::io::Result<()>
where
    F: Future<Output = ()> + Send + 'static,
{
    listener.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let listener = {
        let _inside = runtime.enter();
        tokio::net::TcpListener::from_std(listener)?
    };
    let accept = async move {
        let guests = Guests::at_most(most);
        loop {
            let Ok((stream, _)) = listener.accept().await else {
                tokio::time::sleep(PAUSE).await;
                continue;
            };
            guests.serve(|guest| connection(stream, guest));
            // What it has sent already is read before the next one comes.
            tokio::task::yield_now().await;
        }
    };
    let thread = std::thread::Builder::new().name(thread.into());
    thread.spawn(move || runtime.block_on(accept))?;
    Ok(())
}

/// Connections that may go.
#[derive(Clone)]
struct Guests {
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
    fn at_most(most: usize) -> Guests {
        Guests {
            most,
            came: Arc::default(),
            waiting: Arc::default(),
        }
    }

    /// Serves a connection that has come, in a task of its own.
    fn serve<F>(&self, connection: impl FnOnce(Guest) -> F)
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
