//! Where metrics are served: the socket is opened before anything starts, and the launcher of a cell keeps it.

use std::net::{SocketAddr, TcpListener};

use anyhow::Context;
use launcher::observers::{Observer, Place};

use crate::listening::{self, another, is_loopback};

/// Port where none is named: the letters QUAD on a telephone. Below 9100, where the registered exporters of Prometheus begin, and
/// below the ports that Linux gives to clients (32768 on).
const PORT: u16 = 7823;
/// Address where none is named: this PC alone.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:7823";

/// Reads `--metrics`: an address with its port, or a port of this PC.
///
/// # Errors
/// Neither; in words.
pub fn parse_address(text: &str) -> Result<SocketAddr, String> {
    listening::parse_address(text, DEFAULT_ADDRESS, PORT)
}

/// The process that serves metrics at an address: opens the socket and says where; loudly if it can be reached from other machines.
///
/// # Errors
/// The address is taken or not one of this PC's.
pub fn observer(address: SocketAddr) -> anyhow::Result<Observer> {
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
    Ok(Observer {
        name: "the process of the metrics",
        subcommand: "metrics",
        arguments: &[],
        variables: Vec::new(),
        place: Place::Socket(listener),
        greeting: None,
    })
}
