//! Whoever stands by for the bus: its socket is open, its memory locked; it follows what the owner sends, and waits
//! for its death at the lock of the drive page.

use std::rc::Rc;
use std::time::{Duration, Instant};

use bus::drive_page::{BusState, Counts, OwnedBus, Wiring};
use bus::member::Pace;
use bus::process::watch;
use bus::realtime::Priority;
use bytemuck::Zeroable;
use rustix::process::{Signal, pidfd_send_signal};

use super::Process;
use crate::link::{Cycle, Socket};

/// Time between two looks at the socket, whose queue must not fill.
const FOLLOW_EVERY: Duration = Duration::from_millis(1);
/// Time between two looks whether it is time to leave.
const LOOK_AROUND: Duration = Duration::from_millis(100);
/// Of the time between two looks no more than this counts against an owner that does not answer: where the whole PC stalled, it had none
/// to answer in.
const LOOK_COUNTS_MOST: Duration = Duration::from_millis(2);
/// In lockstep there is no clock but this one: an owner that has not answered for so long hangs.
const HANGS_IN_LOCKSTEP: Duration = Duration::from_secs(5);

/// Whoever stands by.
pub(super) struct Standby<'a> {
    process: &'a Process,
    following: Option<(Wiring, Cycle)>,
    ready: bool,
    /// While a cycle is open.
    pending: Option<Pending>,
}

/// A cycle that is not answered yet.
#[derive(Debug, Clone, Copy)]
struct Pending {
    /// The last one that was answered.
    answered: Option<u64>,
    /// How long it is open, as far as this process was awake.
    open_for: Duration,
    looked: Instant,
}

/// What a standby is to do.
pub(super) enum Turn<'a> {
    /// Leave.
    Leave,
    /// Go on in place of the owner.
    TakeOver(OwnedBus<'a>, Box<Cycle>),
    /// Start the segment up: the owner died before it was in operation.
    Start(OwnedBus<'a>),
}

impl<'a> Standby<'a> {
    pub fn new(process: &'a Process) -> Standby<'a> {
        Standby {
            process,
            following: None,
            ready: false,
            pending: None,
        }
    }

    /// Waits for its turn.
    pub fn wait(mut self) -> anyhow::Result<Turn<'a>> {
        let page = &self.process.page;
        let mut looked = Instant::now();
        loop {
            self.follow()?;
            if let Some(bus) = page.own(FOLLOW_EVERY)? {
                // An owner that leaves in order has no heir.
                if self.process.leaves() {
                    return Ok(Turn::Leave);
                }
                let cycles = page.state() == BusState::Cycling;
                return Ok(match self.following.take().filter(|_| cycles) {
                    Some((_, cycle)) => Turn::TakeOver(bus, Box::new(cycle)),
                    None => Turn::Start(bus),
                });
            }
            if looked.elapsed() > LOOK_AROUND {
                looked = Instant::now();
                if self.process.leaves() {
                    return Ok(Turn::Leave);
                }
            }
            if self.owner_hangs()
                && let Some(Ok(owner)) = page.owner().map(watch)
            {
                // Two that send would be worse than one that does not: its death passes the bus on.
                tracing::warn!("the owner of the bus hangs: it is ended");
                let _ = pidfd_send_signal(&owner, Signal::KILL);
            }
        }
    }

    /// Follows what the owner sends; where the last start-up failed it is ready to try the next one.
    fn follow(&mut self) -> anyhow::Result<()> {
        match self.process.page.state() {
            BusState::Free | BusState::Starting => return Ok(()),
            BusState::Cycling => self.follow_frames()?,
            BusState::Down => {}
        }
        if !self.ready {
            self.ready = true;
            self.process.member.ready(Priority::Fieldbus);
        }
        Ok(())
    }

    fn follow_frames(&mut self) -> anyhow::Result<()> {
        let wiring = self.process.page.wiring();
        match &mut self.following {
            Some((known, cycle)) if known.nonce == wiring.nonce => cycle.follow(),
            _ => {
                let socket = Rc::new(Socket::open(&self.process.plan.bus.interface)?);
                let cycle = Cycle::new(socket, &wiring, self.process.period_ns, Counts::zeroed());
                self.following = Some((wiring, cycle));
            }
        }
        Ok(())
    }

    /// Whether a cycle has been asked for and not answered for too long.
    fn owner_hangs(&mut self) -> bool {
        let page = &self.process.page;
        let requested = page.requested();
        let cycling = page.state() == BusState::Cycling;
        if !cycling || requested == page.answered() {
            self.pending = None;
            return false;
        }
        let answered = page.answered();
        let begins = Pending {
            answered,
            open_for: Duration::ZERO,
            looked: Instant::now(),
        };
        let pending = self.pending.get_or_insert(begins);
        if pending.answered != answered {
            *pending = begins;
        }
        pending.open_for += pending.looked.elapsed().min(LOOK_COUNTS_MOST);
        pending.looked = Instant::now();
        let limit = match self.process.member.slot.pace {
            Pace::Realtime => {
                Duration::from_nanos(self.process.period_ns) * self.process.hang_scans
            }
            Pace::Lockstep => HANGS_IN_LOCKSTEP,
        };
        pending.open_for > limit
    }
}
