//! The process group: one table of who takes part, started, watched, reaped and stopped by the launcher.

use std::os::fd::{BorrowedFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use bus::cell::{CellPaths, Ownership};
use bus::drive_page::DrivePage;
use bus::member::Pace;
use bus::process::{is_stopped, watch};
use bus::realtime;
use bus::sample::Job;
use bus::service::{Bus, Created, ROLES, Services};
use bus::signal_page::{CellPhase, SignalPage};
use machine::{LogLevel, Machine, Process, Processes};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Signal, pidfd_send_signal};

use crate::run_dir::RunDir;
use console::logs;
use console::output::joined;

mod death;
mod register;
mod restart;

pub use death::Death;
use register::Register;

/// Longest wait until every process has reported that it is ready.
const READY_LIMIT: Duration = Duration::from_secs(30);
/// Longest time between two looks at what has not got ready.
const READY_LOOK: Duration = Duration::from_millis(20);
/// Longest time in which a process leaves in order, the recorder with its queue to empty among them.
pub const LEAVE_LIMIT: Duration = Duration::from_secs(60);
/// Time after the master's leave in order from which on a process that still lives has missed the last feedback: it was stopped, or slow
/// to come. It is told.
const MISSED_LAST_LIMIT: Duration = Duration::from_millis(500);
/// Time after which such a process is ended.
const IDLE_LEAVE_LIMIT: Duration = Duration::from_secs(2);
/// The same where the master is gone and nothing is left to wait for.
pub const LEAVE_LIMIT_AFTER_MACHINE: Duration = Duration::from_secs(2);

/// Longest time without progress of a recorder that has not taken the last scan: it has missed it, and waits for nothing.
const RECORDER_IDLE_LIMIT: Duration = Duration::from_secs(1);

/// Time after which a process that somebody has stopped for good is ended: until then it may be continued.
const STOPPED_LIMIT: Duration = Duration::from_secs(5);

/// The longest wait without looking who has left.
const LEAVE_LOOK: Duration = Duration::from_millis(100);

/// One process of the table.
#[derive(Debug, Clone)]
pub struct Role {
    /// Name in logs, reports and `ps`.
    pub name: String,
    /// What it does.
    pub process: Process,
    /// Arguments beyond its slot.
    pub arguments: Vec<String>,
}

impl Role {
    fn new(machine: &Machine, process: Process, arguments: &[&str]) -> Role {
        let mut role = Role {
            name: process.name(machine),
            process,
            arguments: Vec::new(),
        };
        role.add(arguments);
        role
    }

    fn add(&mut self, arguments: &[&str]) {
        let arguments = arguments.iter().map(|word| word.to_string());
        self.arguments.extend(arguments);
    }
}

/// What the group needs to know of a run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The run directory, whose copies the processes read.
    pub files: RunDir,
    /// What it writes.
    pub level: LogLevel,
    /// Pace.
    pub pace: Pace,
    /// Seconds a living process may take for one answer in lockstep.
    pub answer_limit_s: u64,
    /// Where the blocks that it names begin on the path: line and element.
    pub fault_blocks: Vec<(u32, u32)>,
    /// Servos and planner read the fault script too, and send what it wants them to.
    pub wrong_samples: bool,
    /// The program runs block by block from its start.
    pub single_block: bool,
    /// The line that it begins at; none for its beginning.
    pub start_line: Option<u32>,
}

impl Plan {
    /// For the files of a run directory; its fault script names no blocks and no wrong samples.
    pub fn of(run_dir: &RunDir, pace: Pace, answer_limit_s: u64) -> Plan {
        Plan {
            files: run_dir.clone(),
            level: LogLevel::default(),
            pace,
            answer_limit_s,
            wrong_samples: false,
            fault_blocks: Vec::new(),
            single_block: false,
            start_line: None,
        }
    }
}

