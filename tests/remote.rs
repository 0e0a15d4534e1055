//! A cell seen from another machine: between two network namespaces whose packets come late and get lost, and, where
//! namespaces are not permitted, through a connection that is just as bad.
//!
//! A binary of its own, because it is built with the feature `remote` only: `cargo test --release --features remote --test remote`.

// Each test binary uses a part of it.
#[allow(dead_code)]
#[path = "support.rs"]
mod support;

#[path = "../remote/tests/certificates/mod.rs"]
mod certificates;

#[path = "remote_link/bad_link.rs"]
mod bad_link;
#[path = "remote_link/namespaces.rs"]
mod namespaces;
#[path = "remote_link/orders.rs"]
mod orders;
#[path = "remote_link/proxy.rs"]
mod proxy;
#[path = "remote_link/view.rs"]
mod view;

use std::process::Stdio;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde_json::Value;
use support::{Bench, LiveCell, Run, circles_program, long_program, quadrant, send, text};
use view::{Lines, Place};

/// One cell at a time: what is missed in real time is not to come from the test beside.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is judged over any bad link: the same between namespaces and through a proxy.
fn a_bad_link_is_lived_with(here: &dyn Place, there: &dyn Place, link: &dyn bad_link::Link) {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = here.cell(bench.path(), &program);
    cell.wait_for_scan(100);
    let name = cell.cell.clone();
    let order = |words: &[&str]| {
        let output = quadrant()
            .args(words)
            .args(["--cell", &name])
            .output()
            .expect("an order");
        assert!(output.status.success(), "{words:?}: {output:?}");
    };
    let beside = Lines::of(here, bench.path(), "beside", &["--cell", &name]);
    beside.until("it says something", |_| true);
    let server = here.serve(&name, &link.listen());
    let to = link.endpoint();
    let remote = Lines::of(
        there,
        bench.path(),
        "remote",
        &["--remote", &to, "--cell", &name],
    );
    let aged = |line: &Value| line["remote"]["data_age_s_max"].is_f64();
    let first = remote.until("it knows how old its data is", aged);
    assert_eq!(first["cell"], name.as_str());
    assert_eq!(first["pace"], "realtime");
    assert_eq!(first["remote"]["link_lost"], false);
    let one_way_s = bad_link::DELAY.as_secs_f64();
    let age = |line: &Value, key: &str| line["remote"][key].as_f64().unwrap_or(f64::NAN);
    // Packets need 50 ms each way: no bound may deny it.
    for line in remote.all().iter().filter(|line| aged(line)) {
        assert!(age(line, "data_age_s_max") >= one_way_s, "{line}");
        assert!(
            age(line, "data_age_s_min") <= age(line, "data_age_s_max"),
            "{line}"
        );
        assert!(age(line, "round_trip_s") >= 2.0 * one_way_s, "{line}");
    }
    for axis in first["axes"].as_array().expect("axes") {
        for key in [
            "feedback_mm",
            "command_mm",
            "velocity_command_mm_s",
            "following_error_um",
        ] {
            assert!(axis[key].is_f64(), "{key}: {axis}");
        }
    }
    let names = |line: &Value| -> Vec<Value> {
        let each = line["processes"].as_array().expect("processes").iter();
        each.map(|process| process["process"].clone()).collect()
    };
    assert_eq!(names(&first), names(&beside.last()));

    // Another remote is stopped, and killed later on: nobody waits for it.
    let dead = Lines::of(
        there,
        bench.path(),
        "dead",
        &["--remote", &to, "--cell", &name],
    );
    dead.until("it says something", |_| true);
    dead.signal(libc::SIGSTOP);

    // Things happen: some while the link is there, some while it is cut.
    for percent in ["90", "80", "70"] {
        order(&["override", percent]);
    }
    let planner = cell.pid_of(" planner ");
    send(planner, libc::SIGKILL);
    let goes_on = |line: &Value| {
        let events = line["events"].as_array().cloned().unwrap_or_default();
        events
            .iter()
            .any(|event| event["event"] == "planner restarted (start 2)")
    };
    remote.until("the planner came back", goes_on);
    let before = remote.last();
    link.cut();
    for percent in ["60", "50", "40", "100"] {
        order(&["override", percent]);
    }
    let lost = remote.until("it says that the link is lost", |line| {
        line["remote"]["link_lost"] == true
    });
    let older = remote.until("its data gets old", |line| {
        age(line, "data_age_s_max") > 2.5
    });
    assert!(
        lost["state"]
            .as_str()
            .unwrap_or_default()
            .starts_with("no link"),
        "{lost}"
    );
    // What is at rest is not given out as new.
    assert!(age(&older, "data_age_s_min") > 2.0, "{older}");
    assert_eq!(older["scan"], lost["scan"]);
    link.mend();
    let back = remote.until("it comes back", |line| {
        let newer = line["scan"].as_u64() > older["scan"].as_u64();
        newer && line["remote"]["link_lost"] == false && age(line, "data_age_s_max") < 2.0
    });
    assert!(back["remote"]["snapshots"].as_u64() > before["remote"]["snapshots"].as_u64());
    dead.signal(libc::SIGKILL);
    order(&["hold"]);
    order(&["resume"]);
    let all = |lines: &Lines| -> Vec<(Option<u64>, String)> {
        let lines = lines.all();
        let events = lines
            .iter()
            .flat_map(|line| line["events"].as_array().cloned().unwrap_or_default());
        let reported = events.map(|event| {
            let words = event["event"].as_str().unwrap_or_default().to_string();
            // A start has no scan of its own: each observer gives it the one in which it saw it.
            let scan = event["scan"]
                .as_u64()
                .filter(|_| !words.contains("restarted"));
            (scan, words)
        });
        // What comes often on a PC that is not made for real time is counted, and reported at different moments.
        let often = |words: &str| words.contains("no command in") || words.starts_with("master: ");
        reported.filter(|(_, words)| !often(words)).collect()
    };
    let resumed = |line: &Value| {
        let events = line["events"].as_array().cloned().unwrap_or_default();
        events
            .iter()
            .any(|event| event["event"] == "resume: hold is off")
    };
    beside.until("the last event is reported beside the cell", resumed);
    let end = remote.until("and over the link", resumed);
    // Whoever looked on from beside the cell saw the same things in the same order.
    let (seen, reported) = (all(&beside), all(&remote));
    assert!(seen.len() >= 11, "{seen:?}");
    assert_eq!(reported, seen);
    assert_eq!(end["remote"]["events_lost"], 0);
    assert_eq!(end["remote"]["messages_refused"], 0);
    // The cell went its way: nobody stopped it.
    let feedback = cell.wait_for_scan(0);
    assert_eq!(feedback.mode, bus::sample::Mode::Enabled as u32);
    assert_eq!(feedback.cause, 0);
    eprintln!(
        "{}: {} snapshots came, {} were lost; {} scans, {} overrun; the cell's events: {}",
        link.name(),
        end["remote"]["snapshots"],
        end["remote"]["snapshots_lost"],
        feedback.scan,
        feedback.overrun_scans,
        seen.len()
    );
    drop(server);
    drop(cell);
}

