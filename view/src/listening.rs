//! Sockets that the metrics and the page are served at: opened by the command that starts a cell, before anything starts, so that an
//! address that is taken is found in time, and handed to the process that serves.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::os::fd::AsFd;

use anyhow::{Context, bail};

/// Reads an address with its port, or a port of this PC; `usual` is the address where none is named.
///
/// # Errors
/// Neither; in words.
pub fn parse_address(text: &str, usual: &str, port: u16) -> Result<SocketAddr, String> {
    if let Ok(port) = text.parse::<u16>() {
        return Ok(SocketAddr::new(Ipv4Addr::LOCALHOST.into(), port));
    }
    text.parse().map_err(|_| {
        format!("must be an address and a port ({usual}, [::1]:{port}) or a port alone; 0 takes a free one")
    })
}

/// Where to listen instead of an address that is taken: the next port, or any that is free.
pub fn another(address: SocketAddr) -> SocketAddr {
    let port = match address.port() {
        0 => 0,
        port => port.checked_add(1).unwrap_or(0),
    };
    SocketAddr::new(address.ip(), port)
}

/// Whether only this PC reaches it.
pub fn is_loopback(ip: IpAddr) -> bool {
    match ip {
        IpAddr::V4(ip) => ip.is_loopback(),
        IpAddr::V6(ip) => {
            ip.is_loopback() || ip.to_ipv4_mapped().is_some_and(|v4| v4.is_loopback())
        }
    }
}

/// The listening socket that this process was given as its standard input, as by inetd or systemd (`StandardInput=socket`).
///
/// # Errors
/// Standard input is none.
pub fn inherited() -> anyhow::Result<TcpListener> {
    let given = std::io::stdin().as_fd().try_clone_to_owned()?;
    let listens = rustix::net::sockopt::socket_acceptconn(&given);
    if !listens.context("standard input is no socket to serve at")? {
        bail!("standard input is a socket that does not listen: nothing can be served at it");
    }
    Ok(given.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_with_its_port_and_a_port_alone_is_this_pcs() {
        let usual = "127.0.0.1:7823";
        let read = |text| parse_address(text, usual, 7823).map(|address| address.to_string());
        assert_eq!(read("0"), Ok("127.0.0.1:0".into()));
        assert_eq!(read("7900"), Ok("127.0.0.1:7900".into()));
        assert_eq!(read("0.0.0.0:7823"), Ok("0.0.0.0:7823".into()));
        assert_eq!(read("[::1]:7823"), Ok("[::1]:7823".into()));
        for wrong in ["", "localhost", "10.0.0.1", "70000", "machines/xy"] {
            let error = read(wrong).expect_err(wrong);
            assert!(error.contains(usual), "{wrong}: {error}");
        }
    }

    #[test]
    fn only_loopback_addresses_are_taken_for_this_pcs_alone() {
        for (text, alone) in [
            ("127.0.0.1", true),
            ("127.9.9.9", true),
            ("::1", true),
            ("::ffff:127.0.0.1", true),
            ("0.0.0.0", false),
            ("::", false),
            ("192.168.0.4", false),
        ] {
            let ip: IpAddr = text.parse().expect(text);
            assert_eq!(is_loopback(ip), alone, "{text}");
        }
    }
}