/// The table of processes, in the order they are started in: who listens before who speaks.
pub fn roles(machine: &Machine, plan: &Plan) -> Vec<Role> {
    let path = |p: &PathBuf| p.display().to_string();
    let files = &plan.files;
    let mut recorder = Role::new(machine, Job::Monitor.into(), &["recorder"]);
    recorder.add(&["--out", &path(&files.folder)]);
    recorder.add(&["--level", &plan.level.to_string()]);
    let (planner, subcommand) = match plan.wrong_samples {
        true => ("faulty-planner", "faulty-servo"),
        false => ("planner", "servo"),
    };
    let mut planner = Role::new(machine, Job::Planner.into(), &[planner]);
    let limit = plan.answer_limit_s.to_string();
    let limit = ["--answer-limit", &limit];
    let mut master = Role::new(machine, Job::Master.into(), &[]);
    match &files.plant {
        Some(plant) => master.add(&["plant-sim", "--plant", &path(plant)]),
        None => master.add(&["master"]),
    }
    master.add(&limit);
    if let Some(program) = &files.program {
        recorder.add(&["--program", &path(program)]);
        planner.add(&["--program", &path(program)]);
        master.add(&["--enabled", "--end-after-program"]);
    }
    if plan.single_block {
        master.add(&["--single-block"]);
    }
    if let Some(line) = plan.start_line {
        master.add(&["--start-line", &line.to_string()]);
    }
    if let Some(orders) = &files.orders {
        master.add(&["--orders", &path(orders)]);
    }
    let servo = |process: Process| {
        let axis = machine.axis_name(process.axis as usize);
        let role = ROLES.get(process.role as usize).unwrap_or(&"?");
        let arguments = [subcommand, "--axis", axis, "--role", role];
        Role::new(machine, process, &arguments)
    };
    let fieldbus = |process: Process| {
        let mut role = Role::new(machine, process, &["fieldbus"]);
        role.add(&limit);
        role
    };
    let mut others: Vec<Role> = Process::fieldbus(machine).map(fieldbus).collect();
    others.extend(machine.logic.as_ref().map(|_| {
        let mut role = Role::new(machine, Job::Logic.into(), &["logic"]);
        role.add(&limit);
        role
    }));
    others.extend(Process::servos(machine).map(servo));
    others.extend([planner, master]);
    give_faults(&mut others, plan);
    let mut roles = vec![recorder];
    roles.extend(others);
    if plan.pace == Pace::Realtime {
        for role in &mut roles {
            add_realtime(role, &machine.processes);
        }
    }
    roles
}

/// Tells a process how it runs in realtime, where that is not the usual way.
fn add_realtime(role: &mut Role, processes: &Processes) {
    let (settings, processors) = processes.of(role.process.job);
    if let Some(priority) = settings.priority {
        role.add(&["--priority", &priority.to_string()]);
    }
    if !processors.is_empty() {
        role.add(&["--processors", &realtime::list(&processors)]);
    }
    let options = |of: &realtime::Settings| {
        [
            ("--lock-memory", of.lock_memory.to_string()),
            ("--touch-stack-kb", of.touch_stack_kb.to_string()),
            ("--touch-heap-kb", of.touch_heap_kb.to_string()),
            ("--timer-slack-ns", of.timer_slack_ns.to_string()),
            ("--busy-max-ms", of.busy_max_ms.to_string()),
        ]
    };
    let usual = options(&realtime::Settings::DEFAULT);
    for (option, _) in options(&settings)
        .iter()
        .zip(&usual)
        .filter(|(set, usual)| set != usual)
    {
        role.add(&[option.0, &option.1]);
    }
}

/// Hands the fault script to the master, which comes last, and to what sends wrong samples by it.
fn give_faults(roles: &mut [Role], plan: &Plan) {
    let Some(faults) = &plan.files.faults else {
        return;
    };
    let faults = faults.display().to_string();
    let reads = |role: &&mut Role| {
        let job = role.process.job;
        let sends = matches!(job, Job::Servo | Job::Planner);
        job == Job::Master || plan.wrong_samples && sends
    };
    for role in roles.iter_mut().filter(reads) {
        role.add(&["--faults", &faults]);
    }
    if let Some(master) = roles.last_mut() {
        for (line, element) in &plan.fault_blocks {
            master.add(&["--fault-block", &format!("{line}={element}")]);
        }
    }
}

