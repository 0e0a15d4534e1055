//! `load`, `start` and `down`: the programs of a cell that stays up, and its end.

use std::ffi::OsString;
use std::fs::{self, DirBuilder};
use std::io::ErrorKind;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{anyhow, bail};
use bus::process::watch;
use bus::sample::{
    Cause, Feedback, Mode, OperatorRequest, OperatorResponse, Order, ProgramState, RunOutcome,
};
use machine::Dialect;
use monitor::ended::Ended;
use monitor::log::part_files;
use planner::ProgramText;
use program::{Note, ProgramEnd};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Signal, pidfd_send_signal};

use super::Client;
use super::client::ANSWER_LIMIT;
use super::eyes::Eyes;
use crate::options::{LoadOptions, OperatorOptions, StartOptions};
use console::exit::{Failure, Kind, Outcome};
use console::output::say;
use launcher::check::{self, all_arrives, at_line, without_spindle};
use launcher::run_dir::{copy_program, program_name};
use launcher::supervise::stop_words;
use launcher::user_codes;

/// A program that takes longer to check would let the planner of a running cell seem to hang.
const CHECK_LIMIT: Duration = Duration::from_secs(10);
/// So long the planner may take to read a program.
pub(super) const READ_LIMIT: Duration = Duration::from_secs(60);
/// So long a cell may take to come to rest, make its last report and leave.
const DOWN_LIMIT: Duration = Duration::from_secs(240);
/// So long a cell that takes no order may take to say that it ends.
const ENDS_BY_ITSELF: Duration = Duration::from_millis(500);
/// Time between two looks whether it does.
const ENDS_LOOK: Duration = Duration::from_millis(5);
/// The recorder comes behind the machine; one that was lost is replaced by then.
const RECORDED_WITHIN: Duration = Duration::from_secs(10);
pub(super) const LOOK: Duration = Duration::from_millis(5);

/// `load`.
pub fn load(options: &LoadOptions) -> Outcome {
    let file = &options.program;
    let dialect = options.of_program.dialect;
    let name = program_name(file).input()?.to_string();
    let client = Client::to_order(options.to.cell.as_deref())?;
    fits(file).input()?;
    let mut eyes = Eyes::open(&client)?;
    let now = eyes.look()?;
    let started = Instant::now();
    let Checked { notes, read, .. } = check(&client, file, dialect, &now).input()?;
    for note in &notes {
        say(note);
    }
    if started.elapsed() > CHECK_LIMIT {
        return Err(Failure::Input(anyhow!(
            "{}: takes {:.0} s to read; a cell waits for its planner for {} s at most: make several programs of it, or use `quadrant run`",
            file.display(),
            started.elapsed().as_secs_f64(),
            CHECK_LIMIT.as_secs()
        )));
    }
    let mut laid = Laid::down(&client, now.load, &name, file, dialect)?;
    laid.load(&client)?;
    until_read(&mut eyes, laid.number, &name)?;
    let given_up = if now.program == ProgramState::Running as u32 {
        format!("; run {} is given up", now.run)
    } else {
        String::new()
    };
    client.say(&format!(
        "loaded {name}: {read}{given_up}; `quadrant start` begins it"
    ));
    Ok(())
}

/// Waits until the planner has read a program.
pub(super) fn until_read(eyes: &mut Eyes<'_>, number: u32, name: &str) -> Result<(), Failure> {
    let started = Instant::now();
    loop {
        let seen = eyes.look()?;
        let state = ProgramState::from_wire(seen.program);
        if seen.load > number {
            return Err(Failure::Stopped(anyhow!(
                "another program was loaded meanwhile"
            )));
        }
        match state {
            // The order was obeyed, but is not seen yet.
            _ if seen.load < number => {}
            Some(ProgramState::Loading) => {}
            Some(ProgramState::None) | None => {
                return Err(Failure::Stopped(anyhow!(
                    "the planner refuses {name}: {}",
                    eyes.planners_reason(&seen)
                )));
            }
            Some(_) => return Ok(()),
        }
        if started.elapsed() > READ_LIMIT {
            return Err(Failure::Stopped(anyhow!(
                "the planner has not read {name} after {} s; it is still at it",
                READ_LIMIT.as_secs()
            )));
        }
        std::thread::sleep(LOOK);
    }
}

/// A loaded program lies in memory as long as its cell is up.
fn fits(file: &Path) -> anyhow::Result<()> {
    let bytes = fs::metadata(file).map_or(0, |of| of.len());
    if bytes > program::FILE_BYTES_MAX {
        bail!(
            "{}: has {} MiB: a program that is loaded has at most {} MiB; `quadrant run` takes one of any length",
            file.display(),
            bytes >> 20,
            program::FILE_BYTES_MAX >> 20
        );
    }
    Ok(())
}

