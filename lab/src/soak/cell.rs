//! A cell under soak: a `quadrant run` as a child process, seen from outside by its feedback, its roster and /proc.

use std::fs::{self, File};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use bus::cell::CellPaths;
use bus::drive_page::DrivePage;
use bus::port::{OperatorClient, PendingOrder, Reader};
use bus::process::watch;
use bus::sample::{Feedback, Job, Mode, OperatorRequest, Order, Participant, Refused, Roster};
use bus::service::{Bus, RECORDER_DEPTH_SCANS};
use bus::signal_page::SignalPage;
use console::child;
use machine::Machine;
use rustix::process::{Pid, Signal, kill_process, pidfd_send_signal};

use crate::invariants::Course;

use super::growth::Held;
use super::judge::{self, Judge};

/// A cell that is not up by then never will be.
const UP_LIMIT: Duration = Duration::from_secs(30);
/// Members of a launcher that was killed get so long to leave.
const CLEAN_PATIENCE: Duration = Duration::from_secs(5);
/// Wait between two looks at the feedback: its queue holds a thousand scans.
const LOOK: Duration = Duration::from_micros(500);
/// The operator looks at the machine as often.
const OPERATOR_LOOKS_EVERY: Duration = Duration::from_millis(5);
/// The launcher cleans up after dead clients once in this time, and a last time when the machine has said its last.
const CLEANS_EVERY: Duration = Duration::from_secs(1);
/// Time between two orders of the operator.
const ORDER_EVERY: Duration = Duration::from_millis(20);

/// A child of the launcher.
#[derive(Debug)]
pub struct Process {
    /// Its id.
    pub pid: i32,
    /// Its slot in the roster.
    pub slot: usize,
    /// What it is: its subcommand.
    pub role: String,
    handle: OwnedFd,
}

impl Process {
    /// Sends it a signal; nothing if it has ended.
    pub fn signal(&self, signal: Signal) {
        let _ = pidfd_send_signal(&self.handle, signal);
    }
}

/// What /proc says of a process: parent and state.
fn stat(pid: i32) -> Option<(i32, char)> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let (_, rest) = text.rsplit_once(')')?;
    let mut words = rest.split_whitespace();
    let state = words.next()?.chars().next()?;
    Some((words.next()?.parse().ok()?, state))
}

fn all_pids() -> impl Iterator<Item = i32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}

/// What a process holds of its own; none of one that is gone. Shared memory is the cell's: its segments are as large as they are from
/// the start, and become resident where a queue is full for the first time, behind a client that was stopped.
pub fn held(pid: i32) -> Option<Held> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let own = ["RssAnon:", "RssFile:"];
    let lines = status
        .lines()
        .filter(|line| own.iter().any(|key| line.starts_with(key)));
    let kb = lines
        .map(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok())
        .sum::<Option<u64>>()?;
    let files = fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count();
    Some(Held { kb, files }).filter(|held| held.kb > 0)
}

/// What a process's memory consists of, in words: its own, files, shared memory; and its threads.
pub fn memory_in_words(pid: i32) -> String {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let shown = ["RssAnon:", "RssFile:", "RssShmem:", "Threads:"];
    let lines = status
        .lines()
        .filter(|line| shown.iter().any(|key| line.starts_with(key)));
    let words: Vec<String> = lines
        .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "))
        .collect();
    words.join(", ")
}

/// The cell.
pub struct Cell {
    child: Child,
    /// How it ended, once it has.
    pub status: Option<ExitStatus>,
    ended: Option<Instant>,
    /// When its last feedback was seen.
    over: Option<Instant>,
    /// When one was killed last.
    client_killed: Option<Instant>,
    /// Its launcher's process id.
    pub launcher: i32,
    place: CellPaths,
    bus: Bus,
    page: SignalPage,
    /// Where frames and drives meet; none where drives are simulated.
    drive_page: Option<DrivePage>,
    feedback: Reader<Feedback>,
    rosters: Reader<Roster>,
    /// The newest roster.
    pub roster: Option<Roster>,
    /// What must hold.
    pub judge: Judge,
    order: Option<(Order, OperatorClient, PendingOrder)>,
    ordered: Option<Instant>,
    /// Orders that were obeyed, and that were refused.
    pub orders: (u64, u64),
    /// Largest number of scans by which the newest feedback seen stood behind a scan that a servo had already answered.
    pub status_age_scans_max: u64,
    /// Looks at that.
    pub status_looks: u64,
}

