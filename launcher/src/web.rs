//! `--web`: the page in the browser (docs/howto/web.md), served by a process of its own, so that a machine that moves never waits
//! for a browser. The launcher opens its socket before anything starts, so that a port that is taken is found in time, and keeps
//! socket and token: a page that dies is started again at the same address, with the same token.

mod socket;
mod token;

use std::net::{SocketAddr, TcpListener};
use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use bus::process::end_with_parent;
use rustix::process::Signal;

pub use crate::listening::is_loopback;
pub use socket::{DEFAULT_ADDRESS, PORT, parse_address};
pub use token::{TOKEN_VARIABLE, Token};

use crate::closing::close;
use console::exit::{Failure, Kind};
use console::output::say;

/// So long the page may take to leave.
const CLOSE_LIMIT: Duration = Duration::from_secs(1);
/// A page that has died is started again after so long.
const RESTART_AFTER: Duration = Duration::from_secs(1);
/// So often at most.
const RESTARTS_MAX: u32 = 20;
const LOOK: Duration = Duration::from_millis(10);

/// Where the page is served, and the token that orders need.
#[derive(Debug)]
pub struct Place {
    listener: TcpListener,
    address: SocketAddr,
    token: Token,
    token_file: Option<String>,
}

impl Place {
    /// Opens the socket, and makes the token or reads it.
    ///
    /// # Errors
    /// The address is taken or not one of this PC's; the token's file is not usable.
    pub fn open(address: SocketAddr, token_file: Option<&Path>) -> Result<Place, Failure> {
        let token = match token_file {
            Some(file) => Token::of_file(file).input()?,
            None => Token::random().environment()?,
        };
        let listener = socket::listen(address).environment()?;
        Ok(Place {
            address: listener.local_addr().environment()?,
            listener,
            token,
            token_file: token_file.map(|file| file.display().to_string()),
        })
    }

    /// The same if it is wanted.
    ///
    /// # Errors
    /// As [`Place::open`].
    pub fn open_if(
        address: Option<SocketAddr>,
        token_file: Option<&Path>,
    ) -> Result<Option<Place>, Failure> {
        let opened = address.map(|address| Place::open(address, token_file));
        opened.transpose()
    }

    /// The place that the launcher has given to this process: the socket as standard input, the token in the environment.
    ///
    /// # Errors
    /// Neither is there.
    pub fn inherited() -> anyhow::Result<Place> {
        let listener = socket::inherited()?;
        Ok(Place {
            address: listener.local_addr()?,
            listener,
            token: Token::of_environment()?,
            token_file: None,
        })
    }

    /// Its socket, its address, its token.
    pub fn parts(self) -> (TcpListener, SocketAddr, Token) {
        (self.listener, self.address, self.token)
    }

    /// Says where the page is; loudly if it can be reached from other machines. A token that is in a file is not printed.
    pub fn announce(&self) {
        let page = socket::page(self.address);
        let orders = match &self.token_file {
            Some(file) => format!("{page}#token=TOKEN, the token being in {file}"),
            None => format!("{page}#token={}", self.token.text()),
        };
        let look = match is_loopback(self.address.ip()) {
            true => format!("Page to look at the machine: {page}\n"),
            false => String::new(),
        };
        say(&format!(
            "{look}Page with which orders can be given too: {orders}"
        ));
        if !is_loopback(self.address.ip()) {
            tracing::warn!(
                "--web={} CAN BE REACHED FROM OTHER MACHINES, without encryption: whoever reads along on the network reads the token, and \
                 may give orders with it. For this PC alone: --web={DEFAULT_ADDRESS}, and ssh -L from elsewhere",
                self.address
            );
        }
    }
}

/// The process that serves the page.
#[derive(Debug)]
pub struct Page {
    place: Place,
    cell: String,
    /// Nothing may be printed: the terminal shows the live view.
    silent: bool,
    child: Option<Child>,
    died: Instant,
    restarts: u32,
}

impl Page {
    /// Starts it for a cell that runs, if it is wanted, and says where it is.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start_if(
        place: Option<Place>,
        cell: &str,
        silent: bool,
    ) -> Result<Option<Page>, Failure> {
        let Some(place) = place else {
            return Ok(None);
        };
        place.announce();
        let mut page = Page {
            place,
            cell: cell.into(),
            silent,
            child: None,
            died: Instant::now(),
            restarts: 0,
        };
        page.start().environment()?;
        Ok(Some(page))
    }

    fn start(&mut self) -> anyhow::Result<()> {
        let socket: OwnedFd = self.place.listener.try_clone()?.into();
        let mut command = Command::new("/proc/self/exe");
        command
            .args(["web", "--inherited", "--cell", &self.cell])
            .env(TOKEN_VARIABLE, self.place.token.text())
            .stdin(socket)
            // Ctrl-C goes to the launcher alone.
            .process_group(0);
        if self.silent {
            command.stdout(Stdio::null()).stderr(Stdio::null());
        }
        end_with_parent(&mut command, Signal::TERM);
        self.child = Some(command.spawn().context("starting the page")?);
        Ok(())
    }

    /// Reaps it once it has died, and starts it again after a moment.
    pub fn look(&mut self) {
        if let Some(child) = &mut self.child {
            let Ok(Some(status)) = child.try_wait() else {
                return;
            };
            self.child = None;
            self.died = Instant::now();
            tracing::warn!(
                "the page in the browser {}; the machine goes on",
                ended(status)
            );
        } else if self.restarts < RESTARTS_MAX && self.died.elapsed() >= RESTART_AFTER {
            self.restarts += 1;
            match self.start() {
                Ok(()) => tracing::info!("the page in the browser is there again"),
                Err(error) => {
                    self.died = Instant::now();
                    tracing::warn!("the page in the browser cannot be started: {error:#}");
                }
            }
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

impl Drop for Page {
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else {
            return;
        };
        close(&mut child, CLOSE_LIMIT, LOOK);
    }
}
