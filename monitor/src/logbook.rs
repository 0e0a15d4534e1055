//! Which log samples go into: that of the one run, or, in a cell that stays up, that of the program which was started.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bus::cell::CellPaths;
use bus::sample::{Auxiliaries, Feedback, ProgramState};
use machine::{KeptTexts, LogLevel, Machine, with_kept};

use crate::black_box::Home;
use crate::ended::{ENDED_FILE, Ended};
use crate::log::{BEGINS_AT, Event, LogError, Recorder, RunEnd, RunInfo, SampleRef};
use crate::options::{MonitorError, Options};
use crate::said::SaidFile;

/// Name of the machine file in a run directory.
const MACHINE_FILE: &str = "machine.toml";

/// A file in a run directory that keeps it from being removed; what it holds is the reason.
pub const MARK_FILE: &str = "marked";

/// The log that is open.
struct Open {
    run: u32,
    recorder: Recorder,
    said: Option<SaidFile>,
    folder: PathBuf,
    started: Option<Instant>,
    /// Receptions that had failed when it was opened.
    failed_before: u64,
}

/// The logs of a cell, one after the other.
pub struct Logbook {
    options: Options,
    machine: Machine,
    open: Option<Open>,
    /// The most that goes into a log.
    held_to: LogLevel,
    /// Where black boxes go, until it has been asked for.
    new_home: Option<Home>,
}

/// Folder of a run of a cell that stays up: `003-circle`, third to be started, of the program `circle.ngc`.
pub fn run_folder(session: &Path, run: u32, program: &Path) -> PathBuf {
    let stem = program
        .file_stem()
        .map_or("program".into(), |stem| stem.to_string_lossy());
    session.join(format!("{run:03}-{stem}"))
}

/// The number in the name of a run's folder; none if it is not the name of one.
pub fn run_number(folder: &Path) -> Option<u32> {
    let (number, _) = folder.file_name()?.to_str()?.split_once('-')?;
    number.parse().ok().filter(|_| number.len() >= 3)
}

/// A file that cannot be read or written.
fn failed_at(path: &Path) -> impl FnOnce(std::io::Error) -> MonitorError {
    let path = path.display().to_string();
    move |source| MonitorError::File { path, source }
}

impl Logbook {
    /// Opens the log of the one run; in a cell that stays up none is open before a program is running.
    pub fn new(options: &Options, machine: &Machine) -> Result<Logbook, MonitorError> {
        let mut logbook = Logbook {
            options: options.clone(),
            machine: machine.clone(),
            open: None,
            held_to: LogLevel::Full,
            new_home: None,
        };
        match &options.program {
            Some(program) if !options.level.has_samples() => {
                let machine = options.out.join(MACHINE_FILE);
                logbook.new_home = Some(Home {
                    directory: options.out.clone(),
                    info: run_info(options, &machine, Some(program))?,
                });
            }
            Some(program) => logbook.open(&options.out, program, 1, 0, 0)?,
            None => logbook.new_home = Some(logbook.home_between()?),
        }
        Ok(logbook)
    }

    /// Before this feedback is recorded: ends the log of a program that is over and begins that of one that was started.
    /// Whether one was started.
    pub fn turn(&mut self, feedback: &Feedback, failed: u64) -> Result<bool, MonitorError> {
        if self.options.program.is_none() && self.options.level.has_samples() {
            let started = feedback.program == ProgramState::Running as u32;
            let run = started.then_some(feedback.run);
            if self.open.as_ref().map(|open| open.run) != run {
                self.hear(feedback);
                self.close(None, failed)?;
                if started {
                    self.begin(feedback, failed)?;
                    return Ok(true);
                }
                self.new_home = Some(self.home_between()?);
            }
        }
        Ok(false)
    }

    /// Takes down what the program of the log that is open has said by this feedback, and how it has ended.
    pub fn hear(&mut self, feedback: &Feedback) {
        let staying = self.options.program.is_none();
        if let Some(open) = &self.open
            && let Some(ended) = Ended::told(&self.machine, feedback, open.run)
            && ended.is_whole()
            && let Err(error) = ended.note(&open.folder)
        {
            tracing::warn!("{}: {error}", open.folder.join(ENDED_FILE).display());
        }
        if let Some(open) = &mut self.open
            && (!staying || open.run == feedback.run)
            && let Some(said) = &mut open.said
        {
            said.take(feedback);
        }
    }

    /// Where black boxes go from now on, if that has changed: into the run directory, between programs into the folder of the cell.
    pub fn new_home(&mut self) -> Option<Home> {
        self.new_home.take()
    }

    fn home_between(&self) -> Result<Home, MonitorError> {
        let machine = machine::machine_file(&self.options.slot.machine);
        Ok(Home {
            directory: self.options.out.clone(),
            info: run_info(&self.options, &machine, None)?,
        })
    }

    /// The log that is open.
    pub fn log(&mut self) -> Option<&mut Recorder> {
        let open = self.open.as_mut()?;
        open.started.get_or_insert_with(Instant::now);
        Some(&mut open.recorder)
    }

    /// Does something with the log that is open, if one is.
    pub fn record(
        &mut self,
        write: impl FnOnce(&mut Recorder) -> Result<(), LogError>,
    ) -> Result<(), LogError> {
        self.log().map_or(Ok(()), write)
    }

