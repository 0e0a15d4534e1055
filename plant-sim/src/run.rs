//! The machine side as a process: the clock of the cell.
//!
//! Each scan: say the feedback, wake everybody, move the machine, collect the answers, close the scan.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use bus::fault_file;
use bus::machine::Axis;
use bus::member::{Member, MemberError, Pace, Seat};
use bus::order_file::{self, ScriptedOrder};
use bus::page::CellPhase;
use bus::port::{Age, OperatorServer, Reader, WindowReader, Writer};
use bus::realtime::{self, Priority};
use bus::sample::{
    AxisCommand, Feedback, Instruments, Job, MAX_AXES, MAX_PARTICIPANTS, Order, Participant,
    PlannerStatus, Refused, Roster,
};
use bus::service::{RECORDER_DEPTH_SCANS, ROLES, SCAN_DEPTH};
use bus::settings_file::SettingsFileError;

use crate::axis::{AxisSimulation, StateRefused};
use crate::fault_desk::FaultDesk;
use crate::machine_side::{Answers, MachineSide, RunEnd};
use crate::plant_file::PlantFile;
use crate::saved::{Latches, SavedMachine};
use crate::setup::SetupError;

/// Scans between two looks whether the launcher lives and two rings of the monitor's bell.
const LOOK_AROUND_SCANS: u64 = 64;
/// Scans between two looks whether an operator asks for something.
const OPERATOR_SCANS: u64 = 4;
/// So long the recorder may take for what is in its queue at the end.
const LAST_RECORD_LIMIT: Duration = Duration::from_secs(5);
const WAIT_STEP: Duration = Duration::from_millis(50);

/// How a machine side is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its seat in the cell.
    pub seat: Seat,
    /// The plant file.
    pub plant: PathBuf,
    /// Drives on from the first scan.
    pub enabled: bool,
    /// When the run ends by itself.
    pub run_end: RunEnd,
    /// A file of orders to obey, each at its scan.
    pub orders: Option<PathBuf>,
    /// A fault script.
    pub faults: Option<PathBuf>,
    /// Where the blocks it names begin on the path: line and element.
    pub fault_blocks: Vec<(u32, u32)>,
    /// In lockstep: how long a live process may take for one answer before the environment counts as broken.
    pub answer_limit: Duration,
}

/// Why the machine side ended before its run did.
#[derive(Debug, thiserror::Error)]
pub enum MachineSideError {
    /// It could not take part.
    #[error(transparent)]
    Member(#[from] MemberError),
    /// A settings file (plant, orders) is not usable.
    #[error(transparent)]
    Plant(#[from] SettingsFileError),
    /// Plant file and machine file do not fit each other.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The state that a machine side before this one left is damaged.
    #[error(transparent)]
    Saved(#[from] StateRefused),
    /// Someone who lives does not answer.
    #[error(
        "{who} has not answered scan {scan} for {waited_s} s although it lives: this PC is too busy, or it hangs"
    )]
    NoAnswer {
        /// The silent ones.
        who: String,
        /// The scan.
        scan: u64,
        /// How long it was waited, in s.
        waited_s: u64,
    },
}

struct Ports {
    feedback: Writer<Feedback>,
    instruments: Writer<Instruments>,
    commands: Vec<[Reader<AxisCommand>; ROLES.len()]>,
    windows: WindowReader,
    planner: Reader<PlannerStatus>,
    roster: Reader<Roster>,
    operator: OperatorServer,
}

impl Ports {
    fn open(member: &Member) -> Result<Ports, MemberError> {
        let bus = &member.bus;
        let commands = (0..member.machine.axes.len())
            .map(|axis| {
                Ok([
                    bus.command_reader(axis, 0, SCAN_DEPTH)?,
                    bus.command_reader(axis, 1, SCAN_DEPTH)?,
                ])
            })
            .collect::<Result<Vec<_>, MemberError>>()?;
        Ok(Ports {
            feedback: bus.feedback_writer()?,
            instruments: bus.instruments_writer()?,
            commands,
            windows: bus.window_reader(SCAN_DEPTH)?,
            planner: bus.planner_reader(SCAN_DEPTH)?,
            roster: bus.roster_reader(SCAN_DEPTH)?,
            operator: bus.operator_server()?,
        })
    }

