//! What this PC offers for real time: priority, locked memory, processors of one's own, absolute sleeping.

use std::{fs, io};

use rustix::mm::{Advice, MlockAllFlags, madvise, mlockall, munlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setpriority_process, setrlimit};
use rustix::thread::{ClockId, CpuSet, sched_getaffinity, sched_setaffinity};
use rustix::time::{Timespec, clock_gettime};

/// Who a process is, for its priority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Priority {
    /// The owner of the fieldbus: the master waits for it.
    Fieldbus,
    /// The master.
    Master,
    /// Servos.
    Servo,
    /// The planner.
    Planner,
    /// The monitor stays an ordinary process.
    Ordinary,
}

impl Priority {
    /// SCHED_FIFO priority where the machine file has no other: the clock of the cell above those that answer it. 0: none.
    pub const fn level(self) -> u32 {
        match self {
            Priority::Fieldbus => 65,
            Priority::Master => 60,
            Priority::Servo => 55,
            Priority::Planner => 50,
            Priority::Ordinary => 0,
        }
    }
}

/// How a process runs in realtime.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// SCHED_FIFO priority, 0 for none; the role's where the machine file has none.
    pub priority: Option<u32>,
    /// Keeps its memory in memory.
    pub lock_memory: bool,
    /// Stack that is touched before the first scan, in KiB.
    pub touch_stack_kb: u32,
    /// The same of the heap.
    pub touch_heap_kb: u32,
    /// How late the kernel may end its sleeps so that it wakes less often, in ns; of no effect under SCHED_FIFO.
    pub timer_slack_ns: u32,
    /// Longest time that it may use a processor under SCHED_FIFO without a pause, in ms.
    pub busy_max_ms: u32,
}

impl Settings {
    /// Where the machine file says nothing.
    pub const DEFAULT: Settings = Settings {
        priority: None,
        lock_memory: true,
        touch_stack_kb: 512,
        touch_heap_kb: 1024,
        timer_slack_ns: 1,
        busy_max_ms: 1000,
    };

    /// Prepares the calling thread and its process for scans; what was refused. Its memory comes first: that takes its time.
    pub fn apply(&self, role: Priority) -> Refused {
        let level = self.priority.unwrap_or(role.level());
        let mut memory = Ok(());
        if self.lock_memory {
            memory = lock_memory();
        }
        if level > 0 {
            if self.lock_memory {
                touch_program();
            }
            touch_heap(self.touch_heap_kb);
            touch_stack(self.touch_stack_kb);
            limit_busy(self.busy_max_ms);
        }
        Refused::of(raise(level, self.timer_slack_ns), memory)
    }
}

/// What was refused, in the system's words.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Refused {
    /// SCHED_FIFO.
    pub priority: Option<String>,
    /// Locked memory.
    pub memory: Option<String>,
}

impl Refused {
    fn of(priority: io::Result<()>, memory: io::Result<()>) -> Refused {
        Refused {
            priority: priority.err().map(|error| error.to_string()),
            memory: memory.err().map(|error| error.to_string()),
        }
    }

    /// Tried in a thread of its own and given back.
    pub fn by_trying() -> Refused {
        let tried = std::thread::spawn(|| {
            let priority = raise(Priority::Master.level(), 1);
            lower();
            let memory = lock_memory();
            unlock_memory();
            Refused::of(priority, memory)
        });
        tried.join().unwrap_or_default()
    }
}

