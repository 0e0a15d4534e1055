//! `load`, `start` and `down`: the programs of a cell that stays up, and its end.

use std::fs::{self, DirBuilder};
use std::io::ErrorKind;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use bus::member::watch;
use bus::port::Reader;
use bus::sample::{Feedback, Mode, OperatorRequest, Order, ProgramState};
use control::path::AxisVector;
use program::Setup;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Signal, pidfd_send_signal};

use super::Client;
use crate::cli::{LoadOptions, OperatorOptions, StartOptions};
use crate::exit::{Failure, Kind, Outcome};
use crate::output::say;
use crate::run_dir::program_name;
use crate::supervise::stop_words;

/// A cell of which nothing was heard by then is silent.
const SILENCE: Duration = Duration::from_secs(10);
/// So long the planner may take to read a program.
const READ_LIMIT: Duration = Duration::from_secs(60);
/// So long a cell may take to come to rest, make its last report and leave.
const DOWN_LIMIT: Duration = Duration::from_secs(180);
const LOOK: Duration = Duration::from_millis(5);

/// `load`.
pub fn load(options: &LoadOptions) -> Outcome {
    let file = &options.program;
    let name = program_name(file).input()?.to_string();
    let text = fs::read(file)
        .with_context(|| format!("{}: cannot be read", file.display()))
        .input()?;
    let client = Client::find(options.to.cell.as_deref(), "operator")?;
    let mut eyes = Eyes::open(&client)?;
    let now = eyes.look()?;
    let laid = Laid::down(&client, now.load, &name, &text)?;
    let read = check(&client, &laid.file, file, &now).input()?;
    let request = OperatorRequest {
        order: Order::Load as u32,
        value: f64::from(laid.number),
        ..OperatorRequest::default()
    };
    client.ask(Order::Load, request)?;
    let started = Instant::now();
    loop {
        let now = eyes.look()?;
        let state = ProgramState::from_wire(now.program);
        if now.load > laid.number {
            return Err(Failure::Stopped(anyhow!(
                "another program was loaded meanwhile"
            )));
        }
        match state {
            // The order was obeyed, but is not seen yet.
            _ if now.load < laid.number => {}
            Some(ProgramState::Loading) => {}
            Some(ProgramState::None) | None => {
                return Err(Failure::Stopped(anyhow!(
                    "the planner refuses {name}: its reason stands in the terminal of `quadrant up`"
                )));
            }
            Some(_) => break,
        }
        if started.elapsed() > READ_LIMIT {
            return Err(Failure::Stopped(anyhow!(
                "the planner has not read {name} after {} s; it is still at it",
                READ_LIMIT.as_secs()
            )));
        }
        std::thread::sleep(LOOK);
    }
    laid.keep();
    say(&format!(
        "loaded {name}: {read}; `quadrant start` begins it"
    ));
    Ok(())
}

/// Checks the program against the machine, from where its axes stand; what it is, in words. `shown` stands in messages.
fn check(client: &Client, file: &Path, shown: &Path, now: &Feedback) -> anyhow::Result<String> {
    let machine = &client.machine;
    let mut axes_mm = AxisVector::zeros();
    let registers = machine.axes.iter().zip(now.axes());
    for (to, (axis, sample)) in axes_mm.iter_mut().zip(registers) {
        *to = sample.command_register as f64 * axis.increment_mm();
    }
    let start = planner::tool_at(machine, &axes_mm)?;
    let text =
        fs::read_to_string(file).with_context(|| format!("{}: cannot be read", shown.display()))?;
    let name = shown.display().to_string();
    let program = program::interpret(&name, &text, &Setup::of(machine), start)?;
    let elements = program.path.elements.len();
    let length_mm: f64 = program.path.elements.iter().map(|e| e.length_mm).sum();
    planner::window_planner(machine, program.path, start).with_context(|| name)?;
    Ok(format!("{elements} elements, {length_mm:.1} mm"))
}

/// A program in the cell's folder; taken away again unless it is kept.
struct Laid {
    number: u32,
    folder: PathBuf,
    file: PathBuf,
    kept: bool,
}

