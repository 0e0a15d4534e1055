//! A bounded queue between whoever prints and a terminal or pipe that may take nothing for hours: a thread writes, nobody else
//! waits, what finds no room is dropped and counted.

use std::collections::VecDeque;
use std::os::fd::BorrowedFd;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;

/// The most bytes that wait.
const BYTES_MAX: usize = 256 << 10;
/// Once something was dropped, all is until so few are left: one gap, not many.
const BYTES_AGAIN: usize = BYTES_MAX / 2;
/// A picture is not drawn behind more than this.
const DRAW_BYTES_MAX: usize = 4 << 10;
/// A pipe takes so much in one piece, or nothing.
const CHUNK: usize = 4096;

/// Where something is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Standard output.
    Out,
    /// Standard error.
    Err,
}

#[derive(Debug)]
struct Piece {
    stream: Stream,
    bytes: Vec<u8>,
}

#[derive(Debug, Default)]
struct Waiting {
    pieces: VecDeque<Piece>,
    bytes: usize,
    /// Pieces for which there was no room since the last that was taken.
    dropped: u64,
    held_back: bool,
    /// The thread has a piece in hand.
    writing: bool,
    /// Writes that went through, in all.
    writes: u64,
}

impl Waiting {
    fn push(&mut self, stream: Stream, bytes: Vec<u8>) {
        self.bytes += bytes.len();
        self.pieces.push_back(Piece { stream, bytes });
    }

    /// Room for so many bytes; a text that is larger than the queue has room in an empty one.
    fn has_room(&self, bytes: usize) -> bool {
        let most = match self.dropped {
            0 => BYTES_MAX,
            _ => BYTES_AGAIN,
        };
        self.bytes == 0 || self.bytes + bytes <= most
    }

    /// Reports what was dropped, where it is missing.
    fn report_dropped(&mut self) {
        if self.dropped > 0 {
            let lines = std::mem::take(&mut self.dropped);
            let note = format!("({lines} lines are missing here: this terminal took no more)\n");
            self.push(Stream::Err, note.into_bytes());
        }
    }
}

