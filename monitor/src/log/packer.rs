//! Packs a log and writes it in a thread of its own, at low priority: neither the compression nor a disk that stalls for seconds holds
//! up the thread that receives samples.
//!
//! What waits is bounded: a recorder that is further ahead than that waits too, as it does when it begins or ends a file, until the
//! disk has what was written: a queue of samples must hold that long.

use std::fs::File;
use std::io::{self, BufWriter};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;

use bus::realtime;
use mcap::write::NoSeek;
use mcap::{McapError, McapResult, Writer};

/// Bytes of samples that may wait to be packed: a minute of three axes at 1 ms, some seconds of eight where all of it is recorded.
const AHEAD_BYTES_MAX: usize = 128 << 20;

pub(super) type Sink = NoSeek<BufWriter<File>>;

/// Does something with the log; whether it could.
type Work = Box<dyn FnOnce(&mut Writer<Sink>) -> bool + Send>;

/// What the writer says, as the file system would.
pub(super) fn of_writer(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}

/// Why it cannot be written any more.
#[derive(Debug, Clone, Default)]
struct Failure(Arc<OnceLock<(io::ErrorKind, String)>>);

impl Failure {
    /// Takes what was done; none if it could not be done, which is the last that is heard of this log.
    fn note<T>(&self, done: McapResult<T>) -> Option<T> {
        let noted = |error| {
            let error = of_writer(error);
            self.0.set((error.kind(), error.to_string()))
        };
        done.map_err(noted).ok()
    }

    fn error(&self) -> io::Error {
        match self.0.get() {
            Some((kind, text)) => io::Error::new(*kind, text.clone()),
            None => io::Error::other("the thread that writes it has ended"),
        }
    }
}

/// Hands work on a log over; what was handed over is done before it is gone.
pub(super) struct Packer {
    works: Option<Sender<Work>>,
    ahead_bytes: Arc<AtomicUsize>,
    failure: Failure,
    thread: Option<JoinHandle<()>>,
}

impl Packer {
    /// Of a log that has been begun.
    ///
    /// # Errors
    /// No thread can be started.
    pub(super) fn start(writer: Writer<Sink>) -> io::Result<Packer> {
        let (works, taken) = channel();
        let thread = std::thread::Builder::new()
            .name("log-packer".into())
            .spawn(move || work_off(writer, &taken))?;
        Ok(Packer {
            works: Some(works),
            ahead_bytes: Arc::default(),
            failure: Failure::default(),
            thread: Some(thread),
        })
    }

    /// Has this done behind all that was handed over before; so many bytes wait with it.
    ///
    /// # Errors
    /// The log cannot be written any more.
    pub(super) fn hand_over(
        &self,
        bytes: usize,
        work: impl FnOnce(&mut Writer<Sink>) -> McapResult<()> + Send + 'static,
    ) -> io::Result<()> {
        if self.ahead_bytes.load(Ordering::Relaxed) > AHEAD_BYTES_MAX {
            self.wait()?;
        }
        self.ahead_bytes.fetch_add(bytes, Ordering::Relaxed);
        let (ahead, failure) = (Arc::clone(&self.ahead_bytes), self.failure.clone());
        self.send(Box::new(move |writer| {
            let done = failure.note(work(writer));
            ahead.fetch_sub(bytes, Ordering::Relaxed);
            done.is_some()
        }))
    }

    /// Has this done, and waits for what comes of it.
    ///
    /// # Errors
    /// As [`Packer::hand_over`].
    pub(super) fn ask<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Writer<Sink>) -> McapResult<T> + Send + 'static,
    ) -> io::Result<T> {
        let (answer, answered) = sync_channel(1);
        let failure = self.failure.clone();
        self.send(Box::new(move |writer| {
            let done = failure.note(work(writer));
            done.is_some_and(|done| answer.send(done).is_ok())
        }))?;
        answered.recv().map_err(|_| self.failure.error())
    }

    /// Waits until all that was handed over has been done.
    ///
    /// # Errors
    /// As [`Packer::hand_over`].
    pub(super) fn wait(&self) -> io::Result<()> {
        self.ask(|_| Ok(()))
    }

    fn send(&self, work: Work) -> io::Result<()> {
        let sent = self.works.as_ref().map(|works| works.send(work));
        match sent {
            Some(Ok(())) => Ok(()),
            _ => Err(self.failure.error()),
        }
    }
}

