//! What those take of a run who only watch it: recorder, launcher and report.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::Child;
use std::time::{Duration, Instant};

use anyhow::Context;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process, waitid};

use crate::processor_time;
use console::signals::Signals;

/// How often they are looked at: what one takes behind the last look is missed.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// How often they are weighed: that takes longer.
const WEIGH_EVERY: Duration = Duration::from_millis(200);
/// Subcommands of those who watch.
const WATCHERS: [&str; 2] = ["recorder", "report"];

/// Processor time of a run, in s.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Watched {
    /// Of all its processes.
    pub all_s: f64,
    /// Of the launcher alone.
    pub launcher_s: f64,
    /// Of the recorder.
    pub recorder_s: f64,
    /// Of the report that is made at its end.
    pub report_s: f64,
    /// The most memory that the launcher and its children took together, shared pages shared out (Pss), in MB.
    pub memory_mb: f64,
}

impl Watched {
    /// Those who only watch together.
    pub fn watching_s(&self) -> f64 {
        self.launcher_s + self.recorder_s + self.report_s
    }

    /// Their part of all, in percent.
    pub fn percent(&self, part_s: f64) -> f64 {
        100.0 * part_s / self.all_s.max(1e-9)
    }
}

/// Watches a run to its end: who takes how much.
///
/// # Errors
/// /proc says nothing of it.
pub(crate) fn watch(launcher: &mut Child, signals: &Signals) -> anyhow::Result<Watched> {
    // Ended, but still there to be asked how long it took.
    let ended = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT | WaitIdOptions::NOHANG;
    let pid = Pid::from_child(launcher);
    let mut seen: BTreeMap<u32, Seen> = BTreeMap::new();
    let mut handed_on = false;
    let mut memory_mb = 0.0_f64;
    let mut weighed = Instant::now();
    while waitid(WaitId::Pid(pid), ended)?.is_none() {
        if signals.count() > 0 && !handed_on {
            handed_on = true;
            kill_process(pid, Signal::INT)?;
        }
        look(launcher.id(), &mut seen);
        if weighed.elapsed() > WEIGH_EVERY {
            weighed = Instant::now();
            let all = children_of(launcher.id()).into_iter();
            let all = all.chain([launcher.id()]).map(pss_mb);
            memory_mb = memory_mb.max(all.sum());
        }
        std::thread::sleep(LOOK_EVERY);
    }
    let stat = processor_time::stat(launcher.id());
    let stat = stat.context("/proc says nothing of the launcher")?;
    let of = |who: &str| {
        let its = seen.values().filter(|seen| seen.role == who);
        its.fold(0.0, |all_s, seen| all_s + seen.took_s)
    };
    Ok(Watched {
        all_s: stat.own_s + stat.children_s,
        launcher_s: stat.own_s,
        recorder_s: of("recorder"),
        report_s: of("report"),
        memory_mb,
    })
}

/// Memory of a process, with its part of what it shares; 0 of one that has gone.
fn pss_mb(pid: u32) -> f64 {
    let text = fs::read_to_string(format!("/proc/{pid}/smaps_rollup")).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("Pss:"));
    let kb = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
    kb.unwrap_or(0.0) / 1e3
}

/// A child of the launcher.
struct Seen {
    role: String,
    took_s: f64,
}

/// Looks at the launcher's children that only watch.
fn look(launcher: u32, seen: &mut BTreeMap<u32, Seen>) {
    for pid in children_of(launcher) {
        // Between fork and exec it still has its parent's name.
        let role = seen.get(&pid).map(|seen| seen.role.clone());
        let role = role.filter(|role| !role.is_empty());
        let role = role.unwrap_or_else(|| role_of(pid));
        let watches = WATCHERS.contains(&role.as_str());
        let took_s = watches.then(|| processor_time::of_living_threads_s(pid));
        let took_s = took_s.flatten().unwrap_or(0.0);
        let its = seen.entry(pid).or_insert(Seen {
            role: String::new(),
            took_s,
        });
        its.role = role;
        // Threads that have ended are in it no more.
        its.took_s = its.took_s.max(took_s);
    }
}

fn children_of(pid: u32) -> Vec<u32> {
    let threads = fs::read_dir(format!("/proc/{pid}/task"));
    let threads = threads.into_iter().flatten().flatten();
    let lists =
        threads.filter_map(|thread| fs::read_to_string(thread.path().join("children")).ok());
    lists
        .flat_map(|list| {
            let pids = list.split_whitespace().map(str::to_owned);
            pids.collect::<Vec<_>>()
        })
        .filter_map(|pid| pid.parse().ok())
        .collect()
}

/// The subcommand of a process that stands by that name only; nothing of one that is not yet what it will be.
fn role_of(pid: u32) -> String {
    let line = fs::read(PathBuf::from(format!("/proc/{pid}/cmdline"))).unwrap_or_default();
    let mut words = line.split(|byte| *byte == 0).skip(1);
    let role = words.next().unwrap_or_default();
    match String::from_utf8_lossy(role).into_owned() {
        role if role == "run" => String::new(),
        role => role,
    }
}
