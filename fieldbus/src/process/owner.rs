//! Whoever owns the bus.

use std::rc::Rc;
use std::time::{Duration, Instant};

use bus::drive_page::{BusState, Counts, IMAGE_BYTES_MAX, Outputs, OwnedBus, Wiring};
use bus::member::Pace;
use bus::realtime::{Priority, now_ns};
use bus::signal_page::CellPhase;
use bytemuck::Zeroable;

use super::Process;
use super::claim::Claim;
use crate::link::{Cycle, Found, INIT, LinkError, Socket, Tag, request_state};
use crate::start_up::start_up;

/// The longest wait for the master without a look around.
const LOOK_AROUND: Duration = Duration::from_millis(100);
/// Longest time the kernel may take to take down an owner that has died.
const TAKEN_DOWN: Duration = Duration::from_millis(500);
/// Cycles between two looks whether the launcher lives.
const LOOK_AROUND_CYCLES: u64 = 64;
/// Share of a scan in which an answer must be back, in realtime.
const ANSWER_SHARE: f64 = 0.45;
/// Share of a scan beyond its time after which the master counts as late, and the outputs before are sent again.
const LATE_SHARE: f64 = 1.5;

/// Whoever owns the bus.
#[derive(Debug)]
pub(super) struct Owner<'a> {
    process: &'a Process,
    claim: Option<Claim>,
    /// None where the last start-up failed.
    segment: Option<Segment>,
    /// Given back last.
    _bus: OwnedBus<'a>,
}

/// A segment in operation.
#[derive(Debug)]
struct Segment {
    cycle: Cycle,
    wiring: Wiring,
    outputs: Outputs,
    /// Number of the last frame.
    frame: u64,
    /// The last cycle of the master that is done with.
    done: Option<u64>,
    sent_at_ns: u64,
    /// Cycles in a row in which the master had nothing new.
    silent_scans: u32,
    /// The master has got an answer of this segment.
    seen: bool,
}

/// Why cycles end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Leave,
    StartAgain,
}

impl Segment {
    /// Starts a segment up.
    fn start(process: &Process) -> anyhow::Result<Segment> {
        let socket = Rc::new(Socket::open(&process.plan.bus.interface)?);
        socket.ignore_own();
        let page = &process.page;
        let noted = |slaves| page.note_restarted(slaves);
        let wiring = start_up(&socket, &process.plan, &page.wiring(), noted)?;
        process.page.set_wiring(&wiring);
        let cycle = Cycle::new(socket, &wiring, process.period_ns, Counts::zeroed());
        let requested = process.page.requested();
        Ok(Segment::of(process, cycle, wiring, requested))
    }

    fn of(process: &Process, cycle: Cycle, wiring: Wiring, done: Option<u64>) -> Segment {
        let mut outputs = Outputs::zeroed();
        if let Some(done) = done {
            process.page.outputs(done, &mut outputs);
            // What was asked of a segment before is nothing for this one.
            outputs.image = outputs.silent;
        }
        Segment {
            frame: process.page.sent().max(cycle.newest_followed()),
            cycle,
            wiring,
            outputs,
            done,
            sent_at_ns: now_ns(),
            silent_scans: 1,
            seen: false,
        }
    }
}

