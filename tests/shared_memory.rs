//! Shared memory that is full, too small or removed, and other limits of the PC: no process is killed by a page that it does
//! not get, nobody is told an untruth, and nothing of others is taken away.

use std::fs;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::service::{Bus, Services};
use machine::Machine;

use crate::support::{
    Bench, LiveCell, circle_program, endless_program, long_program, quadrant, root, send,
    traces_of, unique_cell,
};

const PROGRAM: &str = "machines/xy/programs/circle-r25-f3000.ngc";

/// Runs a shell script with a `/dev/shm` of its own of this size; none where that is not permitted.
fn with_shared_memory(size: &str, script: &str) -> Option<Output> {
    let mount = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm");
    let mut command = Command::new("unshare");
    command.current_dir(root()).args(["-m", "sh", "-c"]);
    let possible = Command::new("unshare")
        .args(["-m", "sh", "-c", &mount])
        .output()
        .is_ok_and(|tried| tried.status.success());
    if !possible {
        eprintln!("not tested: a /dev/shm of one's own needs the right to mount");
        return None;
    }
    let quadrant = env!("CARGO_BIN_EXE_quadrant");
    let output = command.arg(format!("{mount} && Q={quadrant}\n{script}"));
    Some(output.output().expect("a shell"))
}

fn words(output: &Output) -> String {
    let out = String::from_utf8_lossy(&output.stdout);
    format!("{out}{}", String::from_utf8_lossy(&output.stderr))
}

#[test]
fn a_cell_for_which_shared_memory_is_too_small_is_not_started() {
    for size in ["64k", "1m", "16m"] {
        let out = tempfile::tempdir().expect("a folder");
        let run = format!(
            "exec $Q run machines/xy {PROGRAM} --pace lockstep --cell small --out {}/run",
            out.path().display()
        );
        let Some(output) = with_shared_memory(size, &run) else {
            return;
        };
        let printed = words(&output);
        assert_eq!(output.status.code(), Some(3), "{size}: {printed}");
        assert!(printed.contains("has no room for"), "{size}: {printed}");
        assert!(printed.contains("remount,size="), "{size}: {printed}");
        let left = out.path().join("run");
        assert!(!left.exists(), "{size}: the run directory of nothing");
    }
}

/// Two that start at once: each finds room, and then one of them does not.
#[test]
fn a_cell_that_finds_shared_memory_full_while_it_is_being_started_leaves_it_to_others() {
    let out = tempfile::tempdir().expect("a folder");
    let run = |cell: &str| {
        format!(
            "( $Q run machines/xy {PROGRAM} --pace lockstep --cell {cell} --out {}/{cell}; echo {cell} ended with $? ) & \n",
            out.path().display()
        )
    };
    let script = format!("{}{}wait; ls /dev/shm", run("one"), run("two"));
    let Some(output) = with_shared_memory("32m", &script) else {
        return;
    };
    let printed = words(&output);
    let ended = |status: &str| printed.matches(&format!("ended with {status}")).count();
    assert_eq!(ended("0") + ended("3"), 2, "{printed}");
    assert!(
        ended("0") == 2 || printed.contains("has no room for"),
        "{printed}"
    );
    assert!(!printed.contains("qd-"), "nothing is left: {printed}");
}

