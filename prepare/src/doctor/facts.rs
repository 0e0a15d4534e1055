//! What the system says of itself. Nothing is judged here; what it does not say is none.

use std::fs;
use std::path::Path;

use rustix::process::{Resource, getrlimit};

use super::lateness::Lateness;
use bus::realtime::Refused;

/// Everything that is judged.
#[derive(Debug, Clone, Default)]
pub struct Facts {
    /// Kernel release and processors, for the heading.
    pub host: String,
    /// `uname -v`.
    pub kernel_version: String,
    /// `/sys/kernel/realtime`.
    pub kernel_realtime: Option<String>,
    /// The kernel's command line.
    pub kernel_arguments: String,
    /// Debian's name of the architecture.
    pub architecture: &'static str,
    /// What was refused when it was tried.
    pub refused: Refused,
    /// Soft limit of real-time priority; none without limit.
    pub rtprio_limit: Option<u64>,
    /// Soft limit of locked memory, in bytes; none without limit.
    pub memlock_limit: Option<u64>,
    /// Soft and hard limit of open files; none without limit.
    pub open_files_limit: (Option<u64>, Option<u64>),
    /// Soft limit of core dumps, in bytes; none without limit.
    pub core_limit: Option<u64>,
    /// `/proc/sys/kernel/core_pattern`.
    pub core_pattern: Option<String>,
    /// `sched_rt_runtime_us` and `sched_rt_period_us`.
    pub throttling_us: Option<(i64, i64)>,
    /// How late scans begin.
    pub measured: Lateness,
    /// Slack of ordinary threads' timers, in ns.
    pub timer_slack_ns: Option<u64>,
    /// Clock source in use, and the others.
    pub clock_source: Option<(String, Vec<String>)>,
    /// Type, free and whole size of `/dev/shm` in bytes, or why not.
    pub shared_memory: Option<Result<SharedMemory, String>>,
    /// Swap spaces.
    pub swap: Vec<String>,
    /// `transparent_hugepage/enabled`.
    pub huge_pages: Option<String>,
    /// Whether there is a logind, and what its files say of `RemoveIPC`, last word last.
    pub logind: Option<Option<bool>>,
    /// User id.
    pub uid: u32,
    /// Whether the processor says that it is a virtual one, and the maker's words.
    pub virtual_machine: Option<String>,
    /// Processors this process may use.
    pub processors: Vec<usize>,
    /// Governors in use, each once.
    pub governors: Vec<String>,
    /// Whether threads share cores.
    pub smt_active: bool,
    /// Isolated processors.
    pub isolated: Vec<usize>,
    /// Interrupts that may go to isolated processors: number and processors.
    pub interrupts_on_isolated: Vec<u32>,
    /// Longest time that an idle state in use takes to leave, in µs, with its name.
    pub idle_exit: Option<(u64, String)>,
}

/// `/dev/shm`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedMemory {
    /// Free, in bytes.
    pub free_bytes: u64,
    /// In all, in bytes.
    pub size_bytes: u64,
    /// A file system in memory.
    pub in_memory: bool,
}

fn read(path: impl AsRef<Path>) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    Some(text.trim().to_string())
}

fn number<T: std::str::FromStr>(path: &str) -> Option<T> {
    read(path)?.parse().ok()
}

