//! Trouble that comes from the PC: its clock is set, it stands still for seconds, it has no memory for somebody, something else takes its
//! processors. The machine goes on, or is stopped with a cause that is named; it can be enabled and moved afterwards, and nothing stays.
//!
//! What is asserted is counted in scans and states, for no PC promises times. (Processes that are stopped for 200 ms: `realtime_faults`;
//! hundreds of troubles, one after the other: `soak`; a disk or shared memory without room: `full_disk`, `shared_memory`.)

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::sample::{Cause, Feedback, Mode};
use lab::soak::freezer::Freezer;

use crate::size;
use crate::support::{
    Bench, LiveCell, circle_program, quadrant, run, send, text, traces_of, unique_cell,
};
use crate::tools::tool;
use crate::up::{ask, down, obeyed, up_on};

/// A lost process is replaced, and waited for.
const REPLACED: (&str, &str) = (
    "[scan]\n",
    "[restart]\nservo = \"wait\"\nmaster = \"wait\"\nrestarts_max = 1000\n\n[scan]\n",
);
/// Time for which the PC stands still, or gives the cell no time.
const STILL: Duration = Duration::from_secs(3);

/// A cell that stays up, with a program that moves.
struct Moving {
    _bench: Bench,
    cell: LiveCell,
    long: String,
}

impl Moving {
    fn new() -> Moving {
        let (bench, cell, _, long) = up_on(Bench::patient("xy", &[REPLACED]), "realtime");
        let mut moving = Moving {
            _bench: bench,
            cell,
            long,
        };
        moving.move_on();
        moving
    }

    fn move_on(&mut self) {
        obeyed(&self.cell, &["enable"]);
        obeyed(&self.cell, &["load", &self.long]);
        obeyed(&self.cell, &["start"]);
        self.cell.wait_for(|f| f.at_rest == 0 && f.tag.element >= 2);
    }

    /// Launcher and all its children.
    fn processes(&self) -> Vec<i32> {
        let children = self.cell.children().into_iter().map(|(pid, _)| pid);
        children.chain([self.cell.child.id() as i32]).collect()
    }

    /// Scans go on; the machine moves on its path, or is stopped with a cause that is named.
    fn goes_on_or_says_why(&mut self, what: &str) -> Feedback {
        let scan = self.cell.wait_for(|_| true).scan;
        let moves = |f: &Feedback| f.mode == Mode::Enabled as u32 && f.at_rest == 0;
        let now = self
            .cell
            .wait_for(|f| f.scan > scan + 300 && (moves(f) || f.cause != Cause::None as u32));
        let status = ask(&self.cell, &["status"]).text;
        let cause = Cause::from_wire(now.cause).unwrap_or_else(|| panic!("{what}: {now:?}"));
        match moves(&now) {
            true => assert!(!now.tag.is_off_path(), "{what}: {status}"),
            false => assert_ne!(cause, Cause::None, "{what}: {status}"),
        }
        println!("{what}: {cause:?}, {}", status.lines().next().unwrap_or(""));
        now
    }

    /// An operator brings it back and moves it, as his manual says.
    fn is_brought_back(&mut self, what: &str) {
        let began = Instant::now();
        loop {
            for order in ["stop", "reset", "enable"] {
                ask(&self.cell, &[order]);
            }
            let scan = self.cell.wait_for(|_| true).scan;
            let now = self.cell.wait_for(|f| f.scan > scan + 20);
            if now.mode == Mode::Ready as u32 {
                break;
            }
            let said = ask(&self.cell, &["status"]).text;
            assert!(began.elapsed() < Duration::from_secs(60), "{what}: {said}");
        }
        let before = self.cell.wait_for(|_| true).axes[0].command_position;
        obeyed(&self.cell, &["jog", "X", "-1", "--wait"]);
        let after = self.cell.wait_for(|_| true).axes[0].command_position;
        assert_eq!(before - after, 1_000_000, "{what}");
    }

