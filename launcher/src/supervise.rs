//! The launcher's loop: it watches the group, restarts who is lost, and stops it in order when asked to or when it has to.

use std::path::Path;
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::member::Pace;
use bus::messages::{self, MessageReader, TROUBLE};
use bus::port::{OperatorClient, PendingOrder};
use bus::sample::{
    Cause, DOWN_FOR_LOSS, Feedback, HoldReason, Job, Mode, OperatorRequest, Order, ProgramState,
    RunOutcome,
};
use bus::signal_page::CellPhase;
use machine::Machine;
use monitor::ended::Ended;
use plant_sim::script::faults::FaultScript;

use crate::events::{Event, Events};
use crate::fault_injector;
use crate::group::{Death, Group, LEAVE_LIMIT, LEAVE_LIMIT_AFTER_MACHINE};
use crate::hangs::Hangs;
use crate::hints;
use crate::observers::Observers;
use crate::progress::{LOOK_EVERY, Progress};
use crate::service_manager;
use crate::session::Session;
use crate::signal_watch::SignalWatch;
use crate::standby_alarm::StandbyAlarm;
use crate::supervisor::{Supervisor, Verdict, goes_on_after_stop};
use crate::user_codes::UserCodes;
use console::exit;
use console::signals::Signals;

/// So long the machine may take to come to rest once it was ordered to.
const STOP_LIMIT: Duration = Duration::from_secs(15);
/// Why a run ends that has lost a process which it needs.
const LOST: &str = "a process is lost for good";
/// Time between two cleanings after clients that were killed.
const CLEAN_EVERY: Duration = Duration::from_secs(1);
/// A stop that has no answer by then is ordered again.
const ANSWER_LIMIT: Duration = Duration::from_millis(500);
/// The longest wait where the program may ask for a user M-code.
const LOOK_AT_CALLS: Duration = Duration::from_millis(10);
/// The longest wait while somebody is being started, or a fault script may ask for something.
const LOOK_OFTEN: Duration = Duration::from_millis(1);

/// How a supervised group ended.
#[derive(Debug)]
pub struct Ending {
    /// The last feedback that was seen.
    pub last: Option<Feedback>,
    /// How the run under way ended; none if there was none.
    pub ended: Option<Ended>,
    /// Who died.
    pub deaths: Vec<Death>,
    /// Times that somebody interrupted it.
    pub interruptions: u32,
    /// The master left by itself; it was not killed.
    pub in_order: bool,
    /// Why and where the machine stopped, in words; empty if no scan ran.
    pub stop: String,
    /// Somebody removed files of the cell while it ran.
    pub files_removed: bool,
}

/// The launcher's own looks into the cell; made before the scans begin, so that it sees also the shortest run.
pub struct Watch {
    progress: Progress,
    signals: Option<SignalWatch>,
    operator: OperatorClient,
}

impl Watch {
    /// Looks on; with a bar for the one program of a run.
    pub fn new(group: &Group, machine: &Machine, bar: bool) -> anyhow::Result<Watch> {
        let mut progress = Progress::new(
            group.bus.feedback_reader(1)?,
            group.bus.planner_reader(1)?,
            machine.scan_period_s(),
            bar,
        );
        // A reader is connected from its first look on.
        progress.look();
        Ok(Watch {
            progress,
            signals: group.bus.signals_reader(1)?.map(SignalWatch::new),
            operator: group.bus.operator_client()?,
        })
    }
}

/// What is supervised.
pub struct Subject<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// What is to go wrong.
    pub faults: Option<FaultScript>,
    /// The programs of a cell that stays up.
    pub session: Option<Session>,
    /// What shows it.
    pub observers: Observers,
}

/// Watches the group until its master has ended, and stops it in order when asked to or when it has to.
pub fn supervise(
    group: &mut Group,
    subject: Subject<'_>,
    watch: Watch,
    signals: &Signals,
    events: &mut Events,
) -> Ending {
    let mut supervision = Supervision::new(group, subject, watch, signals, events);
    while supervision.goes_on() {
        supervision.look();
        supervision.run_user_codes();
        supervision.tell_messages();
        supervision.report_trip();
        supervision.follow_session();
        supervision.end_hangs();
        supervision.judge_deaths();
        supervision.raise_alarms();
        supervision.note_holds();
        supervision.note_signals();
        supervision.look_after_files();
        supervision.start_replacements();
        supervision.hint();
        supervision.serve_faults();
        supervision.stop_if_needed();
        if supervision.stop_is_overdue() {
            break;
        }
    }
    supervision.end()
}