    /// Takes what has been answered for `scan`, visible in the next, into `answers`; from those who are in the roster.
    fn read_answers(
        &mut self,
        scan: u64,
        ask_planner: bool,
        roster: &Roster,
        answers: &mut Answers,
    ) {
        for place in &roster.participants {
            if place.job != Job::Servo as u32 {
                continue;
            }
            let (axis, role) = (place.axis as usize, place.role as usize);
            let reader = self.commands.get_mut(axis).and_then(|r| r.get_mut(role));
            let command = answers.commands.get_mut(axis).and_then(|c| c.get_mut(role));
            if let (Some(reader), Some(command)) = (reader, command)
                && let Some(newest) = reader.newest(scan + 1)
            {
                *command = Some(newest);
            }
        }
        if ask_planner && let Some(newest) = self.planner.newest(scan + 1) {
            answers.planner = Some(newest);
        }
    }
}

/// Incarnations of the places that lived when a scan was said, 0 for the others: who came later was not asked.
type Asked = [u32; MAX_PARTICIPANTS];

fn asked(roster: &Roster) -> Asked {
    let mut asked = [0; MAX_PARTICIPANTS];
    for (asked, place) in asked.iter_mut().zip(&roster.participants) {
        if place.live == 1 {
            *asked = place.incarnation;
        }
    }
    asked
}

/// Who of those who live and were asked has not answered the scan yet. One that `excused` says has answered without a word
/// that counts.
fn missing(
    scan: u64,
    ask_planner: bool,
    answers: &Answers,
    (roster, asked): (&Roster, &Asked),
    excused: impl Fn(usize, &Participant) -> bool,
) -> Missing {
    let mut missing = Missing::default();
    for (index, (place, asked)) in roster.participants.iter().zip(asked).enumerate() {
        if place.live == 0 || place.stalled == 1 || place.incarnation != *asked {
            continue;
        }
        let answered = if place.job == Job::Servo as u32 {
            answers
                .commands
                .get(place.axis as usize)
                .and_then(|roles| roles.get(place.role as usize))
                .is_some_and(|c| {
                    c.is_some_and(|c| c.scan >= scan && c.incarnation == place.incarnation)
                })
        } else if place.job == Job::Planner as u32 && ask_planner {
            answers
                .planner
                .is_some_and(|s| s.scan >= scan && s.incarnation == place.incarnation)
        } else {
            continue;
        };
        if answered || excused(index, place) {
            missing.answered += 1;
        } else if let Some(slot) = missing.places.get_mut(missing.count) {
            *slot = (place.job, place.axis, place.role);
            missing.count += 1;
        }
    }
    missing
}

#[derive(Default)]
struct Missing {
    answered: usize,
    count: usize,
    places: [(u32, u32, u32); MAX_AXES * ROLES.len() + 1],
}

impl Missing {
    /// Who they are, and when they were last heard.
    fn names(&self, scan: u64, axes: &[Axis], ports: &Ports) -> String {
        let name = |&(job, axis, role): &(u32, u32, u32)| {
            if job == Job::Planner as u32 {
                return format!("the planner ({})", ports.planner.age(scan));
            }
            let letter = axes.get(axis as usize).map_or("?", |a| a.name.as_str());
            let roles = ports.commands.get(axis as usize);
            let age = roles
                .and_then(|roles| roles.get(role as usize))
                .map_or(Age::Never, |reader| reader.age(scan));
            let standby = if role == 0 { "" } else { "-b" };
            format!("servo {letter}{standby} ({age})")
        };
        let names: Vec<String> = self.places.iter().take(self.count).map(name).collect();
        names.join(" and ")
    }
}

/// The clock's two paces: how the end of a scan is awaited.
struct Clock {
    pace: Pace,
    period_ns: u64,
    next_ns: u64,
    answer_limit: Duration,
}

struct Cell {
    member: Member,
    ports: Ports,
    roster: Roster,
    clock: Clock,
    launcher_gone: bool,
    /// The recorder has stalled and is not waited for any more.
    recorder_dropped: bool,
    /// What is to go wrong.
    faults: Option<FaultDesk>,
    /// The last request to the launcher in its name.
    asked: u64,
    /// Who lived when this scan was said.
    asked_in_scan: Asked,
    /// Rings of the machine side's bell before anybody was woken in this scan.
    seen_before_waking: u32,
}

impl Cell {
    fn read_roster(&mut self) {
        let recorder = |roster: &Roster| roster.find(Job::Monitor, 0, 0).map(|p| p.incarnation);
        if let Some(roster) = self.ports.roster.newest(u64::MAX) {
            // Another recorder than the one that stalled is worth waiting for again.
            self.recorder_dropped &= recorder(&roster) == recorder(&self.roster);
            self.roster = roster;
        }
    }

