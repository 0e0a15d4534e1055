//! How late the sleeps between scans end on this PC.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use bus::realtime::{self, Priority, Settings, now_ns, sleep_until_ns};

/// Lateness is counted in steps of 1 µs; what is later than all of them counts as the last.
const STEPS: usize = 20_000;
/// Time between two looks at a measurement.
const LOOK: Duration = Duration::from_millis(100);

/// How late scans began.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lateness {
    /// Scan period, in µs.
    pub scan_period_us: u32,
    /// SCHED_FIFO priority that was granted; 0 for none.
    pub priority: u32,
    /// Whether memory was locked.
    pub memory_locked: bool,
    /// Processors that scans could begin on.
    pub processors: Vec<usize>,
    /// Scans that were measured.
    pub scans: u64,
    /// Those that began a whole scan late or later.
    pub lost_scans: u64,
    /// Median of the lateness, in µs, to the next whole one.
    pub p50_us: f64,
    /// 99th percentile, the same.
    pub p99_us: f64,
    /// Worst, in µs.
    pub max_us: f64,
}

/// Begins `scans` scans, or as many as `goes_on` allows, which is told how many have begun; in a thread that runs as a master with
/// these settings and processors does.
pub fn measure(
    (settings, processors): &(Settings, Vec<usize>),
    (scan_period_us, scans): (u32, u64),
    mut goes_on: impl FnMut(u64) -> bool,
) -> Lateness {
    let (done, ends) = (AtomicU64::new(0), AtomicBool::new(false));
    let measured = std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            if !processors.is_empty() {
                realtime::stay_on_all(processors);
            }
            let refused = settings.apply(Priority::Master);
            let asked = settings.priority.unwrap_or(Priority::Master.level());
            Lateness {
                priority: refused.priority.map_or(asked, |_| 0),
                memory_locked: settings.lock_memory && refused.memory.is_none(),
                processors: realtime::processors(),
                ..begin_scans(scan_period_us, |begun| {
                    done.store(begun, Ordering::Relaxed);
                    begun < scans && !ends.load(Ordering::Relaxed)
                })
            }
        });
        while !thread.is_finished() {
            std::thread::sleep(LOOK);
            ends.fetch_or(!goes_on(done.load(Ordering::Relaxed)), Ordering::Relaxed);
        }
        thread.join().unwrap_or_default()
    });
    realtime::unlock_memory();
    measured
}

/// Sleeps on the calling thread as a master does between its scans.
fn begin_scans(scan_period_us: u32, goes_on: impl Fn(u64) -> bool) -> Lateness {
    let period_ns = u64::from(scan_period_us) * 1000;
    let (mut scans, mut lost_scans, mut max_ns, mut steps) = (0, 0, 0, vec![0; STEPS]);
    let mut next_ns = now_ns() + period_ns;
    while goes_on(scans) {
        sleep_until_ns(next_ns);
        let now = now_ns();
        let late_ns = now.saturating_sub(next_ns);
        if late_ns >= period_ns {
            // Time that was lost is not made up.
            next_ns = now;
            lost_scans += 1;
        }
        next_ns += period_ns;
        scans += 1;
        max_ns = late_ns.max(max_ns);
        if let Some(count) = steps.get_mut((late_ns as usize / 1000).min(STEPS - 1)) {
            *count += 1;
        }
    }
    let max_us = max_ns as f64 / 1000.0;
    Lateness {
        scan_period_us,
        scans,
        lost_scans,
        p50_us: part_us(&steps, 0.5).min(max_us),
        p99_us: part_us(&steps, 0.99).min(max_us),
        max_us,
        ..Lateness::default()
    }
}

/// The lateness that this part of all scans does not exceed, in µs.
fn part_us(steps: &[u64], part: f64) -> f64 {
    let wanted = (steps.iter().sum::<u64>() as f64 * part).ceil() as u64;
    let mut counted = 0;
    let step = steps.iter().position(|count| {
        counted += count;
        counted >= wanted
    });
    step.map_or(0.0, |step| step as f64 + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_exact_to_a_microsecond() {
        let mut steps = vec![1; 100];
        assert_eq!((part_us(&steps, 0.5), part_us(&steps, 0.99)), (50.0, 99.0));
        steps.extend([0, 0, 900]);
        assert_eq!((part_us(&steps, 0.1), part_us(&steps, 0.5)), (100.0, 103.0));
    }

    #[test]
    fn a_measurement_ends_after_its_scans_or_when_it_is_told_to() {
        let as_master = (Settings::DEFAULT, realtime::processors());
        let measured = measure(&as_master, (125, 40), |_| true);
        assert_eq!((measured.scans, measured.scan_period_us), (40, 125));
        assert_eq!(measured.processors, as_master.1);
        assert!(measured.p50_us <= measured.p99_us && measured.p99_us <= measured.max_us);
        let told = measure(&as_master, (125, u64::MAX), |scans| scans == 0);
        assert!(told.scans > 0, "{told:?}");
    }
}
