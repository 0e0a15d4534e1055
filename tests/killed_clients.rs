//! Clients that are killed or stalled before their answer: they keep nobody else from the machine.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Bench, LiveCell, long_program, quadrant, send};

/// More clients than have a place in the cell, each waiting for the answer to an order: the master is stopped meanwhile.
fn waiting_clients(cell: &LiveCell) -> Vec<Child> {
    let spawn = |_| {
        quadrant()
            .args(["override", "100%", "--cell", &cell.cell])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("a client")
    };
    let clients = (0..12).map(spawn).collect();
    std::thread::sleep(Duration::from_millis(400));
    clients
}

/// An order is obeyed, and soon.
fn obeyed(cell: &LiveCell, order: &str) {
    let asked = Instant::now();
    let answered = quadrant()
        .args([order, "--cell", &cell.cell])
        .output()
        .expect("the order");
    let printed = String::from_utf8_lossy(&answered.stderr).into_owned();
    assert!(answered.status.success(), "{order}: {printed}");
    assert!(asked.elapsed() < Duration::from_secs(4), "{order}");
}

fn running_cell() -> (Bench, LiveCell) {
    // A master that is stopped for a moment is not to trip.
    let bench = Bench::of("xy", &[("watchdog_scans = 50 ", "watchdog_scans = 1000 ")]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(100);
    (bench, cell)
}

fn stopped_by_an_operator(cell: LiveCell) {
    let run = cell.finish();
    assert_eq!(run.status(), 1, "{}", run.stderr());
}

#[test]
fn clients_killed_before_their_answer_give_their_places_back() {
    let (_bench, cell) = running_cell();
    let master = cell.pid_of("quadrant plant-sim");
    send(master, libc::SIGSTOP);
    for mut client in waiting_clients(&cell) {
        client.kill().expect("killing a client");
        client.wait().expect("reaping it");
    }
    send(master, libc::SIGCONT);
    obeyed(&cell, "resume");
    obeyed(&cell, "stop");
    stopped_by_an_operator(cell);
}

#[test]
fn hold_and_stop_come_through_however_many_clients_are_stalled() {
    let (_bench, cell) = running_cell();
    let master = cell.pid_of("quadrant plant-sim");
    send(master, libc::SIGSTOP);
    let mut stalled = waiting_clients(&cell);
    for client in &stalled {
        send(client.id() as i32, libc::SIGSTOP);
    }
    send(master, libc::SIGCONT);
    obeyed(&cell, "hold");
    obeyed(&cell, "stop");
    stopped_by_an_operator(cell);
    for client in &mut stalled {
        let _ = client.kill();
        client.wait().expect("reaping it");
    }
}
