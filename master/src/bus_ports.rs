//! The ports of a master process: shared memory, the signal page, the clock.

use std::time::{Duration, Instant};

use bus::cell::CellError;
use bus::member::{Member, Pace};
use bus::port::{Age, OperatorServer, Reader, WindowReader, Writer};
use bus::realtime;
use bus::sample::{
    AxisCommand, BusCycle, Feedback, Instruments, Job, LogicAnswer, MAX_PARTICIPANTS, Mode,
    OperatorRequest, OperatorResponse, Participant, PlannerStatus, ProgramState, Roster, Setpoint,
    Signals, WindowHeader,
};
use bus::service::{RECORDER_DEPTH_SCANS, ROLES, SCAN_DEPTH};
use bus::signal_page::CellPhase;
use bytemuck::Zeroable;
use machine::Machine;

use crate::answers::Answers;
use crate::drives::Drives;
use crate::error::MasterError;
use crate::ports::{Answered, Flow, MasterPorts};
use crate::saved::{Latches, SavedState};

/// Scans between two looks whether the launcher lives and two signals to the recorder.
const LOOK_AROUND_SCANS: u64 = 64;
/// Scans between two looks whether an operator asks for something.
const OPERATOR_SCANS: u64 = 4;
/// Scans of a machine that waits for an order that pass at full speed in lockstep.
const STOOD_SCANS: u64 = 2_000;
/// Answers are visible in the scan after the feedback that they answer, and nobody has a later feedback than the master has
/// published.
const HORIZON_SCANS: u64 = 1;
/// At the end of a run a recorder that has taken nothing from its queue for so long is not waited for.
const LAST_RECORD_LIMIT: Duration = Duration::from_secs(2);
/// The longest wait at a signal without a look at the ports.
pub const WAIT_STEP: Duration = Duration::from_millis(50);
/// Once the launcher has gone, whoever is silent for so long is not waited for any more.
const ORPHANED_LIMIT: Duration = Duration::from_millis(200);

struct Ports {
    feedback: Writer<Feedback>,
    instruments: Writer<Instruments>,
    bus_cycle: Option<Writer<BusCycle>>,
    signals: Option<Writer<Signals>>,
    commands: Vec<[Reader<AxisCommand>; ROLES.len()]>,
    windows: WindowReader,
    planner: Reader<PlannerStatus>,
    logic: Option<Reader<LogicAnswer>>,
    roster: Reader<Roster>,
    operator: OperatorServer,
}

impl Ports {
    fn open(member: &Member) -> Result<Ports, CellError> {
        let bus = &member.bus;
        Ok(Ports {
            feedback: bus.feedback_writer()?,
            instruments: bus.instruments_writer()?,
            bus_cycle: bus.bus_cycle_writer()?,
            signals: bus.signals_writer()?,
            commands: bus
                .command_readers(SCAN_DEPTH)?
                .into_iter()
                .map(|roles| roles.map(|reader| reader.with_horizon(HORIZON_SCANS)))
                .collect(),
            windows: bus.window_reader(SCAN_DEPTH)?.with_horizon(HORIZON_SCANS),
            planner: bus.planner_reader(SCAN_DEPTH)?.with_horizon(HORIZON_SCANS),
            logic: bus
                .logic_reader(SCAN_DEPTH)?
                .map(|reader| reader.with_horizon(HORIZON_SCANS)),
            roster: bus.roster_reader(SCAN_DEPTH)?,
            operator: bus.operator_server()?,
        })
    }