/// A started process.
#[derive(Debug)]
struct Member {
    role: Role,
    /// Counts the processes that had this place, from 1.
    incarnation: u32,
    /// Since when it is being started in place of one that was lost; it is not in the roster yet.
    joining: Option<Instant>,
    child: Child,
    ended: OwnedFd,
    log: Option<JoinHandle<Option<String>>>,
    status: Option<ExitStatus>,
}

impl Member {
    /// Waits until all is passed on that it printed; why it gave up, if it said so.
    fn last_words(&mut self) -> Option<String> {
        self.log.take()?.join().ok().flatten()
    }

    /// Lives, and has been admitted.
    fn takes_part(&self) -> bool {
        self.status.is_none() && self.joining.is_none()
    }
}

/// The group of one cell. Dropping it ends and reaps whatever still lives, then the cell's files go.
#[derive(Debug)]
pub struct Group {
    members: Vec<Member>,
    plan: Plan,
    cores: Option<[usize; 3]>,
    register: Register,
    /// The launcher's foot in the cell.
    pub bus: Bus,
    /// The signal page.
    pub page: SignalPage,
    /// The drive page, where the drives are on a fieldbus.
    drive_page: Option<DrivePage>,
    _services: Created,
    cell: Ownership,
}

/// The processors of a lockstep cell: one for master and planner, which works while the master waits; one for the servos, which hand
/// over to each other there; and one for the recorder, the master's where there are two. On a busy PC nobody waits awake for long,
/// and to wake a process on another processor costs more than on the same: there all but the recorder share one. Cells spread over the
/// processors by the launcher's process id.
fn lockstep_cores(pace: Pace) -> Option<[usize; 3]> {
    if pace != Pace::Lockstep {
        return None;
    }
    let cores = realtime::processors();
    let first = std::process::id() as usize % cores.len().max(1);
    let mut from_first = cores.iter().cycle().skip(first).copied();
    let of_master = from_first.next()?;
    let of_answers = match runs_now() > cores.len() {
        true => of_master,
        false => from_first.next()?,
    };
    Some([of_master, of_answers, from_first.next()?])
}

/// Number of threads on this PC that run or could, this one among them.
fn runs_now() -> usize {
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let running = load.split([' ', '/']).nth(3);
    running.and_then(|word| word.parse().ok()).unwrap_or(1)
}

impl Group {
    /// Creates the cell's services and starts all roles; returns when every one of them is ready. Scans run from
    /// [`Group::begin`] on, so that whoever wants to see the first has time to listen.
    ///
    /// # Errors
    /// The cell is taken, the environment refuses, a process ends or does not get ready. Nothing is left running.
    pub fn start(
        mut cell: Ownership,
        machine: &Machine,
        plan: &Plan,
        interrupted: &dyn Fn() -> bool,
    ) -> anyhow::Result<Group> {
        let place: CellPaths = cell.place().clone();
        if plan.pace == Pace::Realtime {
            machine.processes.check_here().map_err(anyhow::Error::msg)?;
        }
        let services = Services::of(&place, &machine.shape());
        bus::limits::check(&place, &services)?;
        bus::limits::check_room(&place, &services)?;
        // Its clients know the machine from here.
        let machine_file = machine::snapshot(&plan.files.machine)?;
        std::fs::write(place.machine_file(), machine_file)
            .context("copying the machine file into the cell")?;
        let named = plan.files.kept_files.name_in(&place);
        named.context("naming the files of offsets and tools")?;
        let bus = Bus::enter(&place, &machine.shape(), "launcher", true)?;
        let services = bus.create_all()?;
        let drive_page = machine.bus.is_some().then(|| DrivePage::create(&place));
        let drive_page = drive_page.transpose()?;
        // Last: who finds it finds all the rest.
        let page = SignalPage::create(&place)?;
        let register = Register::new(bus.roster_writer()?);
        cell.keep_spare_room();
        cell.note_made();
        let cores = lockstep_cores(plan.pace);
        let mut group = Group {
            members: Vec::new(),
            plan: plan.clone(),
            cores,
            register,
            bus,
            page,
            drive_page,
            _services: services,
            cell,
        };
        for (index, role) in roles(machine, plan).into_iter().enumerate() {
            let member = group.spawn(index, role, 1, None)?;
            group.register.enter(index, member.role.process.first());
            group.members.push(member);
        }
        group.wait_until_ready(interrupted)?;
        Ok(group)
    }

