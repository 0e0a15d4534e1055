//! Processes that show a cell, each one of its own, so that a machine that moves never waits for a screen, a browser or a scrape.
//! The desk names them; the launcher starts them once the cell runs, starts a server that has died again by the rule of all processes
//! ([`Restarts`]), and ends them with the cell.

use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use console::child;
use console::output::{self, say};
use machine::Restart;
use rustix::process::{Pid, Signal, kill_process};

use crate::supervisor::{Restarts, say_given_up};

/// Time an observer has to leave before it is killed.
const CLOSE_LIMIT: Duration = Duration::from_secs(1);
const CLOSE_LOOK: Duration = Duration::from_millis(10);

/// A process that shows a cell, and that the cell does without.
#[derive(Debug)]
pub struct Observer {
    /// Its name in messages.
    pub name: &'static str,
    /// Its subcommand.
    pub subcommand: &'static str,
    /// What that takes; the name of the cell is added.
    pub arguments: &'static [&'static str],
    /// What is set in its environment.
    pub variables: Vec<(&'static str, String)>,
    /// Where it shows the cell.
    pub place: Place,
    /// Said when it is started for the first time.
    pub greeting: Option<String>,
}

/// Where an observer shows a cell.
#[derive(Debug)]
pub enum Place {
    /// In the launcher's own terminal, until somebody closes it. What the launcher has to say meanwhile is printed then.
    Terminal,
    /// At this listening socket, its standard input. The launcher keeps it: one that dies is started again at the same address.
    Socket(TcpListener),
}

impl Observer {
    /// Whether it draws on the launcher's terminal.
    pub fn is_in_terminal(&self) -> bool {
        matches!(self.place, Place::Terminal)
    }

    /// A process of it; where `silent`, it must print nothing.
    fn start(&self, cell: &str, silent: bool) -> anyhow::Result<Child> {
        let mut command = match &self.place {
            Place::Terminal => {
                let mut command = Command::new("/proc/self/exe");
                command.arg(self.subcommand);
                command
            }
            Place::Socket(socket) => {
                let mut command = child::command(self.subcommand);
                command.stdin(OwnedFd::from(socket.try_clone()?));
                if silent {
                    command.stderr(Stdio::null());
                }
                command
            }
        };
        let variables = self.variables.iter().map(|(name, value)| (name, value));
        let command = command.args(self.arguments).args(["--cell", cell]);
        let child = command.envs(variables).spawn();
        child.with_context(|| format!("starting {}", self.name))
    }
}

/// The observers of a cell that runs.
#[derive(Debug)]
pub struct Observers {
    cell: String,
    policy: Restart,
    begun: Instant,
    all: Vec<Running>,
}

#[derive(Debug)]
struct Running {
    of: Observer,
    child: Option<Child>,
    restarts: Restarts,
}

impl Observers {
    /// Starts them for a cell that runs, whose processes are restarted so, and says where they are.
    ///
    /// # Errors
    /// One of them cannot be started.
    pub fn start(all: Vec<Observer>, cell: &str, policy: Restart) -> anyhow::Result<Observers> {
        let silent = all.iter().any(Observer::is_in_terminal);
        let mut observers = Observers {
            cell: cell.into(),
            policy,
            begun: Instant::now(),
            all: Vec::new(),
        };
        for of in all {
            if let Some(greeting) = &of.greeting {
                say(greeting);
            }
            let child = Some(of.start(cell, silent)?);
            if of.is_in_terminal() {
                output::hold_back();
            }
            observers.all.push(Running {
                of,
                child,
                restarts: Restarts::default(),
            });
        }
        Ok(observers)
    }

    /// Reaps whichever has ended, and starts a server again; whether somebody has just closed the one in the terminal. The socket of one
    /// that is given up is closed: nobody waits there for an answer.
    pub fn look(&mut self) -> bool {
        let in_terminal = |one: &Running| one.of.is_in_terminal() && one.child.is_some();
        let silent = self.all.iter().any(in_terminal);
        let now = self.begun.elapsed();
        let (cell, policy) = (&self.cell, &self.policy);
        self.all
            .retain_mut(|one| one.look(cell, silent, policy, now));
        silent && !self.all.iter().any(in_terminal)
    }

    /// Ends the one in the terminal.
    pub fn leave_terminal(&mut self) {
        self.all.retain(|one| !one.of.is_in_terminal());
    }
}

impl Running {
    /// Whether it is there, or will be.
    fn look(&mut self, cell: &str, silent: bool, policy: &Restart, now: Duration) -> bool {
        let name = self.of.name;
        if let Some(child) = &mut self.child {
            let Ok(Some(status)) = child.try_wait() else {
                return true;
            };
            self.child = None;
            if self.of.is_in_terminal() {
                output::release();
                return false;
            }
            tracing::warn!("{name} {}; the machine goes on", ended(status));
            if !self.restarts.plan(policy, now) {
                say_given_up(name, policy);
                return false;
            }
        } else if self.restarts.take_due(now) {
            match self.of.start(cell, silent) {
                Ok(child) => {
                    self.child = Some(child);
                    tracing::info!("{name} is there again");
                }
                Err(error) => {
                    tracing::warn!("{name} cannot be started: {error:#}");
                    self.restarts.put_off(now);
                }
            }
        }
        true
    }
}

impl Drop for Running {
    /// Asks it to leave, and kills it if it does not.
    fn drop(&mut self) {
        let Some(child) = &mut self.child else {
            return;
        };
        let _ = kill_process(Pid::from_child(child), Signal::TERM);
        let since = Instant::now();
        while matches!(child.try_wait(), Ok(None)) {
            if since.elapsed() > CLOSE_LIMIT {
                let _ = child.kill();
                let _ = child.wait();
                break;
            }
            std::thread::sleep(CLOSE_LOOK);
        }
        if self.of.is_in_terminal() {
            output::release();
        }
    }
}

fn ended(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) => format!("was killed by signal {signal}"),
        (_, Some(code)) => format!("has ended with status {code}"),
        _ => "has ended".into(),
    }
}