/// Enters the cell of a launcher. The launcher makes its page last: from then on all services are there, and what a run before
/// has left is not; whoever enters earlier obstructs the launcher that cleans up.
fn enter(
    place: &CellPaths,
    machine: &Machine,
    launcher: u32,
) -> anyhow::Result<(SignalPage, Bus, Reader<Feedback>, Reader<Roster>)> {
    let page = SignalPage::open(place)?;
    if page.launcher_pid() != launcher {
        bail!("the page is of another launcher");
    }
    let bus = Bus::enter(place, &machine.shape(), "soak", false)?;
    let feedback = bus.feedback_reader(RECORDER_DEPTH_SCANS)?;
    let rosters = bus.roster_reader(16)?;
    Ok((page, bus, feedback, rosters))
}

/// How a cell is started.
pub struct Start<'a> {
    pub machine_folder: &'a Path,
    pub machine: &'a Machine,
    pub program: &'a Path,
    pub pace: &'a str,
    pub name: &'a str,
    pub out: &'a Path,
    pub published: &'a Path,
}

impl Cell {
    /// Starts it and finds its samples.
    ///
    /// # Errors
    /// It does not come up.
    pub fn start(start: &Start<'_>, course: Course) -> anyhow::Result<Cell> {
        let place = CellPaths::new(start.name)?;
        let published = File::create(start.published).context("a file for what the run says")?;
        let mut child = child::command("run")
            .arg(start.machine_folder)
            .arg(start.program)
            .args(["--pace", start.pace, "--cell", start.name, "--out"])
            .arg(start.out)
            .stderr(published)
            .spawn()
            .context("starting a run")?;
        let launcher = child.id();
        let since = Instant::now();
        let (page, bus, mut feedback, mut rosters) = loop {
            match enter(&place, start.machine, launcher) {
                Ok(entered) => break entered,
                Err(error) if since.elapsed() > UP_LIMIT => {
                    let _ = child.kill();
                    let _ = child.wait();
                    clean(&place);
                    return Err(error.context("the cell does not come up"));
                }
                Err(_) => std::thread::sleep(Duration::from_millis(2)),
            }
            if let Some(status) = child.try_wait()? {
                clean(&place);
                bail!("a run ended with {status} before its cell was up");
            }
        };
        let drive_page = start.machine.bus.is_some().then(|| DrivePage::open(&place));
        // A reader is connected from its first look on.
        let first = feedback.any();
        let roster = rosters.newest(u64::MAX);
        let mut judge = Judge::new(start.machine, course);
        if let Some(first) = first {
            judge.take(&first);
        }
        Ok(Cell {
            launcher: child.id() as i32,
            child,
            status: None,
            ended: None,
            over: None,
            client_killed: None,
            drive_page: drive_page.transpose()?,
            place,
            bus,
            page,
            feedback,
            rosters,
            roster,
            judge,
            order: None,
            ordered: None,
            orders: (0, 0),
            status_age_scans_max: 0,
            status_looks: 0,
        })
    }

    /// Takes in all that has come; whether the run still goes on.
    pub fn look(&mut self) -> bool {
        // What a servo has answered has been published before: read first, so that the comparison cannot be unfair.
        let answered = self.answered();
        while let Some(feedback) = self.feedback.any() {
            self.judge.take(&feedback);
        }
        if self.judge.newest().is_some_and(|newest| newest.last == 1) {
            self.over.get_or_insert_with(Instant::now);
        }
        if let (Some(answered), Some(newest)) = (answered, self.judge.newest()) {
            self.status_looks += 1;
            self.status_age_scans_max = self
                .status_age_scans_max
                .max(answered.saturating_sub(newest.scan));
        }
        if let Some(roster) = self.rosters.newest(u64::MAX) {
            self.roster = Some(roster);
        }
        if self.status.is_none()
            && let Ok(Some(status)) = self.child.try_wait()
        {
            self.status = Some(status);
            self.ended = Some(Instant::now());
            while let Some(feedback) = self.feedback.any() {
                self.judge.take(&feedback);
            }
        }
        self.status.is_none()
    }

    /// The newest scan that a servo has answered.
    fn answered(&self) -> Option<u64> {
        let places = self.roster.iter().flat_map(|roster| &roster.participants);
        places
            .enumerate()
            .filter(|(_, place)| place.job == Job::Servo as u32)
            .filter_map(|(index, _)| self.page.answered_scan(index))
            .max()
    }