/// A program that was checked.
pub(super) struct Checked {
    /// What is to be noted.
    pub notes: Vec<String>,
    /// What it is, in words.
    read: String,
    /// M2 or M30 ends it.
    pub ends_by_word: bool,
}

/// Checks the program against the machine, from where its axes are.
pub(super) fn check(
    client: &Client,
    file: &Path,
    dialect: Option<Dialect>,
    now: &Feedback,
) -> anyhow::Result<Checked> {
    let mut machine = client.machine_of_next_program(&now.auxiliary)?;
    machine.program.dialect = dialect.unwrap_or(machine.program.dialect);
    let machine = &machine;
    let start = now.path_positions();
    let name = file.display().to_string();
    let short = program::load_if_short(machine, &start, file, program::SHORT_ELEMENTS, &[])?;
    let (notes, elements, length_mm, ends_by_word) = match short {
        Some(program) => {
            // The copy of a cell names the folder in full.
            if let Some(folder) = machine.user_code_folder(Path::new("")) {
                user_codes::check(&folder, &program)?;
            }
            all_arrives(machine, &program)?;
            let (elements, length_mm) = (program.path.elements.len(), program.path.length_mm());
            let ends_by_word = matches!(program.end, ProgramEnd::M2(_) | ProgramEnd::M30(_));
            let beside = without_spindle(machine, &program);
            let notes = program.notes.iter().map(Note::shown);
            let notes: Vec<String> = beside.into_iter().chain(notes).collect();
            planner::course(machine, program).map_err(|e| at_line(&name, &e.to_string()))?;
            (notes, elements as u64, length_mm, ends_by_word)
        }
        None => {
            let text = ProgramText::File(file.to_path_buf());
            let survey = planner::survey(machine, &text, start, u64::MAX, |_| {})?;
            let notes = survey.notes.iter().map(Note::shown).collect();
            (notes, survey.elements, survey.length_mm, false)
        }
    };
    Ok(Checked {
        notes,
        read: format!("{elements} elements, {length_mm:.1} mm"),
        ends_by_word,
    })
}

/// A program in the cell's folder; taken away again unless it is kept.
pub(super) struct Laid {
    pub number: u32,
    folder: PathBuf,
    kept: bool,
}

impl Laid {
    /// Puts the program there under a number that nobody has, above that of the one that is loaded.
    pub fn down(
        client: &Client,
        loaded: u32,
        name: &str,
        program: &Path,
        dialect: Option<Dialect>,
    ) -> Result<Laid, Failure> {
        let laid = Laid::empty(client, loaded)?;
        let to = laid.folder.join(name);
        copy_program(program, &client.machine, dialect, &to).environment()?;
        Ok(laid)
    }

    /// Puts a copy of the program that is loaded there, as it lies there now; none if it is gone.
    pub fn again(client: &Client, above: u32, loaded: u32) -> Result<Option<Laid>, Failure> {
        let from = client.cell.place.program_folder(loaded);
        let Ok(files) = fs::read_dir(from) else {
            return Ok(None);
        };
        let laid = Laid::empty(client, above)?;
        for file in files.flatten() {
            fs::copy(file.path(), laid.folder.join(file.file_name())).environment()?;
        }
        Ok(Some(laid))
    }

    /// Has the cell take it.
    fn load(&mut self, client: &Client) -> Result<(), Failure> {
        self.give(client, None, OperatorRequest::default())?;
        Ok(())
    }

    /// Has the cell take it as typed-in blocks, with a copy of the program that `now` shows loaded, if one is. `end_program` where M2 or M30
    /// ends them.
    pub fn load_typed(
        &mut self,
        client: &Client,
        now: &Feedback,
        before: Option<&mut Laid>,
        end_program: bool,
    ) -> Result<OperatorResponse, Failure> {
        let request = OperatorRequest {
            axis: u32::from(end_program),
            session: now.load.saturating_add(1),
            deadline_scans: before.as_ref().map_or(0, |before| before.number),
            ..OperatorRequest::default()
        };
        self.give(client, before, request)
    }

    fn give(
        &mut self,
        client: &Client,
        before: Option<&mut Laid>,
        request: OperatorRequest,
    ) -> Result<OperatorResponse, Failure> {
        let request = OperatorRequest {
            value: f64::from(self.number),
            ..request
        };
        let answer = client.hear(Order::Load, request);
        // Unless it was refused the cell has it, or may have: then its launcher takes it away.
        self.kept = answer.as_ref().map_or(true, |answer| answer.accepted == 1);
        if let Some(before) = before {
            before.kept = self.kept;
        }
        client.accepted(Order::Load, answer?)
    }

