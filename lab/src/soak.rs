//! `quadrant-lab soak`: a real cell whose processes, launcher and clients are killed and stopped at random instants, again and again,
//! and what must hold all the while.
//!
//! One loop: look on (`cell::Cell::look`, every feedback judged by `judge::Judge`), inject a fault, wait until the cell is whole
//! again, note what came of it.

mod cell;
mod disturb;
mod ending;
mod fault;
pub mod freezer;
mod growth;
mod judge;
mod places;
mod program;
mod tally;

use std::collections::BTreeMap;
use std::fs;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use bus::process::watch;
use bus::sample::{Mode, Participant};
use machine::{Machine, machine_file};
use plant_sim::script::rng::Rng;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Signal, pidfd_send_signal};
use tempfile::TempDir;
use toml_edit::{DocumentMut, value};

use crate::invariants::Course;
use crate::options::SoakOptions;
use cell::{Cell, Process, Start};
use console::exit::{Failure, Kind, Outcome};
use console::logs;
use console::output::say;
use console::signals::Signals;
use disturb::RETURN_LIMIT;
use ending::Left;
use fault::Injection;
use freezer::Freezer;
use growth::{FILES_MAX, Growth};
use launcher::check::{self, Checked};
use places::Places;
use tally::{Came, Tally};

/// A cell that is not whole again so long after a fault counts as broken.
const WHOLE_LIMIT: Duration = Duration::from_secs(30);
/// Scans that the cell must have gone on for, whole.
const GOES_ON_SCANS: u64 = 2;
/// Longest wait between a cell that is whole and the next fault, in µs.
const PAUSE_US: u64 = 300_000;
/// Undisturbed length of a program in s, in realtime and in lockstep, at most; and for each kill that is still to come.
const PROGRAM_S: [f64; 2] = [60.0, 240.0];
const PROGRAM_S_PER_KILL: [f64; 2] = [0.6, 5.0];
/// Of so many faults one is none of a member of the cell.
const DISTURBED_ONE_IN: u64 = 4;
/// Dead children of the launcher are reaped within this.
const REAP_LIMIT: Duration = Duration::from_secs(2);
/// A process may take so much more memory than when it was first seen, in kB: the first part of a program has not used all.
const GROWTH_MAX_KB: u64 = 4096;
/// The same where clients come and go, whose connections stay mapped for a while.
const GROWTH_WITH_CLIENTS_MAX_KB: u64 = 8192;
/// So many more files may be in shared memory while the cell is whole, than when it first was.
const SHARED_FILES_MAX: usize = 8 * FILES_MAX;

/// A soak.
struct Soak<'a> {
    options: &'a SoakOptions,
    signals: Signals,
    /// Unmounted before its folder goes.
    places: Option<Places>,
    scratch: TempDir,
    cell_name: String,
    rng: Rng,
    tally: Tally,
    kills: u64,
    faults: u64,
    clients: u64,
    freezer: Option<Freezer>,
    left: Left,
    /// The last fault was not waited out.
    early: bool,
    runs: u64,
    violations: Vec<String>,
    violation_count: u64,
    judged: u64,
    unseen: u64,
    /// Runs that ended in the trip of a starved master, or of drives without frames.
    starved: u64,
    /// Files that clients had left who were killed while their cell ended.
    left_by_clients: u64,
    off_path_max: f64,
    /// By what a process is.
    growth_kb_max: BTreeMap<String, u64>,
    files_growth_max: usize,
    shared_growth_max: usize,
    overrun_scans: u64,
    orders: (u64, u64),
    status_age_max: u64,
    status_looks: u64,
    began: Instant,
}

