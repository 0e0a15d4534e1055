//! Connections, so many at a time: where another one comes the oldest goes of the address that has the most.
//!
//! One that is silent, sends a byte a second or takes nothing keeps no other waiting, however many there are. One that has shown what
//! it may stays: what it takes then bounds those. However many come from one address, those of another keep their places.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::net::{IpAddr, TcpListener};
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
            let Ok((stream, from)) = listener.accept().await else {
                tokio::time::sleep(PAUSE).await;
                continue;
            };
            guests.serve(from.ip(), |guest| connection(stream, guest));
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
    waiting: Arc<Mutex<BTreeMap<u64, (IpAddr, AbortHandle)>>>,
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

    /// Serves a connection that has come from an address, in a task of its own.
    fn serve<F>(&self, from: IpAddr, connection: impl FnOnce(Guest) -> F)
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
        waiting.insert(number, (from, task.abort_handle()));
        if waiting.len() > self.most
            && let Some((_, oldest)) = goes(&waiting).and_then(|goes| waiting.remove(&goes))
        {
            oldest.abort();
        }
    }

    fn waiting(&self) -> MutexGuard<'_, BTreeMap<u64, (IpAddr, AbortHandle)>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The oldest of the address that has the most; of several, of the one whose oldest has been there longest.
fn goes<T>(waiting: &BTreeMap<u64, (IpAddr, T)>) -> Option<u64> {
    let mut of_address = BTreeMap::new();
    for (number, (from, _)) in waiting {
        of_address.entry(from).or_insert((*number, 0)).1 += 1;
    }
    let most = of_address.into_values();
    let most = most.max_by_key(|(oldest, count)| (*count, Reverse(*oldest)));
    most.map(|(oldest, _)| oldest)
}

impl Guest {
    /// It stays, whoever comes.
    pub fn stays(&self) {
        self.guests.waiting().remove(&self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_with_most_connections_makes_room() {
        let one = IpAddr::from([10, 0, 0, 1]);
        let many = IpAddr::from([10, 0, 0, 2]);
        let of = |from: &[IpAddr]| {
            let each = from.iter().zip(1..);
            goes(&each.map(|(from, number)| (number, (*from, ()))).collect())
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[one]), Some(1));
        assert_eq!(of(&[one, many, many]), Some(2));
        assert_eq!(of(&[one, many, many, one, many]), Some(2));
        assert_eq!(of(&[one, many]), Some(1));
        assert_eq!(of(&[many, one, one]), Some(2));
    }
}
