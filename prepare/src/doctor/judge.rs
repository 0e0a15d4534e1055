//! Judges kernel, limits, memory and the like: facts in, findings out.

use super::facts::Facts;
use super::finding::Finding;
use bus::realtime::list;

/// Shared memory that a cell wants, in bytes: the queues of its services are sparse files that fill as they are used.
const SHARED_MEMORY_BYTES: u64 = 64 << 20;
/// Open files without which no cell runs: the master of three axes with standbys has 99.
const OPEN_FILES_MIN: u64 = 256;
/// Open files that leave room for eight axes with standbys and observers.
const OPEN_FILES_WANTED: u64 = 1024;
/// The share of a scan that its beginning may be late by: the processes have the rest.
const LATE_SHARE: f64 = 0.2;

/// Everything but the processors.
pub fn judge(facts: &Facts) -> Vec<Finding> {
    let judges = [
        kernel,
        priority,
        locked_memory,
        throttling,
        scans,
        timer_slack,
        clock_source,
        shared_memory,
        remove_ipc,
        open_files,
        core_dumps,
        swap,
        huge_pages,
        virtual_machine,
    ];
    judges.iter().filter_map(|judge| judge(facts)).collect()
}

fn kernel(facts: &Facts) -> Option<Finding> {
    let what = "kernel";
    let version = &facts.kernel_version;
    if facts.kernel_realtime.as_deref() == Some("1") || version.contains("PREEMPT_RT") {
        return Some(Finding::fine(what, "PREEMPT_RT"));
    }
    let dynamic = version.contains("PREEMPT_DYNAMIC");
    let full = facts
        .kernel_arguments
        .split(' ')
        .any(|a| a == "preempt=full");
    let found = match (dynamic, full) {
        (true, true) => "no PREEMPT_RT; preempt=full",
        (true, false) => "no PREEMPT_RT; PREEMPT_DYNAMIC, preempt=full not asked for",
        (false, _) => "no PREEMPT_RT",
    };
    let package = format!("apt install linux-image-rt-{}", facts.architecture);
    let mut change = vec![package.as_str(), "reboot"];
    if dynamic && !full {
        change.extend([
            "# or, with this kernel: preempt=full in GRUB_CMDLINE_LINUX of /etc/default/grub, then",
            "update-grub && reboot",
        ]);
    }
    let why = "an ordinary kernel may delay a scan by milliseconds; fine for simulation, not for a machine";
    Some(Finding::better(what, found, why, &change))
}

fn priority(facts: &Facts) -> Option<Finding> {
    let what = "SCHED_FIFO";
    let limit = match facts.rtprio_limit {
        None => "rtprio without limit".to_string(),
        Some(limit) => format!("rtprio limit {limit}"),
    };
    let Some(error) = &facts.refused.priority else {
        let found = match facts.rtprio_limit {
            Some(limit) if limit < 60 => "allowed (by privilege)".into(),
            _ => format!("allowed ({limit})"),
        };
        return Some(Finding::fine(what, found));
    };
    Some(Finding::must(
        what,
        format!("refused: {error} ({limit})"),
        "without priority every other process of this PC goes before a scan; 60 is asked for",
        &[
            "groupadd -f realtime && usermod -aG realtime USER    # who runs cells",
            "echo '@realtime - rtprio 95' >> /etc/security/limits.d/quadrant.conf",
            "# log in again; in a systemd unit: LimitRTPRIO=95",
        ],
    ))
}

fn locked_memory(facts: &Facts) -> Option<Finding> {
    let what = "locked memory";
    let limit = match facts.memlock_limit {
        None => "memlock without limit".to_string(),
        Some(bytes) => format!("memlock limit {} KiB", bytes >> 10),
    };
    let Some(error) = &facts.refused.memory else {
        let found = match facts.memlock_limit {
            Some(bytes) if bytes < SHARED_MEMORY_BYTES => "allowed (by privilege)".into(),
            _ => format!("allowed ({limit})"),
        };
        return Some(Finding::fine(what, found));
    };
    Some(Finding::must(
        what,
        format!("refused: {error} ({limit})"),
        "a page that is not in memory costs a scan when it is touched; a process locks some 40 MiB",
        &[
            "groupadd -f realtime && usermod -aG realtime USER    # who runs cells",
            "echo '@realtime - memlock unlimited' >> /etc/security/limits.d/quadrant.conf",
            "# log in again; in a systemd unit: LimitMEMLOCK=infinity",
        ],
    ))
}