    /// The newest scan that the launcher has seen: what it notices happened about then.
    pub fn newest_scan(&self) -> u64 {
        self.register.newest_scan()
    }

    /// The launcher has seen a scan.
    pub fn see(&mut self, scan: u64) {
        self.register.see(scan);
    }

    /// The cell's name.
    pub fn cell_name(&self) -> &str {
        self.cell.place().name()
    }

    /// Where the programs of user M-codes lie; none if they are not switched on.
    pub fn user_code_folder(&self) -> Option<&Path> {
        self.plan.files.user_codes.as_deref()
    }

    /// The cell's pace.
    pub fn pace(&self) -> Pace {
        self.plan.pace
    }

    /// Keeps room for who takes the place of a dead process, unless somebody is about to.
    pub fn keep_spare_room(&mut self) {
        if !self.somebody_joins() {
            self.cell.keep_spare_room();
        }
    }

    /// A file of the cell that somebody has removed while it runs, if so.
    pub fn removed_file(&self) -> Option<String> {
        self.cell.removed().map(|path| path.display().to_string())
    }

    /// Lets the scans begin.
    pub fn begin(&mut self) {
        self.register.publish(&self.page);
        self.page.set_phase(CellPhase::Running);
    }

    /// Hands the roster to observers that have come meanwhile. Not while a process is on its way into it: that one must see
    /// no roster before the one that admits it.
    pub fn publish_roster_to_newcomers(&self) {
        if !self.somebody_joins() {
            self.register.connect_readers();
        }
    }

    /// Says the roster again now and then, for whoever has dropped it because it was not what was sent. Not while a process is on
    /// its way into it.
    pub fn repeat_roster(&mut self) {
        if !self.somebody_joins() {
            self.register.repeat(&self.page);
        }
    }

