//! Homing through the real processes and the command line: refusals, a cell that stays up, a run with orders to the bit.

use bus::sample::{Mode, ProgramState};
use serde_json::Value;

use crate::support::{Bench, LiveCell, circle_program, quadrant, send, text};
use crate::up::{ask, is, obeyed, refused, up_on};

/// True place of the index behind the switch, and the position that the machine has there.
const REFERENCE_MM: f64 = -15.5;

/// X is homed by switch and index, and after it Y by its drive.
const OF_MACHINE: [&str; 2] = [
    "[axis.homing]\nmethod = \"switch-index\"\nswitch_input = 3\nsearch_mm_s = 40\nlatch_mm_s = 5\n\
     position_mm = -15.5\nsearch_distance_mm = 60\n",
    "[axis.homing]\nmethod = \"drive\"\norder = 2\n",
];
const OF_PLANT: [&str; 2] = [
    "[axis.encoder]\nshows_mm = 512.75\nindex_at_mm = -5.5\n\
     [axis.home_switch]\ndigital = 3\nat_mm = -8\nscatter_um = 30\n",
    "[axis.encoder]\nshows_mm = -33.3\n\
     [axis.drive_homing]\nspeed_mm_s = -20\nswitch_at_mm = -12\nposition_mm = -12\n",
];

/// Adds a table to each axis of a file.
fn add(bench: &Bench, name: &str, tables: [&str; 2]) {
    let file = bench.path().join(name);
    let text = std::fs::read_to_string(&file).expect(name);
    let mut pieces = text.split("[axis.motor]\n");
    let mut whole = pieces.next().expect("a beginning").to_string();
    for (piece, table) in pieces.zip(tables) {
        whole += &format!("{table}\n[axis.motor]\n{piece}");
    }
    std::fs::write(file, whole).expect("written");
}

fn bench(bench: Bench) -> Bench {
    add(&bench, "machine.toml", OF_MACHINE);
    add(&bench, "plant.toml", OF_PLANT);
    bench
}

/// How each axis knows its place, by `status --json`.
fn references(cell: &LiveCell) -> Vec<String> {
    let printed = ask(cell, &["status", "--json"]);
    let state: Value = serde_json::from_str(&printed.text).expect("JSON");
    let axes = state["axes"].as_array().expect("axes").iter();
    axes.map(|axis| text(axis, "/reference")).collect()
}

#[test]
fn a_cell_is_homed_starts_programs_then_and_is_homed_still_after_its_master_was_killed() {
    let bench = bench(Bench::patient("xy", &[]));
    let (_bench, mut cell, short, _) = up_on(bench, "realtime");
    obeyed(&cell, &["load", &short]);
    refused(&cell, &["home"], "the drives are off");
    obeyed(&cell, &["enable"]);
    cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Loaded));
    assert_eq!(references(&cell), ["not homed", "not homed"]);
    let first = "not homed: X Y: `quadrant home X Y` first";
    refused(&cell, &["start"], first);
    let homed = |axes: &str| format!("{0}: homing {axes}\n{0}: homed\n", cell.cell);
    assert_eq!(obeyed(&cell, &["home", "x", "--wait"]), homed("X"));
    assert_eq!(references(&cell), ["homed", "not homed"]);
    refused(&cell, &["start"], "`quadrant home Y` first");
    let stopped = std::thread::scope(|scope| {
        let waits = scope.spawn(|| ask(&cell, &["home", "Y", "--wait"]));
        std::thread::sleep(std::time::Duration::from_millis(300));
        obeyed(&cell, &["stop"]);
        waits.join().expect("the command")
    });
    assert_eq!(stopped.status, 1);
    assert!(
        stopped.text.contains("not homed: Y: it was stopped"),
        "{}",
        stopped.text
    );
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert_eq!(obeyed(&cell, &["home", "--wait"]), homed("X Y"));
    assert!(obeyed(&cell, &["status"]).contains("homed"));

    send(cell.pid_of("plant-sim"), libc::SIGKILL);
    let off = cell.wait_for(|now| now.incarnation == 2);
    assert_eq!(Mode::from_wire(off.mode), Some(Mode::Disabled));
    assert_eq!(references(&cell), ["homed", "homed"]);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["start"]);
    let end = cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Done));
    // Whoever stands at the end of the circle is where the machine says.
    let off_mm = end.axes[0].motor_position as f64 * 1e-6 - 10.0;
    assert!(off_mm.abs() < 0.02, "{off_mm}");
    obeyed(&cell, &["down"]);
    assert_eq!(cell.finish().status(), 0);
}

#[test]
fn a_run_waits_in_hold_to_be_homed_and_repeats_to_the_bit() {
    let bench = bench(Bench::of("xy", &[]));
    let program = circle_program(10.0, 3000.0, (0.0, 0.0), 0.0);
    let program = bench.file("circle.ngc", &program);
    let orders =
        "[[order]]\nscan = 300\norder = \"home\"\n[[order]]\nscan = 9000\norder = \"resume\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    let digest = || {
        let more = ["--orders", orders.as_str()];
        let run = LiveCell::start_with(bench.path(), &program, "lockstep", &more).finish();
        let report = run.good_report();
        let contour_um = crate::support::number(&report, "/contour_error_um/peak");
        (text(&report, "/motion_digest"), contour_um)
    };
    let (first, contour_um) = digest();
    assert_eq!(digest().0, first);
    // The zero is the true one: the table is where the program says.
    assert!(
        contour_um < 30.0,
        "{contour_um} with the index at {REFERENCE_MM} mm"
    );
}

#[test]
fn a_machine_without_homing_has_absolute_axes_and_nothing_to_home() {
    let (_bench, mut cell, _, _) = up_on(Bench::patient("xy", &[]), "realtime");
    obeyed(&cell, &["enable"]);
    cell.wait_for(|now| is(now, Mode::Ready, ProgramState::None));
    assert_eq!(references(&cell), ["absolute", "absolute"]);
    refused(&cell, &["home"], "there is nothing to home");
    let bad = quadrant()
        .args(["home", "Q", "--cell", &cell.cell])
        .output();
    assert_eq!(bad.expect("the command").status.code(), Some(2));
    obeyed(&cell, &["down"]);
    assert_eq!(cell.finish().status(), 0);
}
