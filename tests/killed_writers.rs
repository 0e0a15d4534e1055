//! Clients that type a block, set an offset or a tool, touch off or tune are killed at every stage: no place, lock or file stays behind, and
//! the same command works at once.
//!
//! `WRITERS=200 cargo test --release --test cell -- killed_writers --nocapture` for so many of each; so in full.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::sample::{Mode, ProgramState};
use machine::Machine;

use crate::monitor_live::terminal;
use crate::size;
use crate::support::{Bench, LiveCell, PATIENCE, quadrant, send, traces_of};
use crate::up::{down, obeyed};
use crate::web::Page;

/// Clients at once: more than have a place in the cell.
const AT_ONCE: usize = 12;

fn writers(default: u64) -> u64 {
    size::number("WRITERS", default, 200)
}

/// Names in a folder, of which nothing is said otherwise.
fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

fn wait_until(what: &str, mut reached: impl FnMut() -> bool) {
    let since = Instant::now();
    while !reached() {
        assert!(since.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A machine that is ready, and whose files of offsets and tools are there.
struct Ready {
    bench: Bench,
    cell: LiveCell,
    /// The folder for temporary files of its clients.
    temporary: tempfile::TempDir,
    /// What of it is in shared memory when no client is there.
    alone: Vec<String>,
}

impl Ready {
    fn new(more: &[&str]) -> Ready {
        let bench = Bench::patient("xy", &[]);
        bench.file("offsets.toml", "[G55]\nX = 0.0\n");
        bench.file("tools.toml", "[T1]\nlength_mm = 0.0\n");
        let cell = LiveCell::up_with(bench.path(), "realtime", more);
        Ready {
            bench,
            cell,
            temporary: tempfile::tempdir().expect("a folder"),
            alone: Vec::new(),
        }
    }

    fn enable(&mut self) {
        self.cell.wait_for(|_| true);
        obeyed(&self.cell, &["enable"]);
        self.cell.wait_for(|now| now.mode == Mode::Ready as u32);
        self.alone = self.traces();
    }

    fn traces(&self) -> Vec<String> {
        let mut traces = traces_of(&self.cell.cell);
        traces.sort();
        traces
    }

    fn client(&self, words: &[String]) -> Child {
        let mut client = quadrant();
        client.args(words).args(["--cell", &self.cell.cell]);
        client.env("TMPDIR", self.temporary.path());
        client.stdout(Stdio::null()).stderr(Stdio::null());
        client.spawn().expect("a client")
    }

    /// How long the command takes that nobody kills.
    fn takes(&mut self, words: &[String]) -> Duration {
        let since = Instant::now();
        let ended = self.client(words).wait().expect("a client");
        assert!(ended.success(), "{words:?}");
        since.elapsed()
    }

    /// Nothing is left of any client: places, room in shared memory, files. Nothing waits for one that is dead.
    fn nothing_is_left(&mut self) {
        // A typed-in block ends without the client that has typed it.
        self.cell.wait_for(|now| {
            let states = [ProgramState::Running, ProgramState::Loading];
            now.mode == Mode::Ready as u32 && !states.map(|of| of as u32).contains(&now.program)
        });
        let mut clients: Vec<Child> = (0..AT_ONCE)
            .map(|_| self.client(&["override".into(), "100%".into()]))
            .collect();
        for client in &mut clients {
            assert!(client.wait().expect("a client").success(), "a place");
        }
        let since = Instant::now();
        loop {
            let mut left = self.traces();
            left.retain(|name| !self.alone.contains(name));
            if left.is_empty() {
                break;
            }
            assert!(since.elapsed() < PATIENCE / 4, "{left:?} stay");
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(names_in(self.temporary.path()), Vec::<String>::new());
        let beside: Vec<String> = names_in(self.bench.path());
        let is_left = |name: &&String| name.ends_with(".new");
        assert_eq!(beside.iter().find(is_left), None, "{beside:?}");
    }

    fn end(self) {
        let left = down(self.cell);
        assert_eq!(left.status(), 0, "{}", left.stderr());
    }
}

/// Several clients of each kind, each at another moment from its start to its end.
#[test]
fn a_client_that_writes_is_killed_at_every_stage_and_the_next_one_writes_at_once() {
    let mut ready = Ready::new(&[]);
    ready.enable();
    let words = |words: &str, value: u64| -> Vec<String> {
        let value = value.to_string();
        words
            .split(' ')
            .map(|word| word.replace('#', &value))
            .collect()
    };
    let count = writers(12);
    for kind in [
        "mdi G91G1X0.00#F6000",
        "offsets set G55 X=#",
        "tool set T1 length_mm=#",
        "zero X --at # --offset G55",
    ] {
        let takes = ready.takes(&words(kind, 1));
        for index in 0..count {
            let mut client = ready.client(&words(kind, 1 + index % 9));
            std::thread::sleep(takes.mul_f64(1.2 * index as f64 / count as f64));
            client.kill().expect("killing a client");
            client.wait().expect("reaping it");
            // Each file is whole at any time.
            Machine::load(ready.bench.path()).expect("offsets and tools");
        }
        if kind.starts_with("mdi") {
            ready.nothing_is_left();
        }
        let last: Vec<String> = words(kind, 7);
        let last: Vec<&str> = last.iter().map(String::as_str).collect();
        obeyed(&ready.cell, &last);
        ready.nothing_is_left();
        println!("{kind}: {count} killed within {:.1?}", takes.mul_f64(1.2));
    }
    let now = Machine::load(ready.bench.path()).expect("a machine");
    let length = now.tools.iter().find(|tool| tool.number == 1);
    assert_eq!(length.expect("T1").offset[2], 7.0);
    ready.end();
}

/// Blocks typed in at the terminal, which set an offset; who has typed them is killed before, while and after they run.
#[test]
fn a_terminal_that_is_killed_over_a_block_which_sets_an_offset_leaves_nothing() {
    let mut ready = Ready::new(&[]);
    ready.enable();
    let count = writers(6);
    for index in 0..count {
        let (mut ours, screen) = terminal();
        let mut view = quadrant()
            .args(["monitor", "--cell", &ready.cell.cell])
            .env("TMPDIR", ready.temporary.path())
            .stdin(screen.try_clone().expect("a descriptor"))
            .stdout(screen.try_clone().expect("a descriptor"))
            .stderr(screen)
            .spawn()
            .expect("the monitor");
        // Sent before it is there: it has them with its first look at its keys.
        let typed = format!(":G10 L2 P2 X{}\r", 1 + index % 9);
        ours.write_all(typed.as_bytes()).expect("keys");
        std::thread::sleep(Duration::from_millis(200 * index / count));
        view.kill().expect("killing it");
        view.wait().expect("reaping it");
        Machine::load(ready.bench.path()).expect("whole files");
    }
    ready.nothing_is_left();
    obeyed(&ready.cell, &["mdi", "G10 L2 P2 X7"]);
    let now = Machine::load(ready.bench.path()).expect("a machine");
    assert_eq!(now.parameters[&5241], 7.0);
    ready.nothing_is_left();
    ready.end();
}

/// Browsers that go away over a touch-off, and a page that is killed over it, as often as one may be replaced.
#[test]
fn browsers_and_a_page_that_go_away_over_a_touch_off_leave_nothing() {
    let mut ready = Ready::new(&["--web=0"]);
    let page = Page::of(&mut ready.cell);
    ready.enable();
    page.frames().next().expect("a frame");
    let zero = r#"{"order":"zero","axis":"X"}"#;
    let (status, said) = page.order(zero);
    assert_eq!(status, 200, "{said}");
    ready.alone = ready.traces();
    let count = writers(12);
    for index in 0..count {
        let asked = page.send_order(zero);
        std::thread::sleep(Duration::from_millis(30 * index / count));
        drop(asked);
        Machine::load(ready.bench.path()).expect("whole files");
    }
    for wait_ms in [0, 10] {
        let asked = page.send_order(zero);
        std::thread::sleep(Duration::from_millis(wait_ms));
        send(ready.cell.pid_of(" web "), libc::SIGKILL);
        drop(asked);
        page.frames().next().expect("a frame of the next page");
    }
    wait_until("the page gives the order", || page.order(zero).0 == 200);
    // The page that is there now has segments of its own.
    let count = ready.alone.len();
    wait_until("segments of dead pages stay", || {
        ready.traces().len() <= count
    });
    ready.alone = ready.traces();
    ready.nothing_is_left();
    ready.end();
}

/// Processes of a cell, by its name in their command lines.
fn processes_of(cell: &str) -> Vec<String> {
    let processes = fs::read_dir("/proc").expect("/proc").flatten();
    let lines = processes.filter_map(|entry| fs::read(entry.path().join("cmdline")).ok());
    let lines = lines.map(|line| String::from_utf8_lossy(&line).replace('\0', " "));
    lines
        .filter(|line| line.contains(&format!(" --cell {cell} ")))
        .collect()
}

/// A command that tunes, with its temporary files in this folder.
fn tune(machine: &Path, temporary: &Path) -> Command {
    let mut tune = quadrant();
    tune.arg("tune").arg(machine).args(["--circles", "25:3000"]);
    tune.env("TMPDIR", temporary);
    tune.stdout(Stdio::null()).stderr(Stdio::null());
    tune
}

/// Its folder, its cell and the processes of that: before, while and between test motions.
#[test]
fn a_tune_is_killed_at_every_stage_and_nothing_runs_on_or_stays() {
    let bench = Bench::of("xy", &[]);
    let temporary = tempfile::tempdir().expect("a folder");
    let files = names_in(bench.path());
    let text = |name: &str| fs::read_to_string(bench.path().join(name)).expect("a file");
    let machine = text("machine.toml");
    let count = writers(8);
    for index in 0..count {
        let mut child = tune(bench.path(), temporary.path()).spawn().expect("tune");
        std::thread::sleep(Duration::from_millis(1500 * index / count));
        child.kill().expect("killing it");
        child.wait().expect("reaping it");
        let cell = format!("tune-{}", child.id());
        wait_until("its cell runs on", || processes_of(&cell).is_empty());
        assert_eq!(traces_of(&cell), Vec::<String>::new(), "after {index}");
    }
    assert_eq!(names_in(bench.path()), files);
    assert_eq!(text("machine.toml"), machine);
    // The next one removes the folders that the killed ones had, and its own; none of one that tunes beside it.
    let left = names_in(temporary.path());
    assert!(!left.is_empty(), "none was killed over its folder");
    let beside = tune(bench.path(), temporary.path()).spawn();
    let mut beside = beside.expect("tune");
    let folders = |temporary: &Path| -> Vec<PathBuf> {
        let names = names_in(temporary).into_iter();
        let all = names.map(|name| temporary.join(name));
        all.filter(|folder| folder.join("machine.toml").exists())
            .collect()
    };
    wait_until("folders of killed ones stay", || {
        let names = names_in(temporary.path());
        names.len() == 1 && names != left && folders(temporary.path()).len() == 1
    });
    let own = folders(temporary.path());
    let mut other = tune(bench.path(), temporary.path()).spawn().expect("tune");
    wait_until("two folders", || folders(temporary.path()).len() == 2);
    send(other.id() as i32, libc::SIGINT);
    assert_eq!(other.wait().expect("its end").code(), Some(130));
    assert_eq!(folders(temporary.path()), own, "who tunes keeps his own");
    send(beside.id() as i32, libc::SIGINT);
    assert_eq!(beside.wait().expect("its end").code(), Some(130));
    assert_eq!(names_in(temporary.path()), Vec::<String>::new());
    assert_eq!(names_in(bench.path()), files);
}