    /// Starts the process of a place; it takes part once the roster reports it.
    fn spawn(
        &self,
        index: usize,
        role: Role,
        incarnation: u32,
        after_scan: Option<u64>,
    ) -> anyhow::Result<Member> {
        let mut command = Command::new("/proc/self/exe");
        command
            .arg0("quadrant")
            .args(&role.arguments)
            .args(["--cell", self.cell.place().name(), "--machine"])
            .arg(&self.plan.files.machine)
            .args(["--pace", self.plan.pace.word()])
            .args(["--index", &index.to_string()])
            .args(["--incarnation", &incarnation.to_string()])
            .args(["--launcher", &std::process::id().to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            // Ctrl-C goes to the launcher alone, which stops the group in order.
            .process_group(0);
        if let Some(scan) = after_scan {
            command.args(["--after-scan", &scan.to_string()]);
        }
        if let Some([of_master, of_answers, of_recorder]) = self.cores {
            let core = match role.process.job {
                Job::Master | Job::Planner => of_master,
                Job::Monitor => of_recorder,
                _ => of_answers,
            };
            command.args(["--processors", &core.to_string()]);
        }
        let mut child = command
            .spawn()
            .with_context(|| format!("starting {}", role.name))?;
        let stderr = child.stderr.take();
        let followed = || -> anyhow::Result<_> {
            let ended = watch(child.id()).with_context(|| format!("watching {}", role.name))?;
            let log = stderr.map(|stderr| logs::forward(role.name.clone(), stderr));
            let log = log.transpose();
            Ok((
                ended,
                log.with_context(|| format!("reading what {} prints", role.name))?,
            ))
        };
        let (ended, log) = followed().inspect_err(|_| {
            // Nobody else knows of it yet.
            let _ = child.kill();
            let _ = child.wait();
        })?;
        tracing::debug!(process = role.name, pid = child.id(), "started");
        Ok(Member {
            role,
            incarnation,
            joining: (incarnation > 1).then(Instant::now),
            child,
            ended,
            log,
            status: None,
        })
    }

    fn wait_until_ready(&mut self, interrupted: &dyn Fn() -> bool) -> anyhow::Result<()> {
        let started = Instant::now();
        loop {
            let seen = self.page.launcher_signal().count();
            let waiting = self.members.iter().enumerate();
            let waiting =
                waiting.filter(|(index, m)| self.page.ready_incarnation(*index) != m.incarnation);
            let waiting = joined(waiting.map(|(_, member)| &member.role.name), ", ");
            if waiting.is_empty() {
                return Ok(());
            }
            if started.elapsed() > READY_LIMIT {
                bail!("not ready after {} s: {waiting}", READY_LIMIT.as_secs());
            }
            if interrupted() {
                bail!("interrupted while the processes were being started");
            }
            if let Some(death) = self.collect(|| {}).into_iter().next() {
                return Err(death.before_ready());
            }
            self.page.launcher_signal().wait(seen, READY_LOOK);
        }
    }

    /// Sleeps until a process ends or `also` becomes readable, at most `limit`.
    pub fn wait(&self, also: Option<BorrowedFd<'_>>, limit: Duration) {
        let living = self.members.iter().filter(|m| m.status.is_none());
        let ends = living.map(|member| PollFd::new(&member.ended, PollFlags::IN));
        let also = also.map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN));
        let mut fds: Vec<PollFd<'_>> = ends.chain(also).collect();
        let limit = Timespec {
            tv_sec: limit.as_secs() as i64,
            tv_nsec: i64::from(limit.subsec_nanos()),
        };
        let _ = poll(&mut fds, Some(&limit));
    }

    /// Names and process ids of all that live.
    pub fn living(&self) -> impl Iterator<Item = (&str, u32)> {
        let living = self.members.iter().filter(|m| m.status.is_none());
        living.map(|m| (m.role.name.as_str(), m.child.id()))
    }

    /// Whether the process doing this job lives, in the roster or on its way into it.
    pub fn lives(&self, job: Job) -> bool {
        let mut members = self.members.iter();
        members.any(|m| m.role.process.job == job && m.status.is_none())
    }

    /// Reaps whoever has ended, cleans up what they left in shared memory and tells the cell.
    pub fn reap(&mut self) -> Vec<Death> {
        self.reap_after(|| {})
    }

    /// The same; takes a last look before what they left, samples that nobody has taken among it, is cleaned up.
    pub fn reap_after(&mut self, last_look: impl FnOnce()) -> Vec<Death> {
        let deaths = self.collect(last_look);
        for death in &deaths {
            if let Some(words) = &death.last_words {
                tracing::error!("{}: {words}", death.name);
            }
        }
        deaths
    }

    /// The same without a word.
    fn collect(&mut self, last_look: impl FnOnce()) -> Vec<Death> {
        let mut deaths = Vec::new();
        for (index, member) in self.members.iter_mut().enumerate() {
            if member.status.is_some() {
                continue;
            }
            let Ok(Some(status)) = member.child.try_wait() else {
                continue;
            };
            member.status = Some(status);
            let last_words = member.last_words();
            // Who leaves in order has been ordered to: that is no news, and no sample may depend on when it was noticed.
            if !status.success() {
                self.register.note_death(index, status);
            }
            deaths.push(Death {
                last_words,
                ..Death::of(member, index, status)
            });
        }
        self.free_bus(&deaths);
        if !deaths.is_empty() {
            last_look();
            self.bus.clean_dead();
        }
        if deaths.iter().any(|death| !death.status.success()) {
            self.register.publish(&self.page);
        }
        deaths
    }

