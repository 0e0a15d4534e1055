//! What the system says of the network interface of a fieldbus. Nothing is judged here; what it does not say is none.

use std::fs;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::path::Path;

use fieldbus::link::interfaces;

/// Network interface of a fieldbus.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Network {
    /// Its name.
    pub interface: String,
    /// Those that there are, if it is not there.
    pub others: Option<Vec<String>>,
    /// Whether it is switched on.
    pub up: bool,
    /// Whether something is plugged in.
    pub link: bool,
    /// In Mbit/s.
    pub speed_mbit_s: Option<u32>,
    /// The kernel's driver; none of a virtual one.
    pub driver: Option<String>,
    /// Whether it hangs at USB.
    pub usb: bool,
    /// Whether it is a radio.
    pub wireless: bool,
    /// Whether the kernel speaks IPv6 on it.
    pub ipv6: bool,
    /// Whether routes of this PC go over it.
    pub routes: bool,
    /// Longest wait of the interface before it says that a frame has come or gone, in µs.
    pub coalescing_us: Option<(u32, u32)>,
    /// Whether this program may open raw sockets.
    pub raw_sockets: bool,
}

fn read(path: impl AsRef<Path>) -> String {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.trim().to_string()
}

impl Network {
    /// Asks the system.
    pub fn of(interface: &str) -> Network {
        let mut network = Network {
            interface: interface.into(),
            raw_sockets: has_capability(&read("/proc/self/status"), CAP_NET_RAW),
            ..Network::default()
        };
        let all = interfaces();
        let Some(found) = all.iter().find(|one| one.name == interface) else {
            network.others = Some(all.into_iter().map(|one| one.name).collect());
            return network;
        };
        let folder = Path::new("/sys/class/net").join(interface);
        let device = fs::canonicalize(folder.join("device"));
        let driver = fs::canonicalize(folder.join("device/driver")).ok();
        (network.up, network.link) = (found.up, found.link);
        network.speed_mbit_s = read(folder.join("speed")).parse().ok();
        network.driver = driver
            .as_deref()
            .and_then(Path::file_name)
            .map(|name| name.to_string_lossy().into_owned());
        network.usb = device.is_ok_and(|path| path.to_string_lossy().contains("/usb"));
        network.wireless = folder.join("wireless").exists() || folder.join("phy80211").exists();
        let ipv6 = format!("/proc/sys/net/ipv6/conf/{interface}/disable_ipv6");
        network.ipv6 = read(ipv6) == "0";
        network.routes = has_route(&read("/proc/net/route"), interface);
        network.coalescing_us = coalescing_us(interface);
        network
    }
}

/// Number of the capability (linux/capability.h).
const CAP_NET_RAW: u32 = 13;

/// Whether `/proc/self/status` says that this process has a capability.
fn has_capability(status: &str, number: u32) -> bool {
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("CapEff:"))
        .unwrap_or_default();
    u64::from_str_radix(line.trim(), 16).is_ok_and(|set| set & (1 << number) != 0)
}

/// Whether a line of `/proc/net/route` is of this interface.
fn has_route(table: &str, interface: &str) -> bool {
    let mut lines = table.lines().skip(1);
    lines.any(|line| line.split_whitespace().next() == Some(interface))
}

/// How long the interface keeps back that frames have come and gone (ethtool's `rx-usecs` and `tx-usecs`).
fn coalescing_us(interface: &str) -> Option<(u32, u32)> {
    /// `ETHTOOL_GCOALESCE` of linux/ethtool.h.
    const GET_COALESCING: u32 = 0x0E;
    /// `struct ethtool_coalesce`: 23 numbers, of which the second and the sixth are asked for.
    const NUMBERS: usize = 23;
    let kind = libc::SOCK_DGRAM | libc::SOCK_CLOEXEC;
    // SAFETY: a plain system call.
    let raw = unsafe { libc::socket(libc::AF_INET, kind, 0) };
    if raw < 0 {
        return None;
    }
    // SAFETY: the descriptor was made just now and belongs to nobody else.
    let socket = unsafe { OwnedFd::from_raw_fd(raw) };
    let mut numbers = [0_u32; NUMBERS];
    numbers[0] = GET_COALESCING;
    // SAFETY: an all-zero request is a valid one.
    let mut request: libc::ifreq = unsafe { std::mem::zeroed() };
    if interface.len() >= request.ifr_name.len() {
        return None;
    }
    for (to, from) in request.ifr_name.iter_mut().zip(interface.bytes()) {
        *to = from as libc::c_char;
    }
    request.ifr_ifru.ifru_data = numbers.as_mut_ptr().cast();
    // SAFETY: request and numbers live over the call; the kernel writes no more than the structure has.
    let done = unsafe { libc::ioctl(socket.as_raw_fd(), libc::SIOCETHTOOL as _, &raw mut request) };
    (done == 0).then_some((numbers[1], numbers[5]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_capability_is_a_bit_of_the_effective_ones() {
        let status = "CapPrm:\t0000000000000000\nCapEff:\t0000000000002000\n";
        assert!(has_capability(status, CAP_NET_RAW));
        assert!(!has_capability(status, 14));
        assert!(!has_capability("", CAP_NET_RAW));
    }

    #[test]
    fn a_route_belongs_to_the_interface_that_its_line_begins_with() {
        let table = "Iface\tDestination\neth0\t00000000\t0100A8C0\n";
        assert!(has_route(table, "eth0"));
        assert!(!has_route(table, "eth"));
        assert!(!has_route(table, "Iface"));
    }
}
