//! The records of one log file, read, decompressed and checked in a thread of their own, so that whoever measures them does
//! not wait for that: batch by batch, in the order of the file, a bounded number ahead.
//!
//! What nobody here reads (rows for people, indexes, attachments) is left out already in that thread.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, BufReader};
use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

use mcap::records::{Record, op};

use super::codec::Content;
use super::records::{Broken, Records, parse_record};

/// Bytes after which a batch is handed over.
const BATCH_BYTES: usize = 1 << 18;
/// Batches that may wait to be taken.
const BATCHES_AHEAD: usize = 4;

/// Some records, one behind the other.
#[derive(Debug, Default)]
pub(super) struct Batch {
    bytes: Vec<u8>,
    /// Of each record: its kind, and where it ends in `bytes`.
    records: Vec<(u8, usize)>,
    /// How many have been taken, and where the last of them ends.
    taken: (usize, usize),
}

impl Batch {
    fn put(&mut self, opcode: u8, data: &[u8]) {
        self.bytes.extend_from_slice(data);
        self.records.push((opcode, self.bytes.len()));
    }

    fn clear(&mut self) {
        self.bytes.clear();
        self.records.clear();
        self.taken = (0, 0);
    }

    /// The next record: its kind and its content.
    pub(super) fn next(&mut self) -> Option<(u8, &[u8])> {
        let (index, start) = self.taken;
        let (opcode, end) = *self.records.get(index)?;
        self.taken = (index + 1, end);
        Some((opcode, self.bytes.get(start..end)?))
    }
}

/// The next records, none behind the last; or why there are no more.
type Parcel = Result<Option<Batch>, Broken>;

/// What comes from the thread that reads.
#[derive(Debug)]
pub(super) struct Feed {
    parcels: Option<Receiver<Parcel>>,
    empty: Option<Sender<Batch>>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    /// Goes on with the records from where they are.
    ///
    /// # Errors
    /// No thread can be started.
    pub(super) fn start(records: Records<BufReader<File>>) -> io::Result<Feed> {
        let (parcel_out, parcels) = sync_channel(BATCHES_AHEAD);
        let (empty, empty_in) = channel();
        let thread = std::thread::Builder::new()
            .name("log-reader".into())
            .spawn(move || hand_over(records, &parcel_out, &empty_in))?;
        Ok(Feed {
            parcels: Some(parcels),
            empty: Some(empty),
            thread: Some(thread),
        })
    }

    /// The next batch, none behind the last; `used` is one that is done with.
    ///
    /// # Errors
    /// There are no more before their end.
    pub(super) fn next(&mut self, used: Batch) -> Parcel {
        if let Some(empty) = &self.empty {
            // Nobody takes it who has ended.
            let _ = empty.send(used);
        }
        let parcel = self.parcels.as_ref().and_then(|all| all.recv().ok());
        parcel.unwrap_or_else(|| {
            let early = io::Error::other("the thread that reads it ended early");
            Err(Broken::Failed(early))
        })
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        // Without anybody to take its batches the thread ends.
        self.parcels = None;
        self.empty = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What the thread does.
fn hand_over(
    mut records: Records<BufReader<File>>,
    out: &SyncSender<Parcel>,
    empty: &Receiver<Batch>,
) {
    // Channels whose messages nobody here reads.
    let mut unread = BTreeSet::new();
    let mut batch = Batch::default();
    let ended = records.each(|opcode, data| {
        if wanted(opcode, data, &mut unread) {
            batch.put(opcode, data);
        }
        if opcode == op::DATA_END {
            return ControlFlow::Break(());
        }
        if batch.bytes.len() >= BATCH_BYTES {
            let mut next = empty.try_recv().unwrap_or_default();
            next.clear();
            let full = std::mem::replace(&mut batch, next);
            if out.send(Ok(Some(full))).is_err() {
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    });
    let _ = out.send(Ok(Some(batch)));
    let _ = out.send(ended.map(|_| None));
}

/// Whether a record says anything to a reader of samples.
fn wanted(opcode: u8, data: &[u8], unread: &mut BTreeSet<u16>) -> bool {
    match opcode {
        op::MESSAGE => {
            let channel = data.first_chunk::<2>().map(|id| u16::from_le_bytes(*id));
            channel.is_none_or(|channel| !unread.contains(&channel))
        }
        op::CHANNEL => {
            if let Ok(Record::Channel(channel)) = parse_record(opcode, data)
                && Content::of_topic(&channel.topic).is_none()
            {
                unread.insert(channel.id);
            }
            true
        }
        op::METADATA | op::DATA_END => true,
        _ => false,
    }
}
