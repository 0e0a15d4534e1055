//! Metrics of a running cell for Prometheus and its kind: OpenMetrics text from the recorder's process (docs/howto/metrics.md).
//!
//! A reader descends so: the launcher opens the listening socket ([`launcher::metrics_socket`]) before anything starts and hands it to the recorder
//! as its standard input, so that a port that is taken is found in time and a recorder that replaces a lost one answers at the
//! same address. In the recorder `watch` puts what it hears into `numbers`, atomics alone; a thread of its own answers
//! scrapes (`server`) with what stands there (`exposition`). The recorder waits for neither.

mod exposition;
mod interval;
mod numbers;
mod served;
mod server;
mod watch;

use std::net::TcpListener;
use std::os::fd::AsFd;

use anyhow::{Context, bail};

pub use watch::Watch;

/// The listening socket that this process was given as its standard input, as by inetd or systemd (`StandardInput=socket`).
///
/// # Errors
/// Standard input is no listening socket.
pub fn inherited() -> anyhow::Result<TcpListener> {
    let given = std::io::stdin().as_fd().try_clone_to_owned()?;
    let listens = rustix::net::sockopt::socket_acceptconn(&given);
    if !listens.context("standard input is no socket to serve metrics at")? {
        bail!("standard input is a socket that does not listen: no metrics can be served at it");
    }
    Ok(given.into())
}