fn throttling(facts: &Facts) -> Option<Finding> {
    let what = "realtime throttling";
    let (runtime_us, period_us) = facts.throttling_us?;
    if runtime_us < 0 {
        let note = "a process in an endless loop at real-time priority can freeze this PC";
        return Some(Finding::fine(what, "off").because(note));
    }
    let share = 100.0 * runtime_us as f64 / period_us.max(1) as f64;
    let found = format!("{runtime_us} µs of every {period_us} µs ({share:.0} %)");
    let back = ["sysctl -w kernel.sched_rt_runtime_us=950000"];
    if runtime_us == 0 {
        let why = "no real-time process gets the processor at all";
        return Some(Finding::must(what, found, why, &back));
    }
    if share < 50.0 {
        let why = "a cell that is busy for longer stands until the next period: scans are missed";
        return Some(Finding::better(what, found, why, &back));
    }
    Some(Finding::fine(what, found))
}

fn scans(facts: &Facts) -> Option<Finding> {
    let what = "scans";
    let seen = &facts.measured;
    let (period_us, on) = (f64::from(seen.scan_period_us), list(&seen.processors));
    let priority = match seen.priority {
        0 => "no SCHED_FIFO".into(),
        level => format!("SCHED_FIFO {level}"),
    };
    let memory = if seen.memory_locked { "" } else { "not " };
    let found = format!(
        "{} of {period_us} µs begun as a master would ({priority}, memory {memory}locked, processors {on}): {:.0} µs late (half), \
         {:.0} µs (99 %), {:.0} µs (worst); {} lost, begun a whole scan late",
        seen.scans, seen.p50_us, seen.p99_us, seen.max_us, seen.lost_scans
    );
    if seen.max_us <= period_us * LATE_SHARE {
        return Some(Finding::fine(what, format!("{found}: fit for a machine")));
    }
    let why = match seen.lost_scans {
        0 => {
            "none was lost, but the worst left its scan little time: fit for simulation, for a machine only if it gets no worse"
        }
        _ => "a drive gets nothing in a scan that is lost: fit for simulation, not for a machine",
    };
    let change = [
        "# what else stands here is mostly the cause: kernel, SCHED_FIFO, governor, idle states",
        "# processors for the cell alone: docs/howto/realtime.md; then again, under load:",
        "quadrant doctor MACHINE --seconds 600",
    ];
    if seen.p99_us >= period_us {
        return Some(Finding::must(
            what,
            found,
            "one scan in a hundred is lost, or more",
            &change,
        ));
    }
    Some(Finding::better(what, found, why, &change))
}

fn timer_slack(facts: &Facts) -> Option<Finding> {
    let what = "timer slack";
    let slack_us = facts.timer_slack_ns? as f64 / 1000.0;
    let found = format!("{slack_us} µs for ordinary threads, none under SCHED_FIFO");
    if facts.refused.priority.is_none() || slack_us <= 50.0 {
        return Some(Finding::fine(what, found));
    }
    Some(Finding::better(
        what,
        found,
        "without SCHED_FIFO every sleep may end that much later, so that wake-ups can be put together",
        &["# get SCHED_FIFO allowed, see there; or in the systemd unit: TimerSlackNSec=1"],
    ))
}

fn clock_source(facts: &Facts) -> Option<Finding> {
    let what = "clock source";
    let (current, available) = facts.clock_source.as_ref()?;
    let slow = ["hpet", "acpi_pm", "refined-jiffies", "jiffies", "pit"];
    if !slow.contains(&current.as_str()) {
        return Some(Finding::fine(what, current.as_str()));
    }
    let why =
        "every look at the clock asks a slow device: a microsecond or more, several times a scan";
    let switch = "echo tsc > /sys/devices/system/clocksource/clocksource0/current_clocksource";
    let change = if available.iter().any(|name| name == "tsc") {
        vec![
            switch,
            "# for good: clocksource=tsc on the kernel's command line",
        ]
    } else {
        vec![
            "dmesg | grep -i tsc    # says why the kernel does not trust the processor's counter",
            "# if the hardware is known to be good: tsc=reliable on the kernel's command line",
        ]
    };
    Some(Finding::better(what, current.as_str(), why, &change))
}