/// Puts the calling thread under SCHED_FIFO, or at 0 leaves it as it is, and sets the slack of its timers.
///
/// # Errors
/// The operating system refuses: no `CAP_SYS_NICE` and no `rtprio` limit.
pub fn raise(level: u32, timer_slack_ns: u32) -> io::Result<()> {
    let parameter = libc::sched_param {
        sched_priority: level as i32,
    };
    // SAFETY: plain system calls on the calling thread; the parameter lives over the call.
    let refused = unsafe {
        libc::prctl(libc::PR_SET_TIMERSLACK, libc::c_ulong::from(timer_slack_ns));
        level > 0 && libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) != 0
    };
    if refused {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

/// Lets the kernel end this process (SIGXCPU) once it has used a processor under SCHED_FIFO for so long without a pause: one that
/// never sleeps again leaves nothing of that processor to anybody, the launcher that would end it among them (getrlimit(2), RLIMIT_RTTIME).
fn limit_busy(busy_max_ms: u32) {
    let limit = getrlimit(Resource::Rttime);
    let wanted_us = u64::from(busy_max_ms) * 1000;
    let current = Some(limit.maximum.map_or(wanted_us, |most| most.min(wanted_us)));
    let _ = setrlimit(Resource::Rttime, Rlimit { current, ..limit });
}

/// Touches so much of the stack below the caller, half of what it may have at most.
fn touch_stack(kb: u32) {
    let half_kb = getrlimit(Resource::Stack)
        .current
        .map_or(u64::MAX, |bytes| bytes >> 11);
    touch_frames(u64::from(kb).min(half_kb));
}

#[inline(never)]
fn touch_frames(kb: u64) {
    const FRAME_KB: u64 = 16;
    let frame = std::hint::black_box([0_u8; FRAME_KB as usize * 1024]);
    if kb > FRAME_KB {
        touch_frames(kb - FRAME_KB);
    }
    std::hint::black_box(&frame);
}

/// Touches so much of the heap, which the allocator then keeps for what is asked for later (mallopt(3)).
fn touch_heap(kb: u32) {
    /// Blocks below the threshold from which on the allocator maps them apart and gives them back.
    const BLOCK_KB: u32 = 64;
    #[cfg(target_env = "gnu")]
    // SAFETY: a plain call; it sets a number.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, (kb as i32).saturating_mul(2048));
    }
    let blocks = (0..kb / BLOCK_KB).map(|_| vec![1_u8; BLOCK_KB as usize * 1024]);
    std::hint::black_box(blocks.collect::<Vec<_>>());
}

/// Puts the calling thread back under the ordinary scheduler.
pub fn lower() {
    let parameter = libc::sched_param { sched_priority: 0 };
    // SAFETY: as in `raise`.
    unsafe {
        libc::sched_setscheduler(0, libc::SCHED_OTHER, &raw const parameter);
    }
}

/// Lets others of ordinary priority go before the calling thread: for what may take its time.
pub fn step_back() {
    // Of the calling thread alone (Linux, setpriority(2)). If it is refused it competes as before.
    let _ = setpriority_process(None, 5);
}

/// Keeps in memory what this process has touched and touches from now on.
///
/// # Errors
/// The operating system refuses: the `memlock` limit.
pub fn lock_memory() -> io::Result<()> {
    Ok(mlockall(
        MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT,
    )?)
}

/// Touches the program and its libraries, so that no page is read from a disk when it is wanted for the first time, such as the code
/// of a stop. Before Linux 5.14 without effect (madvise(2)). Queues are left as they are: most of their pages are never used.
fn touch_program() {
    let maps = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    for (start, bytes, advice) in maps.lines().filter_map(of_program) {
        let start = std::ptr::without_provenance_mut(start);
        // SAFETY: it changes nothing that is there; what is no longer mapped is an error.
        let _ = unsafe { madvise(start, bytes, advice) };
    }
}

/// Where a mapping of a file that nobody else writes to begins, its bytes, and how it is touched (proc_pid_maps(5)).
fn of_program(line: &str) -> Option<(usize, usize, Advice)> {
    let mut words = line.split_whitespace();
    let (start, end) = words.next()?.split_once('-')?;
    let advice = match words.next()? {
        "rw-p" => Advice::LinuxPopulateWrite,
        "r--p" | "r-xp" => Advice::LinuxPopulateRead,
        _ => return None,
    };
    let is_file = words.nth(3)?.starts_with('/');
    let [start, end] = [start, end].map(|address| usize::from_str_radix(address, 16).ok());
    let start = start.filter(|_| is_file)?;
    Some((start, end?.checked_sub(start)?, advice))
}

/// Lets memory go again.
pub fn unlock_memory() {
    let _ = munlockall();
}

/// Processors this process may use.
pub fn processors() -> Vec<usize> {
    sched_getaffinity(None).map_or_else(
        |_| vec![0],
        |set| {
            (0..CpuSet::MAX_CPU)
                .filter(|&cpu| set.is_set(cpu))
                .collect()
        },
    )
}

/// Processors as commands take them.
pub fn list(processors: &[usize]) -> String {
    let words: Vec<String> = processors.iter().map(usize::to_string).collect();
    words.join(",")
}

/// Keeps the calling thread on these processors; without effect where that is refused.
pub fn stay_on_all(cores: &[usize]) {
    let mut set = CpuSet::new();
    for &core in cores {
        set.set(core);
    }
    let _ = sched_setaffinity(None, &set);
}

/// Processors of these that a thread cannot be kept on here: only trying tells, since it may be kept on isolated ones too, which it
/// does not use unasked.
pub fn missing(wanted: &[usize]) -> Vec<usize> {
    let wanted = wanted.to_vec();
    let tried = std::thread::spawn(move || {
        stay_on_all(&wanted);
        let granted = processors();
        wanted
            .into_iter()
            .filter(|one| !granted.contains(one))
            .collect()
    });
    tried.join().unwrap_or_default()
}

