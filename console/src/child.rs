//! Children of benches and tools: `quadrant` itself, once more. None outlives the one that started it.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use bus::process::{end_with_parent, watch};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, Signal, kill_process};

use crate::signals::Signals;

/// How often an interruption is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// This program with another subcommand, which comes to an orderly end when its parent has ended, however that ended. What it prints
/// goes nowhere, its errors go where those of its parent go.
pub fn command(subcommand: &str) -> Command {
    let mut command = Command::new("/proc/self/exe");
    command
        .arg0("quadrant")
        .arg(subcommand)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        // Ctrl-C goes to the parent alone, which hands it on.
        .process_group(0);
    end_with_parent(&mut command, Signal::TERM);
    command
}

/// Waits for its end; each interruption is handed on to it.
///
/// # Errors
/// The system does not tell.
pub fn wait(child: &mut Child, signals: &Signals) -> io::Result<ExitStatus> {
    let mut handed_on = 0;
    let ended = watch(child.id()).ok();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        let interruptions = signals.count();
        if interruptions > handed_on {
            handed_on = interruptions;
            let _ = kill_process(Pid::from_child(child), Signal::INT);
        }
        let limit = Timespec {
            tv_sec: 0,
            tv_nsec: LOOK_EVERY.subsec_nanos().into(),
        };
        match &ended {
            Some(ended) => {
                let _ = poll(&mut [PollFd::new(ended, PollFlags::IN)], Some(&limit));
            }
            None => std::thread::sleep(LOOK_EVERY),
        }
    }
}