impl Drop for Packer {
    fn drop(&mut self) {
        self.works = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn work_off(mut writer: Writer<Sink>, works: &Receiver<Work>) {
    realtime::step_back();
    while let Ok(work) = works.recv() {
        if !work(&mut writer) {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use mcap::read::LinearReader;
    use mcap::records::Record;
    use mcap::{Attachment, WriteOptions};

    use super::*;

    fn packer(path: &Path) -> Packer {
        let file = File::create(path).unwrap();
        let sink = NoSeek::new(BufWriter::with_capacity(64, file));
        let options = WriteOptions::new().disable_seeking(true);
        Packer::start(options.create(sink).unwrap()).unwrap()
    }

    /// Writes so many bytes of a value.
    fn hand_over(packer: &Packer, bytes: usize, value: u8) -> io::Result<()> {
        packer.hand_over(bytes, move |writer| {
            writer.attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: "piece".into(),
                media_type: String::new(),
                data: vec![value; bytes].into(),
            })
        })
    }

    #[test]
    fn everything_is_in_the_file_once_it_was_waited_for_in_order_and_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        let packer = packer(&path);
        let pieces = (0..200u8).map(|piece| (usize::from(piece) * 977, piece));
        for (bytes, value) in pieces.clone() {
            hand_over(&packer, bytes, value).unwrap();
        }
        packer.ask(Writer::flush).unwrap();
        assert_eq!(packer.ahead_bytes.load(Ordering::Relaxed), 0);
        packer.ask(Writer::finish).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let records = LinearReader::new(&whole).unwrap().map(Result::unwrap);
        let found = records.filter_map(|record| match record {
            Record::Attachment { data, .. } => Some(data.into_owned()),
            _ => None,
        });
        assert!(found.eq(pieces.map(|(bytes, value)| vec![value; bytes])));
        drop(packer);
        assert_eq!(std::fs::read(&path).unwrap(), whole);
    }

    #[test]
    fn a_recorder_that_is_far_ahead_waits_and_nothing_is_left_out() {
        let dir = tempfile::tempdir().unwrap();
        let packer = packer(&dir.path().join("file"));
        let (open, gate) = channel();
        packer
            .hand_over(0, move |_| {
                let _ = gate.recv();
                Ok(())
            })
            .unwrap();
        let (handed_over, done) = (AtomicUsize::new(0), Arc::new(AtomicUsize::new(0)));
        std::thread::scope(|scope| {
            let open = open;
            scope.spawn(|| {
                for _ in 0..16 {
                    let done = Arc::clone(&done);
                    let count = move |_: &mut _| {
                        done.fetch_add(1, Ordering::SeqCst);
                        Ok(())
                    };
                    packer.hand_over(AHEAD_BYTES_MAX / 8, count).unwrap();
                    handed_over.fetch_add(1, Ordering::SeqCst);
                }
            });
            while handed_over.load(Ordering::SeqCst) < 9 {
                std::thread::yield_now();
            }
            std::thread::yield_now();
            assert_eq!(handed_over.load(Ordering::SeqCst), 9);
            open.send(()).unwrap();
        });
        packer.wait().unwrap();
        assert_eq!(done.load(Ordering::SeqCst), 16);
    }

    #[test]
    fn a_file_that_cannot_be_written_says_why() {
        let packer = packer(Path::new("/dev/full"));
        let no_space = io::ErrorKind::StorageFull;
        let done = hand_over(&packer, 1 << 20, 7).and_then(|()| packer.wait());
        assert_eq!(done.unwrap_err().kind(), no_space);
        assert_eq!(packer.wait().unwrap_err().kind(), no_space);
        assert_eq!(hand_over(&packer, 1, 7).unwrap_err().kind(), no_space);
    }
}