fn shared_memory(facts: &Facts) -> Option<Finding> {
    let what = "shared memory";
    let mount = "mount -t tmpfs -o mode=1777,size=50% tmpfs /dev/shm";
    let memory = match facts.shared_memory.as_ref()? {
        Ok(memory) => memory,
        Err(error) => {
            return Some(Finding::must(
                what,
                format!("/dev/shm: {error}"),
                "all samples of a cell pass through files there",
                &[
                    mount,
                    "chmod 1777 /dev/shm",
                    "# in a container: --ipc=host or --shm-size=256m",
                ],
            ));
        }
    };
    let mib = |bytes: u64| bytes >> 20;
    let found = format!(
        "{} of {} MiB free in /dev/shm",
        mib(memory.free_bytes),
        mib(memory.size_bytes)
    );
    if memory.free_bytes < SHARED_MEMORY_BYTES {
        return Some(Finding::must(
            what,
            found,
            "a cell wants 64 MiB; a process that finds no room there is ended by SIGBUS",
            &[
                "ls -l /dev/shm    # what a crash left of a cell goes with: quadrant clean CELL",
                "mount -o remount,size=50% /dev/shm    # in a container: --shm-size=256m",
            ],
        ));
    }
    if !memory.in_memory {
        let why = "it is no file system in memory: samples may be written to a disk";
        return Some(Finding::better(what, found, why, &[mount]));
    }
    Some(Finding::fine(what, found))
}

fn remove_ipc(facts: &Facts) -> Option<Finding> {
    let what = "RemoveIPC";
    // logind spares root and system users (ids below 1000).
    const FIRST_ORDINARY_USER: u32 = 1000;
    let configured = facts.logind?;
    let found = match configured {
        Some(true) => "yes (logind.conf)",
        Some(false) => return Some(Finding::fine(what, "no (logind.conf)")),
        None => "yes (the default of logind)",
    };
    if facts.uid < FIRST_ORDINARY_USER {
        let note = format!("{found}; not for system users");
        return Some(Finding::fine(what, note));
    }
    Some(Finding::better(
        what,
        found,
        "when this user's last session ends, logind removes the user's files in /dev/shm from under a cell that still runs",
        &[
            "mkdir -p /etc/systemd/logind.conf.d",
            "printf '[Login]\\nRemoveIPC=no\\n' > /etc/systemd/logind.conf.d/quadrant.conf",
            "systemctl restart systemd-logind",
            "# or run the cell as a service of a system user: docs/howto/service.md",
        ],
    ))
}

fn open_files(facts: &Facts) -> Option<Finding> {
    let what = "open files";
    let (soft, hard) = facts.open_files_limit;
    let Some(limit) = soft else {
        return Some(Finding::fine(what, "no limit"));
    };
    let found = format!("limit {limit}");
    if limit >= OPEN_FILES_WANTED {
        return Some(Finding::fine(what, found));
    }
    let raise = if hard.is_none_or(|hard| hard >= OPEN_FILES_WANTED) {
        "ulimit -n 1024"
    } else {
        "echo '* - nofile 1024' >> /etc/security/limits.d/quadrant.conf    # log in again"
    };
    let change = [raise, "# in a systemd unit: LimitNOFILE=1024"];
    if limit < OPEN_FILES_MIN {
        let why = "every connection between two processes is a file: the master of three axes with standbys has 99";
        return Some(Finding::must(what, found, why, &change));
    }
    let why = "eight axes with standbys and a few monitors may want more";
    Some(Finding::better(what, found, why, &change))
}

fn core_dumps(facts: &Facts) -> Option<Finding> {
    let what = "core dumps";
    let pattern = facts.core_pattern.as_deref()?;
    let piped = pattern.starts_with('|');
    let why = "while a process that crashed is being dumped it keeps its locks: its replacement waits, for seconds with a large one";
    if piped {
        // core(5): the limit is not enforced for dumps into a pipe.
        return Some(Finding::better(
            what,
            "piped into a program".to_string(),
            why,
            &[
                "sysctl -w kernel.core_pattern=core    # with LimitCORE=0 or ulimit -c 0 there is none",
                "# for good: kernel.core_pattern=core in /etc/sysctl.d/90-quadrant.conf",
            ],
        ));
    }
    if facts.core_limit == Some(0) {
        return Some(Finding::fine(what, "off (limit 0)"));
    }
    let change = ["ulimit -c 0", "# in a systemd unit: LimitCORE=0"];
    Some(Finding::better(what, "on", why, &change))
}