    fn empty(client: &Client, loaded: u32) -> Result<Laid, Failure> {
        let mut maker = DirBuilder::new();
        let maker = maker.mode(0o700);
        let programs = client.cell.place.programs();
        match maker.create(&programs) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                return Err(Failure::Environment(error.into()));
            }
            _ => {}
        }
        let mut number = loaded;
        let folder = loop {
            number = number.saturating_add(1);
            let folder = client.cell.place.program_folder(number);
            match maker.create(&folder) {
                Ok(()) => break folder,
                Err(error) if error.kind() == ErrorKind::AlreadyExists && number < u32::MAX => {}
                Err(error) => return Err(Failure::Environment(error.into())),
            }
        };
        Ok(Laid {
            number,
            folder,
            kept: false,
        })
    }
}

impl Drop for Laid {
    fn drop(&mut self) {
        if !self.kept {
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

/// Orders the start, block by block if that is wanted.
fn begin(
    client: &Client,
    options: &StartOptions,
    before: &Feedback,
) -> Result<OperatorResponse, Failure> {
    if options.single_block {
        client.order(Order::SingleBlock, 1.0)?;
    }
    let request = OperatorRequest {
        value: f64::from(options.line.unwrap_or(0)),
        // A line is one of the program that was looked at.
        session: if options.line.is_some() {
            before.load
        } else {
            0
        },
        ..OperatorRequest::default()
    };
    client.ask(Order::Start, request).inspect_err(|_| {
        // Nothing starts half.
        if options.single_block && !before.inputs.single_block() {
            let _ = client.order(Order::SingleBlock, 0.0);
        }
    })
}

/// Whether the program that is loaded can be started at a line, from where the axes stand.
fn begins_at(client: &Client, now: &Feedback, line: u32) -> anyhow::Result<()> {
    let Some(file) = client.cell.place.program(now.load) else {
        // Without a program the cell refuses to start.
        return Ok(());
    };
    let machine = client.machine_of_next_program(&now.auxiliary)?;
    let start = now.path_positions();
    check::start_line(&machine, &file, start, line)
}

/// `start`.
pub fn start(options: &StartOptions) -> Outcome {
    let client = Client::to_order(options.to.cell.as_deref())?;
    // Listens before it asks, so that the shortest program is not missed.
    let mut eyes = Eyes::open(&client)?;
    let before = eyes.look()?;
    let loaded = before.load;
    if let Some(line) = options.line {
        begins_at(&client, &before, line).input()?;
    }
    let answer = begin(&client, options, &before)?;
    let (words, folder) = started(&client, &answer, loaded);
    let at = options.line.map(|line| format!(", at line {line}"));
    client.say(&(words + &at.unwrap_or_default()));
    match options.wait {
        true => match until_done(&client, &mut eyes, answer.run, &|| false)? {
            Some(scan) => done(&client, answer.run, scan, folder.as_deref()),
            None => Ok(()),
        },
        false => Ok(()),
    }
}

/// The program with the number `load` was started: which run it is, in words, and where its run directory is.
pub(super) fn started(
    client: &Client,
    answer: &OperatorResponse,
    load: u32,
) -> (String, Option<PathBuf>) {
    let program = client.cell.place.program(load);
    let folder = program.and_then(|program| folder_of(client, answer.run, &program));
    (
        started_words(answer.run, answer.hold == 1, folder.as_deref()),
        folder,
    )
}

/// A run was started, in words.
pub(super) fn started_words(run: u32, in_hold: bool, folder: Option<&Path>) -> String {
    let hold = if in_hold {
        ", in hold: resume moves"
    } else {
        ""
    };
    let shown = folder.map_or(String::new(), |folder| format!(": {}", folder.display()));
    format!("run {run} started{hold}{shown}")
}

/// Waits until a run is done: the scan in which it is; none if `is_over` says so before.
pub(super) fn until_done(
    client: &Client,
    eyes: &mut Eyes<'_>,
    run: u32,
    is_over: &dyn Fn() -> bool,
) -> Result<Option<u64>, Failure> {
    let messages = client.cell.place.messages();
    let stop_words = |now: &Feedback| stop_words(now, &client.machine, Some(&messages));
    while !is_over() {
        let now = eyes.look()?;
        let started = now.program == ProgramState::Running as u32;
        // Once it has come to rest it is left, and can be started again.
        let leaves = now.cause == Cause::Abort as u32 && started && now.last == 0;
        let ended = Ended::told(&client.machine, &now, run);
        if let Some(ended) = &ended
            && (ended.outcome == RunOutcome::Completed || now.run > run || !started)
        {
            if ended.outcome == RunOutcome::Completed {
                return Ok(Some(now.scan));
            }
            let why = match Cause::from_wire(now.cause) {
                Some(Cause::None) if ended.text.is_empty() => ended.outcome.word(),
                Some(Cause::None) => &ended.text,
                _ => &stop_words(&now),
            };
            return Err(Failure::Stopped(anyhow!("run {run} was given up: {why}")));
        }
        if now.run > run {
            return Err(Failure::Stopped(anyhow!(
                "run {run} is over and another one has started: how it ended stands in its report"
            )));
        }
        let mode = Mode::from_wire(now.mode);
        let stands = matches!(mode, Some(Mode::Tripped | Mode::Stopped | Mode::Disabled));
        if now.run == run && (stands && !leaves || now.last == 1) {
            return Err(Failure::Stopped(anyhow!(
                "run {run} is not done: {}",
                stop_words(&now)
            )));
        }
        std::thread::sleep(LOOK);
    }
    Ok(None)
}

/// A run is done: whether it was recorded too.
fn done(client: &Client, run: u32, scan: u64, folder: Option<&Path>) -> Outcome {
    let asked = Instant::now();
    let page = &client.cell.page;
    while page.recorded_scans() <= scan && !client.cell.is_gone() {
        if asked.elapsed() > RECORDED_WITHIN {
            break;
        }
        std::thread::sleep(LOOK);
    }
    let log = folder.map(|folder| folder.join(monitor::log::LOG_FILE));
    let is_there = |log: &PathBuf| fs::metadata(log).is_ok_and(|of| of.len() > 0);
    // Each recorder begins a part of its own: what the one before had not written is missing.
    let parts = folder.and_then(|folder| part_files(folder).ok());
    let is_whole = parts.is_none_or(|parts| parts.len() < 2);
    let recorded = is_whole && (client.cell.is_gone() || page.recorded_scans() > scan);
    if log.as_ref().is_none_or(is_there) && recorded {
        client.say(&format!("run {run} is done"));
        return Ok(());
    }
    let log = log.unwrap_or_default();
    let what = if is_there(&log) {
        "is not all in its log"
    } else {
        "was not recorded: there is no log"
    };
    Err(Failure::Environment(anyhow!(
        "{}: run {run} is done, but {what} {}: the terminal of `quadrant up` has the reason",
        client.cell.place.name(),
        log.display()
    )))
}

/// Run directory of a run of this program that was started just now, if it can be known.
pub(super) fn folder_of(client: &Client, run: u32, program: &Path) -> Option<PathBuf> {
    let runs = fs::read(client.cell.place.runs_file()).ok()?;
    let runs = PathBuf::from(OsString::from_vec(runs));
    Some(monitor::run_folder(&runs, run, program))
}

/// Whether a cell that takes no order ends all the same: somebody else's came first.
fn ends_by_itself(client: &Client, launcher: &OwnedFd) -> bool {
    let asked = Instant::now();
    while !client.cell.is_gone() {
        if asked.elapsed() > ENDS_BY_ITSELF {
            return false;
        }
        let mut ended = [PollFd::new(launcher, PollFlags::IN)];
        let look = Timespec {
            tv_sec: 0,
            tv_nsec: ENDS_LOOK.subsec_nanos().into(),
        };
        if poll(&mut ended, Some(&look)).is_ok_and(|count| count > 0) {
            break;
        }
    }
    true
}

/// `down`.
pub fn down(options: &OperatorOptions) -> Outcome {
    let client = Client::to_order(options.cell.as_deref())?;
    let cell = client.cell.place.name().to_string();
    let launcher = watch(client.cell.page.launcher_pid())
        .map_err(|_| Failure::Stopped(anyhow!("cell {cell:?} has just ended")))?;
    let asked = Instant::now();
    let ask = || client.ask(Order::Down, OperatorRequest::default());
    let mut failed = ask().err();
    let died = failed.is_some() && asked.elapsed() < ANSWER_LIMIT;
    if died && !ends_by_itself(&client, &launcher) {
        // Its master died with the order, or the order was refused: the master there is now is asked.
        failed = ask().err();
    }
    if let Some(failure) = failed
        && !ends_by_itself(&client, &launcher)
    {
        // Nobody there to answer: its launcher ends what is left of it.
        pidfd_send_signal(&launcher, Signal::TERM).map_err(|_| failure)?;
    }
    // A client is gone before the cell is: what it closes later would be the next one's.
    drop(client);
    let mut ended = [PollFd::new(&launcher, PollFlags::IN)];
    let limit = Timespec {
        tv_sec: DOWN_LIMIT.as_secs() as i64,
        tv_nsec: 0,
    };
    match poll(&mut ended, Some(&limit)) {
        Ok(0) | Err(_) => Err(Failure::Stopped(anyhow!(
            "cell {cell:?} is ordered to end, and has not after {} s",
            DOWN_LIMIT.as_secs()
        ))),
        Ok(_) => {
            say(&format!("{cell}: down"));
            Ok(())
        }
    }
}
