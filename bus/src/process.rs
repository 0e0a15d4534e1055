//! Processes: watched by descriptor, and tied to the one that starts them.

use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::{fs, io};

use rustix::io::Errno;
use rustix::process::{
    Pid, PidfdFlags, Signal, getpid, getppid, kill_process, pidfd_open,
    set_parent_process_death_signal,
};

/// Looks for processes that are to be ended, at most.
const ENDING_ROUNDS: u32 = 20;

/// A descriptor that becomes readable when the process ends.
///
/// # Errors
/// The process does not exist.
pub fn watch(pid: u32) -> io::Result<OwnedFd> {
    let pid = i32::try_from(pid)
        .ok()
        .and_then(Pid::from_raw)
        .ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))?;
    Ok(pidfd_open(pid, PidfdFlags::empty())?)
}

/// Whether a signal has stopped a process: it does nothing until another one continues it (proc(5), third field of `stat`).
pub fn is_stopped(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let behind_name = stat.rsplit_once(") ");
    behind_name.is_some_and(|(_, state)| state.starts_with(['T', 't']))
}

/// Gives the process that a command starts its standard streams alone, and nothing else that is open here.
pub fn keep_files_back(command: &mut Command) -> &mut Command {
    let close = || {
        // SAFETY: a plain system call; it closes nothing before the program begins.
        let done = unsafe {
            libc::syscall(
                libc::SYS_close_range,
                3,
                libc::c_uint::MAX,
                libc::CLOSE_RANGE_CLOEXEC,
            )
        };
        match done {
            0 => Ok(()),
            _ => Err(io::Error::last_os_error()),
        }
    };
    // SAFETY: between fork and exec nothing but a system call is made.
    unsafe { command.pre_exec(close) }
}

/// Ends every process of this user that began with this in its environment, and those that they start meanwhile: also what has left its
/// parent, its group and its session.
pub fn end_all_with(variable: &str, value: &str) {
    let mark = format!("{variable}={value}");
    let is_marked = |pid: Pid| {
        let environment = fs::read(format!("/proc/{}/environ", pid.as_raw_nonzero()));
        let environment = environment.unwrap_or_default();
        let mut all = environment.split(|byte| *byte == 0);
        all.any(|one| one == mark.as_bytes())
    };
    // Each time nobody is found who was there before; a process that forks faster than that is beyond this.
    for _ in 0..ENDING_ROUNDS {
        let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
        let pids = processes.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        let marked: Vec<Pid> = pids
            .filter_map(Pid::from_raw)
            .filter(|pid| is_marked(*pid))
            .collect();
        if marked.is_empty() {
            return;
        }
        for pid in marked {
            let _ = kill_process(pid, Signal::KILL);
        }
    }
}

/// Ties the process that a command starts to the one that starts it: the kernel sends it this signal when the thread that starts it has
/// ended, and so when its process has, however it ended. One whose parent has ended before that does not start.
pub fn end_with_parent(command: &mut Command, signal: Signal) -> &mut Command {
    let parent = getpid();
    let tie = move || {
        set_parent_process_death_signal(Some(signal))?;
        match getppid() == Some(parent) {
            true => Ok(()),
            false => Err(Errno::SRCH.into()),
        }
    };
    // SAFETY: between fork and exec nothing but two system calls is made.
    unsafe { command.pre_exec(tie) }
}