impl Facts {
    /// Asks the system, and tries what only trying tells.
    pub fn gather(measured: Lateness) -> Facts {
        let uname = rustix::system::uname();
        let kernel_version = uname.version().to_string_lossy().into_owned();
        let processors = bus::realtime::processors();
        let isolated = cpu_list(&read("/sys/devices/system/cpu/isolated").unwrap_or_default());
        let release = uname.release().to_string_lossy();
        Facts {
            host: format!("Linux {release}, {} processors", processors.len()),
            kernel_version,
            kernel_realtime: read("/sys/kernel/realtime"),
            kernel_arguments: read("/proc/cmdline").unwrap_or_default(),
            architecture: match std::env::consts::ARCH {
                "x86_64" => "amd64",
                "aarch64" => "arm64",
                other => other,
            },
            refused: Refused::by_trying(),
            rtprio_limit: getrlimit(Resource::Rtprio).current,
            memlock_limit: getrlimit(Resource::Memlock).current,
            open_files_limit: {
                let limit = getrlimit(Resource::Nofile);
                (limit.current, limit.maximum)
            },
            core_limit: getrlimit(Resource::Core).current,
            core_pattern: read("/proc/sys/kernel/core_pattern"),
            throttling_us: number("/proc/sys/kernel/sched_rt_runtime_us")
                .zip(number("/proc/sys/kernel/sched_rt_period_us")),
            measured,
            timer_slack_ns: number("/proc/self/timerslack_ns"),
            clock_source: clock_source(),
            shared_memory: Some(shared_memory()),
            swap: swaps(&read("/proc/swaps").unwrap_or_default()),
            huge_pages: read("/sys/kernel/mm/transparent_hugepage/enabled"),
            logind: Path::new("/run/systemd/slots").exists().then(logind_files),
            uid: rustix::process::getuid().as_raw(),
            virtual_machine: virtual_machine(),
            governors: governors(),
            smt_active: read("/sys/devices/system/cpu/smt/active").as_deref() == Some("1"),
            interrupts_on_isolated: interrupts_on(&isolated),
            idle_exit: idle_exit(),
            isolated,
            processors,
        }
    }
}

fn clock_source() -> Option<(String, Vec<String>)> {
    let folder = Path::new("/sys/devices/system/clocksource/clocksource0");
    let others = read(folder.join("available_clocksource"))?;
    let others = others.split_whitespace().map(str::to_string).collect();
    Some((read(folder.join("current_clocksource"))?, others))
}

fn shared_memory() -> Result<SharedMemory, String> {
    /// `TMPFS_MAGIC` and `RAMFS_MAGIC` of linux/magic.h.
    const IN_MEMORY: [u64; 2] = [0x0102_1994, 0x8584_58f6];
    let of = rustix::fs::statvfs("/dev/shm").map_err(|error| error.to_string())?;
    let kind = rustix::fs::statfs("/dev/shm").map_err(|error| error.to_string())?;
    tempfile::tempfile_in("/dev/shm").map_err(|error| error.to_string())?;
    Ok(SharedMemory {
        free_bytes: of.f_bavail.saturating_mul(of.f_frsize),
        size_bytes: of.f_blocks.saturating_mul(of.f_frsize),
        in_memory: IN_MEMORY.contains(&(kind.f_type as u64)),
    })
}

/// Names in `/proc/swaps`.
pub fn swaps(text: &str) -> Vec<String> {
    let lines = text.lines().skip(1);
    lines
        .filter_map(|line| Some(line.split_whitespace().next()?.to_string()))
        .collect()
}

/// What `logind.conf` and the files that amend it say of `RemoveIPC`.
fn logind_files() -> Option<bool> {
    let mut files = vec![Path::new("/etc/systemd/logind.conf").to_path_buf()];
    let mut more = Vec::new();
    for folder in ["/usr/lib", "/run", "/etc"] {
        let folder = format!("{folder}/systemd/logind.conf.d");
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        more.extend(entries.map(|entry| entry.path()));
    }
    // By name, wherever they stand.
    more.sort_by_key(|path| path.file_name().map(|name| name.to_os_string()));
    files.extend(more);
    files
        .iter()
        .filter_map(|file| remove_ipc(&read(file)?))
        .next_back()
}

/// The last word of a `logind.conf` on `RemoveIPC`.
pub fn remove_ipc(text: &str) -> Option<bool> {
    let mut lines = text.lines().filter_map(|line| line.split_once('='));
    let (_, value) = lines.rfind(|(name, _)| name.trim() == "RemoveIPC")?;
    Some(matches!(value.trim(), "yes" | "true" | "on" | "1"))
}