    /// Takes what has been answered for `scan`, visible in the next, into `answers`; from those who are in the roster.
    fn read_answers(&mut self, scan: u64, asks: Asks, roster: &Roster, answers: &mut Answers) {
        for place in roster.places() {
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
        if asks.planner
            && let Some(newest) = self.planner.newest(scan + 1)
        {
            answers.planner = Some(newest);
        }
        // The logic says by itself that it is lost, at any time.
        let logic = self.logic.as_mut();
        if let Some(newest) = logic.and_then(|reader| reader.newest(scan + 1)) {
            answers.logic = Some(newest);
        }
    }
}

/// Who beside the servos is asked in a scan.
#[derive(Debug, Clone, Copy)]
struct Asks {
    planner: bool,
    logic: bool,
}

/// Incarnations of the places that lived when a scan was published, 0 for the others: who came later was not asked.
type Asked = [u32; MAX_PARTICIPANTS];

fn asked(roster: &Roster) -> Asked {
    let mut asked = [0; MAX_PARTICIPANTS];
    for (asked, place) in asked.iter_mut().zip(roster.places()) {
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
    asks: Asks,
    answers: &Answers,
    (roster, asked): (&Roster, &Asked),
    excused: impl Fn(usize, &Participant) -> bool,
) -> Missing {
    let mut missing = Missing::default();
    for (index, (place, asked)) in roster.places().iter().zip(asked).enumerate() {
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
        } else if place.job == Job::Planner as u32 && asks.planner {
            answers
                .planner
                .is_some_and(|s| s.scan >= scan && s.incarnation == place.incarnation)
        } else if place.job == Job::Logic as u32 && asks.logic {
            answers
                .logic
                .is_some_and(|s| s.scan >= scan && s.incarnation == place.incarnation)
        } else {
            continue;
        };
        if answered || excused(index, place) {
            missing.answered += 1;
        } else {
            missing.places |= 1 << index;
        }
    }
    missing
}

#[derive(Default)]
struct Missing {
    answered: usize,
    /// A bit for each place of the roster.
    places: u128,
}

const _: () = assert!(MAX_PARTICIPANTS <= u128::BITS as usize);

impl Missing {
    fn count(&self) -> u32 {
        self.places.count_ones()
    }

    /// Whether the one in this place of the roster is.
    fn has(&self, index: usize) -> bool {
        self.places >> index & 1 == 1
    }