    fn missing(&self, scan: u64, ask_planner: bool, answers: &Answers) -> Missing {
        let page = &self.member.page;
        let asked = (&self.roster, &self.asked_in_scan);
        missing(scan, ask_planner, answers, asked, |place, who| {
            // It says when it is done with the scan, so that it never misses the next feedback.
            let excused = |desk: &FaultDesk| desk.excuses(who, scan);
            self.faults.as_ref().is_some_and(excused)
                && page
                    .answered_scan(place)
                    .is_some_and(|answered| answered >= scan)
        })
    }

    /// Has the launcher do what the fault script wants in this scan, before its feedback is said or after. In lockstep it
    /// is done when this returns; in realtime nobody waits, and one thing is asked for after the other. False when the cell
    /// is to end at once.
    fn commit_faults(&mut self, scan: u64, said: bool) -> bool {
        let realtime = self.clock.pace == Pace::Realtime;
        loop {
            if realtime && !self.member.page.is_done(self.asked) {
                return true;
            }
            let Some((index, step)) = self.faults.as_mut().and_then(|f| f.next(scan, said)) else {
                return true;
            };
            self.asked = self.member.page.ask_launcher(index, step, scan);
            if realtime {
                continue;
            }
            while !self.member.page.is_done(self.asked) {
                let seen = self.member.page.machine_bell().count();
                if self.member.page.is_done(self.asked) {
                    break;
                }
                if self.member.ending() || !self.member.launcher_lives() {
                    return false;
                }
                self.member.page.machine_bell().wait(seen, WAIT_STEP);
            }
            self.read_roster();
        }
    }

    /// Waits for the launcher's word; false if the cell ends before it began.
    fn wait_for_start(&mut self) -> bool {
        loop {
            let seen = self.member.page.machine_bell().count();
            self.read_roster();
            match self.member.page.phase() {
                CellPhase::Running if self.roster.version > 0 => return true,
                CellPhase::Ending => return false,
                _ => {}
            }
            if !self.member.launcher_lives() {
                return false;
            }
            self.member.page.machine_bell().wait(seen, WAIT_STEP);
        }
    }

    /// Says the feedback of a scan and wakes whoever is to answer it.
    fn begin_scan(&mut self, feedback: &Feedback, ask_planner: bool) {
        let scan = feedback.scan;
        self.asked_in_scan = asked(&self.roster);
        let everybody = (&self.roster, &self.asked_in_scan);
        let asked = missing(scan, ask_planner, &Answers::NONE, everybody, |_, _| false);
        let page = &self.member.page;
        self.seen_before_waking = page.machine_bell().count();
        page.expect_answers(asked.count as u32);
        page.set_answered(self.member.seat().place, scan);
        self.ports.feedback.send(feedback);
        page.scan_bell().ring();
        if ask_planner {
            page.planner_bell().ring();
        }
        if scan.is_multiple_of(LOOK_AROUND_SCANS) {
            page.monitor_bell().ring();
        }
    }

