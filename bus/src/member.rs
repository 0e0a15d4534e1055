//! Taking part in a cell: what every role does before its first scan, and how it learns that it is to leave.

use std::io;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::cell::{CellError, CellPaths, Membership};
use crate::patience::Patience;
use crate::port::{Held, Reader};
use crate::process::watch;
use crate::realtime;
use crate::sample::Feedback;
use crate::service::{Bus, PLACE_LIMIT, PLACE_LOOK, Shape};
use crate::signal_page::{CellPhase, Signal, SignalPage};

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

/// A role's slot in a cell, as its command line says it.
#[derive(Debug, Clone)]
pub struct Slot {
    /// Name of the cell.
    pub cell: String,
    /// Machine file.
    pub machine: PathBuf,
    /// Its number in the roster.
    pub index: usize,
    /// Which process in that slot this is, counted from 1.
    pub incarnation: u32,
    /// Process id of the launcher whose cell it is: a latecomer must not take a slot in the next one of that name.
    pub launcher: u32,
    /// Pace of the cell.
    pub pace: Pace,
    /// Processors to stay on; none for all that the launcher may use.
    pub processors: Vec<usize>,
    /// How it runs in realtime.
    pub realtime: realtime::Settings,
    /// The last scan that is not its business: until then the process it replaces, or nobody, had its slot.
    pub after_scan: Option<u64>,
}

/// Why a role cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum MemberError {
    /// The cell refuses it.
    #[error(transparent)]
    Cell(#[from] CellError),
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
    /// The signal page.
    pub page: SignalPage,
    /// Its foot in shared memory.
    pub bus: Bus,
    /// The slot it has.
    pub slot: Slot,
    launcher: OwnedFd,
    patience: Patience,
    _membership: Membership,
}

/// Without any feedback for this long after the launcher's death, a member leaves.
pub const ORPHAN_PATIENCE: Duration = Duration::from_millis(500);
/// The longest wait awake in lockstep: most scans take less. Who waits for longer, as the planner for its next period, soon sleeps at
/// once (`Patience`).
pub const AWAKE: Duration = Duration::from_micros(100);
/// The longest wait without looking whether the cell still exists.
const LOOK_AROUND: Duration = Duration::from_millis(100);

/// Enters as soon as there is room: a process that has died leaves it in a moment.
fn patiently(enter: impl Fn() -> Result<Bus, CellError>) -> Result<Bus, CellError> {
    let started = Instant::now();
    loop {
        match enter() {
            Err(CellError::NoRoom { .. }) if started.elapsed() < PLACE_LIMIT => {
                std::thread::sleep(PLACE_LOOK);
            }
            done => return done,
        }
    }
}

impl Member {
    /// Enters the cell as `who`. Ports are made by the caller, then [`Member::ready`].
    ///
    /// # Errors
    /// [`MemberError`].
    pub fn enter(slot: Slot, who: &str, shape: &Shape) -> Result<Member, MemberError> {
        let _ = rustix::thread::set_name(
            &std::ffi::CString::new(format!("qd-{who}")).unwrap_or_default(),
        );
        let place = CellPaths::new(&slot.cell)?;
        let membership = place.join()?;
        let page = SignalPage::open(&place)?;
        if page.launcher_pid() != slot.launcher {
            return Err(MemberError::OtherLauncher {
                found: page.launcher_pid(),
                expected: slot.launcher,
            });
        }
        let launcher = watch(page.launcher_pid()).map_err(MemberError::LauncherGone)?;
        // In real time nobody is awake who could sleep.
        let patience = Patience::new(match slot.pace {
            Pace::Lockstep => AWAKE,
            Pace::Realtime => Duration::ZERO,
        });
        let bus = patiently(|| Bus::enter(&place, shape, who, false))?.patient();
        Ok(Member {
            page,
            bus,
            slot,
            launcher,
            patience,
            _membership: membership,
        })
    }

    /// Prepares the process for its scans as the pace wants it and says that it is ready.
    pub fn ready(&self, priority: realtime::Priority) {
        if !self.slot.processors.is_empty() {
            realtime::stay_on_all(&self.slot.processors);
        }
        if self.slot.pace == Pace::Realtime {
            // What is refused here was published once by the launcher, for all.
            self.slot.realtime.apply(priority);
        }
        self.page.set_ready(self.slot.index, self.slot.incarnation);
    }

    /// Reports that this process is done with a scan.
    pub fn answered(&self, scan: u64) {
        self.page.set_answered(self.slot.index, scan);
        self.page.answered();
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

    /// Waits until the count of `signal` is no longer `seen`, at most `limit`: in lockstep awake at first. May return early.
    pub fn wait(&self, signal: &Signal, seen: u32, limit: Duration) {
        if !self.patience.try_for(|| signal.count() != seen) {
            signal.wait(seen, limit);
        }
    }

    /// Waits at `signal` for the newest feedback beyond `after`; `None` when it is time to leave.
    pub fn next_feedback(
        &self,
        signal: &Signal,
        reader: &mut Reader<Feedback>,
        after: Option<u64>,
    ) -> Option<Held<Feedback>> {
        let mut alone_since: Option<Instant> = None;
        loop {
            let seen = signal.count();
            if let Some(feedback) = reader.newest_held(u64::MAX)
                && after.is_none_or(|scan| feedback.scan > scan)
            {
                return Some(feedback);
            }
            if self.ending() {
                return None;
            }
            self.wait(signal, seen, LOOK_AROUND);
            if signal.count() == seen && !self.launcher_lives() {
                let since = alone_since.get_or_insert_with(Instant::now);
                if since.elapsed() > ORPHAN_PATIENCE {
                    return None;
                }
            }
        }
    }
}

/// Which feedbacks ask a process that is asked once in so many scans: the first one seen of each period.
#[derive(Debug)]
pub struct Boundaries {
    period_scans: u64,
    lockstep: bool,
    answered: Option<u64>,
}

impl Boundaries {
    /// Of periods of so many scans.
    pub fn every(period_scans: u64, lockstep: bool) -> Boundaries {
        Boundaries {
            period_scans: period_scans.max(1),
            lockstep,
            answered: None,
        }
    }

    /// Whether the feedback of this scan asks. A signal between two boundaries was meant for all processes and asks nothing; a process
    /// that sees one in lockstep, where the master waits for all, has just joined.
    pub fn asks(&mut self, scan: u64) -> bool {
        let boundary = scan - scan % self.period_scans;
        let unasked = self.lockstep && scan != boundary;
        if unasked || self.answered.is_some_and(|answered| answered >= boundary) {
            return false;
        }
        self.answered = Some(boundary);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::Boundaries;

    fn asked(lockstep: bool, scans: &[u64]) -> Vec<u64> {
        let mut boundaries = Boundaries {
            period_scans: 4,
            lockstep,
            answered: None,
        };
        let asks = scans.iter().filter(|scan| boundaries.asks(**scan));
        asks.copied().collect()
    }

    #[test]
    fn each_period_asks_once_also_a_planner_that_woke_late() {
        assert_eq!(asked(false, &[0, 1, 4, 5, 9, 10, 12]), [0, 4, 9, 12]);
    }

    #[test]
    fn in_lockstep_a_planner_that_joined_within_a_period_waits_for_the_next() {
        assert_eq!(asked(true, &[6, 7, 8, 9, 12]), [8, 12]);
    }
}