/// Runs a soak.
pub fn soak(options: &SoakOptions) -> Outcome {
    logs::init_launcher();
    if options.only.is_none() {
        places::enter_namespace();
    }
    let seed = options.seed.unwrap_or_else(|| {
        // Hash maps begin with a random number of the system's.
        RandomState::new().build_hasher().finish() % 1_000_000_000
    });
    check::load(&options.machine, None, check::Depth::Whole).input()?;
    let signals = Signals::catch().environment()?;
    let name = format!("soak-{}", std::process::id());
    let scratch = tempfile::Builder::new().prefix("quadrant-soak-").tempdir();
    let scratch = scratch.context("a temporary folder").environment()?;
    let mut soak = Soak {
        options,
        signals,
        places: Places::make(scratch.path()),
        scratch,
        rng: Rng::new(seed),
        tally: Tally::default(),
        kills: 0,
        faults: 0,
        clients: 0,
        freezer: Freezer::make(&format!("quadrant-{name}")),
        left: Left::default(),
        early: false,
        runs: 0,
        violations: Vec::new(),
        violation_count: 0,
        judged: 0,
        unseen: 0,
        starved: 0,
        left_by_clients: 0,
        off_path_max: 0.0,
        growth_kb_max: BTreeMap::new(),
        files_growth_max: 0,
        shared_growth_max: 0,
        overrun_scans: 0,
        orders: (0, 0),
        status_age_max: 0,
        status_looks: 0,
        began: Instant::now(),
        cell_name: name,
    };
    say(&format!(
        "soak of {}, {}, {}, seed {seed}",
        options.machine.display(),
        options.pace,
        soak.length()
    ));
    if soak.freezer.is_none() {
        say("no cgroup can be made here: none is frozen");
    }
    if soak.places.is_none() && options.only.is_none() {
        say("no file system can be mounted here: /dev/shm and the disk are not filled");
    }
    while !soak.is_over() {
        soak.run()?;
    }
    soak.conclude(seed)
}