    fn end(self) {
        down(self.cell);
    }
}

/// Reads of the wall clock answer with a time that jumps by hours, days and years, every 50 ms.
const JUMPING: &str = r"
#define _GNU_SOURCE
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static long jump_s(void) {
    static const long jumps_s[4] = {0, 3600, -86400, 315360000};
    struct timespec since;
    syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &since);
    return jumps_s[(since.tv_sec * 20 + since.tv_nsec / 50000000) % 4];
}
int clock_gettime(clockid_t clock, struct timespec *now) {
    int done = syscall(SYS_clock_gettime, clock, now);
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI)
        now->tv_sec += jump_s();
    return done;
}
int gettimeofday(struct timeval *now, void *zone) {
    struct timespec time;
    clock_gettime(CLOCK_REALTIME, &time);
    now->tv_sec = time.tv_sec;
    now->tv_usec = time.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *to) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (to)
        *to = now.tv_sec;
    return now.tv_sec;
}
";

/// The library of [`JUMPING`]; none where nothing can make it.
fn jumping(folder: &Path) -> Option<PathBuf> {
    let cc = tool("cc")?;
    let (source, library) = (folder.join("jumping.c"), folder.join("jumping.so"));
    fs::write(&source, JUMPING).expect("written");
    let mut make = Command::new(cc);
    make.args(["-shared", "-fPIC", "-o"])
        .args([&library, &source]);
    let made = make.status().expect("cc");
    assert!(made.success(), "the library");
    // It does what it is for.
    let seen: BTreeSet<String> = (0..12)
        .map(|_| {
            std::thread::sleep(Duration::from_millis(30));
            let year = Command::new("date")
                .arg("+%Y")
                .env("LD_PRELOAD", &library)
                .output();
            String::from_utf8_lossy(&year.expect("date").stdout).into_owned()
        })
        .collect();
    assert!(seen.len() > 1, "the clock does not jump: {seen:?}");
    Some(library)
}

/// As if somebody set the clock of the PC, forwards and backwards, in all processes of the cell and its clients.
#[test]
fn a_wall_clock_that_jumps_changes_no_bit_and_keeps_nobody_waiting() {
    let bench = Bench::patient("xy", &[]);
    let Some(library) = jumping(bench.path()) else {
        return;
    };
    let program = bench.file("circle.ngc", &circle_program(10.0, 3000.0, (0.0, 0.0), 0.0));
    let undisturbed = run(bench.path(), &program).good_report();
    for pace in ["lockstep", "realtime"] {
        let (cell, out) = (unique_cell(), bench.path().join(pace));
        let mut run = quadrant();
        run.env("LD_PRELOAD", &library).arg("run");
        run.args([bench.path(), &program]).args(["--pace", pace]);
        run.args(["--cell", &cell, "--out"]).arg(&out);
        let ended = run.output().expect("a run");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(0), "{pace}: {said}");
        assert_eq!(traces_of(&cell), Vec::<String>::new());
        let report = fs::read_to_string(out.join("report.json")).expect("a report");
        let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        assert_eq!(text(&report, "/outcome/kind"), "completed");
        if pace == "lockstep" {
            for digest in ["/digest", "/motion_digest"] {
                assert_eq!(text(&report, digest), text(&undisturbed, digest));
            }
        }
    }
}

/// By the kernel where it lets this test, else one by one: also those who watch and wait.
fn stand_still(name: &str, pids: &[i32]) {
    let freezer = Freezer::make(&format!("quadrant-{name}"));
    let frozen = freezer.as_ref().map(|freezer| freezer.freeze(pids));
    if let Some(Ok(())) = frozen {
        std::thread::sleep(STILL);
    } else {
        pids.iter().for_each(|pid| send(*pid, libc::SIGSTOP));
        std::thread::sleep(STILL);
        pids.iter().for_each(|pid| send(*pid, libc::SIGCONT));
    }
    let thawed = freezer.map(|freezer| freezer.thaw());
    assert!(thawed.is_none_or(|thawed| thawed.is_ok()), "{frozen:?}");
}