#[test]
fn shared_memory_that_fills_up_while_the_machine_moves_kills_nobody() {
    let bench = Bench::patient(
        "xy",
        &[("[scan]\n", "[restart]\nservo = \"wait\"\n\n[scan]\n")],
    );
    let program = bench.file("long.ngc", &long_program());
    let folder = bench.path().display();
    let script = format!(
        "$Q run {folder} {} --pace realtime --cell full --out {folder}/run > {folder}/log 2>&1 &
        LAUNCHER=$!
        sleep 2
        head -c 100m /dev/zero > /dev/shm/fill 2>/dev/null
        $Q status --cell full; echo status $?
        $Q override 90 --cell full; echo override $?
        $Q hold --cell full; echo hold $?
        $Q resume --cell full; echo resume $?
        kill -9 $(pgrep -P $LAUNCHER -f 'servo --axis X')
        sleep 3
        $Q stop --cell full; echo stop $?
        wait $LAUNCHER; echo ended with $?
        cat {folder}/log",
        program.display()
    );
    let Some(output) = with_shared_memory("50m", &script) else {
        return;
    };
    let printed = words(&output);
    for expected in [
        "status 3",
        "override 3",
        "hold 0",
        "resume 3",
        "stop 0",
        "ended with 1",
    ] {
        assert!(printed.contains(expected), "{expected}: {printed}");
    }
    assert!(printed.contains("has no room for"), "{printed}");
    // What the dead servo had is enough for the next.
    assert!(printed.contains("servo-X restarted"), "{printed}");
    assert!(!printed.contains("signal 7"), "{printed}");
}

/// What a cell says that it needs is what it takes, and no more than a quarter is in reserve.
#[test]
fn a_cell_takes_the_room_that_it_asks_for() {
    use std::os::unix::fs::MetadataExt;
    for machine in ["xy", "xyz-mill"] {
        let bench = Bench::patient(machine, &[]);
        let mut cell = LiveCell::up(bench.path(), "realtime");
        cell.wait_for_scan(100);
        let traces = traces_of(&cell.cell);
        let taken: u64 = traces
            .iter()
            .filter_map(|name| fs::metadata(Path::new("/dev/shm").join(name)).ok())
            .map(|found| found.blocks() * 512)
            .sum();
        let place = CellPaths::new(&cell.cell).expect("a name");
        let shape = Machine::load(bench.path()).expect("a machine").shape();
        let asked = Services::of(&place, &shape).room_bytes();
        assert!(taken <= asked, "{machine}: {taken} of {asked} bytes");
        assert!(
            asked * 3 / 4 <= taken,
            "{machine}: {taken} of {asked} bytes"
        );
    }
}

#[test]
fn a_cell_whose_files_are_removed_says_so_and_ends_and_nobody_takes_its_name_before() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &endless_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(300);
    let place = CellPaths::new(&cell.cell).expect("a name");
    fs::remove_dir_all(place.folder()).expect("removing its folder");
    let second = LiveCell::start_as(&cell.cell, bench.path(), &program, "lockstep", &[]).finish();
    assert_eq!(second.status(), 3, "{}", second.stderr());
    assert!(
        second.stderr().contains("already running"),
        "{}",
        second.stderr()
    );
    let first = cell.finish();
    assert_eq!(first.status(), 1, "{}", first.stderr());
    assert!(first.stderr().contains("was removed"), "{}", first.stderr());
    assert!(
        first.stderr().contains("files of the cell were removed"),
        "{}",
        first.stderr()
    );
    let report = first.report();
    assert_eq!(
        report
            .pointer("/limits/acceleration_exceeded")
            .and_then(|n| n.as_f64()),
        Some(0.0)
    );
    assert!(
        traces_of(&first.cell).is_empty(),
        "{:?}",
        traces_of(&first.cell)
    );
}

#[test]
fn a_segment_that_is_removed_under_a_cell_is_noticed() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(300);
    for name in traces_of(&cell.cell)
        .iter()
        .filter(|name| name.starts_with("qd-"))
    {
        let _ = fs::remove_file(Path::new("/dev/shm").join(name));
    }
    let run = cell.finish();
    assert_eq!(run.status(), 1, "{}", run.stderr());
    assert!(
        run.stderr().contains("files of the cell were removed"),
        "{}",
        run.stderr()
    );
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
}

/// Whether a process has ended and nobody has asked how.
fn is_zombie(pid: i32) -> bool {
    let status = fs::read_to_string(format!("/proc/{pid}/stat")).expect("a child of the launcher");
    let state = status.rsplit(')').next().unwrap_or_default();
    state.trim_start().starts_with('Z')
}