    /// Who they are, and when they were last heard.
    fn names(&self, scan: u64, axes: &[String], roster: &Roster, ports: &Ports) -> String {
        let name = |place: &Participant| {
            if place.job == Job::Planner as u32 {
                return format!("the planner ({})", ports.planner.age(scan));
            }
            if place.job == Job::Logic as u32 {
                let age = ports
                    .logic
                    .as_ref()
                    .map_or(Age::Never, |logic| logic.age(scan));
                return format!("the logic ({age})");
            }
            let letter = axes.get(place.axis as usize).map_or("?", String::as_str);
            let roles = ports.commands.get(place.axis as usize);
            let age = roles
                .and_then(|roles| roles.get(place.role as usize))
                .map_or(Age::Never, |reader| reader.age(scan));
            let standby = if place.role == 0 { "" } else { "-b" };
            format!("servo {letter}{standby} ({age})")
        };
        let missing = roster.places().iter().enumerate();
        let missing = missing.filter(|(index, _)| self.has(*index));
        let names: Vec<String> = missing.map(|(_, place)| name(place)).collect();
        names.join(" and ")
    }
}

/// The clock's two paces: how the end of a scan is awaited.
struct Clock {
    pace: Pace,
    period_ns: u64,
    next_ns: u64,
    answer_limit: Duration,
    /// It follows the drives' clock.
    follows: bool,
}

/// Of what the scans are off from the drives' clock, so much is made up for in each.
const FOLLOW_SHARE: f64 = 1.0 / 16.0;
/// And at most this share of a scan: a late frame moves no clock.
const FOLLOW_MOST: f64 = 1.0 / 50.0;

impl Clock {
    /// Follows the drives' clock, against which the last exchange was so much too late.
    fn follow(&mut self, late_ns: i64) {
        if late_ns != 0 && !std::mem::replace(&mut self.follows, true) {
            // Nothing moves yet: the scans begin where the drives want them.
            let later_ns = late_ns.saturating_neg().rem_euclid(self.period_ns as i64);
            self.next_ns = self.next_ns.saturating_add_signed(later_ns);
            return;
        }
        let most_ns = self.period_ns as f64 * FOLLOW_MOST;
        let step_ns = (late_ns as f64 * FOLLOW_SHARE).clamp(-most_ns, most_ns);
        self.next_ns = self.next_ns.saturating_add_signed(-(step_ns as i64));
    }
}

/// The ports of a master process.
pub struct BusPorts {
    /// The process's membership of its cell.
    pub member: Member,
    axes: Vec<String>,
    /// Scans between two questions to the logic, of a machine that has one.
    logic_every_scans: Option<u64>,
    ports: Ports,
    roster: Roster,
    answers: Answers,
    clock: Clock,
    launcher_gone: bool,
    /// The recorder has stalled and is not waited for any more.
    recorder_dropped: bool,
    /// Scans in a row in which the machine has waited for an order.
    waited_for_order_scans: u64,
    /// Who took part when this scan was published.
    asked_in_scan: Asked,
    /// Signals to the master before anybody was signalled in this scan; none where nobody is to answer it.
    seen_before_waking: Option<u32>,
    saved: Option<SavedState>,
}

impl BusPorts {
    /// Opens the ports of the master of this machine; in lockstep whoever takes part may take `answer_limit` for an answer.
    ///
    /// # Errors
    /// [`CellError::Transport`], also if the cell has a master already.
    pub fn open(
        member: Member,
        machine: &Machine,
        answer_limit: Duration,
    ) -> Result<BusPorts, CellError> {
        Ok(BusPorts {
            ports: Ports::open(&member)?,
            axes: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
            logic_every_scans: machine.logic_every_scans(),
            roster: Roster::zeroed(),
            answers: Answers::of_axes(machine.axes.len()),
            clock: Clock {
                pace: member.slot.pace,
                period_ns: u64::from(machine.scan.period_us) * 1000,
                next_ns: 0,
                answer_limit,
                follows: false,
            },
            launcher_gone: false,
            recorder_dropped: false,
            waited_for_order_scans: 0,
            asked_in_scan: [0; MAX_PARTICIPANTS],
            seen_before_waking: None,
            saved: None,
            member,
        })
    }

    /// The pace of the cell.
    pub fn pace(&self) -> Pace {
        self.clock.pace
    }

    /// Who is asked in this scan, the planner among them or not.
    fn asks(&self, scan: u64, planner: bool) -> Asks {
        let every = self.logic_every_scans;
        Asks {
            planner,
            logic: every.is_some_and(|every| scan.is_multiple_of(every)),
        }
    }

    fn missing(&self, scan: u64, asks: Asks, excused: &dyn Fn(&Participant) -> bool) -> Missing {
        let page = &self.member.page;
        let asked = (&self.roster, &self.asked_in_scan);
        missing(scan, asks, &self.answers, asked, |slot, who| {
            // It reports when it is done with the scan, so that it never misses the next feedback.
            excused(who)
                && page
                    .answered_scan(slot)
                    .is_some_and(|answered| answered >= scan)
        })
    }

    /// Waits for the launcher's word; false if the cell ends before it began.
    pub fn wait_for_start(&mut self) -> bool {
        loop {
            let seen = self.member.page.master_signal().count();
            self.read_roster();
            match self.member.page.phase() {
                CellPhase::Running if self.roster.version > 0 => {
                    self.clock.next_ns = realtime::now_ns() + self.clock.period_ns;
                    return true;
                }
                CellPhase::Ending => return false,
                _ => {}
            }
            if !self.member.launcher_lives() {
                return false;
            }
            self.member.page.master_signal().wait(seen, WAIT_STEP);
        }
    }

