//! Locks: the holder is named, what is said of it is true, and a user who may only read keeps nothing from the owner.

use std::fs::{self, File};
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::Duration;

use crate::support::{
    Bench, LiveCell, PATIENCE, endless_program, long_program, quadrant, send, traces_of,
    unique_cell,
};
use crate::up::ask;

/// Offsets and parameters that outlive a program, of which it sets both.
const PROGRAM: &str = "G21 G90 G94\n#100=[#100+1]\nG1 X1 F6000\nG10 L2 P1 X5\nM2\n";

fn words(output: &Output) -> String {
    let both = [&output.stdout, &output.stderr];
    both.map(|bytes| String::from_utf8_lossy(bytes)).concat()
}

/// This process, as it is named.
fn this() -> String {
    let name = fs::read_to_string("/proc/self/comm").expect("a name");
    format!("{} ({})", std::process::id(), name.trim_end())
}

/// A machine with a file of parameters and one of offsets; the lock of the offsets, as their writers take it.
fn keeping() -> (Bench, File) {
    let named = "[program]\nparameter_file = \"xy.var\"\n\n[scan]\n";
    let bench = Bench::patient("xy", &[("[scan]\n", named)]);
    bench.file("xy.var", "100\t4\n");
    bench.file("offsets.toml", "[G54]\nX = 1.0\n");
    let lock = bench.file(".offsets.toml.lock", "");
    (bench, File::open(lock).expect("its lock"))
}

fn kept(machine: &Path) -> (f64, f64) {
    let machine = machine::Machine::load(machine).expect("a machine");
    (machine.parameters[&100], machine.parameters[&5221])
}

#[test]
fn a_writer_that_does_not_let_go_of_the_offsets_is_named() {
    let (bench, lock) = keeping();
    lock.lock().expect("the lock");
    let machine = bench.path().display().to_string();
    let set = || {
        let words = ["offsets", &machine, "set", "G54", "X=2"];
        quadrant().args(words).output().expect("a command")
    };
    let refused = set();
    assert_eq!(refused.status.code(), Some(3), "{}", words(&refused));
    assert!(words(&refused).contains(&this()), "{}", words(&refused));
    assert_eq!(kept(bench.path()), (4.0, 1.0));
    drop(lock);
    assert!(set().status.success());
    assert_eq!(kept(bench.path()), (4.0, 2.0));
}

/// Nothing of it is kept, and that is said; once it can be, all of it is.
#[test]
fn a_program_whose_offsets_cannot_be_kept_keeps_no_parameter_either_and_says_who_is_in_its_way() {
    let (bench, lock) = keeping();
    let program = bench.file("set.ngc", PROGRAM);
    lock.lock().expect("the lock");
    for pace in ["lockstep", "realtime"] {
        let run = LiveCell::start(bench.path(), &program, pace).finish();
        let said = run.stderr();
        assert_ne!(run.status(), 0, "{pace}: {said}");
        assert!(said.contains("the parameters are not kept"), "{said}");
        assert!(said.contains(&this()), "{said}");
        assert_eq!(kept(bench.path()), (4.0, 1.0), "{pace}");
    }
    // One that lets go in time holds up the end of a program, and that is all.
    let run = LiveCell::start(bench.path(), &program, "lockstep");
    std::thread::sleep(Duration::from_millis(1500));
    drop(lock);
    let run = run.finish();
    assert_eq!(run.status(), 0, "{}", run.stderr());
    assert_eq!(kept(bench.path()), (5.0, 5.0));
    assert!(!bench.path().join(".offsets.toml.new").exists());
}

#[test]
fn the_holder_of_a_cell_is_named_with_its_program() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(50);
    let clean = || {
        let refused = quadrant().args(["clean", &cell.cell]).output();
        let refused = refused.expect("a command");
        assert_eq!(refused.status.code(), Some(3), "{}", words(&refused));
        words(&refused)
    };
    let named = |pid: i32| format!("{pid} (quadrant)");
    let launcher = cell.child.id() as i32;
    let said = clean();
    assert!(said.contains(&named(launcher)), "{said}");
    // Somebody who stays when its launcher and all others have gone.
    let members = format!("/dev/shm/quadrant-{}/members.lock", cell.cell);
    let member = File::open(members).expect("the members' lock");
    member.lock_shared().expect("a member");
    send(launcher, libc::SIGKILL);
    let said = clean();
    assert!(said.contains(&this()), "{said}");
    drop(member);
    let cleaned = quadrant().args(["clean", &cell.cell]).output();
    assert!(cleaned.expect("a command").status.success());
    assert!(traces_of(&cell.cell).is_empty());
}

/// Who may read a run may lock its files as well: such a lock says nothing of its launcher.
#[test]
fn a_run_that_somebody_reads_and_locks_is_removed_as_any_other_and_one_under_way_is_not() {
    let keep = "[log]\nkeep_days = 0.0000001\n\n[scan]\n";
    let bench = Bench::patient("xy", &[("[scan]\n", keep)]);
    bench.file("part.ngc", "G21 G90\nG1 X1 F6000\nM2\n");
    bench.file("long.ngc", &endless_program());
    let runs = || {
        let runs = fs::read_dir(bench.path().join("runs"));
        let runs = runs.into_iter().flatten().flatten();
        runs.map(|run| run.path()).collect::<Vec<_>>()
    };
    let run = |program: &str, cell: &str| {
        let mut run = quadrant();
        run.current_dir(bench.path());
        run.stdout(Stdio::null()).stderr(Stdio::null());
        run.args(["run", ".", program, "--pace", "lockstep", "--cell", cell]);
        run
    };
    let good = || run("part.ngc", &unique_cell()).status().expect("a run");
    assert!(good().success());
    // Not of the same second as the next one.
    let old = bench.path().join("runs/xy-part-20200101-000000");
    fs::rename(runs().pop().expect("a run"), &old).expect("another name");
    let read = File::open(old.join("events.jsonl")).expect("its events");
    read.lock().expect("a lock");
    assert!(good().success());
    assert!(!old.exists(), "what somebody else has locked stays");
    let name = unique_cell();
    let mut under_way = run("long.ngc", &name).spawn().expect("a run");
    let since = std::time::Instant::now();
    while !quadrant()
        .args(["status", "--cell", &name])
        .output()
        .is_ok_and(|said| said.status.success())
    {
        assert!(since.elapsed() < PATIENCE, "it does not come up");
        std::thread::sleep(Duration::from_millis(20));
    }
    let before = runs();
    assert!(good().success());
    let stays = before.iter().filter(|run| run.exists()).count();
    let stopped = quadrant().args(["stop", "--cell", &name]).status();
    assert!(stopped.expect("a stop").success());
    under_way.wait().expect("its end");
    assert_eq!(stays, 1, "of {before:?} the one under way alone");
}

/// A clients' question beside it is answered as ever.
#[test]
fn offsets_of_a_running_cell_that_somebody_holds_keep_no_order_waiting() {
    let (bench, lock) = keeping();
    lock.lock().expect("the lock");
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    let set = ask(&cell, &["offsets", "set", "G54", "X=2"]);
    assert_eq!(set.status, 3, "{}", set.text);
    assert!(set.text.contains(&this()), "{}", set.text);
    drop(lock);
    crate::up::obeyed(&cell, &["offsets", "set", "G54", "X=2"]);
    crate::up::down(cell);
    assert_eq!(kept(bench.path()).1, 2.0);
}
