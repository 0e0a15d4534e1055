//! A program of the machine builder that a process of a cell runs: a user M-code, or the logic. Nothing of it outlives its run.

use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus};
use std::{fs, io};

use rustix::process::{
    Pid, Signal, WaitId, WaitIdOptions, kill_process, kill_process_group, waitid,
};

use crate::process::end_with_parent;

/// Looks for processes that are to be ended, at most.
const ENDING_ROUNDS: u32 = 20;

/// A program that runs. It ends with this value and with the process that runs it, and all that it has started ends with it.
#[derive(Debug)]
pub struct BuilderProgram {
    /// Its process and its streams.
    pub child: Child,
    /// A variable of its environment and the value, which tell it and all that it starts from other processes.
    mark: (&'static str, String),
    is_reaped: bool,
}

impl BuilderProgram {
    /// Starts it in a process group of its own, so that Ctrl-C does not reach it, with its standard streams and no other open file.
    ///
    /// # Errors
    /// It cannot be run.
    pub fn start(
        command: &mut Command,
        variable: &'static str,
        value: String,
    ) -> io::Result<BuilderProgram> {
        command.env(variable, &value).process_group(0);
        end_with_parent(command, Signal::KILL);
        Ok(BuilderProgram {
            child: keep_files_back(command).spawn()?,
            mark: (variable, value),
            is_reaped: false,
        })
    }

    /// Whether it has ended; it is not reaped yet.
    pub fn has_ended(&self) -> bool {
        let process = WaitId::Pid(Pid::from_child(&self.child));
        let look = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        // Who cannot be waited for is not there any more.
        waitid(process, look).map_or(true, |ended| ended.is_some())
    }

    /// Ends it, with all that it has started; how it has ended. As long as it is not reaped, nobody else has its number.
    pub fn end(&mut self) -> Option<ExitStatus> {
        if std::mem::replace(&mut self.is_reaped, true) {
            return self.child.wait().ok();
        }
        let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        let status = self.child.wait().ok();
        let (variable, value) = &self.mark;
        end_all_with(variable, value);
        status
    }
}

impl Drop for BuilderProgram {
    fn drop(&mut self) {
        self.end();
    }
}

/// Gives the process that a command starts its standard streams alone, and nothing else that is open here.
fn keep_files_back(command: &mut Command) -> &mut Command {
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
fn end_all_with(variable: &str, value: &str) {
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