/// A virtual machine that is paused, a laptop that was closed: the cell, its launcher and a client that waits.
#[test]
fn a_pc_that_stands_still_for_3_s_stops_the_machine_at_most_and_everybody_goes_on() {
    let mut moving = Moving::new();
    let mut waits = quadrant();
    waits.args(["monitor", "--json", "--cell", &moving.cell.cell]);
    let mut waits = waits.stdout(Stdio::null()).spawn().expect("a monitor");
    for time in 0..size::number("TIMES", 2, 10) {
        let what = format!("still, time {time}");
        let pids: Vec<i32> = moving
            .processes()
            .into_iter()
            .chain([waits.id() as i32])
            .collect();
        let before = moving.cell.wait_for(|_| true);
        stand_still(&moving.cell.cell, &pids);
        let now = moving.goes_on_or_says_why(&what);
        // Scans that could not be are counted, and never made up for.
        let late = u64::from(now.overrun_scans - before.overrun_scans);
        assert!(late > 1000, "{what}: {late} scans late");
        assert!(is_running(&mut waits), "{what}: who watches goes on");
        moving.is_brought_back(&what);
        moving.move_on();
    }
    send(waits.id() as i32, libc::SIGINT);
    waits.wait().expect("its end");
    moving.end();
}

fn is_running(child: &mut Child) -> bool {
    matches!(child.try_wait(), Ok(None))
}

/// Limits a process to the address space that it has now.
fn limit_memory(pid: i32) {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).expect("its status");
    let line = status.lines().find(|line| line.starts_with("VmSize:"));
    let kb = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok());
    let limit = libc::rlimit {
        rlim_cur: kb.expect("its size") << 10,
        rlim_max: kb.expect("its size") << 10,
    };
    // SAFETY: the limit lives over the call.
    let done = unsafe { libc::prlimit(pid, libc::RLIMIT_AS, &limit, std::ptr::null_mut()) };
    assert_eq!(done, 0, "a limit");
}

/// A control group without memory; dropping it removes it.
struct NoMemory(PathBuf);

