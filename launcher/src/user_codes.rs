//! User M-codes: programs of the machine builder that a part program has run. Each call is run once, and ended where it takes too long.

use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::bail;
use bus::builder_program::BuilderProgram;
use bus::cell::CellPaths;
use bus::user_codes::{self, CallEnd, CallId, UserCall};
use machine::Machine;
use program::{EventKind, Program};
use rustix::fs::Access;

use console::logs;

/// Name of the variable that tells a call, and all that it starts, from other processes.
const MARK: &str = "QUADRANT_USER_CODE";

/// Where they lie, and the one that runs.
pub struct UserCodes {
    folder: PathBuf,
    patience: Duration,
    place: CellPaths,
    /// The call that was taken up last: it is not run again.
    taken: Option<CallId>,
    running: Option<Running>,
}

struct Running {
    call: UserCall,
    program: BuilderProgram,
    since: Instant,
}

impl UserCodes {
    /// Those of a machine, for a cell.
    pub fn new(folder: PathBuf, machine: &Machine, place: CellPaths) -> UserCodes {
        UserCodes {
            folder,
            patience: Duration::from_secs_f64(machine.program.user_code_patience_s),
            place,
            taken: None,
            running: None,
        }
    }

    /// Begins what is asked for, and says how what ran has ended.
    pub fn look(&mut self) {
        if let Some(running) = &self.running {
            let has_ended = running.program.has_ended();
            if !has_ended && running.since.elapsed() < self.patience {
                return;
            }
            let call = running.call;
            let status = self
                .running
                .take()
                .and_then(|mut running| running.program.end());
            let limit_s = self.patience.as_secs_f64();
            let failed = match has_ended {
                true => status.and_then(bad_end),
                false => Some(format!("has not ended within {limit_s} s, and was ended")),
            };
            self.say_end(&call, failed);
        }
        let called = user_codes::called(&self.place).ok().flatten();
        if let Some(call) = called.filter(|call| self.taken != Some(call.id)) {
            self.taken = Some(call.id);
            self.begin(call);
        }
    }

    fn begin(&mut self, call: UserCall) {
        let name = format!("M{}", call.code);
        let mut command = Command::new(self.folder.join(&name));
        command
            .args([call.p, call.q].map(|value| format!("{value:.6}")))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let (p, q, line) = (call.p, call.q, call.line);
        tracing::info!("line {line}: {name} runs, P {p} Q {q}");
        match BuilderProgram::start(&mut command, MARK, mark(&call)) {
            Ok(mut program) => {
                // What it prints is told; a thread that cannot be had only costs that.
                let lines = program.child.stderr.take();
                let _ = lines.map(|lines| logs::forward_all(name, lines));
                let since = Instant::now();
                self.running = Some(Running {
                    call,
                    program,
                    since,
                });
            }
            Err(error) => {
                let file = self.folder.join(name);
                let why = format!("cannot be run: {}: {error}", file.display());
                self.say_end(&call, Some(why));
            }
        }
    }

    fn say_end(&self, call: &UserCall, failed: Option<String>) {
        let end = CallEnd {
            id: call.id,
            failed: failed.map(|why| format!("M{} {why}", call.code)),
        };
        if let Err(error) = user_codes::end(&self.place, &end) {
            tracing::error!("how M{} has ended cannot be told: {error}", call.code);
        }
    }
}

/// What a call and all that it starts have in their environment.
fn mark(call: &UserCall) -> String {
    let CallId { load, run, event } = call.id;
    format!("{}-{load}-{run}-{event}", std::process::id())
}

/// Refuses a program with a user M-code that has no program to run, before it moves.
///
/// # Errors
/// The first such code, with its line.
pub fn check(folder: &Path, program: &Program) -> anyhow::Result<()> {
    for event in &program.events {
        let EventKind::UserCode { code, .. } = event.kind else {
            continue;
        };
        let file = folder.join(format!("M{code}"));
        let is_executable = rustix::fs::access(&file, Access::EXEC_OK).is_ok() && file.is_file();
        if !is_executable {
            bail!(
                "{}:{}: M{code} has no program: {} is no executable file",
                program.name,
                event.line,
                file.display()
            );
        }
    }
    Ok(())
}

/// Why an end is not good.
fn bad_end(status: ExitStatus) -> Option<String> {
    match (status.code(), status.signal()) {
        (Some(0), _) => None,
        (Some(code), _) => Some(format!("ended with status {code}")),
        (None, signal) => Some(format!("was killed by signal {}", signal.unwrap_or(0))),
    }
}
