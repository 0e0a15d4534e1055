//! Processor time of processes, from /proc.

use std::fs;

use rustix::time::{ClockId, clock_gettime};

/// Unit of processor times in /proc/PID/stat: USER_HZ, 100 on every architecture this runs on.
const CLOCK_TICKS_PER_S: f64 = 100.0;

/// Of the calling thread, in s.
pub(crate) fn of_thread_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Of all threads that a process has now, in s, to the ns (schedstat); none of one that is gone. What threads took that have ended is
/// not in it.
pub(crate) fn of_living_threads_s(pid: u32) -> Option<f64> {
    let mut all_ns = 0_u64;
    for thread in fs::read_dir(format!("/proc/{pid}/task")).ok()?.flatten() {
        if let Ok(text) = fs::read_to_string(thread.path().join("schedstat")) {
            let ran = text.split_whitespace().next();
            all_ns += ran.and_then(|ns| ns.parse::<u64>().ok()).unwrap_or(0);
        }
    }
    (all_ns > 0).then_some(all_ns as f64 * 1e-9)
}

/// Times in user and kernel mode, in s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stat {
    /// Of the process itself, with threads that have ended.
    pub own_s: f64,
    /// Of children that it has waited for, and theirs.
    pub children_s: f64,
}

/// What /proc/PID/stat says (proc(5), fields 14 to 17), also of a process that has ended and was not waited for.
pub(crate) fn stat(pid: u32) -> Option<Stat> {
    parse(&fs::read_to_string(format!("/proc/{pid}/stat")).ok()?)
}

fn parse(text: &str) -> Option<Stat> {
    // A name may have brackets and spaces in it.
    let (_, rest) = text.rsplit_once(')')?;
    let words = rest.split_whitespace().skip(11).take(4);
    let ticks: Vec<f64> = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let &[user, system, children_user, children_system] = ticks.as_slice() else {
        return None;
    };
    Some(Stat {
        own_s: (user + system) / CLOCK_TICKS_PER_S,
        children_s: (children_user + children_system) / CLOCK_TICKS_PER_S,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_found_behind_a_name_with_brackets() {
        let text = "7 (a) b) S 1 7 7 0 -1 4194560 100 0 0 0 120 30 50 25 20 0 1 0";
        let stat = parse(text).expect("a process");
        assert_eq!((stat.own_s, stat.children_s), (1.5, 0.75));
        assert_eq!(parse("7 (a) S 1"), None);
    }

    #[test]
    fn this_process_takes_time() {
        let before_s = of_thread_s();
        while of_thread_s() < before_s + 0.02 {}
        let own_s = of_living_threads_s(std::process::id()).expect("of this process");
        assert!(own_s >= 0.02, "{own_s}");
        assert!(stat(std::process::id()).is_some());
    }
}
