//! A short soak: the long one is `quadrant-lab soak machines/xy --kills 500` (docs/developers/measurements.md).

use crate::size;
use crate::support::quadrant;

#[test]
fn live_kills_break_nothing() {
    let kills = size::number("KILLS", 6, 12).to_string();
    let soak = quadrant()
        .args(["soak", "machines/xy", "--kills", &kills, "--seed", "7"])
        .output()
        .expect("a soak");
    let printed = String::from_utf8_lossy(&soak.stdout);
    let stderr = String::from_utf8_lossy(&soak.stderr);
    assert_eq!(soak.status.code(), Some(0), "{printed}{stderr}");
    assert!(printed.contains("violations: 0"), "{printed}");
}

/// Clients, orders, frozen and starved cells, full places and launchers that are killed, as many as there is time for.
#[test]
fn a_short_soak_of_everything_breaks_and_leaves_nothing() {
    let soak = quadrant()
        .args(["soak", "machines/xy", "--hours", "0.002", "--seed", "5"])
        .output()
        .expect("a soak");
    let printed = String::from_utf8_lossy(&soak.stdout);
    let stderr = String::from_utf8_lossy(&soak.stderr);
    assert_eq!(soak.status.code(), Some(0), "{printed}{stderr}");
    assert!(printed.contains("violations: 0"), "{printed}");
}

/// A master that is killed between saying a scan and saving it: whoever comes after it must not say that scan again.
#[test]
fn in_lockstep_the_master_is_killed_at_any_instant_and_the_next_one_is_answered() {
    let soak = quadrant()
        .args(["soak", "machines/xy", "--kills", "5", "--seed", "3"])
        .args(["--pace", "lockstep", "--only", "plant-sim"])
        .output()
        .expect("a soak");
    let printed = String::from_utf8_lossy(&soak.stdout);
    assert_eq!(soak.status.code(), Some(0), "{printed}");
}

#[test]
fn a_soak_without_an_end_or_of_no_machine_is_refused() {
    for arguments in [
        ["soak", "machines/xy"].as_slice(),
        &["soak", "nowhere", "--kills", "3"],
        &["soak", "machines/xy", "--hours", "0"],
    ] {
        let soak = quadrant().args(arguments).output().expect("a soak");
        assert_eq!(soak.status.code(), Some(2), "{arguments:?}");
    }
}