    /// Publishes the feedback of a scan and signals whoever is to answer it.
    fn publish_feedback(&mut self, feedback: &Feedback, ask_planner: bool) {
        let scan = feedback.scan;
        self.asked_in_scan = asked(&self.roster);
        let everybody = (&self.roster, &self.asked_in_scan);
        let asks = self.asks(scan, ask_planner);
        let asked = missing(scan, asks, &Answers::NONE, everybody, |_, _| false);
        let page = &self.member.page;
        self.seen_before_waking = (asked.places != 0).then(|| page.master_signal().count());
        page.expect_answers(asked.count());
        page.set_answered(self.member.slot.index, scan);
        self.ports.feedback.send(feedback);
        page.scan_signal().raise();
        if ask_planner {
            page.planner_signal().raise();
        }
        if scan.is_multiple_of(LOOK_AROUND_SCANS) {
            page.recorder_signal().raise();
        }
    }

    /// Lockstep: waits until every live participant has answered; false when the cell is to end at once.
    fn await_everybody(
        &mut self,
        scan: u64,
        asks: Asks,
        excused: &dyn Fn(&Participant) -> bool,
    ) -> Result<bool, MasterError> {
        self.answers.clear();
        // Nearly always the last to answer has rung or will, and all answers are there after one wait.
        if let Some(seen) = self.seen_before_waking {
            let signal = self.member.page.master_signal();
            self.member.wait(signal, seen, WAIT_STEP);
        }
        let mut late_since: Option<Instant> = None;
        loop {
            let seen = self.member.page.master_signal().count();
            self.ports
                .read_answers(scan, asks, &self.roster, &mut self.answers);
            let missing = self.missing(scan, asks, excused);
            if missing.places == 0 {
                return Ok(true);
            }
            if self.member.ending() {
                return Ok(false);
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
                return Err(MasterError::NoAnswer {
                    who: missing.names(scan, &self.axes, &self.roster, &self.ports),
                    scan,
                    waited_s: self.clock.answer_limit.as_secs(),
                });
            }
            if self.launcher_gone || !self.member.launcher_lives() {
                self.launcher_gone = true;
                if since.elapsed() >= ORPHANED_LIMIT {
                    self.drop_the_silent(&missing);
                }
            }
            self.member.page.master_signal().wait(seen, WAIT_STEP);
        }
    }

    /// Without a launcher nobody reports who died: whoever is silent for long is not waited for.
    fn drop_the_silent(&mut self, missing: &Missing) {
        for (index, place) in self.roster.participants.iter_mut().enumerate() {
            if missing.has(index) {
                place.live = 0;
            }
        }
    }

    fn recorder_incarnation(&self) -> Option<u32> {
        let recorder = self.roster.find(Job::Monitor, 0, 0);
        recorder.map(|recorder| recorder.incarnation)
    }

    /// In lockstep the recorder loses nothing: waits until it has taken the first scan (from then on it is connected to
    /// everybody) and then while its queue is half full.
    fn await_recorder(&mut self, scan: u64) {
        let taken = (scan + 1).saturating_sub(RECORDER_DEPTH_SCANS as u64 / 2);
        self.await_recorded(taken.max(1), self.clock.answer_limit);
    }

    /// In lockstep: waits until the recorder has taken every scan before this one.
    pub fn await_log(&mut self, scan: u64) {
        self.await_recorded(scan, self.clock.answer_limit);
    }

