//! Processes: watched by descriptor, and tied to the one that starts them.

use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::{fs, io};

use rustix::io::Errno;
use rustix::process::{
    Pid, PidfdFlags, Signal, getpid, getppid, pidfd_open, set_parent_process_death_signal,
};

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
