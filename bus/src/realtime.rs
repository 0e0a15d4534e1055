//! What this PC offers for real time: priority, locked memory, a processor of one's own, absolute sleeping.

use std::io;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::setpriority_process;
use rustix::thread::{ClockId, CpuSet, sched_getaffinity, sched_setaffinity};
use rustix::time::{Timespec, clock_gettime};

/// SCHED_FIFO priorities of the roles: the clock of the cell above those that answer it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Priority {
    /// Whoever owns the fieldbus: the master waits for it.
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
    fn level(self) -> Option<i32> {
        match self {
            Priority::Fieldbus => Some(65),
            Priority::Master => Some(60),
            Priority::Servo => Some(55),
            Priority::Planner => Some(50),
            Priority::Ordinary => None,
        }
    }
}

/// Puts the calling thread under SCHED_FIFO and asks for timers without slack.
///
/// # Errors
/// The operating system refuses: no `CAP_SYS_NICE` and no `rtprio` limit.
pub fn raise(priority: Priority) -> io::Result<()> {
    let Some(level) = priority.level() else {
        return Ok(());
    };
    // SAFETY: plain system calls on the calling thread; the parameter lives over the call.
    let refused = unsafe {
        libc::prctl(libc::PR_SET_TIMERSLACK, 1);
        let parameter = libc::sched_param {
            sched_priority: level,
        };
        libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) != 0
    };
    if refused {
        return Err(io::Error::last_os_error());
    }
    Ok(())
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

/// Keeps in memory whatever this process touches from now on, and what it has touched.
///
/// # Errors
/// The operating system refuses: the `memlock` limit.
pub fn lock_memory() -> io::Result<()> {
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT)?;
    Ok(())
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

/// Keeps the calling thread on one processor; without effect where that is refused.
pub fn stay_on(core: usize) {
    stay_on_all(&[core]);
}

/// Keeps the calling thread on these processors; without effect where that is refused.
pub fn stay_on_all(cores: &[usize]) {
    let mut set = CpuSet::new();
    for &core in cores {
        set.set(core);
    }
    let _ = sched_setaffinity(None, &set);
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