/// The launcher cleans up after a dead process as soon as it can: until then the place is waited for.
#[test]
fn the_place_of_a_dead_servo_is_had_once_the_launcher_has_cleaned_up() {
    let bench = Bench::of(
        "xy",
        &[("[scan]\n", "[restart]\nservo = \"end\"\n\n[scan]\n")],
    );
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(300);
    let machine = Machine::load(bench.path()).expect("the machine");
    let place = CellPaths::new(&cell.cell).expect("a name");
    let bus = Bus::enter(&place, &machine.shape(), "next", false).expect("entering as the owner");
    cell.signal_launcher(libc::SIGSTOP);
    let servo = cell.pid_of("quadrant servo --axis X");
    send(servo, libc::SIGKILL);
    while !is_zombie(servo) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let launcher = cell.child.id() as i32;
    let busy = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(400));
        send(launcher, libc::SIGCONT);
    });
    let taken = bus.command_writer(0, 0);
    busy.join().expect("a thread");
    assert!(taken.is_ok(), "{:?}", taken.err());
}

#[test]
fn a_phase_that_somebody_overwrites_ends_no_cell_in_motion() {
    use std::os::unix::fs::FileExt;
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for(|f| f.at_rest == 0);
    let place = CellPaths::new(&cell.cell).expect("a name");
    let page = fs::OpenOptions::new()
        .write(true)
        .open(place.page())
        .expect("the page");
    for word in [2u32, 0, 1, u32::MAX] {
        // After the words that name the page and its launcher.
        page.write_all_at(&word.to_le_bytes(), 12).expect("writing");
        let scan = cell.wait_for_scan(0).scan;
        let moves = cell.wait_for_scan(scan + 200);
        assert_eq!((moves.at_rest, moves.last), (0, 0));
    }
    cell.signal_launcher(libc::SIGTERM);
    assert_eq!(cell.finish().status(), 130);
}

#[test]
fn what_is_no_program_file_is_not_loaded() {
    let bench = Bench::patient("xy", &[]);
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for_scan(10);
    let pipe = bench.path().join("pipe.ngc");
    let made = Command::new("mkfifo").arg(&pipe).status().expect("mkfifo");
    assert!(made.success());
    for file in [pipe.as_path(), Path::new("/dev/zero")] {
        let asked = quadrant()
            .arg("load")
            .arg(file)
            .args(["--cell", &cell.cell])
            .output();
        let output = asked.expect("load");
        assert_eq!(output.status.code(), Some(2), "{}", words(&output));
        assert!(
            words(&output).contains("not a regular file"),
            "{}",
            words(&output)
        );
    }
}

/// `nohup quadrant run …`: the terminal goes, the run stays.
#[test]
fn a_hangup_that_was_ignored_at_the_start_stays_ignored() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(5.0, 3000.0, (0.0, 0.0), 0.0));
    let cell = unique_cell();
    let out = bench.path().join("run");
    let mut command = quadrant();
    command
        .arg("run")
        .args([bench.path(), program.as_path()])
        .args(["--pace", "realtime", "--cell", &cell, "--out"])
        .arg(&out)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null());
    // SAFETY: only a system call that may be made between fork and exec.
    unsafe {
        command.pre_exec(|| {
            libc::signal(libc::SIGHUP, libc::SIG_IGN);
            Ok(())
        });
    }
    let mut run = command.spawn().expect("quadrant");
    let page = CellPaths::new(&cell).expect("a name").page();
    let started = Instant::now();
    while !page.exists() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    send(run.id() as i32, libc::SIGHUP);
    assert_eq!(run.wait().expect("the run").code(), Some(0));
}

/// Runs with a limit of the operating system, set by `prlimit`; nothing of the cell is left.
fn limited(limit: &str) -> Output {
    let out = tempfile::tempdir().expect("a folder");
    let cell = unique_cell();
    let output = Command::new("prlimit")
        .current_dir(root())
        .arg(limit)
        .arg(env!("CARGO_BIN_EXE_quadrant"))
        .args(["run", "machines/xy", PROGRAM, "--pace", "lockstep"])
        .args(["--cell", &cell, "--out"])
        .arg(out.path().join("run"))
        .output()
        .expect("prlimit");
    assert!(
        traces_of(&cell).is_empty(),
        "{limit}: {:?}",
        traces_of(&cell)
    );
    output
}