/// The loop's state; its methods are the steps of one pass.
struct Supervision<'a> {
    group: &'a mut Group,
    machine: &'a Machine,
    session: Option<Session>,
    observers: Observers,
    user_codes: Option<UserCodes>,
    faults: Option<FaultScript>,
    watch: Watch,
    signals: &'a Signals,
    events: &'a mut Events,
    supervisor: Supervisor,
    hangs: Hangs,
    cell: String,
    master_slot: usize,
    newest: Option<Feedback>,
    messages: Option<MessageReader>,
    standby_alarm: StandbyAlarm,
    /// Reason of the hold, as it was noted last.
    held: HoldReason,
    /// Losses of the logic that were noted.
    logic_losses: u32,
    tripped: bool,
    deaths: Vec<Death>,
    /// Why the run cannot go on, if so.
    ends: Option<&'static str>,
    files_removed: bool,
    hinted: Option<String>,
    stop_since: Option<Instant>,
    looked_after_files: Instant,
    asked: Option<Asked>,
}

/// The stop that was ordered last.
struct Asked {
    /// Incarnation of the master that was to obey: another one knows nothing of it.
    incarnation: u32,
    since: Instant,
    order: PendingOrder,
    /// Scan of the answer.
    answered: Option<u64>,
}

impl Asked {
    /// Whether the master of this feedback has obeyed, or still may.
    fn holds(&mut self, newest: Option<&Feedback>) -> bool {
        if self.answered.is_none() {
            self.answered = self.order.answer().map(|answer| answer.scan);
        }
        let same = self.incarnation == newest.map_or(0, |feedback| feedback.incarnation);
        let obeyed = match (self.answered, newest) {
            (Some(answered), Some(newest)) => !goes_on_after_stop(answered, newest),
            (Some(_), None) => true,
            (None, _) => self.since.elapsed() < ANSWER_LIMIT,
        };
        same && obeyed
    }
}