impl Soak<'_> {
    fn realtime(&self) -> bool {
        self.options.pace == "realtime"
    }

    /// How long it is, in words.
    fn length(&self) -> String {
        let kills = self.options.kills.map(|kills| format!("{kills} kills"));
        let hours = self.options.hours.map(|hours| format!("{hours} h"));
        let both: Vec<String> = kills.into_iter().chain(hours).collect();
        both.join(" or ")
    }

    /// All kills are spent, or all time, or somebody has had enough.
    fn is_over(&self) -> bool {
        let hours = self.began.elapsed().as_secs_f64() / 3600.0;
        self.options.kills.is_some_and(|kills| self.kills >= kills)
            || self.options.hours.is_some_and(|most| hours >= most)
            || self.signals.count() > 0
    }

    /// Undisturbed length of the next program in s.
    fn program_s(&self) -> f64 {
        let pace = usize::from(!self.realtime());
        let pause_s = self.options.pause_ms as f64 * 1e-3;
        let per_kill = PROGRAM_S_PER_KILL[pace] + pause_s;
        let left = self.options.kills.map_or(f64::INFINITY, |kills| {
            kills.saturating_sub(self.kills) as f64 * per_kill
        });
        left.clamp(2.0, PROGRAM_S[pace])
    }

    fn violated(&mut self, text: String) {
        self.violation_count += 1;
        say(&format!("  VIOLATION: {text}"));
        self.violations.push(text);
    }

    /// Writes the machine of the next run: everything restarts; every axis has a standby, or in every other run every second.
    fn write_machine(&self) -> anyhow::Result<()> {
        let file = machine_file(&self.options.machine);
        let text = machine::snapshot(&file)?;
        let mut machine: DocumentMut = text.parse()?;
        for (key, word) in [
            ("planner", "resume"),
            ("servo", "resume"),
            ("master", "wait"),
            ("monitor", "restart"),
        ] {
            machine["restart"][key] = value(word);
        }
        machine["restart"]["restarts_max"] = value(1_000_000);
        let axes = machine["axis"].as_array_of_tables_mut();
        for (index, axis) in axes
            .into_iter()
            .flat_map(|axes| axes.iter_mut())
            .enumerate()
        {
            axis["standby"] = value(self.runs % 2 == 1 || index % 2 == 0);
        }
        fs::write(
            self.scratch.path().join("machine.toml"),
            machine.to_string(),
        )?;
        let scratch = self.scratch.path();
        if let Some(bus) = machine.get_mut("bus") {
            bus["standby"] = value(self.runs % 2 == 1);
            let beside = file.parent().unwrap_or(Path::new(""));
            Machine::load(&file)?.copy_drive_files(beside, scratch)?;
        } else {
            fs::copy(
                file.with_file_name("plant.toml"),
                scratch.join("plant.toml"),
            )?;
        }
        Ok(())
    }

    /// One run: faults until its program is done or all kills are spent.
    fn run(&mut self) -> Result<(), Failure> {
        self.runs += 1;
        self.write_machine().environment()?;
        let seconds = self.program_s();
        let program = self.scratch.path().join("soak.ngc");
        let text = program::generate(&mut self.rng, seconds);
        let on_bus = Machine::load(self.scratch.path()).input()?.bus.is_some();
        let text = if on_bus {
            program::from_anywhere(&text)
        } else {
            text
        };
        fs::write(&program, text).environment()?;
        let Checked {
            machine,
            program: checked,
            ..
        } = check::load(self.scratch.path(), Some(&program), check::Depth::Whole).input()?;
        let checked = checked.context("a program").environment()?;
        let course = Course::of_program(&machine, checked).environment()?;
        let folder = self.places.as_ref().map(|places| places.disk.as_path());
        let folder = folder.unwrap_or_else(|| self.scratch.path());
        let out = folder.join(format!("run-{}", self.runs));
        let kept = self.scratch.path().join(format!("run-{}", self.runs));
        let published = self.scratch.path().join(format!("run-{}.txt", self.runs));
        let since = Instant::now();
        let start = Start {
            machine_folder: self.scratch.path(),
            machine: &machine,
            program: &program,
            pace: &self.options.pace,
            name: &self.cell_name,
            out: &out,
            published: &published,
        };
        let mut cell = Cell::start(&start, course).environment()?;
        let violations_before = self.violation_count;
        let faults_before = self.faults;
        self.left.started(since, &mut self.tally);
        let (ending, after) = self.draw_ending();
        self.inject_until_done(&mut cell, after);
        let ending = self.end(&mut cell, ending, seconds, &out);
        let (scan, clients_killed) = (cell.scan(), cell.clients_killed_at_end());
        drop(cell);
        self.judge_left(ending, clients_killed);
        let broken = self.violation_count > violations_before;
        say(&format!(
            "run {:>3}: {:<15} {:>4} faults, {:>5} kills in all, {:>6} scans, {:>4.0} s{}",
            self.runs,
            ending.word(),
            self.faults - faults_before,
            self.kills,
            scan,
            self.began.elapsed().as_secs_f64(),
            if broken {
                format!(", see {}", kept.display())
            } else {
                String::new()
            }
        ));
        if !broken {
            let _ = fs::remove_file(&published);
        } else if self.places.is_some() {
            keep(&out, &kept);
        }
        if !broken || self.places.is_some() {
            let _ = fs::remove_dir_all(&out);
        }
        Ok(())
    }

    fn inject_until_done(&mut self, cell: &mut Cell, faults: u64) {
        if !self.await_whole(cell) {
            return;
        }
        let shared_at_first = cell.files();
        let mut growth = Growth::default();
        let until = self.faults.saturating_add(faults);
        while !self.is_over() && self.faults < until {
            let pause_us = self.options.pause_ms * 1000 + self.rng.below(PAUSE_US);
            let pause = Duration::from_micros(pause_us);
            if !cell.operate_until(Instant::now() + pause) {
                return;
            }
            // What dies while the processes leave is not replaced: the run reports it and ends otherwise than well.
            if cell.mode() == Some(Mode::Finished) {
                return;
            }
            let only = self.options.only.as_deref();
            let goes_on = if only.is_none() && self.rng.below(DISTURBED_ONE_IN) == 0 {
                self.disturb(cell)
            } else {
                let injection = fault::next(&mut self.rng, cell, only);
                self.inject(cell, &injection)
            };
            if !goes_on {
                return;
            }
            self.measure_floor();
            if !cell.look() {
                return;
            }
            self.judge_processes(cell, &mut growth, shared_at_first);
        }
    }

    /// Injects a fault and waits until the cell is whole again; false if there is nothing more to hit in this run.
    fn inject(&mut self, cell: &mut Cell, injection: &Injection) -> bool {
        let processes = cell.processes();
        let hit: Vec<&Process> = processes
            .iter()
            .filter(|process| injection.slots.contains(&process.slot))
            .collect();
        let before = fault::incarnations(cell, &injection.slots);
        cell.look();
        if cell.mode() == Some(Mode::Finished) {
            return false;
        }
        cell.judge.reactions();
        cell.judge.drives_are_left &= self.early;
        cell.judge.drives_are_left |= injection.leaves_drives;
        let (scan, at) = (cell.scan(), Instant::now());
        let signal = if injection.stopped.is_some() {
            Signal::STOP
        } else {
            Signal::KILL
        };
        for process in &hit {
            process.signal(signal);
        }
        self.faults += 1;
        let mut back = None;
        let mut early = false;
        let whole = if let Some(stopped) = injection.stopped {
            let goes_on = cell.look_until(at + stopped);
            for process in &hit {
                process.signal(Signal::CONT);
            }
            // What was stopped has to have been asked again before it shows what it makes of it.
            goes_on
                && cell.look_until(Instant::now() + Duration::from_millis(20))
                && self.await_whole(cell)
        } else {
            self.kills += hit.len() as u64;
            let whole = self.await_back(cell, &before);
            if whole {
                let ms = at.elapsed().as_secs_f64() * 1e3;
                back = Some((cell.scan().saturating_sub(scan) as f64, ms));
            }
            // Now and then the next fault comes while the machine is on its way back.
            early = self.rng.below(10) == 0;
            whole && (early || self.await_whole(cell))
        };
        let kind = if std::mem::replace(&mut self.early, early) {
            "any, before the one before was over"
        } else {
            injection.kind
        };
        let reactions = cell.judge.reactions();
        let ended = cell.status.is_some() || cell.mode() == Some(Mode::Finished);
        let reaction = reactions.words(early, ended);
        self.overrun_scans += u64::from(reactions.overrun_scans);
        self.tally.add(&Came {
            kind,
            reaction,
            restart: back,
            whole_scans: (whole && !ended && !early)
                .then(|| cell.scan().saturating_sub(scan) as f64),
        });
        whole
    }

    /// Waits until other processes have the slots; false if the run has ended or they do not come.
    fn await_back(&mut self, cell: &mut Cell, before: &[(usize, u32)]) -> bool {
        let since = Instant::now();
        loop {
            if !cell.look() {
                return false;
            }
            let slots = cell.slots();
            let back = before.iter().all(|(slot, incarnation)| {
                let is = |(at, p): &&(usize, Participant)| at == slot && p.live == 1;
                slots
                    .iter()
                    .find(is)
                    .is_some_and(|(_, p)| p.incarnation > *incarnation)
            });
            if back {
                return true;
            }
            if cell.mode() == Some(Mode::Finished) {
                return false;
            }
            if since.elapsed() > WHOLE_LIMIT {
                self.not_whole(cell, "who was killed has no successor");
                return false;
            }
            cell.look_until(Instant::now() + Duration::from_micros(500));
        }
    }

    /// Waits until all take part and the machine moves or is done; false if the run has ended or that does not come.
    fn await_whole(&mut self, cell: &mut Cell) -> bool {
        let since = Instant::now();
        let mut whole_at = None;
        loop {
            if !cell.look() {
                return false;
            }
            if !cell.is_whole() {
                whole_at = None;
            } else if cell.mode() == Some(Mode::Finished) {
                return true;
            } else if cell.scan() >= *whole_at.get_or_insert(cell.scan()) + GOES_ON_SCANS {
                // A machine that is at rest in the middle of a scan looks whole, too.
                return true;
            }
            cell.operate();
            if since.elapsed() > WHOLE_LIMIT {
                self.not_whole(cell, "the cell is not whole again");
                return false;
            }
            cell.look_until(Instant::now() + Duration::from_micros(500));
        }
    }

    fn not_whole(&mut self, cell: &Cell, what: &str) {
        let mode = cell.mode().map_or("without a mode", Mode::word);
        let hold = cell.judge.newest().map_or(0, |f| f.hold);
        self.violated(format!(
            "{what} after {} s: {mode}, hold {hold}, scan {}, roster {:?}",
            WHOLE_LIMIT.as_secs(),
            cell.scan(),
            cell.slots()
        ));
    }

    /// Nobody grows, nobody stays dead, and what is in shared memory does not pile up.
    fn judge_processes(&mut self, cell: &mut Cell, growth: &mut Growth, shared_at_first: usize) {
        for (pid, role) in cell.settled() {
            let most_kb = match self.clients {
                0 => GROWTH_MAX_KB,
                _ => GROWTH_WITH_CLIENTS_MAX_KB,
            };
            let Some(mut held) = cell::held(pid) else {
                continue;
            };
            let since = Instant::now();
            while growth.exceeds(pid, held, most_kb) && since.elapsed() < RETURN_LIMIT {
                cell.look_until(Instant::now() + Duration::from_millis(20));
                match cell::held(pid) {
                    Some(now) if !cell.is_over() => held = now,
                    _ => return,
                }
            }
            let (grown, is_too_much) = growth.take(pid, held, most_kb, Instant::now());
            let most = self.growth_kb_max.entry(role.clone()).or_default();
            *most = grown.kb.max(*most);
            self.files_growth_max = self.files_growth_max.max(grown.files);
            if is_too_much {
                self.violated(format!(
                    "{role}, process {pid}, has grown by {} kB and {} open files ({})",
                    grown.kb,
                    grown.files,
                    cell::memory_in_words(pid)
                ));
            }
        }
        // What clients that were killed have left goes once in a second.
        let since = Instant::now();
        while cell.files() > shared_at_first + SHARED_FILES_MAX && since.elapsed() < RETURN_LIMIT {
            cell.look_until(Instant::now() + Duration::from_millis(20));
        }
        let shared = cell.files().saturating_sub(shared_at_first);
        self.shared_growth_max = self.shared_growth_max.max(shared);
        if shared > SHARED_FILES_MAX {
            self.violated(format!("{shared} more files of the cell in /dev/shm"));
        }
        let dead = cell.zombies();
        let since = Instant::now();
        let mut left = dead;
        while !left.is_empty() && since.elapsed() < REAP_LIMIT {
            cell.look_until(Instant::now() + Duration::from_millis(5));
            let now = cell.zombies();
            left.retain(|pid| now.contains(pid));
        }
        if !left.is_empty() {
            self.violated(format!("dead and not reaped: {left:?}"));
        }
    }

    /// What no restart can be faster than, here and now: the kernel's word of a death, and a process that does nothing.
    fn measure_floor(&mut self) {
        let sleeper = Command::new("sleep").arg("60").stdin(Stdio::null()).spawn();
        if let Ok(mut child) = sleeper {
            if let Ok(handle) = watch(child.id()) {
                let since = Instant::now();
                let _ = pidfd_send_signal(&handle, Signal::KILL);
                let _ = poll(&mut [PollFd::new(&handle, PollFlags::IN)], None);
                self.tally
                    .notification_ms
                    .add(since.elapsed().as_secs_f64() * 1e3);
            }
            let _ = child.kill();
            let _ = child.wait();
        }
        let since = Instant::now();
        let bare = Command::new("/proc/self/exe")
            .arg("--version")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .status();
        if bare.is_ok() {
            self.tally
                .process_ms
                .add(since.elapsed().as_secs_f64() * 1e3);
        }
    }

    fn conclude(mut self, seed: u64) -> Outcome {
        say("");
        say(&self.tally.words());
        let growth = self.growth_kb_max.iter();
        let growth: Vec<String> = growth.map(|(role, kb)| format!("{role} {kb}")).collect();
        say(&format!(
            "{} kills, {} faults, {} clients killed or stopped, {} runs, {:.0} s; {} scans judged, {} not seen\n\
             commanded points off the path: at most {:.2} increments; scans overrun and counted: {}\n\
             operator: {} orders obeyed, {} refused until the machine was ready for them\n\
             growth of a process, in kB at most: {}; at most {} open files; of the cell's shared memory: {} files\n\
             status: of {} looks none saw the machine older than {} scans before a servo's last answer\n\
             runs that ended in the trip of a starved master or of drives without frames: {}; files of clients killed at the end, cleaned up: {}",
            self.kills,
            self.faults,
            self.clients,
            self.runs,
            self.began.elapsed().as_secs_f64(),
            self.judged,
            self.unseen,
            self.off_path_max,
            self.overrun_scans,
            self.orders.0,
            self.orders.1,
            growth.join(", "),
            self.files_growth_max,
            self.shared_growth_max,
            self.status_looks,
            self.status_age_max,
            self.starved,
            self.left_by_clients,
        ));
        say(&format!("violations: {}", self.violation_count));
        // Files of a run that violated something stay for whoever looks for the cause.
        self.scratch.disable_cleanup(self.violation_count > 0);
        if self.signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        if let Some(first) = self.violations.first() {
            return Err(Failure::Stopped(anyhow!(
                "{} violations, the first: {first}; files in {}; the same choices again: --seed {seed}",
                self.violation_count,
                self.scratch.path().display()
            )));
        }
        Ok(())
    }
}

/// Copies the files of a folder that goes with the soak.
fn keep(folder: &Path, to: &Path) {
    let _ = fs::create_dir(to);
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let _ = fs::copy(entry.path(), to.join(entry.file_name()));
    }
}