    /// Lockstep: waits until every live participant has answered. `None` when the cell is to end at once.
    fn await_answers(
        &mut self,
        scan: u64,
        ask_planner: bool,
    ) -> Result<Option<Answers>, MachineSideError> {
        let mut answers = Answers::NONE;
        // Nearly always the last to answer has rung or will, and all answers are there after one wait.
        self.member
            .page
            .machine_bell()
            .wait(self.seen_before_waking, WAIT_STEP);
        let mut late_since: Option<Instant> = None;
        loop {
            let seen = self.member.page.machine_bell().count();
            self.ports
                .read_answers(scan, ask_planner, &self.roster, &mut answers);
            let missing = self.missing(scan, ask_planner, &answers);
            if missing.count == 0 {
                return Ok(Some(answers));
            }
            if self.member.ending() {
                return Ok(None);
            }
            self.read_roster();
            let Some(since) = late_since else {
                // Rung by somebody else, or someone died or came back: from here on each answer rings. Who answered
                // just before is found by looking once more.
                self.member.page.expect_eagerly();
                late_since = Some(Instant::now());
                continue;
            };
            if since.elapsed() > self.clock.answer_limit {
                return Err(MachineSideError::NoAnswer {
                    who: missing.names(scan, &self.member.machine.axes, &self.ports),
                    scan,
                    waited_s: self.clock.answer_limit.as_secs(),
                });
            }
            if self.launcher_gone || !self.member.launcher_lives() {
                self.launcher_gone = true;
                self.give_up_on_the_silent(scan, ask_planner, &answers, since);
            }
            self.member.page.machine_bell().wait(seen, WAIT_STEP);
        }
    }

    /// Without a launcher nobody says who died: whoever is silent for long is not waited for.
    fn give_up_on_the_silent(
        &mut self,
        scan: u64,
        ask_planner: bool,
        answers: &Answers,
        since: Instant,
    ) {
        if since.elapsed() < 4 * WAIT_STEP {
            return;
        }
        let missing = self.missing(scan, ask_planner, answers);
        for (job, axis, role) in missing.places.iter().take(missing.count) {
            for place in &mut self.roster.participants {
                if place.job == *job && place.axis == *axis && place.role == *role {
                    place.live = 0;
                }
            }
        }
    }

    /// In lockstep the recorder loses nothing: waits until it has taken the first scan (from then on it is connected to
    /// everybody) and then while its queue is half full.
    fn await_recorder(&mut self, scan: u64) {
        let taken = (scan + 1).saturating_sub(RECORDER_DEPTH_SCANS as u64 / 2);
        self.await_recorded(taken.max(1), self.clock.answer_limit);
    }

    /// Waits until the recorder has taken this many scans. One that does not within `limit` is stalled: it is not waited
    /// for again, and its log shows what it lost.
    fn await_recorded(&mut self, scans: u64, limit: Duration) {
        let mut since: Option<Instant> = None;
        while !self.recorder_dropped && self.member.page.recorded_scans() < scans {
            let recorder = self.roster.living(Job::Monitor, 0, 0);
            if recorder.is_none_or(|r| r.stalled == 1) {
                return;
            }
            let seen = self.member.page.machine_bell().count();
            self.member.page.monitor_bell().ring();
            if self.member.page.recorded_scans() >= scans {
                return;
            }
            self.member.page.machine_bell().wait(seen, WAIT_STEP);
            self.read_roster();
            if since.get_or_insert_with(Instant::now).elapsed() > limit {
                tracing::warn!("the recorder has stalled: it is not waited for any more");
                self.recorder_dropped = true;
            }
            if self.member.ending() || !self.member.launcher_lives() {
                return;
            }
        }
    }

