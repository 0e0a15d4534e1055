//! The socket of the page.

use std::net::{SocketAddr, TcpListener};
use std::os::fd::AsFd;

use anyhow::{Context, bail};

use crate::listening::{self, another};

/// Port where none is named: below those that Linux gives to clients (32768 on).
pub const PORT: u16 = 8640;
/// Address where none is named: this PC alone.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:8640";

/// Reads an address with its port, or a port of this PC.
///
/// # Errors
/// Neither; in words.
pub fn parse_address(text: &str) -> Result<SocketAddr, String> {
    listening::parse_address(text, DEFAULT_ADDRESS, PORT)
}

/// Opens the socket.
///
/// # Errors
/// The address is taken or not one of this PC's.
pub fn listen(address: SocketAddr) -> anyhow::Result<TcpListener> {
    TcpListener::bind(address).with_context(|| {
        let other = another(address);
        format!("the page cannot be served at {address} (another cell's? then --web={other})")
    })
}

/// The listening socket that this process was given as its standard input.
///
/// # Errors
/// Standard input is none.
pub fn inherited() -> anyhow::Result<TcpListener> {
    let given = std::io::stdin().as_fd().try_clone_to_owned()?;
    let listens = rustix::net::sockopt::socket_acceptconn(&given);
    if !listens.context("standard input is no socket to serve a page at")? {
        bail!("standard input is a socket that does not listen: no page can be served at it");
    }
    Ok(given.into())
}

/// Address of the page for a browser; where it listens at all addresses, by the name of this PC.
pub fn page(address: SocketAddr) -> String {
    if address.ip().is_unspecified() {
        let system = rustix::system::uname();
        let name = system.nodename().to_string_lossy().into_owned();
        return format!("http://{name}:{}/", address.port());
    }
    format!("http://{address}/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_with_its_port_and_a_port_alone_is_this_pcs() {
        let read = |text| parse_address(text).map(|address| address.to_string());
        assert_eq!(read("0"), Ok("127.0.0.1:0".into()));
        assert_eq!(read("0.0.0.0:8640"), Ok("0.0.0.0:8640".into()));
        assert_eq!(
            parse_address(DEFAULT_ADDRESS).map(|address| address.port()),
            Ok(PORT)
        );
        for wrong in ["", "localhost", "10.0.0.1", "70000", "machines/xy"] {
            let error = read(wrong).expect_err(wrong);
            assert!(error.contains(DEFAULT_ADDRESS), "{wrong}: {error}");
        }
    }
}