fn virtual_machine() -> Option<String> {
    let flags = read("/proc/cpuinfo")?;
    let hypervised = flags
        .lines()
        .filter(|line| line.starts_with("flags"))
        .any(|line| line.split_whitespace().any(|flag| flag == "hypervisor"));
    let maker = ["sys_vendor", "product_name"]
        .iter()
        .filter_map(|name| read(Path::new("/sys/class/dmi/id").join(name)))
        .collect::<Vec<_>>()
        .join(" ");
    let known = ["QEMU", "VMware", "VirtualBox", "KVM", "Xen", "Bochs"];
    let made = known.iter().any(|name| maker.contains(name));
    (hypervised || made).then_some(maker)
}

fn governors() -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let entries = fs::read_dir("/sys/devices/system/cpu")
        .into_iter()
        .flatten();
    for entry in entries.flatten() {
        if let Some(governor) = read(entry.path().join("cpufreq/scaling_governor"))
            && !found.contains(&governor)
        {
            found.push(governor);
        }
    }
    found.sort();
    found
}

fn idle_exit() -> Option<(u64, String)> {
    let states = fs::read_dir("/sys/devices/system/cpu/cpu0/cpuidle").ok()?;
    let states = states.flatten().filter_map(|entry| {
        let disabled = read(entry.path().join("disable")).as_deref() == Some("1");
        let latency_us = read(entry.path().join("latency"))?.parse().ok()?;
        let name = read(entry.path().join("name"))?;
        (!disabled).then_some((latency_us, name))
    });
    states.max()
}

fn interrupts_on(isolated: &[usize]) -> Vec<u32> {
    if isolated.is_empty() {
        return Vec::new();
    }
    let entries = fs::read_dir("/proc/irq").into_iter().flatten().flatten();
    let mut found: Vec<u32> = entries
        .filter_map(|entry| {
            let number = entry.file_name().to_str()?.parse().ok()?;
            let list = read(entry.path().join("effective_affinity_list"))?;
            let meets = cpu_list(&list).iter().any(|cpu| isolated.contains(cpu));
            meets.then_some(number)
        })
        .collect();
    found.sort_unstable();
    found
}

/// Processors of a list as the kernel writes it: `0-2,5`. At most 4096.
pub fn cpu_list(text: &str) -> Vec<usize> {
    const MOST: usize = 4096;
    let mut cpus = Vec::new();
    for range in text.split(',').filter(|range| !range.is_empty()) {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        if let (Ok(first), Ok(last)) = (first.trim().parse(), last.trim().parse::<usize>()) {
            cpus.extend((first..=last.min(MOST)).take(MOST - cpus.len().min(MOST)));
        }
    }
    cpus
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_processors_are_read_as_the_kernel_writes_them() {
        assert_eq!(cpu_list("0-2,5"), [0, 1, 2, 5]);
        assert_eq!(cpu_list(""), [0usize; 0]);
        assert_eq!(cpu_list("3\n"), [3]);
        assert_eq!(cpu_list("x,2-1"), [0usize; 0]);
        assert!(cpu_list("0-99999999").len() <= 4097);
    }

    #[test]
    fn the_last_word_on_remove_ipc_counts_and_a_comment_is_none() {
        assert_eq!(remove_ipc("[Login]\n#RemoveIPC=yes\n"), None);
        assert_eq!(remove_ipc("RemoveIPC=yes\nRemoveIPC = no\n"), Some(false));
        assert_eq!(remove_ipc("RemoveIPC=on"), Some(true));
    }

    #[test]
    fn swap_spaces_are_those_below_the_heading() {
        assert!(swaps("Filename\tType\tSize\n").is_empty());
        let two = "Filename Type\n/dev/sda2 partition 1 0 -2\n/swap file 2 0 -3\n";
        assert_eq!(swaps(two), ["/dev/sda2", "/swap"]);
    }
}