impl<'a> Supervision<'a> {
    fn new(
        group: &'a mut Group,
        subject: Subject<'a>,
        watch: Watch,
        signals: &'a Signals,
        events: &'a mut Events,
    ) -> Supervision<'a> {
        let machine = subject.machine;
        let place = CellPaths::new(group.cell_name()).ok();
        let user_codes = group.user_code_folder().zip(place.clone());
        let user_codes =
            user_codes.map(|(folder, place)| UserCodes::new(folder.into(), machine, place));
        let messages = place.map(|place| MessageReader::new(place.messages()));
        Supervision {
            machine,
            session: subject.session,
            observers: subject.observers,
            user_codes,
            faults: subject.faults,
            watch,
            signals,
            events,
            supervisor: Supervisor::new(machine),
            hangs: Hangs::default(),
            cell: group.cell_name().to_string(),
            master_slot: group.place_of(Job::Master.into()).unwrap_or_default(),
            group,
            newest: None,
            messages,
            standby_alarm: StandbyAlarm::default(),
            held: HoldReason::None,
            logic_losses: 0,
            tripped: false,
            deaths: Vec::new(),
            ends: None,
            files_removed: false,
            hinted: None,
            stop_since: None,
            looked_after_files: Instant::now(),
            asked: None,
        }
    }

    /// There is a master, or one is due; nobody has interrupted twice.
    fn goes_on(&self) -> bool {
        let master = self.group.lives(Job::Master) || self.supervisor.is_due(self.master_slot);
        master && self.signals.count() < 2
    }

    /// Waits for something to happen, and takes the newest feedback.
    fn look(&mut self) {
        let often = self.faults.is_some() || self.supervisor.is_busy(self.group);
        let limit = match (often, &self.user_codes) {
            (true, _) => LOOK_OFTEN,
            (false, Some(_)) => LOOK_AT_CALLS,
            (false, None) => LOOK_EVERY,
        };
        self.group.wait(Some(self.signals.descriptor()), limit);
        self.group.publish_roster_to_newcomers();
        self.group.repeat_roster();
        if self.observers.look() {
            let (cell, run) = (&self.cell, self.session.is_none());
            let what = if run { "the run" } else { "the cell" };
            tracing::info!(
                "the view is closed, {what} goes on (Ctrl-C ends it; `quadrant monitor --cell {cell}` shows it again)"
            );
            if run {
                self.watch.progress.show_bar();
            }
        }
        self.watch.progress.look();
        self.take_newest();
    }

    fn take_newest(&mut self) {
        self.newest = self.watch.progress.newest().copied();
        let newest = self.newest.map_or(0, |feedback| feedback.scan);
        self.group.see(newest);
    }

    /// Runs the user M-codes that the program comes to.
    fn run_user_codes(&mut self) {
        if let Some(user_codes) = &mut self.user_codes {
            user_codes.look();
        }
    }

    /// Says what the program has said: once, whoever of the cell is killed. What is for the log alone goes to the events only.
    fn tell_messages(&mut self) {
        let (Some(feedback), Some(messages)) = (&self.newest, &mut self.messages) else {
            return;
        };
        let heard = messages.hear(feedback);
        for message in &heard.messages {
            let text = message.to_string();
            // What is wrong with the planner it has said itself.
            if !message.log_only && message.number != TROUBLE {
                tracing::info!("the program says, {text}");
            }
            self.events.note(feedback.scan, "message", text);
        }
        if heard.dropped > 0 {
            let text = format!("{} messages of the program are lost", heard.dropped);
            tracing::warn!("{text}: they were said faster than they could be read");
            self.events.note(feedback.scan, "messages-lost", text);
        }
    }

    /// Says which alarms of the machine have come, and what is forced.
    fn note_signals(&mut self) {
        let Some(signals) = &mut self.watch.signals else {
            return;
        };
        for noted in signals.look(self.machine) {
            match noted.urgent {
                true => tracing::warn!("{}", noted.words),
                false => tracing::info!("{}", noted.words),
            }
            self.events.note(noted.scan, noted.event, noted.words);
        }
    }

    /// Notes each feed hold with its reason, and each loss of the machine's own logic.
    fn note_holds(&mut self) {
        let Some(feedback) = &self.newest else {
            return;
        };
        let losses = std::mem::replace(&mut self.logic_losses, feedback.logic_losses);
        if feedback.logic_losses > losses {
            let text = "the machine's own logic was lost";
            self.events.note(feedback.scan, "logic-lost", text);
        }
        let now = HoldReason::from_wire(feedback.hold_reason).unwrap_or_default();
        if std::mem::replace(&mut self.held, now) == now {
            return;
        }
        let (event, words) = match now {
            HoldReason::None => ("hold-over", "the hold is over"),
            HoldReason::Program => ("hold", "the program waits for its operator"),
            HoldReason::Order => ("hold", "ordered, or drives are on again after a stop"),
            reason => ("hold", reason.words().unwrap_or_default()),
        };
        self.events.note(feedback.scan, event, words);
    }

    /// Says which axes have been without their standby for too long.
    fn raise_alarms(&mut self) {
        let Some(feedback) = &self.newest else {
            return;
        };
        for alarm in self.standby_alarm.look(feedback, self.machine) {
            if alarm.over {
                tracing::info!("{}", alarm.words);
            } else {
                tracing::warn!("{}", alarm.words);
            }
            self.events.note(feedback.scan, alarm.event, alarm.words);
        }
    }

    /// The last feedback has been published: there is nothing left to do for anybody, and nobody is replaced.
    fn is_over(&self) -> bool {
        self.newest.is_some_and(|feedback| feedback.last == 1)
    }

    fn report_trip(&mut self) {
        let Some(feedback) = &self.newest else {
            return;
        };
        let is_tripped = feedback.mode == Mode::Tripped as u32;
        if is_tripped && !self.tripped {
            let mut how = stop_words(feedback, self.machine, None);
            let of_drive = [Cause::DriveLost as u32, Cause::DriveFault as u32];
            let of_drive = of_drive.contains(&feedback.cause);
            if let Some(words) = self.group.bus_words().filter(|_| of_drive) {
                how += &format!("; {words}");
            }
            tracing::error!("{how}");
            self.events.note(feedback.scan, "trip", how);
        }
        self.tripped = is_tripped;
    }

    /// Reports of the programs of a cell that stays up; a recorder that was lost for good gets another chance with each.
    fn follow_session(&mut self) {
        let (Some(feedback), Some(session)) = (&self.newest, &mut self.session) else {
            return;
        };
        let recorded = self.group.page.recorded_scans();
        session.look(feedback, self.machine, recorded, self.events);
        let recorder = self.group.place_of(Job::Monitor.into()).unwrap_or_default();
        let lost = !self.group.lives(Job::Monitor) && !self.supervisor.is_due(recorder);
        if session.is_another(feedback) && lost {
            // Whatever kept it from writing may have passed.
            self.supervisor.try_again(recorder);
        }
    }

    /// Clients and observers that were killed keep their places in the services until somebody cleans up after them. A fault
    /// script repeats itself only if nothing but the script decides when that is done.
    ///
    /// Where somebody has removed files of the cell, no order comes through and nobody is replaced: the run ends.
    fn look_after_files(&mut self) {
        if self.looked_after_files.elapsed() < CLEAN_EVERY || self.files_removed {
            return;
        }
        self.looked_after_files = Instant::now();
        if let Some(path) = self.group.removed_file() {
            let text = format!("{path} was removed");
            tracing::error!(
                "{text}: nobody reaches the cell any more, and nobody who is lost is replaced"
            );
            let scan = self.group.newest_scan();
            self.events.note(scan, "files removed", text);
            self.files_removed = true;
            self.ends = Some("files of the cell were removed");
        } else if self.faults.is_none() {
            self.group.bus.clean_dead();
            self.group.keep_spare_room();
        }
    }

    /// In lockstep the master waits for everybody and reports by itself who does not answer. To the last feedback nobody answers.
    fn end_hangs(&mut self) {
        if self.group.pace() != Pace::Realtime || self.is_over() {
            return;
        }
        for process in self.hangs.end(self.group) {
            let scan = self.group.newest_scan();
            self.events.note_of(&process, scan, "hangs", "killed");
        }
    }

    fn judge_deaths(&mut self) {
        let progress = &mut self.watch.progress;
        let mut died = self.group.reap_after(|| {
            progress.look();
        });
        self.take_newest();
        note_deaths(&died, self.group.newest_scan(), self.events);
        let over = self.is_over();
        for death in died.iter_mut().filter(|d| !d.status.success()) {
            if over {
                death.note_after_end();
                continue;
            }
            match self.supervisor.judge(self.group, death) {
                Verdict::Restarts => death.replaced = true,
                Verdict::GoesOn => {}
                // A cell that stays up waits for its operator, also without a servo.
                Verdict::Ends if self.session.is_some() && death.job == Job::Servo => {}
                Verdict::Ends => self.ends = Some(LOST),
            }
        }
        self.deaths.extend(died);
    }

    fn start_replacements(&mut self) {
        if self.is_over() {
            return;
        }
        self.supervisor.start_due(self.group);
        for (process, pid) in self.group.admit_ready() {
            tracing::info!("{process} restarted");
            let scan = self.group.newest_scan();
            self.events.note_started(&process, pid, scan, "restarted");
        }
    }

    /// Tells what a machine waits for that has lost a process, once.
    fn hint(&mut self) {
        let replaced = self.deaths.iter().any(|death| death.replaced);
        let waits = self.newest.filter(|_| replaced);
        let hint = waits.and_then(|feedback| match self.session {
            None => hints::waits_for(&feedback, &self.machine.restart),
            Some(_) => hints::lost_in(&feedback),
        });
        let hint = hint.map(|hint| hint.words(&self.cell, self.session.is_none()));
        if hint != self.hinted && !self.supervisor.is_busy(self.group) {
            if let Some(hint) = &hint {
                tracing::warn!("{hint}");
            }
            self.hinted = hint;
        }
    }

    /// Does what the master asks for in the name of a fault script, as long as it asks.
    fn serve_faults(&mut self) {
        let Some(faults) = &self.faults else {
            return;
        };
        loop {
            match fault_injector::serve(faults, self.group, &self.supervisor) {
                Ok(Some(served)) => {
                    if let Some((scan, word, process)) = &served.event {
                        let by = "by the fault script";
                        self.events.note_of(process, *scan, word, by);
                    }
                    let for_good = |d: &Death| d.job == Job::Planner && !d.replaced;
                    if served.death.as_ref().is_some_and(for_good) {
                        self.ends = Some(LOST);
                    }
                    self.deaths.extend(served.death);
                }
                Ok(None) => return,
                Err(error) => {
                    tracing::error!("{}", exit::words(&error));
                    self.ends = Some(LOST);
                    return;
                }
            }
        }
    }

    /// Asks the master to come to rest on the path, and a cell that stays up to end then. The order stands until it is obeyed: it is
    /// given again where it could not be sent or finds no answer, where somebody has resumed the machine since, and to a master that
    /// takes the place of the one that was asked.
    fn stop_if_needed(&mut self) {
        let interrupted = self.signals.count() > 0;
        let (why, again) = match (interrupted, self.ends) {
            (true, _) => ("interrupted", "again"),
            (false, Some(why)) => (why, "twice"),
            (false, None) => return,
        };
        let newest = self.newest.as_ref();
        if self.asked.as_mut().is_some_and(|a| a.holds(newest)) {
            return;
        }
        let incarnation = newest.map_or(0, |feedback| feedback.incarnation);
        let for_loss = !interrupted && self.ends.is_some();
        let Some(order) = stop(self.group, &self.watch.operator, for_loss) else {
            return;
        };
        self.asked = Some(Asked {
            incarnation,
            since: Instant::now(),
            order,
            answered: None,
        });
        if self.stop_since.is_some() {
            return;
        }
        self.stop_since = Some(Instant::now());
        service_manager::stopping();
        self.events.note(self.group.newest_scan(), "stop", why);
        tracing::info!("{why}: the tool comes to rest on the path (Ctrl-C {again} stops at once)");
    }

    fn stop_is_overdue(&self) -> bool {
        let since = self.stop_since;
        let overdue = since.is_some_and(|since| since.elapsed() > STOP_LIMIT);
        if overdue {
            let limit_s = STOP_LIMIT.as_secs();
            tracing::error!("not at rest {limit_s} s after it was ordered to stop");
        }
        overdue
    }

    /// Waits until all have left, or ends them where the master did not leave in order.
    fn end(mut self) -> Ending {
        self.observers.leave_terminal();
        drop(self.user_codes.take());
        service_manager::stopping();
        let in_order = !self.group.lives(Job::Master);
        if in_order {
            self.wait_until_left();
        } else {
            tracing::warn!("stopped at once");
            self.group.kill();
        }
        self.watch.progress.look();
        self.watch.progress.finish();
        self.note_recorder_without_room();
        self.take_newest();
        self.tell_messages();
        let last = self.watch.progress.newest().copied();
        let ended = last.as_ref().and_then(|last| self.ended(last, in_order));
        if let (Some(session), Some(last)) = (&mut self.session, &last) {
            // Whoever looks for the cell now finds none; its last report is still being made.
            self.group.page.set_phase(CellPhase::Ending);
            session.take_end(ended.clone());
            match in_order {
                true => session.finish(last, self.signals, self.events),
                false => session.give_up(last, self.events),
            }
        }
        let mut stop = String::new();
        if let Some(last) = &last {
            let messages = CellPaths::new(&self.cell).map(|place| place.messages());
            stop = stop_words(last, self.machine, messages.ok().as_deref());
            let of_run = ended.as_ref().filter(|_| self.session.is_none());
            self.events.write(&Event {
                outcome: of_run.map(|ended| ended.outcome.word()),
                ..Event::of_cell(last.scan, "ended", Some(stop.clone()))
            });
        }
        Ending {
            last,
            ended,
            deaths: self.deaths,
            interruptions: self.signals.count(),
            in_order,
            stop,
            files_removed: self.files_removed,
        }
    }

    /// A recorder that could not go on, and whose successor had not begun when the run was over: the log has no end.
    fn note_recorder_without_room(&mut self) {
        let mut left = self.deaths.iter_mut().rev();
        let last = left.find(|death| death.job == Job::Monitor);
        if let Some(death) = last.filter(|death| death.status.code() == Some(3)) {
            death.replaced = false;
        }
    }

    /// How the run under way ended: as the master says it, who alone knows; where none was left to say it, without its end.
    fn ended(&self, last: &Feedback, in_order: bool) -> Option<Ended> {
        let told = Ended::told(self.machine, last, last.run);
        if told.is_none() && last.program != ProgramState::Running as u32 {
            return None;
        }
        if let Some(told) = told.as_ref().filter(|told| told.is_whole()) {
            return Some(told.clone());
        }
        let rests = match in_order && told.is_some() {
            true => "the machine came to rest on the path",
            false => "the machine did not come to rest in order",
        };
        let lost = self.deaths.iter().find(|death| death.is_loss());
        let lost = lost.map_or_else(String::new, |of| format!("{} {}; ", of.name, of.words()));
        let outcome = match (&told, self.signals.count()) {
            (None, 2..) => RunOutcome::Interrupted,
            _ => RunOutcome::Stopped,
        };
        Some(Ended {
            run: last.run,
            scan: last.scan,
            outcome,
            cause: last.cause,
            text: lost + rests,
        })
    }

    fn wait_until_left(&mut self) {
        let master_lost = |d: &Death| d.job == Job::Master && d.is_loss();
        let limit = if self.deaths.iter().any(master_lost) {
            self.group.page.set_phase(CellPhase::Ending);
            LEAVE_LIMIT_AFTER_MACHINE
        } else {
            LEAVE_LIMIT
        };
        let before = self.signals.count();
        let interrupted = || self.signals.count() > before;
        let mut left = self.group.wait_until_left(limit, &interrupted);
        if self.is_over() {
            left.iter_mut().for_each(Death::note_after_end);
        }
        note_deaths(&left, self.group.newest_scan(), self.events);
        self.deaths.extend(left);
    }
}