impl NoMemory {
    /// None where nobody may make one.
    fn make(name: &str) -> Option<NoMemory> {
        let places = [
            ("/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
            ("/sys/fs/cgroup", "memory.max"),
        ];
        places.into_iter().find_map(|(place, limit)| {
            let folder = Path::new(place).join(name);
            fs::create_dir(&folder).ok()?;
            let group = NoMemory(folder);
            let limited = fs::write(group.0.join(limit), "65536");
            limited.ok().map(|()| group)
        })
    }

    fn take_in(&self, pid: i32) {
        let _ = fs::write(self.0.join("cgroup.procs"), pid.to_string());
    }
}

impl Drop for NoMemory {
    fn drop(&mut self) {
        let since = Instant::now();
        while fs::remove_dir(&self.0).is_err() && since.elapsed() < Duration::from_secs(5) {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

const MASTER: &str = "quadrant plant-sim";
const VICTIMS: [&str; 4] = [
    "quadrant planner",
    "quadrant servo --axis X",
    "quadrant recorder",
    MASTER,
];

/// Another program makes it need memory. A process that finds none ends and is replaced; the machine goes on, or says what it has lost.
#[test]
fn a_process_that_gets_no_memory_any_more_ends_alone_and_is_replaced() {
    let mut moving = Moving::new();
    for victim in VICTIMS.into_iter().filter(|victim| *victim != MASTER) {
        let pid = moving.cell.pid_of(victim);
        limit_memory(pid);
        moving.goes_on_or_says_why(victim);
        moving.is_brought_back(victim);
        // Where the limit was not lost, it is asked for more.
        for words in [&["load", &moving.long][..], &["start"]] {
            ask(&moving.cell, words);
        }
        moving.goes_on_or_says_why(victim);
        send(pid, libc::SIGKILL);
        moving.is_brought_back(victim);
        moving.move_on();
    }
    moving.is_brought_back("the end");
    moving.end();
}

/// Nobody new hears a master that cannot map what is new; those before do, and what is urgent reaches it.
#[test]
fn a_master_that_gets_no_memory_any_more_moves_on_the_path_and_stops_when_it_is_told_to() {
    let mut moving = Moving::new();
    let (_bus, mut feedback) = moving.cell.feedback();
    let mut until = |what: &str, reached: &dyn Fn(&Feedback) -> bool| {
        let since = Instant::now();
        loop {
            match feedback.newest(u64::MAX) {
                Some(now) if reached(&now) => return now,
                _ => assert!(since.elapsed() < Duration::from_secs(60), "{what}"),
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    };
    let before = until("a feedback", &|_| true);
    let master = moving.cell.pid_of(MASTER);
    limit_memory(master);
    ask(&moving.cell, &["status"]);
    let now = until("it goes on", &|f| f.scan > before.scan + 500);
    assert!(now.mode == Mode::Enabled as u32 && !now.tag.is_off_path());
    obeyed(&moving.cell, &["stop"]);
    let rests = until("it rests", &|f| f.at_rest == 1);
    assert!(!rests.tag.is_off_path(), "{rests:?}");
    send(master, libc::SIGKILL);
    moving.goes_on_or_says_why(MASTER);
    moving.is_brought_back(MASTER);
    moving.end();
}

/// The kernel kills a process that wants a page more than its group may have.
#[test]
fn a_process_that_the_kernel_kills_for_its_memory_is_replaced_and_named() {
    for victim in VICTIMS {
        let mut moving = Moving::new();
        let Some(group) = NoMemory::make(&format!("quadrant-{}", moving.cell.cell)) else {
            eprintln!("not tested: a control group for memory needs the right to make one");
            return moving.end();
        };
        let pid = moving.cell.pid_of(victim);
        group.take_in(pid);
        moving.goes_on_or_says_why(victim);
        moving.is_brought_back(victim);
        moving.move_on();
        let lost = moving.cell.pid_of(victim) != pid;
        println!("{victim}: lost {lost}");
        moving.is_brought_back(victim);
        moving.end();
        drop(group);
    }
}

/// Something else that is more urgent takes each processor for so long.
fn take_processors(time: Duration) -> &'static str {
    let count = std::thread::available_parallelism().map_or(1, usize::from);
    let hogs: Vec<_> = (0..count)
        .map(|processor| {
            std::thread::spawn(move || {
                // SAFETY: plain system calls on this thread alone, with arguments that live over them.
                let urgent = unsafe {
                    let mut set: libc::cpu_set_t = std::mem::zeroed();
                    libc::CPU_SET(processor, &mut set);
                    libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &set);
                    let most = libc::sched_param { sched_priority: 99 };
                    libc::sched_setscheduler(0, libc::SCHED_FIFO, &most) == 0
                };
                let since = Instant::now();
                while since.elapsed() < time {
                    std::hint::spin_loop();
                }
                urgent
            })
        })
        .collect();
    let urgent = hogs.into_iter().all(|hog| hog.join().expect("a hog"));
    if urgent { "urgent" } else { "as urgent" }
}

/// It takes the processors of every test beside it too, so it is run alone.
#[test]
fn processors_that_something_more_urgent_takes_for_a_second_stop_the_machine_at_most() {
    if size::is_left_out() {
        return;
    }
    let mut moving = Moving::new();
    for time in 0..size::number("TIMES", 2, 10) {
        let how = take_processors(Duration::from_secs(1));
        let what = format!("{how}, time {time}");
        moving.goes_on_or_says_why(&what);
        moving.is_brought_back(&what);
        moving.move_on();
    }
    moving.is_brought_back("the end");
    moving.end();
}
