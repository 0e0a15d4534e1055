//! Clients that are killed or stalled before their answer: they keep nobody else from the machine.
//!
//! `CLIENTS=1000 cargo test --release --test cell -- killed_clients --nocapture` for many of them, beside a tool that moves.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::sample::{Mode, Order};
use bus::signal_page::SignalPage;

use crate::support::{Bench, LiveCell, long_program, number, quadrant, send, text};

/// Clients at once: more than have a place in the cell.
const AT_ONCE: usize = 12;
/// A stop is answered by then where this was asked for with many clients.
const ANSWER_LIMIT: Duration = Duration::from_millis(100);

fn client(cell: &LiveCell) -> Child {
    quadrant()
        .args(["override", "100%", "--cell", &cell.cell])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("a client")
}

/// Clients that each wait for the answer to an order: the master is stopped meanwhile.
fn waiting_clients(cell: &LiveCell) -> Vec<Child> {
    let clients = (0..AT_ONCE).map(|_| client(cell)).collect();
    std::thread::sleep(Duration::from_millis(400));
    clients
}

fn kill(mut client: Child) {
    client.kill().expect("killing a client");
    client.wait().expect("reaping it");
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
    let bench = Bench::patient("xy", &[]);
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
    waiting_clients(&cell).into_iter().for_each(kill);
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
    let stalled = waiting_clients(&cell);
    for client in &stalled {
        send(client.id() as i32, libc::SIGSTOP);
    }
    send(master, libc::SIGCONT);
    obeyed(&cell, "hold");
    obeyed(&cell, "stop");
    stopped_by_an_operator(cell);
    stalled.into_iter().for_each(kill);
}

/// Half of them are killed, half stay stalled, each at another moment between its start and its answer.
fn killed_and_stalled(cell: &LiveCell, count: usize) -> Vec<Child> {
    let mut stalled = Vec::new();
    for begun in (0..count).step_by(AT_ONCE) {
        let batch: Vec<Child> = (begun..count.min(begun + AT_ONCE))
            .map(|_| client(cell))
            .collect();
        for (at, client) in batch.into_iter().enumerate() {
            std::thread::sleep(Duration::from_millis((at % 4) as u64));
            if at % 2 == 0 {
                kill(client);
            } else {
                send(client.id() as i32, libc::SIGSTOP);
                stalled.push(client);
            }
        }
    }
    stalled
}

/// Stop needs no place: the tool comes to rest on the path, whoever is killed or stalled.
#[test]
fn a_stop_beside_killed_and_stalled_clients_is_answered_at_once_and_keeps_the_tool_on_the_path() {
    let many = std::env::var("CLIENTS").map(|count| count.parse().expect("CLIENTS"));
    let (_bench, mut cell) = running_cell();
    let stalled = killed_and_stalled(&cell, *many.as_ref().unwrap_or(&AT_ONCE));
    let place = CellPaths::new(&cell.cell).expect("a name");
    let page = SignalPage::open(&place).expect("the page");
    let moves = cell.wait_for(|feedback| feedback.at_rest == 0);
    assert_eq!(moves.mode, Mode::Enabled as u32);
    // A reader that is there before has the last feedback also when the cell is gone.
    let (_bus, mut feedback) = cell.feedback();
    feedback.newest(u64::MAX);
    let asked = Instant::now();
    let order = page.order_urgently(Order::Stop).expect("an order");
    while page.urgent_answer(Order::Stop, order).is_none() {
        assert!(asked.elapsed() < Duration::from_secs(4), "no answer");
        std::thread::sleep(Duration::from_micros(200));
    }
    let took = asked.elapsed();
    let run = cell.finish();
    let rest = asked.elapsed();
    let last = feedback.newest(u64::MAX).expect("a feedback");
    assert_eq!(last.last, 1, "{last:?}");
    let scans = last.scan - moves.scan;
    println!(
        "{} clients stalled and as many killed: stop answered after {took:?}, the run is over after {rest:?}, {scans} scans",
        stalled.len()
    );
    assert!(many.is_err() || took <= ANSWER_LIMIT, "{took:?}");
    assert!(!last.tag.is_off_path() && last.at_rest == 1, "{last:?}");
    assert_eq!(run.status(), 1, "{}", run.stderr());
    let report = run.report();
    assert_eq!(text(&report, "/outcome/kind"), "interrupted");
    for limit in ["velocity", "acceleration", "travel"] {
        assert_eq!(number(&report, &format!("/limits/{limit}_exceeded")), 0.0);
    }
    println!(
        "contour error {:.1} µm",
        number(&report, "/contour_error_um/peak")
    );
    stalled.into_iter().for_each(kill);
}