    /// Realtime: sleeps until the next scan is due; the scans that were overrun.
    fn sleep(&mut self) -> u32 {
        realtime::sleep_until_ns(self.clock.next_ns);
        let now = realtime::now_ns();
        let late = now.saturating_sub(self.clock.next_ns);
        let overrun = late / self.clock.period_ns;
        if overrun > 0 {
            // Time that was lost is not made up: the scans go on from here.
            self.clock.next_ns = now;
        }
        self.clock.next_ns += self.clock.period_ns;
        overrun as u32
    }
}

/// Runs the machine side until its run ends or the cell does.
///
/// # Errors
/// [`MachineSideError`]. A run that ends by itself has sent a feedback marked last; one that is given up has not.
pub fn run(options: &Options) -> Result<(), MachineSideError> {
    let plant = PlantFile::load(&options.plant)?;
    let mut member = Member::enter(options.seat.clone(), "plant-sim")?;
    let faults = match &options.faults {
        Some(path) => {
            let mut script = fault_file::load(path, &member.machine)?;
            let element = |line| {
                let blocks = options.fault_blocks.iter();
                blocks.filter(|(l, _)| *l == line).map(|(_, e)| *e).next()
            };
            script.resolve_blocks(element)?;
            script.restart.apply(&mut member.machine.restart);
            Some(script)
        }
        None => None,
    };
    let ports = Ports::open(&member)?;
    let mut simulations = plant.simulations(&member.machine)?;
    let latches = restore(&member, &mut simulations)?;
    let first_scan = first_scan(
        latches.map(|latches| latches.scan),
        member.page.answered_scan(options.seat.place),
    );
    let mut side = MachineSide::new(
        &member.machine,
        simulations,
        options.seat.incarnation,
        first_scan,
        options.enabled,
        options.run_end,
    );
    if let Some(latches) = &latches {
        side.resume(latches);
    }
    let clock = Clock {
        pace: options.seat.pace,
        period_ns: u64::from(member.machine.scan.period_us) * 1000,
        next_ns: 0,
        answer_limit: options.answer_limit,
    };
    let mut script = match &options.orders {
        Some(path) => order_file::load(path, &member.machine)?,
        None => Vec::new(),
    };
    script.retain(|order| order.scan >= first_scan);
    let fired = |index| member.page.fault_fired(index);
    let faults = faults.map(|script| FaultDesk::new(script, fired, first_scan));
    member.ready(Priority::Machine);
    let mut cell = Cell {
        faults,
        asked: 0,
        asked_in_scan: [0; MAX_PARTICIPANTS],
        member,
        ports,
        roster: bytemuck::Zeroable::zeroed(),
        clock,
        launcher_gone: false,
        recorder_dropped: false,
        seen_before_waking: 0,
    };
    if !cell.wait_for_start() {
        return Ok(());
    }
    cell.clock.next_ns = realtime::now_ns() + cell.clock.period_ns;
    let mut saved = SavedMachine::new(side.simulations().count());
    let result = scan_cycle(&mut cell, &mut side, &mut saved, &script);
    cell.member.page.ring_all();
    result
}

fn scan_cycle(
    cell: &mut Cell,
    side: &mut MachineSide,
    saved: &mut SavedMachine,
    mut script: &[ScriptedOrder],
) -> Result<(), MachineSideError> {
    loop {
        let scan = side.scan();
        let ask_planner = side.is_period_boundary();
        cell.read_roster();
        let feedback = side.feedback();
        if let Some(faults) = &mut cell.faults {
            let page = &cell.member.page;
            faults.look(&feedback, |index| page.set_fault_fired(index, scan));
            if !cell.commit_faults(scan, false) {
                return Ok(());
            }
        }
        cell.begin_scan(&feedback, ask_planner);
        if !cell.commit_faults(scan, true) {
            return Ok(());
        }
        if side.is_last() {
            // The log is whole before this process, and with it what it has sent, goes.
            cell.await_recorded(scan + 1, LAST_RECORD_LIMIT);
            return Ok(());
        }
        cell.ports.instruments.send(&side.simulate());
        saved.save(&side.latches(), side.simulations(), &cell.member.page);

        let answers = match cell.clock.pace {
            Pace::Lockstep => {
                cell.await_recorder(scan);
                match cell.await_answers(scan, ask_planner)? {
                    Some(answers) => answers,
                    None => return Ok(()),
                }
            }
            Pace::Realtime => {
                side.skip(cell.sleep());
                cell.read_roster();
                let mut answers = Answers::NONE;
                cell.ports
                    .read_answers(scan, true, &cell.roster, &mut answers);
                answers
            }
        };
        while let Some((order, rest)) = script.split_first().filter(|(o, _)| o.scan <= scan) {
            script = rest;
            obey(side, order);
        }
        if scan.is_multiple_of(OPERATOR_SCANS) {
            while cell.ports.operator.serve(|request| side.order(request)) {}
        }
        if scan.is_multiple_of(LOOK_AROUND_SCANS) && !cell.launcher_gone {
            cell.launcher_gone = !cell.member.launcher_lives();
            if cell.member.ending() {
                return Ok(());
            }
        }
        if cell.launcher_gone {
            side.end_after_stop();
        }
        let roster = &cell.roster;
        cell.ports
            .windows
            .each(scan, |header, rows| side.offer(header, rows, roster));
        side.close_scan(&answers, &cell.roster);
    }
}

/// Hands a scripted order to the machine side and says what became of it; runs with a script are no production.
fn obey(side: &mut MachineSide, order: &ScriptedOrder) {
    let answer = side.order(&order.request);
    let word = Order::from_wire(order.request.order).map_or("order", Order::word);
    match Refused::from_wire(answer.reason) {
        Some(Refused::Not) => tracing::info!("scan {}: {word}", order.scan),
        reason => {
            let why = reason.map_or("for an unknown reason", Refused::words);
            tracing::warn!("scan {}: {word} refused: {why}", order.scan);
        }
    }
}

/// The first scan of a machine side, from the scan that one before it has saved last and the one it has said last. A scan that
/// was said and not saved is not said again: who has answered it would not answer another of that number, and in lockstep
/// everybody would wait for ever.
fn first_scan(saved: Option<u64>, said: Option<u64>) -> u64 {
    saved.max(said).map_or(0, |scan| scan + 1)
}

/// Takes over what a machine side before this one left.
fn restore(
    member: &Member,
    simulations: &mut [AxisSimulation],
) -> Result<Option<Latches>, MachineSideError> {
    let mut saved = SavedMachine::new(simulations.len());
    let latches = saved.load(&member.page);
    if latches.is_some() {
        saved.restore(simulations)?;
    }
    Ok(latches)
}

#[cfg(test)]
mod tests {
    use bus::sample::{Job, Participant, Roster};
    use bytemuck::Zeroable;

