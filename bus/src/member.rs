//! Taking part in a cell: what every role does before its first scan, and how it learns that it is to leave.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::io;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

use crate::cell::{CellError, CellPlace, Membership};
use crate::machine::Machine;
use crate::page::{Bell, CellPhase, Page};
use crate::port::Reader;
use crate::realtime;
use crate::sample::Feedback;
use crate::service::Bus;
use crate::settings_file::SettingsFileError;

/// How the cell's scans follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// At absolute times, one scan period apart.
    Realtime,
    /// As soon as everyone has answered.
    Lockstep,
}

impl Pace {
    /// The word on the command line and in reports.
    pub fn word(self) -> &'static str {
        match self {
            Pace::Realtime => "realtime",
            Pace::Lockstep => "lockstep",
        }
    }
}

impl std::str::FromStr for Pace {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "realtime" => Ok(Pace::Realtime),
            "lockstep" => Ok(Pace::Lockstep),
            other => Err(format!("{other:?} is neither realtime nor lockstep")),
        }
    }
}

/// A role's seat in a cell, as its command line says it.
#[derive(Debug, Clone)]
pub struct Seat {
    /// Name of the cell.
    pub cell: String,
    /// Machine file.
    pub machine: PathBuf,
    /// Place in the roster.
    pub place: usize,
    /// Which process in that place this is, counted from 1.
    pub incarnation: u32,
    /// Process id of the launcher whose cell it is: a latecomer must not take a seat in the next one of that name.
    pub launcher: u32,
    /// Pace of the cell.
    pub pace: Pace,
    /// Processor to stay on.
    pub core: Option<usize>,
    /// Processor to keep off, where there is another.
    pub avoid_core: Option<usize>,
    /// The last scan that is not its business: until then the process it replaces, or nobody, had its place.
    pub after_scan: Option<u64>,
}

/// Why a role cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum MemberError {
    /// The cell refuses it.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The machine file is not usable.
    #[error(transparent)]
    Machine(#[from] SettingsFileError),
    /// The cell belongs to another launcher.
    #[error("the cell belongs to launcher {found}, not {expected}")]
    OtherLauncher {
        /// Process id in the cell's page.
        found: u32,
        /// Process id that was asked for.
        expected: u32,
    },
    /// The launcher is gone.
    #[error("the launcher of the cell is gone: {0}")]
    LauncherGone(io::Error),
}

/// A process that takes part in a cell.
#[derive(Debug)]
pub struct Member {
    /// The wake page.
    pub page: Page,
    /// Its foot in shared memory.
    pub bus: Bus,
    /// The machine file.
    pub machine: Machine,
    seat: Seat,
    launcher: OwnedFd,
    _membership: Membership,
}

/// Without any feedback for this long after the launcher's death, a member leaves.
const ORPHAN_PATIENCE: Duration = Duration::from_secs(1);
/// The longest wait without looking whether the cell still exists.
const LOOK_AROUND: Duration = Duration::from_millis(100);

impl Member {
    /// Enters the cell as `who`. Ports are made by the caller, then [`Member::ready`].
    ///
    /// # Errors
    /// [`MemberError`].
    pub fn enter(seat: Seat, who: &str) -> Result<Member, MemberError> {
        let _ = rustix::thread::set_name(
            &std::ffi::CString::new(format!("qd-{who}")).unwrap_or_default(),
        );
        let place = CellPlace::new(&seat.cell)?;
        let membership = place.join()?;
        let page = Page::open(&place)?;
        if page.launcher_pid() != seat.launcher {
            return Err(MemberError::OtherLauncher {
                found: page.launcher_pid(),
                expected: seat.launcher,
            });
        }
        let launcher = watch(page.launcher_pid()).map_err(MemberError::LauncherGone)?;
        let machine = Machine::load(&seat.machine)?;
        let bus = Bus::enter(&place, &machine, who, false)?;
        Ok(Member {
            page,
            bus,
            machine,
            seat,
            launcher,
            _membership: membership,
        })
    }

    /// Prepares the process for its scans as the pace wants it and says that it is ready.
    pub fn ready(&self, priority: realtime::Priority) {
        if let Some(core) = self.seat.core {
            realtime::stay_on(core);
        }
        if let Some(core) = self.seat.avoid_core {
            realtime::keep_off(core);
        }
        if self.seat.pace == Pace::Realtime {
            // What is refused here was said once by the launcher, for all.
            let _ = realtime::raise(priority);
            let _ = realtime::lock_memory();
        }
        self.page.set_ready(self.seat.place, self.seat.incarnation);
    }

    /// The seat it has.
    pub fn seat(&self) -> &Seat {
        &self.seat
    }

    /// Whether the launcher still lives. A system call: not every scan.
    pub fn launcher_lives(&self) -> bool {
        let mut fds = [PollFd::new(&self.launcher, PollFlags::IN)];
        !matches!(poll(&mut fds, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })), Ok(n) if n > 0)
    }

    /// Whether everybody is to leave at once.
    pub fn ending(&self) -> bool {
        self.page.phase() == CellPhase::Ending
    }

    /// Waits at `bell` for the newest feedback beyond `after`; `None` when it is time to leave.
    pub fn next_feedback(
        &self,
        bell: &Bell,
        reader: &mut Reader<Feedback>,
        after: Option<u64>,
    ) -> Option<Feedback> {
        let mut alone_since: Option<Instant> = None;
        loop {
            let seen = bell.count();
            if let Some(feedback) = reader.newest(u64::MAX)
                && after.is_none_or(|scan| feedback.scan > scan)
            {
                return Some(feedback);
            }
            if self.ending() {
                return None;
            }
            bell.wait(seen, LOOK_AROUND);
            if bell.count() == seen && !self.launcher_lives() {
                let since = alone_since.get_or_insert_with(Instant::now);
                if since.elapsed() > ORPHAN_PATIENCE {
                    return None;
                }
            }
        }
    }
}

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
