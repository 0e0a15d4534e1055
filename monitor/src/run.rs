//! The monitor as a process: it records the samples of a run and disturbs nothing.

use std::time::{Duration, Instant};

use bus::cell::{CellError, CellPaths};
use bus::member::{Member, MemberError, ORPHAN_PATIENCE, Pace};
use bus::port::{Reader, WindowReader};
use bus::realtime::Priority;
use bus::sample::{AxisCommand, BusCycle, Feedback, Instruments, PlannerStatus, Roster, Signals};
use bus::service::{RECORDER_DEPTH_SCANS, ROLES};
use machine::Machine;

use crate::black_box::{BlackBox, Settings};
use crate::log::{Recorder, SampleRef};
use crate::logbook::Logbook;
use crate::losses::Losses;
use crate::options::{MonitorError, Options};
use crate::room::Room;
use crate::sinks::Sinks;
use crate::standbys::Standbys;

/// Scans recorded between two words to the master about it.
const CREDIT_STEP_SCANS: u64 = 64;
const LOOK_AROUND: Duration = Duration::from_millis(20);

struct Ports {
    feedback: Reader<Feedback>,
    instruments: Reader<Instruments>,
    bus_cycle: Option<Reader<BusCycle>>,
    signals: Option<Reader<Signals>>,
    commands: Vec<[Reader<AxisCommand>; ROLES.len()]>,
    windows: WindowReader,
    planner: Reader<PlannerStatus>,
    roster: Reader<Roster>,
    newest_roster: Option<Roster>,
    /// Commands that name another servo than the one whose place they came from.
    misplaced: u64,
}

impl Ports {
    /// Receptions that failed, in all.
    fn failed(&self) -> u64 {
        let commands: u64 = self.commands.iter().flatten().map(Reader::failed).sum();
        commands
            + self.misplaced
            + self.feedback.failed()
            + self.instruments.failed()
            + self.bus_cycle.as_ref().map_or(0, Reader::failed)
            + self.signals.as_ref().map_or(0, Reader::failed)
            + self.planner.failed()
            + self.roster.failed()
    }

    fn open(member: &Member) -> Result<Ports, CellError> {
        let bus = &member.bus;
        let depth = RECORDER_DEPTH_SCANS;
        Ok(Ports {
            feedback: bus.feedback_reader(depth)?,
            instruments: bus.instruments_reader(depth)?,
            bus_cycle: bus.bus_cycle_reader(depth)?,
            signals: bus.signals_reader(depth)?,
            commands: bus.command_readers(depth)?,
            windows: bus.window_reader(depth)?,
            planner: bus.planner_reader(depth)?,
            roster: bus.roster_reader(depth)?,
            newest_roster: None,
            misplaced: 0,
        })
    }

    /// Hands on whatever became visible by the scan of this feedback, then the feedback itself: samples of one scan
    /// stand together in the log, in the same order on every run.
    fn record(&mut self, feedback: &Feedback, sinks: &mut Sinks) -> Result<(), MonitorError> {
        let scan = feedback.scan;
        while let Some(sample) = self.roster.next(scan) {
            // It is said again and again.
            let before = self.newest_roster.replace(sample);
            if before.is_some_and(|before| before.version == sample.version) {
                continue;
            }
            sinks.take(SampleRef::Roster(&sample))?;
        }
        if let Some(reader) = &mut self.bus_cycle {
            while let Some(sample) = reader.next_held(scan) {
                sinks.take(SampleRef::BusCycle(&sample))?;
            }
        }
        if let Some(reader) = &mut self.signals {
            while let Some(sample) = reader.next_held(scan) {
                sinks.take(SampleRef::Signals(&sample))?;
            }
        }
        while let Some(sample) = self.instruments.next_held(scan) {
            sinks.take(SampleRef::Instruments(&sample))?;
        }
        for (axis, roles) in self.commands.iter_mut().enumerate() {
            for (role, reader) in roles.iter_mut().enumerate() {
                while let Some(sample) = reader.next_held(scan) {
                    if sample.role as usize == role {
                        sinks.take(SampleRef::Command(axis, &sample))?;
                    } else {
                        self.misplaced += 1;
                    }
                }
            }
        }
        while let Some(sample) = self.planner.next_held(scan) {
            sinks.take(SampleRef::Planner(&sample))?;
        }
        let mut result = Ok(());
        self.windows.each(scan, |header, setpoints| {
            if result.is_ok() {
                result = sinks.take(SampleRef::window(header, setpoints));
            }
        });
        result?;
        sinks.feedback(feedback, self.newest_roster.as_ref(), self.failed())
    }
}

/// Records the cell until its last feedback.
///
/// # Errors
/// [`MonitorError`]; what was recorded before stays readable.
pub fn run(options: &Options) -> Result<(), MonitorError> {
    let machine = Machine::load(&options.slot.machine)?;
    let member = Member::enter(options.slot.clone(), "monitor", &machine.shape())?;
    let mut ports = Ports::open(&member).map_err(MemberError::Cell)?;
    let mut logbook = Logbook::new(options, &machine)?;
    let black_box = BlackBox::new(Settings::default(), &machine, logbook.new_home());
    let mut sinks = Sinks {
        logbook,
        black_box,
        standbys: Standbys::default(),
    };
    let place = CellPaths::new(&options.slot.cell).map_err(MemberError::Cell)?;
    let mut losses = Losses::of(&place);
    let mut room = Room::of(&options.out, &place);
    // Scans up to this one are none of a recorder's that comes later.
    let after = options.slot.after_scan;
    member.ready(Priority::Ordinary);

    let lockstep = options.slot.pace == Pace::Lockstep;
    let mut alone_since: Option<Instant> = None;
    let mut ended = false;
    while !ended {
        let seen = member.page.recorder_signal().count();
        while let Some(feedback) = ports.feedback.any() {
            if after.is_some_and(|after| feedback.scan <= after) {
                ended = feedback.last == 1;
                continue;
            }
            alone_since = None;
            losses.feedback(&feedback);
            ports.record(&feedback, &mut sinks)?;
            if lockstep {
                // The master may wait for this processor.
                rustix::thread::sched_yield();
            }
            ended = feedback.last == 1;
            member
                .page
                .set_recorded_scans(feedback.scan.saturating_add(1));
            if ended || (lockstep && feedback.scan.is_multiple_of(CREDIT_STEP_SCANS)) {
                member.page.master_signal().raise();
            }
        }
        losses.tell(ports.failed());
        if let Some((level, says)) = room.look() {
            tracing::warn!("{says}");
            sinks.logbook.hold_to(level, &says)?;
        }
        if ended || member.ending() {
            break;
        }
        if lockstep {
            member.page.master_signal().raise();
        }
        member.page.recorder_signal().wait(seen, LOOK_AROUND);
        sinks.logbook.record(Recorder::flush_if_due)?;
        if member.page.recorder_signal().count() == seen && !member.launcher_lives() {
            // The master still brings the tool to rest: its last feedback ends the log, or this patience.
            let since = alone_since.get_or_insert_with(Instant::now);
            if since.elapsed() > ORPHAN_PATIENCE {
                break;
            }
        }
    }
    sinks.black_box.finish();
    let reason = (!ended).then(|| "the cell ended before its last feedback".into());
    sinks.logbook.close(reason, ports.failed())
}
