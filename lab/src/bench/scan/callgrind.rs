//! Instructions, counted by callgrind. What comes before the scans that count is the same in a run of N and in one of 2 N scans: it
//! is gone in their difference.

use std::process::Command;

use anyhow::{Context, bail};

use super::{COUNTED_SCANS, COUNTED_WINDOWS};
use crate::bench::scans::{Scans, Subject};
use crate::options::{Part, ScanOptions};

/// Where it is not installed.
pub(super) const MISSING: &str = "valgrind is not installed (Debian: apt-get install valgrind): instructions are not counted, and nothing is compared";

/// Its version; none where it is not installed.
pub(super) fn version() -> Option<String> {
    let said = Command::new("valgrind").arg("--version").output().ok()?;
    let said = said.status.success().then_some(said.stdout)?;
    Some(String::from_utf8_lossy(&said).trim().to_string())
}

/// Instructions of one of them.
pub(super) fn instructions(
    options: &ScanOptions,
    subject: &Subject,
    part: Part,
) -> anyhow::Result<f64> {
    let counted = match part {
        Part::Planning => COUNTED_WINDOWS,
        _ => COUNTED_SCANS,
    };
    let half = of_run(options, part, counted, 2 * counted)?;
    let all = of_run(options, part, 2 * counted, 2 * counted)?;
    let second = all.checked_sub(half).context("twice as many take less")?;
    let of = counted * Scans::in_a_scan(&subject.machine, part);
    Ok(second as f64 / of as f64)
}

/// Instructions of a whole run.
fn of_run(options: &ScanOptions, part: Part, times: usize, prepared: usize) -> anyhow::Result<u64> {
    // Valgrind takes the file itself, not a link in /proc that names valgrind by then.
    let program = std::fs::read_link("/proc/self/exe").context("the path of this command")?;
    let mut command = Command::new("valgrind");
    command
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(program)
        .args(["bench-scan-part", "--part", part.word(), "--machine"])
        .arg(&options.machine)
        .args(["--times", &times.to_string()])
        .args(["--prepared", &prepared.to_string()]);
    bus::process::end_with_parent(&mut command, rustix::process::Signal::KILL);
    let said = command.output().context("starting valgrind")?;
    let text = String::from_utf8_lossy(&said.stderr);
    if !said.status.success() {
        bail!("valgrind ended with {}: {text}", said.status);
    }
    collected(&text).with_context(|| format!("valgrind says no count: {text}"))
}

/// The count of `==7== Collected : 1234`.
fn collected(text: &str) -> Option<u64> {
    let line = text.lines().find(|line| line.contains("Collected"))?;
    line.rsplit_once(':')?.1.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::collected;

    #[test]
    fn the_count_is_what_callgrind_has_collected() {
        let text = "==7== Callgrind, a call-graph\n==7== Events    : Ir\n==7== Collected : 81234567\n==7== \n";
        assert_eq!(collected(text), Some(81_234_567));
        assert_eq!(collected("==7== nothing\n"), None);
    }
}
