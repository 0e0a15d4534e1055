//! Where the page is served, and the token that orders from it need. The socket is opened before anything starts; the launcher of a
//! cell keeps both: a page that dies is started again at the same address, with the same token.

use std::net::{SocketAddr, TcpListener};
use std::path::Path;

use anyhow::Context;
use console::exit::{Failure, Kind};
use launcher::observers::{self, Observer};

use super::token::{TOKEN_VARIABLE, Token};
use crate::listening::{self, another, is_loopback};

/// Port where none is named: below those that Linux gives to clients (32768 on).
const PORT: u16 = 8640;
/// Address where none is named: this PC alone.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:8640";

/// Reads an address with its port, or a port of this PC.
///
/// # Errors
/// Neither; in words.
pub fn parse_address(text: &str) -> Result<SocketAddr, String> {
    listening::parse_address(text, DEFAULT_ADDRESS, PORT)
}

/// Where the page is served, and the token that orders need.
#[derive(Debug)]
pub struct Place {
    /// The socket, open.
    pub listener: TcpListener,
    /// Its address.
    pub address: SocketAddr,
    /// The token.
    pub token: Token,
    /// Looking needs none.
    pub shown_to_all: bool,
    token_file: Option<String>,
}

impl Place {
    /// Opens the socket, and makes the token or reads it; loudly if it can be reached from other machines.
    ///
    /// # Errors
    /// The address is taken or not one of this PC's; the token's file is not usable.
    pub fn open(
        address: SocketAddr,
        token_file: Option<&Path>,
        token_to_look: bool,
    ) -> Result<Place, Failure> {
        let token = match token_file {
            Some(file) => Token::of_file(file).input()?,
            None => Token::random().environment()?,
        };
        let listener = TcpListener::bind(address).with_context(|| {
            let other = another(address);
            format!("the page cannot be served at {address} (another cell's? then --web={other})")
        });
        let listener = listener.environment()?;
        let address = listener.local_addr().environment()?;
        let this_pc_alone = is_loopback(address.ip());
        if !this_pc_alone {
            tracing::warn!(
                "--web={address} CAN BE REACHED FROM OTHER MACHINES, without encryption: whoever reads along on the network reads the \
                 token, and may give orders with it. For this PC alone: --web={DEFAULT_ADDRESS}, and ssh -L from elsewhere"
            );
        }
        Ok(Place {
            listener,
            address,
            token,
            shown_to_all: this_pc_alone && !token_to_look,
            token_file: token_file.map(|file| file.display().to_string()),
        })
    }

    /// The place that the launcher has given to this process: the socket as standard input, the token in the environment.
    ///
    /// # Errors
    /// Neither is there.
    pub fn inherited(token_to_look: bool) -> anyhow::Result<Place> {
        let listener = listening::inherited()?;
        let address = listener.local_addr()?;
        Ok(Place {
            listener,
            address,
            shown_to_all: is_loopback(address.ip()) && !token_to_look,
            token: Token::of_environment()?,
            token_file: None,
        })
    }

    /// The process that serves the page of a cell here.
    pub fn observer(self) -> Observer {
        Observer {
            name: "the page in the browser",
            subcommand: "web",
            arguments: match self.shown_to_all {
                true => &["--inherited"],
                false => &["--inherited", "--token-to-look"],
            },
            variables: vec![(TOKEN_VARIABLE, self.token.text().into())],
            greeting: Some(self.words()),
            place: observers::Place::Socket(self.listener),
        }
    }

    /// Where the page is. A token that is in a file is not shown.
    pub fn words(&self) -> String {
        let page = page(self.address);
        let orders = match &self.token_file {
            Some(file) => format!("{page}#token=TOKEN, the token being in {file}"),
            None => format!("{page}#token={}", self.token.text()),
        };
        let look = match self.shown_to_all {
            true => format!("Page to look at the machine: {page}\n"),
            false => String::new(),
        };
        format!("{look}Page with which orders can be given too: {orders}")
    }
}

/// Address of the page for a browser; where it listens at all addresses, by the name of this PC.
fn page(address: SocketAddr) -> String {
    if address.ip().is_unspecified() {
        let system = rustix::system::uname();
        let name = system.nodename().to_string_lossy().into_owned();
        return format!("http://{name}:{}/", address.port());
    }
    format!("http://{address}/")
}
