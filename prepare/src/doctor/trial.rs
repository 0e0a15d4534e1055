//! What only trying tells: what the operating system refuses, and how late sleeps end.

use bus::realtime::{self, Priority};

/// Sleeps that are measured: half a second.
pub const SLEEPS: usize = 500;
const SLEEP_NS: u64 = 1_000_000;

/// What was refused, in the system's words.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Refused {
    /// SCHED_FIFO.
    pub priority: Option<String>,
    /// Locked memory.
    pub memory: Option<String>,
}

/// How late sleeps of 1 ms ended, in µs.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Lateness {
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// Worst.
    pub max_us: f64,
    /// Under SCHED_FIFO, as the master sleeps.
    pub fifo: bool,
}

/// Tried in a thread of its own and given back.
pub fn what_is_refused() -> Refused {
    let tried = std::thread::spawn(|| {
        let priority = realtime::raise(Priority::Master).err();
        realtime::lower();
        let memory = realtime::lock_memory().err();
        let _ = rustix::mm::munlockall();
        Refused {
            priority: priority.map(|error| error.to_string()),
            memory: memory.map(|error| error.to_string()),
        }
    });
    tried.join().unwrap_or(Refused {
        priority: Some("could not be tried".into()),
        memory: Some("could not be tried".into()),
    })
}

/// Sleeps as the master does between scans.
pub fn lateness() -> Lateness {
    let measured = std::thread::spawn(|| {
        let fifo = realtime::raise(Priority::Master).is_ok();
        let mut late: Vec<u64> = Vec::with_capacity(SLEEPS);
        let mut next = realtime::now_ns() + SLEEP_NS;
        for _ in 0..SLEEPS {
            realtime::sleep_until_ns(next);
            let now = realtime::now_ns();
            late.push(now.saturating_sub(next));
            next = now + SLEEP_NS;
        }
        realtime::lower();
        late.sort_unstable();
        let at = |part: f64| {
            let index = ((late.len() - 1) as f64 * part) as usize;
            late.get(index).copied().unwrap_or(0) as f64 / 1000.0
        };
        Lateness {
            p50_us: at(0.5),
            p99_us: at(0.99),
            max_us: at(1.0),
            fifo,
        }
    });
    measured.join().unwrap_or_default()
}
