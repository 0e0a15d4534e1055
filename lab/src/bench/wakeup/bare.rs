//! A loop that sleeps to absolute times, as a master does, and rings.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::anyhow;
use bus::realtime::{self, Priority, now_ns, sleep_until_ns};
use bus::signal_page::Signal;

use super::seen::{Seen, Start};

/// Longest wait for a ring without a look whether the loop has ended.
const WAIT: Duration = Duration::from_millis(50);
/// From the start of the threads to the first scan.
const BEGINS_IN_NS: u64 = 20_000_000;

/// What was seen of one.
#[derive(Debug, Default)]
pub(super) struct Bare {
    /// By who waits for its ring, as a servo does.
    pub seen: Seen,
    /// By itself.
    pub itself: Seen,
}

impl Bare {
    /// Takes another round of the same.
    ///
    /// # Errors
    /// Its times do not fit.
    pub fn join(&mut self, other: &Bare) -> anyhow::Result<()> {
        self.seen.join(&other.seen)?;
        self.itself.join(&other.itself)
    }
}

/// Between a loop and who waits for it.
#[derive(Debug, Default)]
struct Shared {
    ring: Signal,
    /// The scan that begins with the ring.
    scan: AtomicU64,
    overrun: AtomicU64,
    ended: AtomicBool,
}

/// A loop that runs, and who waits for it.
pub(super) struct Running {
    shared: Arc<Shared>,
    period_ns: u64,
    looping: JoinHandle<Seen>,
    waiting: JoinHandle<Vec<Start>>,
}

impl Running {
    /// Starts one whose first scan begins then.
    pub fn start(first_ns: u64, period_ns: u64) -> Running {
        let shared = Arc::new(Shared::default());
        let (of_loop, of_waiter) = (Arc::clone(&shared), Arc::clone(&shared));
        Running {
            waiting: std::thread::spawn(move || wait(&of_waiter)),
            looping: std::thread::spawn(move || run(&of_loop, first_ns, period_ns)),
            shared,
            period_ns,
        }
    }

    /// Ends it.
    ///
    /// # Errors
    /// A thread has panicked.
    pub fn end(self) -> anyhow::Result<Bare> {
        self.shared.ended.store(true, Ordering::Relaxed);
        let panicked = |_| anyhow!("a bare loop has panicked");
        let itself = self.looping.join().map_err(panicked)?;
        let starts = self.waiting.join().map_err(panicked)?;
        Ok(Bare {
            seen: Seen::of(&starts, self.period_ns),
            itself,
        })
    }
}

/// The clock of a master in realtime: time that was lost is not made up.
fn run(shared: &Shared, first_ns: u64, period_ns: u64) -> Seen {
    // Who measures has said whether it is refused.
    let _ = realtime::raise(Priority::Master.level(), 1);
    let mut seen = Seen::default();
    let (mut next_ns, mut scan, mut overruns) = (first_ns, 0_u64, 0_u64);
    while !shared.ended.load(Ordering::Relaxed) {
        sleep_until_ns(next_ns);
        let now = now_ns();
        let late_ns = now.saturating_sub(next_ns);
        let overrun = late_ns / period_ns;
        seen.take(late_ns, overrun);
        if overrun > 0 {
            next_ns = now;
        }
        next_ns += period_ns;
        scan += 1 + overrun;
        overruns += overrun;
        shared.scan.store(scan, Ordering::Release);
        shared.overrun.store(overruns, Ordering::Release);
        shared.ring.raise();
    }
    shared.ring.raise();
    seen
}

fn wait(shared: &Shared) -> Vec<Start> {
    let _ = realtime::raise(Priority::Fieldbus.level(), 1);
    let mut starts = Vec::with_capacity(1 << 16);
    let mut count = shared.ring.count();
    loop {
        shared.ring.wait(count, WAIT);
        let at_ns = now_ns();
        if shared.ended.load(Ordering::Relaxed) {
            return starts;
        }
        if std::mem::replace(&mut count, shared.ring.count()) != count {
            starts.push(Start {
                scan: shared.scan.load(Ordering::Acquire),
                at_ns,
                overrun: shared.overrun.load(Ordering::Acquire),
            });
        }
    }
}

/// Two of them for so long, half a scan apart.
///
/// # Errors
/// A thread has panicked.
pub(super) fn two(
    period_ns: u64,
    time_ns: u64,
    interrupted: &dyn Fn() -> bool,
) -> anyhow::Result<[Bare; 2]> {
    let first_ns = now_ns() + BEGINS_IN_NS;
    let first = Running::start(first_ns, period_ns);
    let second = Running::start(first_ns + period_ns / 2, period_ns);
    while now_ns() < first_ns + time_ns && !interrupted() {
        std::thread::sleep(WAIT);
    }
    Ok([first.end()?, second.end()?])
}
