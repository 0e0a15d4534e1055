//! What processes agree on by words of the page alone: urgent orders and their answers, the answers to a scan, requests to the launcher.
//!
//! Nothing here knows where the words are. So the same code runs over the page, and over the atomics of `loom`, which tries every
//! interleaving of it (lab/model/tests/page.rs).

use super::atomic::{AtomicU32, AtomicU64, Ordering, fence};

/// Orders of one kind that must always come through: they need no place in a service, and wait here for a master that is being
/// replaced. All who have asked by the time it is judged have the same answer, of so many words. So many answers are kept: who looks
/// later than that is told nothing.
#[repr(C, align(64))]
#[derive(Debug)]
pub(crate) struct Urgent<const WORDS: usize, const KEPT: usize> {
    /// Times it was asked for.
    asked: AtomicU32,
    /// Of these, those that are answered.
    answered: AtomicU32,
    /// Answers given; the next one goes into the oldest of the slots.
    given: AtomicU32,
    answers: [Answer<WORDS>; KEPT],
}

/// An answer, and who it is for.
#[repr(C)]
#[derive(Debug)]
struct Answer<const WORDS: usize> {
    /// Odd while it is being written, also for ever if its writer was killed then.
    version: AtomicU32,
    /// The last order that was answered before.
    after: AtomicU32,
    /// The last one that it answers.
    until: AtomicU32,
    words: [AtomicU64; WORDS],
}

/// Whether `number` is counted after `before`, and not after `until`.
fn is_between(before: u32, number: u32, until: u32) -> bool {
    let to = |from: u32, to: u32| to.wrapping_sub(from) as i32;
    to(before, number) > 0 && to(number, until) >= 0
}

impl<const WORDS: usize> Answer<WORDS> {
    /// For the one master that there is. Whoever reads a word of it knows by the version that it is being written.
    fn write(&self, after: u32, until: u32, words: [u64; WORDS]) {
        let version = self.version.load(Ordering::Relaxed) | 1;
        self.version.store(version, Ordering::Relaxed);
        self.after.store(after, Ordering::Release);
        self.until.store(until, Ordering::Release);
        for (word, value) in self.words.iter().zip(words) {
            word.store(value, Ordering::Release);
        }
        self.version
            .store(version.wrapping_add(1), Ordering::Release);
    }

    /// The answer to the order of this number, if it is that and whole.
    fn read(&self, number: u32) -> Option<[u64; WORDS]> {
        let version = self.version.load(Ordering::Acquire);
        let after = self.after.load(Ordering::Acquire);
        let until = self.until.load(Ordering::Acquire);
        let mut words = [0; WORDS];
        for (value, word) in words.iter_mut().zip(&self.words) {
            *value = word.load(Ordering::Acquire);
        }
        let whole = version.is_multiple_of(2) && self.version.load(Ordering::Relaxed) == version;
        (whole && is_between(after, number, until)).then_some(words)
    }
}

impl<const WORDS: usize, const KEPT: usize> Urgent<WORDS, KEPT> {
    /// Asks; the number to look for the answer with.
    pub fn ask(&self) -> u32 {
        self.asked.fetch_add(1, Ordering::AcqRel).wrapping_add(1)
    }

    /// The answer to the order of that number, once it is there. An order that has one is not judged again.
    pub fn answer(&self, number: u32) -> Option<[u64; WORDS]> {
        let answered = self.answered.load(Ordering::Acquire);
        if (answered.wrapping_sub(number) as i32) < 0 {
            return None;
        }
        self.answers.iter().find_map(|answer| answer.read(number))
    }

    /// Judges the orders that are there; for the master. One that dies between judging and answering leaves them to the next: they
    /// are judged twice then, before any other order.
    pub fn serve(&self, judge: impl FnOnce() -> [u64; WORDS]) {
        let asked = self.asked.load(Ordering::Acquire);
        let answered = self.answered.load(Ordering::Acquire);
        if asked == answered {
            return;
        }
        let words = judge();
        let given = self.given.load(Ordering::Relaxed);
        if let Some(answer) = self.answers.get(given as usize % KEPT) {
            answer.write(answered, asked, words);
        }
        self.given.store(given.wrapping_add(1), Ordering::Relaxed);
        self.answered.store(asked, Ordering::Release);
    }
}

/// The words of a signal: how often it was raised, and who sleeps until it is.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct Rings {
    /// Times it was raised: the word that sleepers sleep at.
    pub count: AtomicU32,
    /// Sleeping processes, at least: one that is killed in its sleep stays counted, and costs the others a system call.
    sleepers: AtomicU32,
}

impl Rings {
    /// One more; whether somebody sleeps who is to be woken.
    pub fn raise(&self) -> bool {
        self.count.fetch_add(1, Ordering::Release);
        // Who falls asleep finds this ring, or is found here.
        fence(Ordering::SeqCst);
        self.sleepers.load(Ordering::Relaxed) > 0
    }

    /// Before the caller sleeps, if the count is still what it has seen.
    pub fn sleep(&self) {
        self.sleepers.fetch_add(1, Ordering::Relaxed);
        fence(Ordering::SeqCst);
    }

    /// After it.
    pub fn rise(&self) {
        self.sleepers.fetch_sub(1, Ordering::Relaxed);
    }
}

/// How many answers to the scan the master still waits for.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct Outstanding {
    count: AtomicU32,
    eager: AtomicU32,
}

impl Outstanding {
    /// So many, and the last one is to ring. For the master, before it signals.
    pub fn expect(&self, count: u32) {
        self.eager.store(0, Ordering::Relaxed);
        self.count.store(count, Ordering::Release);
    }

