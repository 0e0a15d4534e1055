//! Random runs: what is killed, stopped, signalled and ordered comes from a seed, at no particular instant, from the first moment
//! of the start to the last of the end. Every command returns within moments of its cause; exit status, report, status and events
//! agree; nothing is left.
//!
//! `RUNS=2000 FROM=0 JOBS=4 cargo test --release --test cell -- random_runs --nocapture` for long, with `UP=1` of cells that stay up
//! alone; a seed repeats what is done, not what comes of it.

mod draw;
mod judge;
mod look;
mod pc;
mod trial;

use std::collections::BTreeMap;
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use trial::Trial;

use crate::size;

/// Every command has returned so long after its cause.
const RETURN_LIMIT: Duration = Duration::from_secs(3);
/// A bare process, from its start to its end, on a PC that does nothing else takes less.
const BARE_PROCESS: Duration = Duration::from_millis(15);
/// So much slower a PC may be for all that runs on it.
const SLOWER_MAX: f64 = 5.0;

/// What came of some runs.
#[derive(Debug, Default)]
struct Figures {
    runs: u64,
    endings: BTreeMap<String, u64>,
    done: BTreeMap<String, u64>,
    /// Times in ms from cause to return, by what returned.
    returns_ms: BTreeMap<String, Vec<f64>>,
    /// Those that were later than the limit, on a PC that was so much slower.
    late: u64,
    violations: Vec<String>,
}

impl Figures {
    fn count(of: &mut BTreeMap<String, u64>, what: &str) {
        *of.entry(what.to_string()).or_default() += 1;
    }

    fn returned(&mut self, what: &str, took: Duration) {
        let ms = took.as_secs_f64() * 1e3;
        self.returns_ms
            .entry(what.to_string())
            .or_default()
            .push(ms);
    }

    fn add(&mut self, other: Figures) {
        self.runs += other.runs;
        self.late += other.late;
        for (what, count) in other.endings {
            *self.endings.entry(what).or_default() += count;
        }
        for (what, count) in other.done {
            *self.done.entry(what).or_default() += count;
        }
        for (what, times) in other.returns_ms {
            self.returns_ms.entry(what).or_default().extend(times);
        }
        self.violations.extend(other.violations);
    }

    fn print(&mut self) {
        println!(
            "{} runs, {} late on a slower PC, endings {:?}",
            self.runs, self.late, self.endings
        );
        println!("done: {:?}", self.done);
        for (what, times) in &mut self.returns_ms {
            times.sort_by(f64::total_cmp);
            let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
            println!(
                "{what:<24} {:>6} times, ms p50 {:>7.1} p99 {:>7.1} max {:>7.1}",
                times.len(),
                at(0.5),
                at(0.99),
                at(1.0)
            );
        }
    }
}

/// How much later than the limit something may return here and now: a bare process is measured.
fn slower() -> f64 {
    let since = Instant::now();
    let _ = Command::new(env!("CARGO_BIN_EXE_quadrant"))
        .arg("--version")
        .output();
    (since.elapsed().as_secs_f64() / BARE_PROCESS.as_secs_f64()).clamp(1.0, SLOWER_MAX)
}

#[test]
fn whatever_is_done_to_a_run_every_command_returns_soon_and_all_that_is_said_agrees() {
    let from = size::number("FROM", 0, 0);
    let (runs, jobs) = (size::number("RUNS", 6, 6), size::number("JOBS", 2, 2));
    pc::watch();
    let next = AtomicU64::new(from);
    let all = Mutex::new(Figures::default());
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= from + runs {
                        return;
                    }
                    let figures = Trial::run(seed);
                    for violation in &figures.violations {
                        println!("VIOLATION {violation}");
                    }
                    all.lock().expect("the figures").add(figures);
                }
            });
        }
    });
    let mut all = all.into_inner().expect("the figures");
    all.print();
    let count = all.violations.len();
    assert_eq!(count, 0, "{}", all.violations.join("\n\n"));
}
