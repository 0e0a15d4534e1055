//! What drives hold of their SYNC signals once a cell is up: what their drive files say, and nothing where there is none.

use std::path::Path;

use crate::cells::{await_status, mode, order};
use crate::segment::{Network, Segment, machine};
use crate::support::{root, unique_cell};

/// What a slave holds: control and activation, start, cycle of SYNC0, time from it to SYNC1.
#[derive(Debug, PartialEq, Eq)]
struct Held {
    assign_activate: u64,
    start_ns: u64,
    sync0_cycle_ns: u64,
    sync1_ns: u64,
}

impl Held {
    fn of(segment: &Segment, slave: usize) -> Held {
        let number = |address: u16, bytes: usize| {
            let shown = segment.order(&format!("registers {slave} {address:#06x} {bytes}"));
            let digits = (0..bytes).rev().map(|at| &shown[2 * at..2 * at + 2]);
            u64::from_str_radix(&digits.collect::<String>(), 16).expect("hex")
        };
        Held {
            assign_activate: number(0x0980, 2),
            start_ns: number(0x0990, 8),
            sync0_cycle_ns: number(0x09A0, 4),
            sync1_ns: number(0x09A4, 4),
        }
    }
}

/// What the slaves of three drives with this `[[sync_mode]]`, and of a device behind them that is none, hold while a cell is up.
fn held(network: &Network, sync_modes: &str) -> Vec<Held> {
    let segment = network.segment(&["--drives", "3", "--io", "3"]);
    let folder = machine(
        &[("sync = \"sm\"", "sync = \"dc\"\nother_slaves = [3]")],
        &[("[option_codes]", &format!("{sync_modes}[option_codes]"))],
    );
    let cell = unique_cell();
    let shown = |path: &Path| path.to_string_lossy().into_owned();
    let (machine, out) = (shown(folder.path()), shown(&folder.path().join("up")));
    let mut up = network
        .command(env!("CARGO_BIN_EXE_quadrant"))
        .args(["up", &machine, "--pace", "lockstep"])
        .args(["--out", &out, "--cell", &cell])
        .current_dir(root())
        .stdout(std::process::Stdio::null())
        .spawn()
        .expect("a cell");
    await_status(network, &cell, "starting", |status| {
        mode(status) == "disabled"
    });
    let held = (0..4).map(|slave| Held::of(&segment, slave)).collect();
    order(network, &cell, &["down"]);
    assert!(up.wait().expect("its end").success());
    held
}

#[test]
fn drives_have_the_sync_signals_of_their_files_and_other_slaves_have_none() {
    const NOTHING: Held = Held {
        assign_activate: 0,
        start_ns: 0,
        sync0_cycle_ns: 0,
        sync1_ns: 0,
    };
    let Some(network) = Network::new() else {
        return;
    };
    let mode = |keys: &str| format!("[[sync_mode]]\nname = \"DC\"\n{keys}\n");
    let free = mode("assign_activate = 0");
    let both = "assign_activate = 0x0700\nsync1_shift_ns = 30000\n";
    // What the file says; the word, cycle of SYNC0, its shift in a scan of 1 ms, and SYNC1.
    for (modes, expected) in [
        (String::new(), Some((0x0300, 1_000_000, 0, 0))),
        (free.clone(), None),
        (
            mode("assign_activate = 0x0300\nsync0_shift_ns = -125000"),
            Some((0x0300, 1_000_000, 875_000, 0)),
        ),
        (
            free + &mode(&format!("{both}sync0_cycle_factor = -4")),
            Some((0x0700, 250_000, 0, 30_000)),
        ),
        (
            mode(&format!(
                "{both}sync0_cycle_ns = 2000000\nsync0_shift_ns = 40000"
            )),
            Some((0x0700, 2_000_000, 40_000, 30_000)),
        ),
    ] {
        let held = held(&network, &modes);
        assert_eq!(held[3], NOTHING, "{modes}");
        for slave in &held[..3] {
            let Some((assign_activate, sync0_cycle_ns, shift_ns, sync1_ns)) = expected else {
                assert_eq!(*slave, NOTHING, "{modes}");
                continue;
            };
            let wanted = Held {
                assign_activate,
                sync0_cycle_ns,
                sync1_ns,
                ..*slave
            };
            assert_eq!(*slave, wanted, "{modes}");
            let step_ns = sync0_cycle_ns.max(1_000_000);
            assert_eq!(slave.start_ns % step_ns, shift_ns, "{modes}");
            assert_eq!(slave.start_ns, held[0].start_ns, "{modes}");
        }
    }
}