#[test]
fn a_limit_that_is_too_low_for_a_cell_is_named() {
    for (limit, name) in [
        ("--nofile=8:8", "ulimit -n"),
        ("--nofile=32:32", "ulimit -n"),
        ("--nofile=72:72", "ulimit -n"),
        ("--as=32000000", "ulimit -v"),
        ("--as=42000000", "ulimit -v"),
    ] {
        let output = limited(limit);
        let printed = words(&output);
        assert_eq!(output.status.code(), Some(3), "{limit}: {printed}");
        assert!(printed.contains(name), "{limit}: {printed}");
    }
    // Whatever is the first that finds none left; with fewer the system does not begin a program.
    for files in 4..16 {
        let output = limited(&format!("--nofile={files}:{files}"));
        let (printed, status) = (words(&output), output.status.code());
        let begun = status != Some(127) || !printed.contains("shared libraries");
        assert!(!begun || status == Some(3), "{files}: {printed}");
        assert!(
            !begun || printed.contains("ulimit -n"),
            "{files}: {printed}"
        );
    }
    // Files are granted once they are asked for.
    let raised = limited("--nofile=32:4096");
    assert_eq!(raised.status.code(), Some(0), "{}", words(&raised));
}

/// The superuser has no limit of processes: another user has.
#[test]
fn a_limit_of_processes_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path().display();
    let script = format!(
        "set -e
        chmod 755 {at}; cp -r machines/xy {at}/xy; mkdir -m 777 {at}/out; cp $Q {at}/quadrant
        cd {at}
        for most in 1 2 3 4 5 6 8 10 12 14 16; do
            set +e
            prlimit --nproc=$most setpriv --reuid=61234 --regid=61234 --clear-groups \\
                ./quadrant run xy xy/programs/circle-r25-f3000.ngc --pace lockstep --cell few --out out/$most
            echo $most ended with $?
        done"
    );
    let Some(output) = with_shared_memory("100m", &script) else {
        return;
    };
    let printed = words(&output);
    assert!(!printed.contains("panicked"), "{printed}");
    let ended = |status| printed.matches(&format!("ended with {status}\n")).count();
    assert!(ended(3) >= 8, "{printed}");
    assert_eq!(ended(3) + ended(0), 11, "{printed}");
    assert!(printed.contains("ulimit -u"), "{printed}");
}

/// Children of a dead launcher, with others of them dead too: in lockstep nobody waits for who does not answer.
#[test]
fn whoever_of_a_cell_outlives_launcher_and_others_leaves_within_moments() {
    for (others, pace) in [
        ("quadrant servo", "lockstep"),
        ("quadrant plant-sim", "lockstep"),
        ("quadrant plant-sim", "realtime"),
    ] {
        let bench = Bench::patient("xy", &[]);
        let program = bench.file("long.ngc", &long_program());
        let mut cell = LiveCell::start(bench.path(), &program, pace);
        cell.wait_for_scan(100);
        let children = cell.children();
        cell.child.kill().expect("killing the launcher");
        for (pid, _) in children.iter().filter(|(_, line)| line.contains(others)) {
            send(*pid, libc::SIGKILL);
        }
        let since = Instant::now();
        cell.child.wait().expect("reaping it");
        let lives = |pid: i32| {
            let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            let state = stat
                .rsplit_once(')')
                .map(|(_, rest)| rest.trim_start().to_string());
            state.is_some_and(|state| !state.starts_with('Z'))
        };
        while let Some((_, line)) = children.iter().find(|(pid, _)| lives(*pid)) {
            let waited = since.elapsed();
            assert!(
                waited < Duration::from_secs(4),
                "{others}, {pace}: {line} lives"
            );
            std::thread::sleep(Duration::from_millis(5));
        }
        eprintln!(
            "launcher and {others} killed, {pace}: gone after {:?}",
            since.elapsed()
        );
        let _ = quadrant().args(["clean", &cell.cell]).output();
    }
}