/// Scans in each half of a pair.
const SCANS: u64 = 1500;
/// Pairs of halves.
const PAIRS: usize = 8;

/// Missed and overrun scans of a cell over the next [`SCANS`].
fn missed(cell: &mut LiveCell) -> u64 {
    let sum = |feedback: &bus::sample::Feedback| {
        let axes = feedback
            .axes()
            .iter()
            .map(|axis| u64::from(axis.missed_scans));
        u64::from(feedback.overrun_scans) + axes.sum::<u64>()
    };
    let before = cell.wait_for_scan(0);
    let after = cell.wait_for_scan(before.scan + SCANS);
    sum(&after) - sum(&before)
}

/// One cell, in turns with and without a server, a remote that reads and one that was stopped. A PC that is not made for real time
/// misses scans now and then anyway: if those who look on cost any, it would be in every turn.
fn the_cell_does_not_notice(here: &dyn Place, there: &dyn Place, link: &dyn bad_link::Link) {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = here.cell(bench.path(), &program);
    cell.wait_for_scan(500);
    let name = cell.cell.clone();
    let mut pairs = Vec::new();
    for pair in 0..PAIRS {
        let alone = missed(&mut cell);
        let server = here.serve(&name, &link.listen());
        let to = link.endpoint();
        let remotes = ["reads", "stopped"].map(|which| {
            let file = format!("{which}-{pair}");
            let lines = Lines::of(
                there,
                bench.path(),
                &file,
                &["--remote", &to, "--cell", &name],
            );
            lines.until("it says something", |_| true);
            lines
        });
        let [_, stopped] = &remotes;
        stopped.signal(libc::SIGSTOP);
        let seen = missed(&mut cell);
        drop(remotes);
        drop(server);
        pairs.push((alone, seen));
    }
    let feedback = cell.wait_for_scan(0);
    let sums = pairs
        .iter()
        .fold((0, 0), |(a, b), (alone, seen)| (a + alone, b + seen));
    eprintln!(
        "{}: missed and overrun in {SCANS} scans each, alone and seen from afar: {pairs:?}, in all {sums:?}",
        link.name()
    );
    assert_eq!(feedback.mode, bus::sample::Mode::Enabled as u32);
    assert_eq!(feedback.cause, 0);
    assert!(pairs.iter().any(|(alone, seen)| seen <= alone), "{pairs:?}");
}

#[test]
fn the_cell_misses_no_more_scans_when_it_is_seen_over_a_bad_link() {
    let _alone = alone();
    match namespaces::Pair::set_up() {
        Ok(pair) => the_cell_does_not_notice(&pair.here(), &pair.there(), &pair),
        Err(why) => {
            eprintln!("\n*** not between namespaces, but through a proxy: {why} ***\n");
            the_cell_does_not_notice(&view::ThisHost, &view::ThisHost, &proxy::Proxy::start());
        }
    }
}