/// Says who died untimely.
fn note_deaths(deaths: &[Death], scan: u64, events: &mut Events) {
    for death in deaths.iter().filter(|death| !death.status.success()) {
        tracing::error!("{} {}", death.name, death.words());
        events.note_of(&death.name, scan, "died", death.words());
    }
}

/// Sends that order, which nobody takes back: a run that was brought on again would be ended in motion when its time to come to rest
/// is over. None if it could not be sent.
fn stop(group: &Group, operator: &OperatorClient, for_loss: bool) -> Option<PendingOrder> {
    let order = OperatorRequest {
        order: Order::Down as u32,
        value: if for_loss { DOWN_FOR_LOSS } else { 0.0 },
        ..OperatorRequest::default()
    };
    let sent = operator.send(order);
    group.page.master_signal().raise();
    sent
}

/// Why and where the machine stopped; also what the program or its planner says of it, from the file of messages.
pub fn stop_words(feedback: &Feedback, machine: &Machine, messages: Option<&Path>) -> String {
    let index = feedback.cause_axis as usize;
    let code = feedback.axes.get(index).map_or(0, |axis| axis.drive_code);
    let cause = Cause::from_wire(feedback.cause);
    let words = match cause {
        Some(cause) => machine.cause_words(cause, index, code),
        None => "an unknown cause".into(),
    };
    let mode = Mode::from_wire(feedback.mode);
    if mode == Some(Mode::Tripped) {
        let axis = machine.axes.get(index);
        let axis = axis.map_or(String::new(), |axis| format!(", axis {}", axis.name));
        let scan = feedback.cause_scan;
        return format!("the machine tripped in scan {scan}: {words}{axis}");
    }
    let word = mode.map_or("in an unknown mode", Mode::word);
    let stands = format!("the machine is {word} in scan {}", feedback.scan);
    if mode.is_none() || feedback.cause == 0 {
        return stands;
    }
    match messages.and_then(|messages| messages::why(messages, feedback)) {
        Some(why) => format!("{stands}: {words}, {why}"),
        None => format!("{stands}: {words}"),
    }
}