impl Laid {
    /// Puts the program there under a number that nobody has, above that of the one that is loaded.
    fn down(client: &Client, loaded: u32, name: &str, text: &[u8]) -> Result<Laid, Failure> {
        let mut maker = DirBuilder::new();
        let maker = maker.mode(0o700);
        let programs = client.place.programs();
        match maker.create(&programs) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                return Err(Failure::Environment(error.into()));
            }
            _ => {}
        }
        let mut number = loaded;
        let folder = loop {
            number = number.saturating_add(1);
            let folder = client.place.program_folder(number);
            match maker.create(&folder) {
                Ok(()) => break folder,
                Err(error) if error.kind() == ErrorKind::AlreadyExists && number < u32::MAX => {}
                Err(error) => return Err(Failure::Environment(error.into())),
            }
        };
        let laid = Laid {
            number,
            file: folder.join(name),
            folder,
            kept: false,
        };
        fs::write(&laid.file, text)
            .with_context(|| format!("{}: cannot be written", laid.file.display()))
            .environment()?;
        Ok(laid)
    }

    fn keep(mut self) {
        self.kept = true;
    }
}

impl Drop for Laid {
    fn drop(&mut self) {
        if !self.kept {
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

/// The cell's feedback, as a client sees it.
struct Eyes<'a> {
    reader: Option<Reader<Feedback>>,
    newest: Option<Feedback>,
    heard: Instant,
    client: &'a Client,
}

impl Drop for Eyes<'_> {
    fn drop(&mut self) {
        if self.client.has_ended() {
            // What is closed now would be the service of the next cell of that name.
            std::mem::forget(self.reader.take());
        }
    }
}

impl Eyes<'_> {
    fn open(client: &Client) -> Result<Eyes<'_>, Failure> {
        Ok(Eyes {
            reader: Some(client.bus.feedback_reader(1).environment()?),
            newest: None,
            heard: Instant::now(),
            client,
        })
    }

    /// The newest feedback, waited for if there was none yet.
    fn look(&mut self) -> Result<Feedback, Failure> {
        loop {
            let newest = self.reader.as_mut().and_then(|r| r.newest(u64::MAX));
            if let Some(feedback) = newest {
                self.newest = Some(feedback);
                self.heard = Instant::now();
            }
            if self.heard.elapsed() > SILENCE {
                return Err(Failure::Stopped(anyhow!(
                    "cell {:?} says nothing any more: its machine side is lost, or the cell has ended",
                    self.client.place.name()
                )));
            }
            if let Some(feedback) = self.newest {
                return Ok(feedback);
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// `start`.
pub fn start(options: &StartOptions) -> Outcome {
    let client = Client::find(options.to.cell.as_deref(), "operator")?;
    // Listens before it asks, so that the shortest program is not missed.
    let mut eyes = Eyes::open(&client)?;
    eyes.look()?;
    let request = OperatorRequest {
        order: Order::Start as u32,
        ..OperatorRequest::default()
    };
    let answer = client.ask(Order::Start, request)?;
    let hold = if answer.hold == 1 {
        ", in hold: resume moves"
    } else {
        ""
    };
    say(&format!("run {} started{hold}", answer.run));
    if !options.wait {
        return Ok(());
    }
    let axes: Vec<String> = client
        .machine
        .axes
        .iter()
        .map(|axis| axis.name.clone())
        .collect();
    loop {
        let now = eyes.look()?;
        let begun = now.program == ProgramState::Begun as u32;
        if now.run > answer.run || now.run == answer.run && !begun {
            if now.run == answer.run && now.program == ProgramState::Done as u32 {
                say(&format!("run {} is done", answer.run));
                return Ok(());
            }
            return Err(Failure::Stopped(anyhow!("run {} was given up", answer.run)));
        }
        let mode = Mode::from_wire(now.mode);
        let stands = matches!(mode, Some(Mode::Tripped | Mode::Stopped | Mode::Disabled));
        if now.run == answer.run && (stands || now.last == 1) {
            return Err(Failure::Stopped(anyhow!(
                "run {} is not done: {}",
                answer.run,
                stop_words(&now, &axes)
            )));
        }
        std::thread::sleep(LOOK);
    }
}

/// `down`.
pub fn down(options: &OperatorOptions) -> Outcome {
    let client = Client::find(options.cell.as_deref(), "operator")?;
    let cell = client.place.name().to_string();
    let launcher = watch(client.page.launcher_pid()).environment()?;
    let request = OperatorRequest {
        order: Order::Down as u32,
        ..OperatorRequest::default()
    };
    if let Err(failure) = client.ask(Order::Down, request) {
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
            "cell {cell:?} is told to end, and has not after {} s",
            DOWN_LIMIT.as_secs()
        ))),
        Ok(_) => {
            say(&format!("cell {cell} is down"));
            Ok(())
        }
    }
}
