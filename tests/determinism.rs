//! Lockstep: the same result to the bit, whatever else this PC does and whoever is slow.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use plant_sim::script::rng::Rng;
use serde_json::Value;

use crate::size;
use crate::support::{Bench, LiveCell, Run, circle_program, circles_each_way, run, send, text};

fn digests(report: &Value) -> (String, String) {
    (text(report, "/digest"), text(report, "/motion_digest"))
}

/// Both ways round a circle.
fn bench() -> (Bench, std::path::PathBuf) {
    let bench = Bench::of("xy", &[]);
    let times = if size::is_full() { 2 } else { 1 };
    let turns = circles_each_way(times, 25.0, 3000.0, (3.0, -2.0), 20.0);
    let program = bench.file("circle.ngc", &turns);
    (bench, program)
}

fn finished(run: Run) -> (String, String) {
    digests(&run.good_report())
}

/// The report of that program with nothing else of the test beside it: one run for all that compare theirs with it.
fn first() -> &'static Value {
    static FIRST: OnceLock<Value> = OnceLock::new();
    FIRST.get_or_init(|| {
        let (bench, program) = bench();
        run(bench.path(), &program).good_report()
    })
}

#[test]
fn two_runs_are_the_same_to_the_bit() {
    let (bench, program) = bench();
    let second = finished(run(bench.path(), &program));
    assert_eq!(digests(first()), second);
}

#[test]
fn the_digests_see_a_changed_gain() {
    let (_bench, program) = bench();
    let other = Bench::of("xy", &[("gain_per_s = 50.0", "gain_per_s = 50.001")]);
    let first = digests(first());
    let second = finished(run(other.path(), &program));
    assert_ne!(first.0, second.0);
    assert_ne!(first.1, second.1);
}

#[test]
fn a_busy_machine_changes_no_bit() {
    let (bench, program) = bench();
    let quiet = digests(first());
    let stop = Arc::new(AtomicBool::new(false));
    let busy: Vec<_> = (0..4)
        .map(|_| {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            })
        })
        .collect();
    let loaded = finished(run(bench.path(), &program));
    stop.store(true, Ordering::Relaxed);
    for thread in busy {
        thread.join().expect("a busy thread");
    }
    assert_eq!(quiet, loaded);
}

/// Every process of the group is stopped and let go again at random instants, wherever in its scan it happens to be.
#[test]
fn processes_delayed_at_random_instants_change_no_bit() {
    let bench = Bench::of("xy", &[]);
    // Some seconds of wall time: enough for the delays, and not much more.
    let feed = if size::is_full() { 600.0 } else { 2_400.0 };
    let turns = circle_program(25.0, feed, (0.0, 0.0), 0.0);
    let program = bench.file("slow.ngc", &turns);
    let undisturbed = finished(run(bench.path(), &program));
    for seed in 1..=size::number("SEEDS", 1, 3) {
        let mut rng = Rng::new(seed);
        let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
        cell.wait_for_scan(1);
        let children: Vec<i32> = cell.children().into_iter().map(|(pid, _)| pid).collect();
        let mut delays = 0;
        for _ in 0..60 {
            if children.is_empty() || !matches!(cell.child.try_wait(), Ok(None)) {
                break;
            }
            let pid = children[rng.below(children.len() as u64) as usize];
            send(pid, libc::SIGSTOP);
            std::thread::sleep(Duration::from_micros(rng.below(4000)));
            send(pid, libc::SIGCONT);
            std::thread::sleep(Duration::from_micros(rng.below(2000)));
            delays += 1;
        }
        let disturbed = finished(cell.finish());
        assert_eq!(undisturbed, disturbed, "seed {seed}, {delays} delays");
        assert!(
            delays > 5,
            "seed {seed}: only {delays} delays, the run was over too soon to tell"
        );
    }
}

#[test]
fn nothing_is_lost_on_the_way_to_the_log() {
    assert_eq!(first()["samples_lost"], 0);
}
