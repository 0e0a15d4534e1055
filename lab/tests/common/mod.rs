//! What the tests share.
#![allow(dead_code, reason = "each test uses its part")]

use bus::sample::{OperatorRequest, Order};

/// Seeds of a run of a test: as many as `SEEDS` in the environment says, for a long one.
pub fn seeds(usual: u64) -> u64 {
    number("SEEDS", usual)
}

/// A number from the environment.
pub fn number(name: &str, usual: u64) -> u64 {
    let asked = std::env::var(name).ok();
    asked.and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// A fault: a process is killed in a scan, and started again so many later.
pub fn kill(who: &str, scan: u64, after: u64) -> String {
    format!(
        "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{who}\"\ndo = \"kill\"\nrestart_after_scans = {after}\n"
    )
}

/// An order without an axis.
pub fn order(order: Order, value: f64) -> OperatorRequest {
    OperatorRequest {
        order: order as u32,
        value,
        ..OperatorRequest::default()
    }
}