/// The monotonic clock in ns.
pub fn now_ns() -> u64 {
    let now = clock_gettime(rustix::time::ClockId::Monotonic);
    (now.tv_sec as u64) * 1_000_000_000 + now.tv_nsec as u64
}

/// Sleeps until an absolute time of the monotonic clock, in ns.
pub fn sleep_until_ns(time_ns: u64) {
    let until = Timespec {
        tv_sec: (time_ns / 1_000_000_000) as i64,
        tv_nsec: (time_ns % 1_000_000_000) as i64,
    };
    while let Err(rustix::io::Errno::INTR) =
        rustix::thread::clock_nanosleep_absolute(ClockId::Monotonic, &until)
    {}
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt;
    use std::process::Command;
    use std::time::{Duration, Instant};

    use super::*;

    /// Page faults of the calling thread.
    fn page_faults() -> i64 {
        // SAFETY: the kernel fills a structure that lives over the call.
        let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
        let done = unsafe { libc::getrusage(libc::RUSAGE_THREAD, &raw mut usage) };
        assert_eq!(done, 0);
        usage.ru_minflt + usage.ru_majflt
    }

    #[test]
    fn stack_and_heap_that_were_touched_cause_no_page_fault() {
        let counted = std::thread::spawn(|| {
            // Locked memory of a thread is there whole; the stack of a process grows as it is touched.
            let settings = Settings {
                lock_memory: false,
                ..Settings::DEFAULT
            };
            settings.apply(Priority::Planner);
            let before = page_faults();
            touch_frames(u64::from(Settings::DEFAULT.touch_stack_kb) - 32);
            let blocks: Vec<Vec<u8>> = (0..12).map(|_| vec![1; 64 << 10]).collect();
            std::hint::black_box(&blocks);
            let faults = page_faults() - before;
            lower();
            faults
        });
        assert_eq!(counted.join().unwrap(), 0);
    }

    /// Says in the environment that this test is to be the process that never pauses.
    const NEVER_PAUSES: &str = "QUADRANT_TEST_NEVER_PAUSES";
    /// Its exit status where SCHED_FIFO is refused.
    const REFUSED: i32 = 77;

    #[test]
    fn a_process_under_fifo_that_never_pauses_is_ended_by_the_kernel() {
        if std::env::var_os(NEVER_PAUSES).is_some() {
            let settings = Settings {
                busy_max_ms: 100,
                ..Settings::DEFAULT
            };
            if settings.apply(Priority::Planner).priority.is_some() {
                std::process::exit(REFUSED);
            }
            loop {
                std::hint::spin_loop();
            }
        }
        let name = std::thread::current().name().unwrap().to_owned();
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", &name])
            .env(NEVER_PAUSES, "1")
            .spawn()
            .unwrap();
        let started = Instant::now();
        let ended = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break Some(status);
            }
            if started.elapsed() > Duration::from_secs(20) {
                break None;
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        let _ = child.kill();
        let _ = child.wait();
        let status = ended.expect("it would use the processor for ever");
        if status.code() == Some(REFUSED) {
            println!("skipped: SCHED_FIFO is refused here");
            return;
        }
        assert_eq!(status.signal(), Some(libc::SIGXCPU), "{status}");
    }

    #[test]
    fn the_program_is_touched_and_queues_and_stacks_are_not() {
        let of = |rest: &str| of_program(&format!("7f00-8f00 {rest}"));
        let code = of("r-xp 00000000 fe:00 12 /usr/bin/quadrant");
        assert_eq!(code, Some((0x7f00, 0x1000, Advice::LinuxPopulateRead)));
        let data = of("rw-p 00000000 fe:00 12 /usr/bin/quadrant");
        assert_eq!(data, Some((0x7f00, 0x1000, Advice::LinuxPopulateWrite)));
        assert_eq!(of("rw-s 00000000 00:19 12 /dev/shm/quadrant-0"), None);
        assert_eq!(of("rw-p 00000000 00:00 0 [stack]"), None);
        assert_eq!(of("rw-p 00000000 00:00 0"), None);
        touch_program();
    }

    #[test]
    fn a_processor_that_is_not_there_is_missing_and_one_that_is_is_not() {
        let here = processors();
        assert_eq!(missing(&here), [0_usize; 0]);
        assert_eq!(missing(&[here[0], 1023]), [1023]);
        assert_eq!(missing(&[1022]), [1022]);
        assert_eq!(processors(), here, "the caller keeps its own");
    }
}
