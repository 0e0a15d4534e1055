//! Judges the network interface of a fieldbus: facts in, findings out.

use super::finding::Finding;
use super::network::Network;

/// EtherCAT is Fast Ethernet.
const ETHERCAT_MBIT_S: u32 = 100;

/// Everything of an interface; of one that is not there nothing else is said.
pub fn judge(network: &Network) -> Vec<Finding> {
    let mut findings = vec![right(network)];
    if let Some(others) = &network.others {
        findings.push(missing(network, others));
        return findings;
    }
    findings.extend([link(network), driver(network), alone(network)]);
    findings.extend(coalescing(network));
    findings
}

fn right(network: &Network) -> Finding {
    let what = "raw sockets";
    if network.raw_sockets {
        return Finding::fine(what, "allowed");
    }
    Finding::must(
        what,
        "refused: no CAP_NET_RAW",
        "EtherCAT frames are raw Ethernet frames, and those are a privilege",
        &[
            "setcap cap_net_raw,cap_ipc_lock,cap_sys_nice+ep $(command -v quadrant)",
            "# in a systemd unit: AmbientCapabilities=CAP_NET_RAW CAP_IPC_LOCK CAP_SYS_NICE",
        ],
    )
}

fn missing(network: &Network, others: &[String]) -> Finding {
    let interface = &network.interface;
    let there = match others {
        [] => "none".into(),
        others => others.join(", "),
    };
    Finding::must(
        "network interface",
        format!("there is no {interface}; there are: {there}"),
        "the drives are reached over it",
        &[
            "ip link    # lists them",
            "# then name it in [bus] interface of the machine file",
        ],
    )
}

fn link(network: &Network) -> Finding {
    let what = "network link";
    let interface = &network.interface;
    if !network.up {
        let up = format!("ip link set {interface} up");
        let why = "no frame goes out";
        return Finding::must(what, format!("{interface} is switched off"), why, &[&up]);
    }
    if !network.link {
        return Finding::must(
            what,
            format!("{interface}: nothing is plugged in"),
            "no frame comes back",
            &["# plug the cable into IN of the first drive, and switch that on"],
        );
    }
    match network.speed_mbit_s {
        Some(speed) if network.driver.is_some() && speed != ETHERCAT_MBIT_S => Finding::better(
            what,
            format!("{interface}: {speed} Mbit/s"),
            "EtherCAT slaves speak 100 Mbit/s: something else is at the end of this cable",
            &["# plug the cable into IN of the first drive, without a switch between"],
        ),
        Some(speed) => Finding::fine(what, format!("{interface}: {speed} Mbit/s")),
        None => Finding::fine(what, format!("{interface}: up")),
    }
}

fn driver(network: &Network) -> Finding {
    let what = "network driver";
    let Some(driver) = &network.driver else {
        let note = "fine for trials with drives that are simulated; no drive is behind it";
        return Finding::fine(what, "none: a virtual interface").because(note);
    };
    if network.wireless {
        let change = ["# take an interface with a cable"];
        return Finding::must(
            what,
            format!("{driver}: a radio"),
            "EtherCAT is a cable",
            &change,
        );
    }
    if network.usb {
        return Finding::better(
            what,
            format!("{driver}, at USB"),
            "USB keeps frames back for up to a millisecond",
            &["# take an interface on PCI Express, or the one on the board"],
        );
    }
    Finding::fine(what, driver.as_str())
}

/// The drives are to be the only users.
fn alone(network: &Network) -> Finding {
    let what = "network users";
    let interface = &network.interface;
    let mut change = Vec::new();
    let mut found = Vec::new();
    if network.routes {
        found.push("this PC's own network goes over it");
        change.push(format!("ip addr flush dev {interface}"));
        change.push("# and take it out of NetworkManager, netplan or ifupdown".into());
    }
    if network.ipv6 {
        found.push("IPv6 is on");
        change.push(format!(
            "sysctl -w net.ipv6.conf.{interface}.disable_ipv6=1"
        ));
    }
    if found.is_empty() {
        return Finding::fine(what, "none: no routes, no IPv6");
    }
    let change: Vec<&str> = change.iter().map(String::as_str).collect();
    Finding::better(
        what,
        found.join("; "),
        "every other frame on the cable may delay one with commands",
        &change,
    )
}

fn coalescing(network: &Network) -> Option<Finding> {
    let what = "network coalescing";
    let (receive_us, send_us) = network.coalescing_us?;
    let found = format!("frames that came wait {receive_us} µs, those that went {send_us} µs");
    if receive_us == 0 && send_us == 0 {
        return Some(Finding::fine(what, "off"));
    }
    let off = format!("ethtool -C {} rx-usecs 0 tx-usecs 0", network.interface);
    Some(Finding::better(
        what,
        found,
        "the interface collects frames before it tells the processor: each answer of the drives is that much later",
        &[&off],
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Grade;

    fn good() -> Network {
        Network {
            interface: "eth1".into(),
            up: true,
            link: true,
            speed_mbit_s: Some(100),
            driver: Some("igb".into()),
            coalescing_us: Some((0, 0)),
            raw_sockets: true,
            ..Network::default()
        }
    }

    fn grade(network: &Network, what: &str) -> Option<Grade> {
        let findings = judge(network);
        let mut findings = findings.iter();
        findings.find(|f| f.what == what).map(|f| f.grade)
    }

    #[test]
    fn an_interface_that_is_good_leaves_nothing_to_do() {
        let findings = judge(&good());
        assert!(
            findings.iter().all(|f| f.grade == Grade::Fine),
            "{findings:?}"
        );
        assert_eq!(findings.len(), 5);
    }

    #[test]
    fn without_the_interface_a_link_or_a_right_no_cell_runs() {
        let missing = Network {
            others: Some(vec!["eth0".into()]),
            ..good()
        };
        assert_eq!(grade(&missing, "network interface"), Some(Grade::Must));
        let down = Network {
            up: false,
            ..good()
        };
        assert_eq!(grade(&down, "network link"), Some(Grade::Must));
        let unplugged = Network {
            link: false,
            ..good()
        };
        assert_eq!(grade(&unplugged, "network link"), Some(Grade::Must));
        let refused = Network {
            raw_sockets: false,
            ..good()
        };
        assert_eq!(grade(&refused, "raw sockets"), Some(Grade::Must));
        let radio = Network {
            wireless: true,
            ..good()
        };
        assert_eq!(grade(&radio, "network driver"), Some(Grade::Must));
    }

    #[test]
    fn what_delays_frames_could_be_better() {
        let usb = Network {
            usb: true,
            ..good()
        };
        assert_eq!(grade(&usb, "network driver"), Some(Grade::Better));
        let shared = Network {
            ipv6: true,
            ..good()
        };
        assert_eq!(grade(&shared, "network users"), Some(Grade::Better));
        let collects = Network {
            coalescing_us: Some((3, 0)),
            ..good()
        };
        assert_eq!(grade(&collects, "network coalescing"), Some(Grade::Better));
        let office = Network {
            speed_mbit_s: Some(1000),
            ..good()
        };
        assert_eq!(grade(&office, "network link"), Some(Grade::Better));
    }
}