impl<'a> Owner<'a> {
    /// Starts the segment up; the process is ready then. A cell does not begin without its drives; one that runs waits for them.
    pub fn start(process: &'a Process, bus: OwnedBus<'a>) -> anyhow::Result<Owner<'a>> {
        let mut owner = Owner {
            process,
            claim: None,
            segment: None,
            _bus: bus,
        };
        if let Err(error) = owner.start_segment() {
            if process.member.page.phase() == CellPhase::Starting {
                return Err(error);
            }
            tracing::warn!("{error}");
            process.member.ready(Priority::Fieldbus);
        }
        Ok(owner)
    }

    /// Starts the segment up; where that fails the bus is down.
    fn start_segment(&mut self) -> anyhow::Result<()> {
        let process = self.process;
        process.page.set_state(BusState::Starting);
        self.segment = None;
        let started = self.claim().and_then(|()| Segment::start(process));
        match started {
            Ok(segment) => {
                process.member.ready(Priority::Fieldbus);
                self.segment = Some(segment);
                // It is the one that was asked for meanwhile.
                process.page.take_start_again();
                process.page.set_failure("");
                process.page.set_state(BusState::Cycling);
                Ok(())
            }
            Err(error) => {
                process.page.set_failure(&error.to_string());
                process.page.set_state(BusState::Down);
                Err(error)
            }
        }
    }

    /// Claims the interface; the kernel may still take down an owner before, which had it.
    fn claim(&mut self) -> anyhow::Result<()> {
        let interface = &self.process.plan.bus.interface;
        let until = Instant::now() + TAKEN_DOWN;
        while self.claim.is_none() {
            match Claim::of(interface) {
                Ok(claim) => self.claim = Some(claim),
                Err(LinkError::Taken(_)) if Instant::now() < until => {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Goes on in place of the owner before: the slaves notice nothing.
    pub fn take_over(process: &'a Process, bus: OwnedBus<'a>, mut cycle: Cycle) -> Owner<'a> {
        let page = &process.page;
        cycle.follow();
        cycle.socket.ignore_own();
        let wiring = page.wiring();
        let (requested, answered) = (page.requested(), page.answered());
        if let Some(newest) = page.newest_inputs() {
            *cycle.counts() = newest.counts;
        }
        let found = requested
            .filter(|_| requested != answered)
            .map(|pending| (pending, cycle.found(pending)));
        let done = match found {
            // Nobody has sent it yet.
            Some((_, Found::NotSent)) => answered,
            _ => requested,
        };
        let mut segment = Segment::of(process, cycle, wiring, done);
        segment.silent_scans = 0;
        match found {
            Some((pending, Found::Answered)) => page.answer(pending, &segment.cycle.inputs),
            Some((pending, Found::Sent { frame })) => {
                let until_ns = process.answer_until_ns();
                let inputs = segment.cycle.receive(frame, until_ns, || true);
                page.answer(pending, inputs);
            }
            Some((_, Found::NotSent)) | None => {}
        }
        if let Some(done) = done {
            page.outputs(done, &mut segment.outputs);
        }
        page.answered_signal().raise();
        Owner {
            process,
            // The kernel still takes down who had it.
            claim: None,
            segment: Some(segment),
            _bus: bus,
        }
    }

    /// Exchanges cycles until it is time to leave; the segment is put to rest then.
    pub fn run(mut self) -> anyhow::Result<()> {
        loop {
            let leaves = match &mut self.segment {
                Some(segment) => segment.cycles(self.process, &mut self.claim) == End::Leave,
                None => !self.process.awaits_start(),
            };
            if leaves {
                if let Some(segment) = &mut self.segment {
                    segment.put_to_rest(self.process);
                    segment.tell_counts();
                }
                return Ok(());
            }
            match self.start_segment() {
                Ok(()) => tracing::info!("the segment is in operation again"),
                Err(error) => tracing::warn!("{error}"),
            }
        }
    }
}

impl Process {
    fn answer_until_ns(&self) -> u64 {
        now_ns().saturating_add(match self.member.slot.pace {
            Pace::Realtime => (self.period_ns as f64 * ANSWER_SHARE) as u64,
            Pace::Lockstep => self.answer_limit.as_nanos() as u64,
        })
    }

    /// Waits until another start-up is asked for; false when it is time to leave.
    fn awaits_start(&self) -> bool {
        loop {
            let seen = self.page.asked_signal().count();
            if self.page.take_start_again() {
                return true;
            }
            if self.leaves() {
                return false;
            }
            self.page.asked_signal().wait(seen, LOOK_AROUND);
        }
    }
}

impl Segment {
    /// Exchanges cycles as they are asked for; in realtime the bus is kept alive while nobody asks.
    fn cycles(&mut self, process: &Process, claim: &mut Option<Claim>) -> End {
        let page = &process.page;
        let realtime = process.member.slot.pace == Pace::Realtime;
        let late_ns = (process.period_ns as f64 * LATE_SHARE) as u64;
        let mut looked = self.frame;
        loop {
            let seen = page.asked_signal().count();
            let requested = page.requested();
            if page.take_start_again() {
                return End::StartAgain;
            }
            if self.frame >= looked + LOOK_AROUND_CYCLES {
                looked = self.frame;
                if claim.is_none() {
                    *claim = Claim::of(&process.plan.bus.interface).ok();
                }
                if process.leaves() {
                    return End::Leave;
                }
            }
            if let Some(cycle) = requested.filter(|_| requested != self.done) {
                page.outputs(cycle, &mut self.outputs);
                self.silent_scans = 0;
                self.done = requested;
                self.exchange(process, cycle, false);
                page.answer(cycle, &self.cycle.inputs);
                if !self.seen && self.cycle.inputs.answered == 1 {
                    self.seen = true;
                    page.forget_restarted();
                }
                continue;
            }
            if !realtime {
                page.asked_signal().wait(seen, LOOK_AROUND);
                if page.asked_signal().count() == seen && process.leaves() {
                    return End::Leave;
                }
                continue;
            }
            let now = now_ns();
            let due_ns = match self.silent_scans {
                0 => self.sent_at_ns + late_ns,
                _ => self.next_by_itself_ns(process.period_ns),
            };
            if now < due_ns {
                let left = Duration::from_nanos(due_ns - now);
                page.asked_signal().wait(seen, left);
            } else {
                self.keep_alive(process);
                if page.has_left() || process.member.ending() {
                    return End::Leave;
                }
            }
        }
    }

    /// When the next frame is due while the master asks for none: a scan later, or when the drives' clock wants it.
    fn next_by_itself_ns(&self, period_ns: u64) -> u64 {
        let most_ns = (period_ns / 8) as i64;
        let late_ns = self.cycle.inputs.clock_late_ns / 4;
        (self.sent_at_ns + period_ns).saturating_add_signed(-late_ns.clamp(-most_ns, most_ns))
    }

    /// The master is late, or gone: what it asked for last is sent again, and after its watchdog what it wanted for that case.
    fn keep_alive(&mut self, process: &Process) {
        self.silent_scans = self.silent_scans.saturating_add(1);
        let silent = self.silent_scans > process.watchdog_scans;
        self.cycle.counts().repeated += 1;
        let cycle = self.done.unwrap_or(0);
        self.exchange(process, cycle, silent);
    }
    fn exchange(&mut self, process: &Process, cycle: u64, silent: bool) {
        self.frame += 1;
        let outputs = &self.outputs;
        let image = if silent {
            &outputs.silent
        } else {
            &outputs.image
        };
        process.page.note_sent(self.frame);
        self.sent_at_ns = now_ns();
        let frame = self.frame;
        self.cycle.send(Tag { frame, cycle }, image);
        let member = &process.member;
        let patient = || !member.ending() && member.launcher_lives();
        self.cycle
            .receive(frame, process.answer_until_ns(), patient);
    }

    /// What came of the cycles since the start-up.
    fn tell_counts(&mut self) {
        let counts = *self.cycle.counts();
        tracing::info!(
            "{} frames: {} without an answer in time, {} that somebody took no part in, {} late, {} foreign or damaged, {} sent again \
             while the master was silent",
            counts.sent,
            counts.missed,
            counts.short,
            counts.late,
            counts.foreign,
            counts.repeated
        );
    }

    /// Nobody drives the slaves any more: they go to INIT.
    fn put_to_rest(&mut self, process: &Process) {
        // It does not hang: it answers nobody any more.
        process.page.set_state(BusState::Free);
        if process.member.slot.pace == Pace::Realtime && !process.page.has_left() {
            // The master has gone without a word: the drives are given the time to stop.
            for _ in 0..(500_000_000 / process.period_ns.max(1)) {
                self.exchange(process, 0, true);
                let until_ns = self.sent_at_ns + process.period_ns;
                bus::realtime::sleep_until_ns(until_ns);
            }
        }
        let nothing = [0; IMAGE_BYTES_MAX];
        self.outputs.image = nothing;
        self.exchange(process, 0, false);
        for slave in self.wiring.slaves() {
            request_state(&self.cycle.socket, slave.address, INIT);
        }
        // The requests are on the cable before the socket goes.
        self.cycle.socket.wait(20_000_000);
    }
}
