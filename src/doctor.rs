//! `quadrant doctor`: what this PC offers for real time.

use std::fs;

use bus::realtime::{self, Priority};

use crate::exit::Outcome;
use crate::output::say;

const TIMER_SAMPLES: usize = 500;

/// Prints the findings, each with what follows from it.
pub fn doctor() -> Outcome {
    let uname = rustix::system::uname();
    row("kernel", &uname.release().to_string_lossy(), "");
    let preempt_rt = read("/sys/kernel/realtime").is_some_and(|text| text.trim() == "1");
    row(
        "PREEMPT_RT",
        yes_no(preempt_rt),
        if preempt_rt {
            ""
        } else {
            "an ordinary kernel may delay a scan by milliseconds; fine for simulation"
        },
    );
    let processors = realtime::processors();
    row(
        "processors",
        &processors.len().to_string(),
        if processors.len() < 2 {
            "realtime pace wants at least two"
        } else {
            ""
        },
    );
    if let Some(governor) = read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor") {
        let governor = governor.trim().to_string();
        let advice = if governor == "performance" {
            ""
        } else {
            "\"performance\" keeps wake-ups short"
        };
        row("CPU governor", &governor, advice);
    }
    let (fifo, memory) = what_is_refused();
    row(
        "SCHED_FIFO",
        &fifo
            .as_ref()
            .map_or("allowed".into(), |e| format!("refused ({e})")),
        if fifo.is_some() {
            "raise rtprio in /etc/security/limits.d, or run with CAP_SYS_NICE"
        } else {
            ""
        },
    );
    row(
        "locked memory",
        &memory
            .as_ref()
            .map_or("allowed".into(), |e| format!("refused ({e})")),
        if memory.is_some() {
            "raise memlock in /etc/security/limits.d"
        } else {
            ""
        },
    );
    if let Some(runtime) = read("/proc/sys/kernel/sched_rt_runtime_us") {
        row(
            "realtime throttling",
            &format!("{} µs of 1 s", runtime.trim()),
            "",
        );
    }
    let (median, p99, worst) = timer_lateness_us();
    row(
        "timer",
        &format!(
            "late by {median:.0} µs (half), {p99:.0} µs (99 %), {worst:.0} µs (worst of {TIMER_SAMPLES})"
        ),
        if p99 > 200.0 {
            "a scan of 1 ms will miss now and then"
        } else {
            ""
        },
    );
    match rustix::fs::statvfs("/dev/shm") {
        Ok(shm) => row(
            "shared memory",
            &format!(
                "{} MiB free in /dev/shm",
                shm.f_bavail * shm.f_frsize / (1 << 20)
            ),
            if shm.f_bavail * shm.f_frsize < 64 << 20 {
                "a cell wants 64 MiB"
            } else {
                ""
            },
        ),
        Err(error) => row(
            "shared memory",
            &format!("/dev/shm: {error}"),
            "a cell cannot run without it",
        ),
    }
    Ok(())
}

fn row(what: &str, found: &str, advice: &str) {
    let advice = if advice.is_empty() {
        String::new()
    } else {
        format!("\n{:21} -> {advice}", "")
    };
    say(&format!("{what:20} {found}{advice}"));
}

fn yes_no(yes: bool) -> &'static str {
    if yes { "yes" } else { "no" }
}

fn read(path: &str) -> Option<String> {
    fs::read_to_string(path).ok()
}

/// What the operating system refuses of priority and locked memory; tried in a thread of its own and given back.
fn what_is_refused() -> (Option<String>, Option<String>) {
    std::thread::spawn(|| {
        let fifo = realtime::raise(Priority::Machine)
            .err()
            .map(|e| e.to_string());
        realtime::lower();
        let memory = realtime::lock_memory().err().map(|e| e.to_string());
        let _ = rustix::mm::munlockall();
        (fifo, memory)
    })
    .join()
    .unwrap_or((
        Some("could not be tried".into()),
        Some("could not be tried".into()),
    ))
}

/// Says once, for the whole group, what realtime pace has to do without.
pub fn say_what_realtime_lacks() {
    let (fifo, memory) = what_is_refused();
    if let Some(error) = fifo {
        tracing::warn!(
            "realtime without SCHED_FIFO ({error}): scans will be missed when this PC is busy; see quadrant doctor"
        );
    }
    if let Some(error) = memory {
        tracing::warn!(
            "realtime without locked memory ({error}): a page fault can cost a scan; see quadrant doctor"
        );
    }
}

/// How late sleeps of 1 ms end: median, 99th percentile and worst, in µs.
fn timer_lateness_us() -> (f64, f64, f64) {
    let mut late: Vec<u64> = Vec::with_capacity(TIMER_SAMPLES);
    let mut next = realtime::now_ns() + 1_000_000;
    for _ in 0..TIMER_SAMPLES {
        realtime::sleep_until_ns(next);
        late.push(realtime::now_ns().saturating_sub(next));
        next = realtime::now_ns() + 1_000_000;
    }
    late.sort_unstable();
    let at = |part: f64| {
        let index = ((late.len() - 1) as f64 * part) as usize;
        late.get(index).copied().unwrap_or(0) as f64 / 1000.0
    };
    (at(0.5), at(0.99), at(1.0))
}
