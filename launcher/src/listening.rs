//! Addresses that a process of a cell listens at: metrics, the page.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

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

#[cfg(test)]
mod tests {
    use super::*;

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