    /// Looks on until `until`; whether the run still goes on then.
    pub fn look_until(&mut self, until: Instant) -> bool {
        loop {
            if !self.look() {
                return false;
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return true;
            }
            std::thread::sleep(left.min(LOOK));
        }
    }

    /// The same with its operator at hand: a run ends by a trip that nobody does anything about.
    pub fn operate_until(&mut self, until: Instant) -> bool {
        while Instant::now() < until {
            self.operate();
            let next = Instant::now() + OPERATOR_LOOKS_EVERY;
            if !self.look_until(next.min(until)) {
                return false;
            }
        }
        self.look()
    }

    /// The launcher, and its children that take part. A process that is seen here before the roster is read has its place by
    /// then, or takes no part: the roster without its predecessor was published before it was started.
    pub fn settled(&mut self) -> Vec<(i32, String)> {
        let processes = self.processes();
        self.look();
        let slots = self.slots();
        let takes_part = |process: &Process| {
            let mut at = slots.iter().filter(|(slot, _)| *slot == process.slot);
            at.any(|(_, place)| place.live == 1)
        };
        let members = processes.into_iter().filter(takes_part);
        let members = members.map(|process| (process.pid, process.role));
        members
            .chain([(self.launcher, "launcher".to_string())])
            .collect()
    }

    /// Whether its last feedback was seen: the launcher makes the report then.
    pub fn is_over(&self) -> bool {
        self.over.is_some()
    }

    /// A client is killed.
    pub fn kill_client(&mut self, mut client: Child) {
        let _ = client.kill();
        let _ = client.wait();
        self.client_killed = Some(Instant::now());
        self.look();
    }

    /// Whether a client was killed so late that nobody cleaned up after it: its files are the next one's to remove.
    pub fn clients_killed_at_end(&self) -> bool {
        let last_cleaning = self.over.or(self.ended).map(|at| at - CLEANS_EVERY);
        let pair = self.client_killed.zip(last_cleaning);
        pair.is_some_and(|(killed, cleaned)| killed > cleaned)
    }

    /// The newest scan seen.
    pub fn scan(&self) -> u64 {
        self.judge.newest().map_or(0, |feedback| feedback.scan)
    }

    /// The mode it is in.
    pub fn mode(&self) -> Option<Mode> {
        self.judge.newest().and_then(|f| Mode::from_wire(f.mode))
    }

    /// The slots of the roster that are taken.
    pub fn slots(&self) -> Vec<(usize, Participant)> {
        let all = self.roster.iter().flat_map(|roster| &roster.participants);
        all.copied()
            .enumerate()
            .filter(|(_, place)| place.job != 0)
            .collect()
    }

    /// The slot of the process that sends the frames of the bus, if there is one now; none where drives are simulated.
    pub fn bus_owner(&self) -> Option<Option<usize>> {
        let owner = self.drive_page.as_ref()?.owner();
        let processes = self.processes();
        let is_owner = |process: &&Process| Some(process.pid as u32) == owner;
        let found = processes.iter().find(is_owner);
        Some(found.map(|process| process.slot))
    }

    /// Everybody is in the roster, and the machine moves on the path or is done.
    pub fn is_whole(&self) -> bool {
        let Some(feedback) = self.judge.newest() else {
            return false;
        };
        let all_live = self
            .slots()
            .iter()
            .all(|(_, place)| place.live == 1 && place.stalled == 0);
        let moves = feedback.mode == Mode::Enabled as u32
            && feedback.hold == 0
            && !feedback.window.is_none()
            && !feedback.tag.is_off_path()
            && feedback.at_rest == 0;
        // After the loss of the master the newest feedback may be that of the one that was killed.
        let machine = self
            .roster
            .and_then(|roster| roster.living(Job::Master, 0, 0).copied());
        let speaks = machine.is_some_and(|machine| machine.incarnation == feedback.incarnation);
        all_live && speaks && (moves || feedback.mode == Mode::Finished as u32)
    }