    /// Waits until the recorder has taken this many scans. One that takes none within `limit` is stalled: it is not waited for
    /// again, and its log shows what it lost.
    fn await_recorded(&mut self, scans: u64, limit: Duration) {
        let mut since: Option<Instant> = None;
        let mut taken = self.member.page.recorded_scans();
        let awaited = self.recorder_incarnation();
        while !self.recorder_dropped && self.member.page.recorded_scans() < scans {
            let recorder = self.roster.living(Job::Monitor, 0, 0);
            if recorder.is_none_or(|r| r.stalled == 1) {
                return;
            }
            // Another one has its place, and its death was not seen here: what has been published before it came it never gets.
            if self.recorder_incarnation() != awaited {
                return;
            }
            let seen = self.member.page.master_signal().count();
            self.member.page.recorder_signal().raise();
            if self.member.page.recorded_scans() >= scans {
                return;
            }
            self.member.page.master_signal().wait(seen, WAIT_STEP);
            self.read_roster();
            let now_taken = self.member.page.recorded_scans();
            if now_taken != std::mem::replace(&mut taken, now_taken) {
                since = None;
            }
            if since.get_or_insert_with(Instant::now).elapsed() > limit {
                tracing::warn!("the recorder has stalled: it is not waited for any more");
                self.recorder_dropped = true;
            }
            if self.member.ending() {
                return;
            }
            // Without a launcher nobody reports its death.
            let waited = since.map_or(Duration::ZERO, |since| since.elapsed());
            self.recorder_dropped |= waited >= ORPHANED_LIMIT && !self.member.launcher_lives();
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

    /// An order or a fault comes by itself in a later scan: the machine does not wait for one.
    pub fn expect_order(&mut self) {
        self.waited_for_order_scans = 0;
    }

    /// Lockstep: where the machine waits for an order, scans pass no faster than time does, once some have: nobody wants hours of a
    /// standing machine in a log, nor a processor at work for them. No sample knows of it.
    fn await_order(&mut self) {
        if self.waited_for_order_scans > STOOD_SCANS {
            realtime::sleep_until_ns(realtime::now_ns() + self.clock.period_ns);
        }
    }

    /// Waits for the answers to a scan as the pace wants it. In lockstep whoever is `excused` is not waited for once it has
    /// reported that it is done with the scan: no answer of it counts.
    ///
    /// # Errors
    /// [`MasterError::NoAnswer`].
    pub fn await_answers_except(
        &mut self,
        scan: u64,
        ask_planner: bool,
        excused: &dyn Fn(&Participant) -> bool,
    ) -> Result<Answered, MasterError> {
        if self.clock.pace == Pace::Lockstep {
            self.await_order();
            self.await_recorder(scan);
            let overrun_scans = 0;
            let asks = self.asks(scan, ask_planner);
            return Ok(if self.await_everybody(scan, asks, excused)? {
                Answered::Scan { overrun_scans }
            } else {
                Answered::Leave
            });
        }
        let overrun_scans = self.sleep();
        self.read_roster();
        self.answers.clear();
        let asks = self.asks(scan, true);
        self.ports
            .read_answers(scan, asks, &self.roster, &mut self.answers);
        Ok(Answered::Scan { overrun_scans })
    }
}

/// Whether nothing moves, and nothing will before somebody orders it: no program is read or searched for a line.
fn waits_for_order(feedback: &Feedback) -> bool {
    let stands = match Mode::from_wire(feedback.mode) {
        Some(Mode::Enabled) => feedback.hold == 1,
        Some(Mode::Disabled | Mode::Ready | Mode::Stopped | Mode::Tripped) => true,
        _ => false,
    };
    let is_read = feedback.program == ProgramState::Loading as u32;
    stands && feedback.rested == 1 && !is_read && feedback.auxiliary.start_line == 0
}

impl MasterPorts for BusPorts {
    type Error = MasterError;

    fn roster(&self) -> &Roster {
        &self.roster
    }

    fn follow_drives(&mut self, late_ns: i64) {
        self.clock.follow(late_ns);
    }

    fn read_roster(&mut self) {
        if let Some(roster) = self.ports.roster.newest(u64::MAX) {
            let before = self.recorder_incarnation();
            self.roster = roster;
            // Another recorder than the one that stalled is worth waiting for again.
            self.recorder_dropped &= self.recorder_incarnation() == before;
        }
    }

    fn begin_scan(&mut self, feedback: &Feedback, ask_planner: bool) -> Flow {
        self.waited_for_order_scans = match waits_for_order(feedback) {
            true => self.waited_for_order_scans.saturating_add(1),
            false => 0,
        };
        self.publish_feedback(feedback, ask_planner);
        Flow::GoOn
    }

    fn publish_instruments(&mut self, instruments: &Instruments) {
        self.ports.instruments.send(instruments);
    }

    fn publish_bus_cycle(&mut self, cycle: &BusCycle) {
        if let Some(writer) = &mut self.ports.bus_cycle {
            writer.send(cycle);
        }
    }

    fn publish_signals(&mut self, signals: &Signals) {
        if let Some(writer) = &mut self.ports.signals {
            writer.send(signals);
        }
    }

    fn save(&mut self, latches: &Latches, drives: &impl Drives) {
        let saved = self.saved.get_or_insert_with(|| SavedState::of(drives));
        self.member
            .page
            .save_machine_state(saved.save(latches, drives));
    }

    fn latch(&mut self, latches: &Latches) {
        if let Some(saved) = self.saved.as_mut() {
            self.member.page.save_machine_state(saved.latch(latches));
        }
    }

    fn await_answers(&mut self, scan: u64, ask_planner: bool) -> Result<Answered, MasterError> {
        self.await_answers_except(scan, ask_planner, &|_| false)
    }

    fn answers(&self) -> &Answers {
        &self.answers
    }

    fn serve_orders(
        &mut self,
        scan: u64,
        mut judge: impl FnMut(&OperatorRequest) -> (OperatorResponse, Latches),
    ) {
        if !scan.is_multiple_of(OPERATOR_SCANS) {
            return;
        }
        let (page, saved) = (&self.member.page, &mut self.saved);
        let mut judge = |request: &OperatorRequest| {
            let (answer, latches) = judge(request);
            if let Some(saved) = saved.as_mut().filter(|_| answer.accepted == 1) {
                page.save_machine_state(saved.latch(&latches));
            }
            answer
        };
        page.serve_urgent(&mut judge);
        while self.ports.operator.serve(&mut judge) {}
    }

    fn launcher_lives(&mut self, scan: u64) -> Option<bool> {
        if scan.is_multiple_of(LOOK_AROUND_SCANS) && !self.launcher_gone {
            self.launcher_gone = !self.member.launcher_lives();
            if self.member.ending() {
                return None;
            }
        }
        Some(!self.launcher_gone)
    }

    fn for_each_window(
        &mut self,
        scan: u64,
        mut offer: impl FnMut(&WindowHeader, &[Setpoint], &Roster),
    ) {
        let roster = &self.roster;
        self.ports
            .windows
            .each(scan, |header, setpoints| offer(header, setpoints, roster));
    }

    fn finish(&mut self, scan: u64) {
        // The log is whole before this process, and with it what it has published, goes.
        self.await_recorded(scan + 1, LAST_RECORD_LIMIT);
    }

    fn leave(&mut self) {
        self.member.page.raise_all();
    }
}

#[cfg(test)]
mod tests {
    use bus::sample::{Job, Participant, Roster};
    use bytemuck::Zeroable;

    use super::{Answers, Asks, asked, missing};

    /// A servo that is admitted while the master waits for the others has had no feedback to answer.
    #[test]
    fn who_comes_while_a_scan_is_awaited_is_not_waited_for_in_it() {
        let mut roster = Roster::zeroed();
        roster.participants[0] = Participant {
            job: Job::Servo as u32,
            incarnation: 1,
            live: 1,
            ..Participant::zeroed()
        };
        let published = asked(&roster);
        let count = |roster: &Roster, published| {
            let asks = Asks {
                planner: false,
                logic: false,
            };
            missing(7, asks, &Answers::NONE, (roster, published), |_, _| false).count()
        };
        assert_eq!(count(&roster, &published), 1);
        roster.participants[0].live = 0;
        assert_eq!(count(&roster, &published), 0);
        roster.participants[0].incarnation = 2;
        roster.participants[0].live = 1;
        assert_eq!(count(&roster, &published), 0);
        assert_eq!(count(&roster, &asked(&roster)), 1);
    }
}