    /// From now on no more than this level goes into logs, for this reason.
    pub fn hold_to(&mut self, level: LogLevel, why: &str) -> Result<(), LogError> {
        self.held_to = level;
        self.record(|log| {
            log.hold_to(level);
            let event = Event {
                scan: log.newest_scan(),
                process: "monitor".into(),
                text: why.into(),
            };
            log.record(SampleRef::Event(&event))
        })
    }

    /// Ends the log that is open, if one is.
    pub fn close(&mut self, reason: Option<String>, failed: u64) -> Result<(), MonitorError> {
        let Some(open) = self.open.take() else {
            return Ok(());
        };
        let digest = open.recorder.finish(&RunEnd {
            wall_s: open.started.map_or(0.0, |at| at.elapsed().as_secs_f64()),
            queue_losses: failed - open.failed_before,
            reason,
            ..RunEnd::default()
        })?;
        tracing::debug!(digest, "recorded");
        Ok(())
    }

    /// Begins the log of a program that was loaded into the cell, in a folder of its own with copies of all it depends on. A
    /// recorder that replaces another goes on in the folder that is there.
    fn begin(&mut self, feedback: &Feedback, failed: u64) -> Result<(), MonitorError> {
        let (load, run, scan) = (feedback.load, feedback.run, feedback.scan);
        let place = CellPaths::new(&self.options.slot.cell).ok();
        let program = place.as_ref().and_then(|place| place.program(load));
        let program = program.ok_or(MonitorError::NoProgram(load))?;
        let folder = run_folder(&self.options.out, run, &program);
        fs::create_dir_all(&folder).map_err(failed_at(&folder))?;
        let mut files = vec![program.clone()];
        let session = fs::read_dir(&self.options.out).map_err(failed_at(&self.options.out))?;
        let settings = session.flatten().map(|entry| entry.path());
        files.extend(settings.filter(|path| path.extension().is_some_and(|e| e == "toml")));
        for file in &files {
            if let Some(name) = file.file_name() {
                fs::copy(file, folder.join(name)).map_err(failed_at(file))?;
            }
        }
        if let Some(place) = &place {
            let (shown, file) = (&feedback.auxiliary, folder.join(MACHINE_FILE));
            note_kept(place, (load, run), &self.machine, shown, &file)?;
        }
        self.open(&folder, &program, run, failed, scan)
    }

    fn open(
        &mut self,
        folder: &Path,
        program: &Path,
        run: u32,
        failed: u64,
        begins_at: u64,
    ) -> Result<(), MonitorError> {
        let machine = folder.join(MACHINE_FILE);
        let mut info = run_info(&self.options, &machine, Some(program))?;
        if begins_at > 0 {
            let settings = &mut info.settings;
            settings.insert(BEGINS_AT.into(), begins_at.to_string());
        }
        Ended::reserve(folder);
        let said = CellPaths::new(&self.options.slot.cell).ok();
        let said = said.and_then(|cell| SaidFile::open(folder, &cell).ok());
        let level = self.options.level;
        let mut recorder = Recorder::create_part(folder, &self.machine, &info, level)?;
        recorder.hold_to(self.held_to);
        self.open = Some(Open {
            run,
            said,
            folder: folder.into(),
            recorder,
            started: None,
            failed_before: failed,
        });
        self.new_home = Some(Home {
            directory: folder.into(),
            info,
        });
        Ok(())
    }
}

/// Writes what a run has begun with into its machine file: the cell's has what was there at the start of the cell.
fn note_kept(
    place: &CellPaths,
    run: (u32, u32),
    machine: &Machine,
    shown: &Auxiliaries,
    file: &Path,
) -> Result<(), MonitorError> {
    let text = fs::read_to_string(file).map_err(failed_at(file))?;
    let noted = KeptTexts::of_run(place, run, machine, shown)
        .map_err(|error| error.to_string())
        .and_then(|kept| with_kept(&text, &kept).map_err(|error| error.to_string()));
    match noted {
        Ok(noted) if noted == text => Ok(()),
        Ok(text) => fs::write(file, text).map_err(failed_at(file)),
        // The planner refuses the program, and says so.
        Err(error) => {
            tracing::error!("{error}");
            Ok(())
        }
    }
}

/// What is known of a run; without a program, of what is between two.
/// The largest program that is put into the log too.
const ATTACHED_BYTES_MAX: u64 = 8 << 20;

fn run_info(
    options: &Options,
    machine: &Path,
    program: Option<&Path>,
) -> Result<RunInfo, MonitorError> {
    let read = |path: &Path| fs::read(path).map_err(failed_at(path));
    let mut files = vec![(MACHINE_FILE.into(), read(machine)?)];
    let mut name = String::new();
    if let Some(program) = program {
        let file_name = program.file_name().unwrap_or("program.ngc".as_ref());
        name = file_name.to_string_lossy().into_owned();
        // A larger one lies in the run's folder alone: an attachment is written from memory.
        if fs::metadata(program).is_ok_and(|of| of.len() <= ATTACHED_BYTES_MAX) {
            files.push((name.clone(), read(program)?));
        }
    }
    Ok(RunInfo {
        quadrant: env!("CARGO_PKG_VERSION").into(),
        cell: options.slot.cell.clone(),
        pace: options.slot.pace.word().into(),
        program: name,
        files,
        ..RunInfo::default()
    })
}
