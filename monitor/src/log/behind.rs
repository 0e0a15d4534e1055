//! Writes a file in a thread of its own: a disk that stalls for seconds holds up nobody who has samples to receive.
//!
//! What waits is bounded: whoever is further ahead than that waits too. So does whoever begins or ends a file, until the disk has
//! what was written: a queue of samples must hold that long.

use std::fs::File;
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};

/// Bytes handed over at once at most.
const PIECE_BYTES: usize = 1 << 16;
/// Pieces that may wait: 64 MB, 24 s of eight axes at 1 ms.
const PIECES_AHEAD: usize = 1 << 10;

enum Order {
    Write(Vec<u8>),
    /// Say when everything before has been written.
    Answer(SyncSender<()>),
}

/// Why it cannot be written any more.
type Failure = Arc<OnceLock<(io::ErrorKind, String)>>;

fn failure_of(failure: &Failure) -> io::Error {
    match failure.get() {
        Some((kind, text)) => io::Error::new(*kind, text.clone()),
        None => io::Error::other("the thread that writes it has ended"),
    }
}

/// The end that is written to.
#[derive(Debug)]
pub(super) struct Behind {
    orders: SyncSender<Order>,
    failure: Failure,
}

/// Waits for what has been handed over; also when it is dropped, after whoever hands over.
#[derive(Debug)]
pub(super) struct Written {
    orders: SyncSender<Order>,
    failure: Failure,
}

/// Writes to `file` from now on.
///
/// # Errors
/// No thread can be started.
pub(super) fn write_behind(file: File) -> io::Result<(Behind, Written)> {
    let (orders, taken) = sync_channel(PIECES_AHEAD);
    let failure = Failure::default();
    let noted = Arc::clone(&failure);
    std::thread::Builder::new()
        .name("log-writer".into())
        .spawn(move || write_all(file, &taken, &noted))?;
    let behind = Behind {
        orders: orders.clone(),
        failure: Arc::clone(&failure),
    };
    Ok((behind, Written { orders, failure }))
}

fn write_all(mut file: impl Write, orders: &Receiver<Order>, failure: &Failure) {
    while let Ok(order) = orders.recv() {
        match order {
            Order::Write(bytes) => {
                if let Err(error) = file.write_all(&bytes) {
                    let _ = failure.set((error.kind(), error.to_string()));
                    return;
                }
            }
            Order::Answer(answer) => {
                let _ = answer.send(());
            }
        }
    }
}

impl Write for Behind {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let piece = bytes.get(..PIECE_BYTES).unwrap_or(bytes);
        let sent = self.orders.send(Order::Write(piece.to_vec()));
        sent.map_err(|_| failure_of(&self.failure))?;
        Ok(piece.len())
    }

    /// It is on its way; [`Written::wait`] waits for it.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Written {
    /// Waits until everything that was handed over before is in the file.
    ///
    /// # Errors
    /// It cannot be written.
    pub(super) fn wait(&self) -> io::Result<()> {
        let (answer, answered) = sync_channel(1);
        let asked = self.orders.send(Order::Answer(answer));
        let done = asked.is_ok() && answered.recv().is_ok();
        done.then_some(()).ok_or_else(|| failure_of(&self.failure))
    }
}

impl Drop for Written {
    fn drop(&mut self) {
        let _ = self.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_in_the_file_once_it_was_waited_for_in_order_and_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        let (mut behind, written) = write_behind(File::create(&path).unwrap()).unwrap();
        let mut expected = Vec::new();
        for piece in 0..200u32 {
            let bytes = vec![piece as u8; piece as usize * 977];
            behind.write_all(&bytes).unwrap();
            expected.extend(bytes);
        }
        written.wait().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), expected);
    }

    #[test]
    fn a_file_that_cannot_be_written_says_why() {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let (mut behind, written) = write_behind(full).unwrap();
        behind.write_all(b"lost").unwrap();
        let no_space = io::ErrorKind::StorageFull;
        assert_eq!(written.wait().unwrap_err().kind(), no_space);
        assert_eq!(behind.write_all(b"more").unwrap_err().kind(), no_space);
    }
}
