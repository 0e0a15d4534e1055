//! Ends a child that only shows: asked first, killed if it does not go, reaped in any case.

use std::process::Child;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

/// Ends a child, which gets `limit` to go by itself and is looked at every `look`.
pub fn close(child: &mut Child, limit: Duration, look: Duration) {
    let _ = kill_process(Pid::from_child(child), Signal::TERM);
    let since = Instant::now();
    while matches!(child.try_wait(), Ok(None)) {
        if since.elapsed() > limit {
            let _ = child.kill();
            let _ = child.wait();
            break;
        }
        std::thread::sleep(look);
    }
}