    /// From now on in this scan every answer is to ring.
    pub fn expect_eagerly(&self) {
        self.eager.store(1, Ordering::Relaxed);
        // Ordered before the look at the ports that follows: an answer is seen there, or its ring is.
        fence(Ordering::SeqCst);
    }

    /// One has answered; whether it is to ring.
    pub fn answered(&self) -> bool {
        let before = self.count.fetch_sub(1, Ordering::AcqRel);
        fence(Ordering::SeqCst);
        before == 1 || self.eager.load(Ordering::Relaxed) != 0
    }
}

/// What the master asks of the launcher: one request at a time.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub(crate) struct Requests {
    /// Requests made; the newest is in the slot of its parity, so that the one before is never torn by it.
    asked: AtomicU64,
    /// The last one that was answered.
    done: AtomicU64,
    slots: [RequestWords; 2],
}

#[repr(C)]
#[derive(Debug, Default)]
struct RequestWords {
    scan: AtomicU64,
    index: AtomicU32,
    step: AtomicU32,
}

impl Requests {
    fn slot(&self, ticket: u64) -> &RequestWords {
        let [even, odd] = &self.slots;
        if ticket.is_multiple_of(2) { even } else { odd }
    }

    /// Asks for a step of the fault of this index in this scan; the ticket.
    pub fn ask(&self, index: u32, step: u32, scan: u64) -> u64 {
        let ticket = self.asked.load(Ordering::Relaxed) + 1;
        let slot = self.slot(ticket);
        slot.scan.store(scan, Ordering::Relaxed);
        slot.index.store(index, Ordering::Relaxed);
        slot.step.store(step, Ordering::Relaxed);
        self.asked.store(ticket, Ordering::Release);
        ticket
    }

    /// Ticket, index, step and scan of what was asked for and is not done.
    pub fn open(&self) -> Option<(u64, u32, u32, u64)> {
        let ticket = self.asked.load(Ordering::Acquire);
        if ticket <= self.done.load(Ordering::Acquire) {
            return None;
        }
        let slot = self.slot(ticket);
        Some((
            ticket,
            slot.index.load(Ordering::Relaxed),
            slot.step.load(Ordering::Relaxed),
            slot.scan.load(Ordering::Relaxed),
        ))
    }

    /// What this ticket asked for is done.
    pub fn answer(&self, ticket: u64) {
        self.done.fetch_max(ticket, Ordering::Release);
    }

    /// Whether it is.
    pub fn is_done(&self, ticket: u64) -> bool {
        self.done.load(Ordering::Acquire) >= ticket
    }
}

/// Two states that are saved in turn, so that a kill in the middle of one leaves the other whole.
#[repr(C, align(64))]
#[derive(Debug)]
pub(crate) struct Saved<const WORDS: usize> {
    slots: [SavedWords<WORDS>; 2],
}

#[repr(C, align(64))]
#[derive(Debug)]
struct SavedWords<const WORDS: usize> {
    /// Odd while it is being written; the higher even one is the newer whole one.
    version: AtomicU64,
    words: [AtomicU64; WORDS],
}

impl<const WORDS: usize> SavedWords<WORDS> {
    /// Its version if it is whole, 0 if it never was or is torn.
    fn whole(&self) -> u64 {
        let version = self.version.load(Ordering::SeqCst);
        if version.is_multiple_of(2) {
            version
        } else {
            0
        }
    }
}

impl<const WORDS: usize> Saved<WORDS> {
    /// Saves these words into the older of the slots.
    pub fn save(&self, words: impl Iterator<Item = u64>) {
        let [a, b] = &self.slots;
        let (a_version, b_version) = (a.whole(), b.whole());
        let (slot, newer) = if a_version <= b_version {
            (a, b_version)
        } else {
            (b, a_version)
        };
        slot.version.store(newer + 1, Ordering::SeqCst);
        for (word, value) in slot.words.iter().zip(words) {
            word.store(value, Ordering::Relaxed);
        }
        slot.version.store(newer + 2, Ordering::SeqCst);
    }

    /// The last whole state that was saved, if any.
    pub fn load(&self) -> Option<impl Iterator<Item = u64> + '_> {
        let [a, b] = &self.slots;
        let slot = if a.whole() >= b.whole() { a } else { b };
        let words = slot.words.iter();
        (slot.whole() > 0).then(|| words.map(|word| word.load(Ordering::Relaxed)))
    }
}

/// Words that no page holds: for tests.
#[cfg(test)]
#[allow(dead_code)]
mod fresh {
    use std::array::from_fn;

    use super::{Answer, AtomicU32, AtomicU64, Saved, SavedWords, Urgent};

    impl<const WORDS: usize, const KEPT: usize> Urgent<WORDS, KEPT> {
        pub fn new() -> Self {
            Urgent {
                asked: AtomicU32::new(0),
                answered: AtomicU32::new(0),
                given: AtomicU32::new(0),
                answers: from_fn(|_| Answer {
                    version: AtomicU32::new(0),
                    after: AtomicU32::new(0),
                    until: AtomicU32::new(0),
                    words: from_fn(|_| AtomicU64::new(0)),
                }),
            }
        }
    }

    impl<const WORDS: usize> Saved<WORDS> {
        pub fn new() -> Self {
            Saved {
                slots: from_fn(|_| SavedWords {
                    version: AtomicU64::new(0),
                    words: from_fn(|_| AtomicU64::new(0)),
                }),
            }
        }
    }
}