    /// Does what an operator does after the loss of the master: drives on, and on.
    pub fn operate(&mut self) {
        if let Some((order, _, pending)) = &self.order
            && let Some(answer) = pending.answer()
        {
            let obeyed = answer.reason == Refused::Not as u32;
            tracing::debug!("{}: {:?}", order.word(), Refused::from_wire(answer.reason));
            self.orders.0 += u64::from(obeyed);
            self.orders.1 += u64::from(!obeyed);
            self.order = None;
        }
        let Some(feedback) = self.judge.newest() else {
            return;
        };
        let order = match Mode::from_wire(feedback.mode) {
            Some(Mode::Disabled) => Order::Enable,
            // From every other trip of a soak the machine goes on by itself.
            Some(Mode::Tripped) if judge::braked_alone(feedback.cause) => Order::Enable,
            Some(Mode::Enabled) if feedback.hold == 1 => Order::Resume,
            _ => return,
        };
        if self.ordered.is_some_and(|at| at.elapsed() < ORDER_EVERY) {
            return;
        }
        self.ordered = Some(Instant::now());
        let request = OperatorRequest::of(order);
        // As every order of a terminal: a client of its own.
        self.order = None;
        if let Ok(client) = self.bus.operator_client()
            && let Some(pending) = client.send(request)
        {
            self.order = Some((order, client, pending));
        }
    }

    /// The launcher's children, each held so that no other process can be struck in its place.
    pub fn processes(&self) -> Vec<Process> {
        let ours = all_pids().filter(|pid| stat(*pid).is_some_and(|(p, _)| p == self.launcher));
        ours.filter_map(|pid| {
            let handle = watch(pid as u32).ok()?;
            let line = fs::read(format!("/proc/{pid}/cmdline")).ok()?;
            let words: Vec<&[u8]> = line.split(|b| *b == 0).collect();
            let at = words.iter().position(|word| *word == b"--index")?;
            let slot = std::str::from_utf8(words.get(at + 1)?).ok()?.parse().ok()?;
            let role = String::from_utf8_lossy(words.get(1)?).into_owned();
            // Held first and looked at again: what was read is of the process that is held.
            let held = stat(pid).is_some_and(|(p, _)| p == self.launcher);
            held.then_some(Process {
                pid,
                slot,
                role,
                handle,
            })
        })
        .collect()
    }

    /// Starts a command of an operator's to the cell.
    pub fn client(&self, words: &[&str]) -> Option<Child> {
        let (subcommand, rest) = words.split_first()?;
        let mut command = child::command(subcommand);
        command.args(rest).args(["--cell", self.place.name()]);
        command.stderr(Stdio::null()).spawn().ok()
    }

    /// Sends a signal to the launcher, unless it has ended.
    pub fn signal_launcher(&self, signal: Signal) {
        if let Some(pid) = Pid::from_raw(self.launcher)
            && self.status.is_none()
        {
            let _ = kill_process(pid, signal);
        }
    }

    /// Dead children that nobody has reaped.
    pub fn zombies(&self) -> Vec<i32> {
        let dead = |pid: &i32| stat(*pid) == Some((self.launcher, 'Z'));
        all_pids().filter(dead).collect()
    }

    /// How much of the cell is in shared memory.
    pub fn files(&self) -> usize {
        files_of(&self.place).len()
    }
}

impl Drop for Cell {
    fn drop(&mut self) {
        if self.status.is_none() {
            for process in self.processes() {
                process.signal(Signal::CONT);
                process.signal(Signal::KILL);
            }
            let _ = self.child.kill();
            let _ = self.child.wait();
            clean(&self.place);
        }
    }
}

/// Removes what a launcher that was killed has left of the cell.
fn clean(place: &CellPaths) {
    if let Err(error) = place.own(CLEAN_PATIENCE) {
        tracing::warn!(%error, "the cell's files stay");
    }
}

/// Files of a cell in shared memory, those in its folder one by one.
pub fn files_of(place: &CellPaths) -> Vec<PathBuf> {
    let segments = format!("qd-{}_", place.name());
    let folder = format!("quadrant-{}", place.name());
    let mut files = Vec::new();
    for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(&segments) {
            files.push(entry.path());
        } else if name == folder || name.starts_with(&format!("{folder}.")) {
            files.push(entry.path());
            add_files_below(&entry.path(), &mut files);
        }
    }
    files
}

fn add_files_below(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        files.push(entry.path());
        add_files_below(&entry.path(), files);
    }
}

/// Processes whose command line names this cell, the soak itself excepted.
pub fn processes_of(cell: &str) -> Vec<i32> {
    let names = |pid: &i32| {
        let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let words: Vec<&[u8]> = line.split(|b| *b == 0).collect();
        words
            .windows(2)
            .any(|two| two == [b"--cell".as_slice(), cell.as_bytes()])
    };
    all_pids().filter(names).collect()
}