/// The queue.
#[derive(Debug)]
pub struct Queue {
    to: [BorrowedFd<'static>; 2],
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

impl Queue {
    /// A queue to these descriptors, standard output and standard error, and its thread; it stays for good.
    pub fn start(to: [BorrowedFd<'static>; 2]) -> std::io::Result<&'static Queue> {
        let queue: &'static Queue = Box::leak(Box::new(Queue {
            to,
            waiting: Mutex::default(),
            changed: Condvar::new(),
        }));
        let thread = std::thread::Builder::new().name("output".into());
        thread.spawn(|| queue.write_for_ever())?;
        Ok(queue)
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has these lines written, if there is room for them.
    pub fn print(&self, stream: Stream, bytes: &[u8]) {
        let mut waiting = self.waiting();
        if !waiting.has_room(bytes.len()) {
            waiting.dropped += 1;
            return;
        }
        waiting.report_dropped();
        waiting.push(stream, bytes.to_vec());
        self.changed.notify_all();
    }

    /// Has a picture drawn on standard error, if next to nothing waits.
    pub fn draw(&self, bytes: &[u8]) {
        let mut waiting = self.waiting();
        if waiting.bytes <= DRAW_BYTES_MAX && !waiting.held_back {
            waiting.push(Stream::Err, bytes.to_vec());
            self.changed.notify_all();
        }
    }

    /// Writes nothing for now, or goes on.
    pub fn hold_back(&self, held_back: bool) {
        self.waiting().held_back = held_back;
        self.changed.notify_all();
    }

    /// Waits until all is written; false if nothing could be written for `limit`.
    pub fn flush(&self, limit: Duration) -> bool {
        let mut waiting = self.waiting();
        waiting.report_dropped();
        self.changed.notify_all();
        let mut since = Instant::now();
        let mut writes = waiting.writes;
        while waiting.writing || !waiting.pieces.is_empty() {
            if waiting.writes != writes {
                writes = waiting.writes;
                since = Instant::now();
            }
            let left = limit.saturating_sub(since.elapsed());
            if left.is_zero() {
                return false;
            }
            let woken = self.changed.wait_timeout(waiting, left);
            waiting = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    fn write_for_ever(&self) {
        let mut waiting = self.waiting();
        loop {
            waiting.writing = false;
            self.changed.notify_all();
            let piece = loop {
                if !waiting.held_back
                    && let Some(piece) = waiting.pieces.pop_front()
                {
                    break piece;
                }
                let woken = self.changed.wait(waiting);
                waiting = woken.unwrap_or_else(PoisonError::into_inner);
            };
            waiting.bytes -= piece.bytes.len();
            waiting.writing = true;
            drop(waiting);
            self.write(&piece);
            waiting = self.waiting();
        }
    }

    /// Writes a piece; a terminal that is gone takes the rest with it.
    fn write(&self, piece: &Piece) {
        let [out, err] = self.to;
        let to = match piece.stream {
            Stream::Out => out,
            Stream::Err => err,
        };
        let mut rest = piece.bytes.as_slice();
        while !rest.is_empty() {
            let chunk = rest.get(..CHUNK).unwrap_or(rest);
            match rustix::io::write(to, chunk) {
                Ok(written) => rest = rest.get(written..).unwrap_or_default(),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => {
                    let _ = poll(&mut [PollFd::new(&to, PollFlags::OUT)], None);
                    continue;
                }
                Err(error) => {
                    if piece.stream == Stream::Out {
                        super::note_failure(error.into());
                    }
                    return;
                }
            }
            self.waiting().writes += 1;
            self.changed.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::Read;
    use std::os::fd::{AsFd, OwnedFd};

    use super::*;

    /// A queue into a pipe that holds one page, and the pipe's other end.
    fn queue() -> (&'static Queue, File) {
        let (reader, writer) = rustix::pipe::pipe().expect("a pipe");
        rustix::pipe::fcntl_setpipe_size(&writer, 4096).expect("a small one");
        let writer: &'static OwnedFd = Box::leak(Box::new(writer));
        let to = [writer.as_fd(), writer.as_fd()];
        (Queue::start(to).expect("a queue"), reader.into())
    }

    #[test]
    fn a_pipe_that_nobody_reads_keeps_nobody_waiting_and_what_is_dropped_is_counted() {
        let (queue, mut reader) = queue();
        let line = format!("{}\n", "x".repeat(99));
        let before = Instant::now();
        (0..10_000).for_each(|_| queue.print(Stream::Err, line.as_bytes()));
        assert!(!queue.flush(Duration::from_millis(50)), "it was flushed");
        assert!(before.elapsed() < Duration::from_secs(5));
        assert!(queue.waiting().bytes <= BYTES_MAX + 100);
        queue.print(Stream::Err, line.as_bytes());
        // Read from now on, it is all there but for what was dropped.
        let reading = std::thread::spawn(move || {
            let mut text = vec![0; 400 << 10];
            let mut filled = 0;
            while !text[..filled].ends_with(b"end\n") {
                filled += reader.read(&mut text[filled..]).expect("reading");
            }
            String::from_utf8_lossy(&text[..filled]).into_owned()
        });
        assert!(queue.flush(Duration::from_secs(5)), "it was not flushed");
        queue.print(Stream::Out, b"end\n");
        let text = reading.join().expect("the reader");
        let lines = text.lines().filter(|l| l.starts_with('x')).count();
        let notes = text
            .lines()
            .filter_map(|l| l.strip_prefix('(')?.split_once(" lines are missing"));
        let missing: usize = notes
            .map(|(n, _)| n.parse::<usize>().expect("a number"))
            .sum();
        assert!(missing > 0);
        assert_eq!(lines + missing, 10_001);
    }

    #[test]
    fn what_is_kept_back_is_written_once_it_is_released() {
        let (queue, mut reader) = queue();
        queue.hold_back(true);
        queue.print(Stream::Err, b"later\n");
        assert!(!queue.flush(Duration::from_millis(20)));
        queue.hold_back(false);
        assert!(queue.flush(Duration::from_secs(5)));
        let mut text = [0; 6];
        reader.read_exact(&mut text).expect("reading");
        assert_eq!(&text, b"later\n");
    }
}