fn swap(facts: &Facts) -> Option<Finding> {
    let what = "swap";
    if facts.swap.is_empty() {
        return Some(Finding::fine(what, "none"));
    }
    let found = facts.swap.join(", ");
    if facts.refused.memory.is_none() {
        return Some(Finding::fine(
            what,
            format!("{found}; a cell locks its memory"),
        ));
    }
    Some(Finding::better(
        what,
        found,
        "memory that is not locked can be swapped out, and back in while a scan waits",
        &["# get locked memory allowed, see there; or", "swapoff -a"],
    ))
}

fn huge_pages(facts: &Facts) -> Option<Finding> {
    let what = "huge pages";
    let text = facts.huge_pages.as_deref()?;
    let chosen = text.split_whitespace().find(|word| word.starts_with('['));
    let chosen = chosen.map_or(text, |word| word.trim_matches(['[', ']']));
    let found = format!("transparent: {chosen}");
    if chosen != "always" {
        return Some(Finding::fine(what, found));
    }
    Some(Finding::better(
        what,
        found,
        "the kernel joins pages behind a process's back and stalls it meanwhile",
        &[
            "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled",
            "# for good: transparent_hugepage=madvise on the kernel's command line",
        ],
    ))
}

fn virtual_machine(facts: &Facts) -> Option<Finding> {
    let what = "virtual machine";
    let Some(maker) = &facts.virtual_machine else {
        return Some(Finding::fine(what, "no"));
    };
    let found = if maker.is_empty() {
        "yes".to_string()
    } else {
        format!("yes: {maker}")
    };
    Some(Finding::better(
        what,
        found,
        "the host may take a processor away at any time, and nobody in here can see it; fine for simulation",
        &[
            "# run a machine on hardware; on a host of one's own, a processor for each virtual one:",
            "virsh vcpupin DOMAIN VCPU CPU    # and <vcpusched scheduler='fifo' priority='1'/>",
        ],
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::facts::SharedMemory;
    use crate::doctor::finding::Grade;
    use crate::doctor::lateness::Lateness;
    use bus::realtime::Refused;

    /// A PC on which there is nothing to find.
    pub fn good() -> Facts {
        Facts {
            kernel_version: "#1 SMP PREEMPT_RT".into(),
            architecture: "amd64",
            rtprio_limit: Some(95),
            core_limit: Some(0),
            core_pattern: Some("core".into()),
            throttling_us: Some((950_000, 1_000_000)),
            measured: Lateness {
                scan_period_us: 1000,
                scans: 10_000,
                max_us: 200.0,
                ..Lateness::default()
            },
            timer_slack_ns: Some(50_000),
            clock_source: Some(("tsc".into(), vec!["tsc".into(), "hpet".into()])),
            shared_memory: Some(Ok(SharedMemory {
                free_bytes: 1 << 30,
                size_bytes: 2 << 30,
                in_memory: true,
            })),
            huge_pages: Some("always [madvise] never".into()),
            logind: Some(Some(false)),
            uid: 1000,
            ..Facts::default()
        }
    }

    fn grade(of: &str, facts: &Facts) -> Grade {
        let findings = judge(facts);
        let finding = findings.iter().find(|finding| finding.what == of);
        finding.unwrap_or_else(|| panic!("no finding {of:?}")).grade
    }

    #[test]
    fn a_pc_made_for_it_has_nothing_to_change() {
        for finding in judge(&good()) {
            assert_eq!(finding.grade, Grade::Fine, "{finding:?}");
            assert!(finding.change.is_empty(), "{finding:?}");
        }
    }

    #[test]
    #[expect(clippy::too_many_lines, reason = "a table of findings")]
    fn each_thing_that_is_wrong_is_graded_and_says_why_and_what_to_change() {
        let refused = Refused {
            priority: Some("Operation not permitted".into()),
            memory: Some("Cannot allocate memory".into()),
        };
        let shm = |free_bytes, in_memory| {
            Some(Ok(SharedMemory {
                free_bytes,
                size_bytes: 2 << 30,
                in_memory,
            }))
        };
        type Spoil = Box<dyn Fn(&mut Facts)>;
        let cases: Vec<(&str, Grade, Spoil)> = vec![
            (
                "kernel",
                Grade::Better,
                Box::new(|f| f.kernel_version = "#1 SMP PREEMPT_DYNAMIC".into()),
            ),
            (
                "kernel",
                Grade::Better,
                Box::new(|f| f.kernel_version = "#1 SMP".into()),
            ),
            ("SCHED_FIFO", Grade::Must, {
                let refused = refused.clone();
                Box::new(move |f| f.refused = refused.clone())
            }),
            ("locked memory", Grade::Must, {
                let refused = refused.clone();
                Box::new(move |f| f.refused = refused.clone())
            }),
            (
                "swap",
                Grade::Better,
                Box::new(move |f| {
                    f.refused = refused.clone();
                    f.swap = vec!["/swap".into()];
                }),
            ),
            (
                "realtime throttling",
                Grade::Must,
                Box::new(|f| f.throttling_us = Some((0, 1_000_000))),
            ),
            (
                "realtime throttling",
                Grade::Better,
                Box::new(|f| f.throttling_us = Some((100_000, 1_000_000))),
            ),
            (
                "scans",
                Grade::Better,
                Box::new(|f| f.measured.max_us = 201.0),
            ),
            (
                "scans",
                Grade::Must,
                Box::new(|f| {
                    f.measured.p99_us = 1000.0;
                    f.measured.max_us = 1500.0;
                }),
            ),
            (
                "timer slack",
                Grade::Better,
                Box::new(|f| {
                    f.refused.priority = Some("no".into());
                    f.timer_slack_ns = Some(1_000_000);
                }),
            ),
            (
                "clock source",
                Grade::Better,
                Box::new(|f| f.clock_source = Some(("hpet".into(), vec!["hpet".into()]))),
            ),
            (
                "shared memory",
                Grade::Must,
                Box::new(|f| f.shared_memory = Some(Err("Permission denied".into()))),
            ),
            (
                "shared memory",
                Grade::Must,
                Box::new(move |f| f.shared_memory = shm((64 << 20) - 1, true)),
            ),
            (
                "shared memory",
                Grade::Better,
                Box::new(move |f| f.shared_memory = shm(1 << 30, false)),
            ),
            (
                "RemoveIPC",
                Grade::Better,
                Box::new(|f| f.logind = Some(None)),
            ),
            (
                "RemoveIPC",
                Grade::Better,
                Box::new(|f| f.logind = Some(Some(true))),
            ),
            (
                "open files",
                Grade::Must,
                Box::new(|f| f.open_files_limit = (Some(255), Some(4096))),
            ),
            (
                "open files",
                Grade::Better,
                Box::new(|f| f.open_files_limit = (Some(1023), Some(1023))),
            ),
            (
                "core dumps",
                Grade::Better,
                Box::new(|f| f.core_pattern = Some("|/usr/lib/systemd/systemd-coredump".into())),
            ),
            (
                "core dumps",
                Grade::Better,
                Box::new(|f| f.core_limit = None),
            ),
            (
                "huge pages",
                Grade::Better,
                Box::new(|f| f.huge_pages = Some("[always] madvise never".into())),
            ),
            (
                "virtual machine",
                Grade::Better,
                Box::new(|f| f.virtual_machine = Some(String::new())),
            ),
        ];
        for (what, expected, spoil) in cases {
            let mut facts = good();
            spoil(&mut facts);
            assert_eq!(grade(what, &facts), expected, "{what}");
            for finding in judge(&facts) {
                let printed = !finding.why.is_empty() && !finding.change.is_empty();
                assert!(printed || finding.grade == Grade::Fine, "{finding:?}");
            }
        }
    }

    #[test]
    fn a_system_user_and_a_pc_without_logind_have_nothing_to_fear_from_it() {
        let mut facts = good();
        facts.logind = Some(None);
        facts.uid = 0;
        assert_eq!(grade("RemoveIPC", &facts), Grade::Fine);
        facts.logind = None;
        assert!(judge(&facts).iter().all(|f| f.what != "RemoveIPC"));
    }

    #[test]
    fn swap_is_no_matter_where_memory_is_locked_and_slack_none_under_priority() {
        let mut facts = good();
        facts.swap = vec!["/swap".into()];
        facts.timer_slack_ns = Some(1_000_000);
        assert_eq!(grade("swap", &facts), Grade::Fine);
        assert_eq!(grade("timer slack", &facts), Grade::Fine);
    }
}
