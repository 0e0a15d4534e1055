//! What the operating system grants a process: files, processes, address space. A cell that would run into a limit, or into the end of
//! shared memory, is not started.

use std::io;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::error::CellError;
use crate::paths::CellPaths;
use crate::room;
use crate::service::Services;

/// Files that a process of a cell holds open for each service, at most: measured 8 in the master, which has most.
const FILES_PER_SERVICE: u64 = 10;
/// Address space of a process beside the segments: measured 30 MB in the recorder.
const PROCESS_BYTES: u64 = 64 << 20;

/// Stack of the main thread that every command does with: 1 MiB that `touch_stack_kb` may ask for, and 1 MiB for what it does (measured:
/// reading the command line alone needs 128 to 256 KiB).
const STACK_BYTES: u64 = 2 << 20;

/// Checks that the stack is large enough for any command: one that is not is noticed by nobody before it is used up.
///
/// # Errors
/// What is granted and needed, in words.
pub fn check_stack() -> Result<(), String> {
    match getrlimit(Resource::Stack).current {
        Some(granted) if granted < STACK_BYTES => Err(format!(
            "{} KiB of stack are granted (`ulimit -s`, LimitSTACK= of a service): {} KiB are needed",
            granted >> 10,
            STACK_BYTES >> 10
        )),
        _ => Ok(()),
    }
}

/// Checks that a process of a cell with these services is granted what it needs; open files are raised as far as they may be.
///
/// # Errors
/// [`CellError::Limit`].
pub fn check(place: &CellPaths, services: &Services) -> Result<(), CellError> {
    let refuse = |what: &'static str, granted: u64, needed: u64| CellError::Limit {
        cell: place.name().into(),
        what,
        granted,
        needed,
    };
    let files = services.count() as u64 * FILES_PER_SERVICE;
    let granted = raised_files();
    if granted < files {
        let what = "open files (`ulimit -n`, LimitNOFILE= of a service)";
        return Err(refuse(what, granted, files));
    }
    // Segments in shared memory are files.
    let file = services.room_bytes() >> 20;
    if let Some(granted) = getrlimit(Resource::Fsize).current
        && granted >> 20 < file
    {
        let what = "MB of file size (`ulimit -f`, LimitFSIZE= of a service)";
        return Err(refuse(what, granted >> 20, file));
    }
    let space = (services.room_bytes() + PROCESS_BYTES) >> 20;
    match getrlimit(Resource::As).current {
        Some(granted) if granted >> 20 < space => Err(refuse(
            "MB of address space (`ulimit -v`, LimitAS= of a service)",
            granted >> 20,
            space,
        )),
        _ => Ok(()),
    }
}

/// Checks that there is room for a whole cell with these services.
///
/// # Errors
/// [`CellError::NoRoom`].
pub fn check_room(place: &CellPaths, services: &Services) -> Result<(), CellError> {
    let needed = services.room_bytes();
    match room::room() {
        Some((free, total)) if free < needed => Err(CellError::NoRoom {
            cell: place.name().into(),
            needed: room::megabytes(needed),
            free: room::megabytes(free),
            total: room::megabytes(total),
        }),
        _ => Ok(()),
    }
}

/// The limit of open files of this process and its children, raised as far as it may be.
fn raised_files() -> u64 {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: limit.maximum,
        ..limit
    };
    match setrlimit(Resource::Nofile, raised) {
        Ok(()) => limit.maximum,
        Err(_) => limit.current,
    }
    .unwrap_or(u64::MAX)
}

/// Which limit an error of the operating system comes from, and how it is changed.
pub fn hint(error: &io::Error) -> Option<&'static str> {
    match rustix::io::Errno::from_io_error(error)? {
        rustix::io::Errno::AGAIN => Some(
            "no more processes or threads are granted (`ulimit -u`; TasksMax= of a service; pids.max of a control group)",
        ),
        rustix::io::Errno::MFILE => {
            Some("no more open files are granted (`ulimit -n`; LimitNOFILE= of a service)")
        }
        rustix::io::Errno::FBIG => {
            Some("files may not be larger (`ulimit -f`; LimitFSIZE= of a service)")
        }
        rustix::io::Errno::NFILE => Some("this PC has no more open files (fs.file-max)"),
        rustix::io::Errno::NOMEM => {
            Some("no more memory is granted (`ulimit -v`; MemoryMax= of a service)")
        }
        _ => None,
    }
}
