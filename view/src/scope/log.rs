//! Samples of a log: a run directory, or one MCAP file of it.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use machine::Machine;
use monitor::log::{LogError, Reader, RunLog, Sample, attached_files, part_files};
use report::scope::Scope;

use super::path::{Paths, Text, Wanted};
use super::source::Source;
use console::exit::{Failure, Kind};

/// Samples between two looks at whether anything else is to be done.
const SAMPLES_AT_ONCE: usize = 4096;

enum Log {
    Run(Box<RunLog>),
    File(Box<Reader>),
}

impl Log {
    fn next(&mut self) -> Result<Option<Sample>, LogError> {
        match self {
            Log::Run(log) => log.next_sample(),
            Log::File(log) => log.next_sample(),
        }
    }
}

/// A log being read.
pub struct LogSource {
    path: PathBuf,
    machine: Machine,
    program: (String, Option<Vec<u8>>),
    log: Log,
    paths: Paths,
}

impl LogSource {
    /// Opens it.
    ///
    /// # Errors
    /// There is no log, or it is not one of this product.
    pub fn open(path: &Path) -> Result<LogSource, Failure> {
        if !path.exists() {
            return Err(Failure::Input(anyhow!(
                "{}: does not exist: --log takes a run directory or an MCAP file of one",
                path.display()
            )));
        }
        let (log, first) = if path.is_dir() {
            let log = RunLog::open(path).input()?;
            let first = started_part(path).input()?;
            (Log::Run(Box::new(log)), first)
        } else {
            (
                Log::File(Box::new(Reader::open(path).input()?)),
                path.into(),
            )
        };
        let mut files = attached_files(&first).input()?;
        let mut take = |name: &str| {
            let at = files.iter().position(|(file, _)| file == name)?;
            Some(files.swap_remove(at).1)
        };
        let shown = first.display();
        let text = take("machine.toml").with_context(|| format!("{shown}: holds no machine.toml"));
        let text = String::from_utf8(text.input()?)
            .with_context(|| format!("{shown}: its machine.toml is not text"));
        let machine =
            Machine::parse(&format!("machine.toml in {shown}"), &text.input()?).input()?;
        let name = match &log {
            Log::Run(log) => log.info().program.clone(),
            Log::File(log) => log.info().program.clone(),
        };
        let program = take(&name);
        Ok(LogSource {
            path: path.into(),
            machine,
            program: (name, program),
            log,
            paths: Paths::default(),
        })
    }
}

/// The first part that holds anything.
fn started_part(run_dir: &Path) -> Result<PathBuf, LogError> {
    let files = part_files(run_dir)?;
    let started = files.iter().find(|file| Reader::open(file).is_ok());
    let first = started.or(files.first()).cloned();
    Ok(first.unwrap_or_else(|| run_dir.into()))
}

impl Source for LogSource {
    fn machine(&self) -> &Machine {
        &self.machine
    }

    fn feed(&mut self, scope: &mut Scope, wanted: &Wanted) -> Result<bool, Failure> {
        for _ in 0..SAMPLES_AT_ONCE {
            let Some(sample) = self.log.next().input()? else {
                return Ok(false);
            };
            if let Sample::Feedback(feedback) = &sample {
                let (name, text) = &self.program;
                let text = || Text::Attached(name.clone(), text.clone());
                self.paths
                    .look(feedback, &self.machine, scope, wanted, text)?;
            }
            scope.take(sample);
        }
        Ok(true)
    }

    fn name(&self) -> String {
        format!("log {}", self.path.display())
    }

    fn is_live(&self) -> bool {
        false
    }
}
