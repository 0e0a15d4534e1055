//! The path of the program, for the signals and triggers that need it; nobody else waits for it to be read.

use std::path::PathBuf;

use anyhow::anyhow;
use bus::sample::Feedback;
use machine::Machine;
use program::{Program, SHORT_ELEMENTS};
use report::scope::signal::KnownPath;
use report::scope::trigger::Trigger;
use report::scope::{Scope, Settings};

use console::exit::Failure;

/// What of the settings needs the path.
pub struct Wanted {
    /// Names of the signals, or the trigger; empty if nothing does.
    by: String,
    /// The line that is waited for.
    line: Option<u32>,
}

impl Wanted {
    /// By these settings.
    pub fn of(settings: &Settings) -> Wanted {
        let signals = settings.signals.iter().filter(|signal| signal.needs_path());
        let mut by: Vec<String> = signals.map(|signal| signal.name.clone()).collect();
        if settings.trigger.needs_path() && by.is_empty() {
            by.push("the trigger".into());
        }
        Wanted {
            by: by.join(", "),
            line: match settings.trigger {
                Trigger::Block(line) => Some(line),
                _ => None,
            },
        }
    }
}

/// Where the program's text is.
pub enum Text {
    /// In the log, under this name; none if it is not there.
    Attached(String, Option<Vec<u8>>),
    /// In a file; none if nobody says in which.
    File(Option<PathBuf>),
}

/// Reads each program once.
#[derive(Default)]
pub struct Paths {
    read: Option<u64>,
}

impl Paths {
    /// Tells the scope the path that this feedback's tag belongs to, if it is wanted and not the one known already.
    ///
    /// # Errors
    /// It is wanted and cannot be had, or ends before the line that is waited for.
    pub fn look(
        &mut self,
        feedback: &Feedback,
        machine: &Machine,
        scope: &mut Scope,
        wanted: &Wanted,
        text: impl FnOnce() -> Text,
    ) -> Result<(), Failure> {
        let hash = feedback.program_hash;
        if wanted.by.is_empty() || hash == 0 || feedback.window.is_none() || self.read == Some(hash)
        {
            return Ok(());
        }
        self.read = Some(hash);
        let program = read(text(), feedback, machine)
            .and_then(|program| match program.source_hash == hash {
                true => Ok(program),
                false => Err(format!("{} is not the program that runs", program.name)),
            })
            .map_err(|why| {
                Failure::Stopped(anyhow!(
                    "{} cannot be known without the path of the program: {why}",
                    wanted.by
                ))
            })?;
        let path = KnownPath::new(hash, program.path);
        if let Some(line) = wanted.line
            && path.first_element_of(line).is_none()
        {
            let lines = match path.lines() {
                Some((first, last)) => format!("moves from line {first} to line {last}"),
                None => "moves nothing".into(),
            };
            return Err(Failure::Input(anyhow!(
                "block {line} is never reached: {} {lines}",
                program.name
            )));
        }
        scope.set_path(path);
        Ok(())
    }
}

fn read(text: Text, feedback: &Feedback, machine: &Machine) -> Result<Program, String> {
    let start = &feedback.program_start;
    match text {
        Text::Attached(name, None) => Err(format!("{name} is not in the log")),
        Text::Attached(name, Some(bytes)) => {
            let text = String::from_utf8(bytes).map_err(|_| format!("{name} is not text"))?;
            let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
            program::resume_from(machine, start, &name, text).map_err(|error| error.to_string())
        }
        Text::File(None) => Err("where it stands is not known".into()),
        Text::File(Some(file)) => {
            let read = program::load_if_short(machine, start, &file, SHORT_ELEMENTS, &[]);
            let read = read.map_err(|error| error.to_string())?;
            read.ok_or_else(|| {
                format!(
                    "{}: has more than {SHORT_ELEMENTS} elements: too long to be held beside the cell",
                    file.display()
                )
            })
        }
    }
}