    use super::{Answers, asked, first_scan, missing};

    /// A servo that is admitted while the machine side waits for the others has had no feedback to answer.
    #[test]
    fn who_comes_while_a_scan_is_awaited_is_not_waited_for_in_it() {
        let mut roster = Roster::zeroed();
        roster.participants[0] = Participant {
            job: Job::Servo as u32,
            incarnation: 1,
            live: 1,
            ..Participant::zeroed()
        };
        let said = asked(&roster);
        let count = |roster: &Roster, said| {
            missing(7, false, &Answers::NONE, (roster, said), |_, _| false).count
        };
        assert_eq!(count(&roster, &said), 1);
        roster.participants[0].live = 0;
        assert_eq!(count(&roster, &said), 0);
        roster.participants[0].incarnation = 2;
        roster.participants[0].live = 1;
        assert_eq!(count(&roster, &said), 0);
        assert_eq!(count(&roster, &asked(&roster)), 1);
    }

    #[test]
    fn a_scan_that_was_said_before_the_kill_is_not_said_again() {
        assert_eq!(first_scan(None, None), 0);
        assert_eq!(first_scan(Some(7), Some(7)), 8);
        assert_eq!(first_scan(Some(7), Some(8)), 9);
        // Killed in its first scan: what stands is not saved, but the number is spent.
        assert_eq!(first_scan(None, Some(0)), 1);
    }
}
