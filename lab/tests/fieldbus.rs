//! Soak and bench of drives on a bus, against a segment of foreign drives (docs/developers/foreign-drives.md).

#[allow(dead_code, reason = "shared with the tests of the cell")]
#[path = "../../tests/ethercat/segment.rs"]
mod segment;
#[allow(dead_code, reason = "shared with the tests of the cell")]
#[path = "../../tests/support.rs"]
mod support;

use std::process::Stdio;

use crate::segment::{Network, enabled_steps, machine};
use crate::support::{QUADRANT, traces_of};

/// The long one is `quadrant-lab soak machines/xy-ethercat --pace lockstep --hours 1` beside a segment (docs/developers/measurements.md).
#[test]
fn a_short_soak_of_the_bus_processes_loses_no_drive_while_one_of_them_lives() {
    let Some(network) = Network::new() else {
        return;
    };
    let segment = network.segment(&["--drives", "3"]);
    let soak = network.quadrant(&[
        "soak",
        "machines/xy-ethercat",
        "--pace",
        "lockstep",
        "--only",
        "fieldbus",
        "--kills",
        "16",
        "--seed",
        "4",
    ]);
    let printed = String::from_utf8_lossy(&soak.stdout);
    let errors = String::from_utf8_lossy(&soak.stderr);
    assert_eq!(soak.status.code(), Some(0), "{printed}{errors}");
    assert!(printed.contains("violations: 0"), "{printed}");
    assert!(
        printed.contains("kill owner of the bus (standby)"),
        "{printed}"
    );
    assert!(enabled_steps(&segment.end()) > 0);
}

#[test]
fn the_bench_of_the_fieldbus_measures_a_cell_beside_a_bare_loop_and_leaves_nothing() {
    let Some(network) = Network::new() else {
        return;
    };
    let segment = network.segment(&["--drives", "3"]);
    let machine = machine(&[], &[]);
    let folder = machine.path().to_string_lossy();
    let bench = network
        .command(QUADRANT.expect("a command to test"))
        .args(["bench", "fieldbus", &folder, "--seconds", "1"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the bench");
    let cell = format!("bench-{}", bench.id());
    let done = bench.wait_with_output().expect("its end");
    assert!(done.status.success(), "{done:?}");
    assert_eq!(traces_of(&cell), Vec::<String>::new());
    let printed = String::from_utf8_lossy(&done.stdout);
    let frames = |line: &str| line.split_whitespace().find_map(|word| word.parse().ok());
    for name in ["bare loop", "cell"] {
        let row = printed.lines().find(|line| line.trim().starts_with(name));
        assert!(row.and_then(frames) > Some(500_u64), "{printed}");
    }
    drop(segment);
}