    /// What came of the frames of the fieldbus, in one line; none without one.
    pub fn bus_words(&self) -> Option<String> {
        let newest = self.drive_page.as_ref()?.newest_inputs()?;
        Some(newest.counts.words())
    }

    /// After the death of a fieldbus process: the bus is free, unless a standby lives, which takes it over.
    fn free_bus(&self, deaths: &[Death]) {
        let died = deaths.iter().any(|death| death.job == Job::Fieldbus);
        if let Some(page) = self.drive_page.as_ref().filter(|_| died)
            && !self.lives(Job::Fieldbus)
        {
            page.disown();
        }
    }

    /// Waits until all have left, at most `limit`, or until somebody is in a hurry; then ends who is still there, which is no
    /// death of theirs. The recorder may have a queue to empty; the others have nothing left to do.
    pub fn wait_until_left(&mut self, limit: Duration, hurry: &dyn Fn() -> bool) -> Vec<Death> {
        let started = Instant::now();
        let mut deaths = Vec::new();
        let mut recorded = (self.page.recorded_scans(), started);
        // They were to replace somebody who is not needed any more.
        let late = |m: &Member| m.joining.is_some() && m.status.is_none();
        self.end(&|m| late(m) && m.role.process.job != Job::Monitor);
        while started.elapsed() < limit && !hurry() {
            deaths.extend(self.reap());
            if self.living().next().is_none() {
                return deaths;
            }
            let scans = self.page.recorded_scans();
            if scans != recorded.0 {
                recorded = (scans, Instant::now());
            }
            let missed = scans <= self.newest_scan() && recorded.1.elapsed() > RECORDER_IDLE_LIMIT;
            let idle = |m: &Member| m.status.is_none() && m.role.process.job != Job::Monitor;
            let idles = self.members.iter().any(idle);
            let missed = missed || idles && started.elapsed() > MISSED_LAST_LIMIT;
            let in_vain = missed || started.elapsed() > limit / 2;
            if in_vain && self.page.phase() != CellPhase::Ending {
                // Whoever still waits for a last feedback waits in vain.
                self.page.set_phase(CellPhase::Ending);
            }
            if started.elapsed() > IDLE_LEAVE_LIMIT && idles {
                self.page.set_phase(CellPhase::Ending);
                self.end_late(&idle);
            }
            if recorded.1.elapsed() > STOPPED_LIMIT {
                self.signal_stopped();
            }
            self.wait(None, LEAVE_LOOK);
        }
        self.page.set_phase(CellPhase::Ending);
        self.end_late(&|member| member.status.is_none());
        deaths
    }

    /// Ends those that somebody has stopped; they are reaped as any other death.
    fn signal_stopped(&self) {
        let lives = self.members.iter().filter(|m| m.status.is_none());
        for member in lives.filter(|m| is_stopped(m.child.id())) {
            tracing::warn!(
                "{} is stopped, and not waited for: killed",
                member.role.name
            );
            let _ = pidfd_send_signal(&member.ended, Signal::KILL);
        }
    }

    /// Ends those who do not leave by themselves, and reports it.
    fn end_late(&mut self, whom: &dyn Fn(&Member) -> bool) {
        for member in self.members.iter().filter(|member| whom(member)) {
            tracing::warn!(process = member.role.name, "did not leave in time: killed");
        }
        self.end(whom);
    }

    /// Ends and reaps them.
    fn end(&mut self, whom: &dyn Fn(&Member) -> bool) {
        for member in self.members.iter_mut().filter(|member| whom(member)) {
            let _ = pidfd_send_signal(&member.ended, Signal::KILL);
            member.status = member.child.wait().ok();
            member.last_words();
        }
        self.bus.clean_dead();
    }

    /// Ends everybody at once and reaps them.
    pub fn kill(&mut self) {
        self.page.set_phase(CellPhase::Ending);
        self.end(&|member| member.status.is_none());
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        if self.living().next().is_some() {
            self.kill();
        }
    }
}