#[test]
fn between_two_hosts_with_50_ms_delay_and_5_percent_loss_the_view_knows_its_age_and_misses_no_event()
 {
    let _alone = alone();
    match namespaces::Pair::set_up() {
        Ok(pair) => a_bad_link_is_lived_with(&pair.here(), &pair.there(), &pair),
        Err(why) => eprintln!(
            "\n*** SKIPPED: between two network namespaces: {why}; the same is judged through a proxy in \
             through_a_proxy_… ***\n"
        ),
    }
}

#[test]
fn through_a_proxy_that_delays_and_stalls_the_view_knows_its_age_and_misses_no_event() {
    let _alone = alone();
    let proxy = proxy::Proxy::start();
    a_bad_link_is_lived_with(&view::ThisHost, &view::ThisHost, &proxy);
}

/// Runs circles in lockstep, seen from afar: through a server, by a view that reads and one that was stopped. `None` where the run was
/// over before anybody looked on.
fn seen_from_afar(circles: usize) -> Option<Run> {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &circles_program(circles));
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for_scan(1);
    let name = cell.cell.clone();
    let proxy = proxy::Proxy::start();
    let here = view::ThisHost;
    let _server = here.serve(&name, &bad_link::Link::listen(&proxy));
    let to = bad_link::Link::endpoint(&proxy);
    let lines = |which: &str| {
        let from = ["--remote", &to, "--cell", &name];
        let lines = Lines::of(&here, bench.path(), which, &from);
        lines.until("it says something", |_| true);
        lines
    };
    let (_reads, stopped) = (lines("reads"), lines("stopped"));
    stopped.signal(libc::SIGSTOP);
    let in_time = matches!(cell.child.try_wait(), Ok(None));
    let run = cell.finish();
    in_time.then_some(run)
}

#[test]
fn who_looks_on_from_another_machine_does_not_change_a_bit_of_the_motion() {
    let _alone = alone();
    // How many circles pass before two views are connected depends on the PC.
    let seen = [10, 40, 160, 640]
        .into_iter()
        .find_map(|circles| Some((circles, seen_from_afar(circles)?)));
    let (circles, seen) = seen.expect("a run that goes on until two have looked on");
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &circles_program(circles));
    let alone = LiveCell::start(bench.path(), &program, "lockstep").finish();
    let (alone, seen) = (alone.good_report(), seen.good_report());
    for digest in ["/motion_digest", "/digest"] {
        assert_eq!(text(&seen, digest), text(&alone, digest), "{digest}");
    }
}

#[test]
fn where_nobody_serves_that_is_said_with_status_1_and_a_bad_place_with_status_2() {
    let _alone = alone();
    let look = |to: &str| {
        let output = quadrant()
            .args(["status", "--remote", to])
            .stdin(Stdio::null())
            .output()
            .expect("it ends");
        let printed = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), printed)
    };
    let port = proxy::free_port();
    let (status, printed) = look(&format!("tcp/127.0.0.1:{port}"));
    assert_eq!(status, Some(1), "{printed}");
    assert!(
        printed.contains("nothing was heard of any cell"),
        "{printed}"
    );
    for bad in [
        "127.0.0.1:7447",
        "udp/127.0.0.1:7447",
        "tcp/x",
        "tcp/h:99999",
        "tcp/h:1#iface=x",
    ] {
        let (status, printed) = look(bad);
        assert_eq!(status, Some(2), "{bad}: {printed}");
        assert!(
            printed.contains("must be tcp/HOST:PORT"),
            "{bad}: {printed}"
        );
    }
}

#[test]
fn a_server_goes_on_with_the_next_cell_of_the_name_and_so_does_the_view() {
    let _alone = alone();
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut first = LiveCell::start(bench.path(), &program, "realtime");
    first.wait_for_scan(200);
    let name = first.cell.clone();
    let here = view::ThisHost;
    let to = format!("tcp/127.0.0.1:{}", proxy::free_port());
    let _server = here.serve(&name, &to);
    let status = || {
        let output = quadrant()
            .args(["status", "--json", "--remote", &to])
            .output()
            .expect("status");
        assert!(output.status.success(), "{output:?}");
        let status: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        status
    };
    assert_eq!(status()["cell"], name.as_str());
    let lines = Lines::of(&here, bench.path(), "lines", &["--remote", &to]);
    lines.until("it says something", |_| true);
    first.signal_launcher(libc::SIGINT);
    first.finish();
    // Lines end with the run, as beside the cell.
    assert_eq!(lines.ended().code(), Some(0));
    let mut second = LiveCell::start_as(&name, bench.path(), &program, "realtime", &[]);
    second.wait_for_scan(200);
    let mut seen = status();
    for _ in 0..100 {
        if seen["scan"].as_u64() >= Some(200) && seen["mode"] == "enabled" {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
        seen = status();
    }
    assert_eq!(seen["mode"], "enabled", "{seen}");
}
