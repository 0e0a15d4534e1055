//! The socket that metrics are served at: opened by the launcher before anything starts, handed to the recorder.

use std::net::{SocketAddr, TcpListener};
use std::os::fd::OwnedFd;
use std::sync::Arc;

use anyhow::Context;

use crate::listening::{self, another, is_loopback};

/// Port where none is named: the letters QUAD on a telephone. Below 9100, where the registered exporters of Prometheus begin, and
/// below the ports that Linux gives to clients (32768 on).
pub const PORT: u16 = 7823;
/// Address where none is named: this PC alone.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:7823";

/// A listening socket for the recorder of a cell.
#[derive(Debug, Clone)]
pub struct Listener(Arc<TcpListener>);

impl Listener {
    /// For a process that is to have it as its standard input.
    ///
    /// # Errors
    /// No descriptor is left.
    pub fn hand_over(&self) -> std::io::Result<OwnedFd> {
        Ok(self.0.try_clone()?.into())
    }
}

/// Reads `--metrics`: an address with its port, or a port of this PC.
///
/// # Errors
/// Neither; in words.
pub fn parse_address(text: &str) -> Result<SocketAddr, String> {
    listening::parse_address(text, DEFAULT_ADDRESS, PORT)
}

/// Opens the socket and says where; loudly if it can be reached from other machines.
///
/// # Errors
/// The address is taken or not one of this PC's.
pub fn listen(address: SocketAddr) -> anyhow::Result<Listener> {
    let listener = TcpListener::bind(address).with_context(|| {
        let other = another(address);
        format!("--metrics={address}: cannot listen there (another cell? then --metrics={other})")
    })?;
    let address = listener.local_addr()?;
    tracing::info!("metrics at http://{address}/metrics");
    if !is_loopback(address.ip()) {
        tracing::warn!(
            "--metrics={address} CAN BE REACHED FROM OTHER MACHINES: whoever reaches it reads this cell's numbers, \
             without password or encryption; nobody can command the cell there. For this PC alone: --metrics={DEFAULT_ADDRESS}"
        );
    }
    Ok(Listener(Arc::new(listener)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_with_its_port_and_a_port_alone_is_this_pcs() {
        let read = |text| parse_address(text).map(|address| address.to_string());
        assert_eq!(read("7900"), Ok("127.0.0.1:7900".into()));
        assert_eq!(read("0.0.0.0:7823"), Ok("0.0.0.0:7823".into()));
        assert_eq!(read("[::1]:7823"), Ok("[::1]:7823".into()));
        for wrong in ["", "localhost", "10.0.0.1", "70000", "machines/xy"] {
            let error = read(wrong).expect_err(wrong);
            assert!(error.contains(DEFAULT_ADDRESS), "{wrong}: {error}");
        }
        assert_eq!(parse_address(DEFAULT_ADDRESS).map(|a| a.port()), Ok(PORT));
    }
}
