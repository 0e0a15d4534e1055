//! Runs cells for tests: each with its own name, ended and cleaned up whatever happens.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Once, OnceLock};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::port::Reader;
use bus::sample::Feedback;
use bus::service::Bus;
use bus::signal_page::SignalPage;
use machine::Machine;
use serde_json::Value;
use tempfile::TempDir;

/// Nothing here takes longer, whatever else this PC does.
pub const PATIENCE: Duration = Duration::from_secs(120);
/// The same for the end of a run: beside a busy PC a long one in lockstep takes minutes.
const RUN_PATIENCE: Duration = Duration::from_secs(600);

/// `LATE_LOOKS_MS=1000` lets tests look at their cells so much later, as on a PC that has no time for them. What a test waits for may
/// not be over by then: in lockstep a second is half a minute of the machine.
pub fn look_late() {
    if let Ok(late_ms) = std::env::var("LATE_LOOKS_MS") {
        let late_ms = late_ms.parse().expect("LATE_LOOKS_MS, in ms");
        std::thread::sleep(Duration::from_millis(late_ms));
    }
}

/// The workspace.
pub fn root() -> PathBuf {
    let mut above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let root = above.find(|folder| folder.join("machines").is_dir());
    root.expect("the workspace").to_path_buf()
}

/// A cell name that no other test has.
pub fn unique_cell() -> String {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    format!(
        "t{}-{}",
        std::process::id(),
        NEXT.fetch_add(1, Ordering::Relaxed)
    )
}

/// A drive that waits for commands a second long.
const PATIENT: (&str, &str) = ("watchdog_scans = 50 ", "watchdog_scans = 1000 ");

/// A machine in a folder of its own, made from a shipped one by replacing text in its files.
pub struct Bench {
    pub folder: TempDir,
}

impl Bench {
    /// The shipped machine `name`; `edits` replace text in machine.toml and must match.
    pub fn of(name: &str, edits: &[(&str, &str)]) -> Bench {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let from = root().join("machines").join(name);
        let mut machine = fs::read_to_string(from.join("machine.toml")).expect("machine.toml");
        for (what, by) in edits {
            assert!(
                machine.contains(what),
                "{name}/machine.toml has no {what:?}"
            );
            machine = machine.replace(what, by);
        }
        fs::write(folder.path().join("machine.toml"), machine).expect("writing machine.toml");
        fs::copy(from.join("plant.toml"), folder.path().join("plant.toml")).expect("plant.toml");
        Bench { folder }
    }

    /// The same for real time on a PC that is not made for it, or runs other tests beside: it may give a servo no time for longer
    /// than the shipped machine stands. What happens then is tested elsewhere.
    pub fn patient(name: &str, edits: &[(&str, &str)]) -> Bench {
        let mut all = vec![PATIENT];
        all.extend(edits);
        Bench::of(name, &all)
    }

    /// The same without what was identified of its axes: its reversals with a friction pulse, no torque fed forward.
    pub fn without_model(name: &str, edits: &[(&str, &str)]) -> Bench {
        let bench = Bench::of(name, &[]);
        let file = bench.path().join("machine.toml");
        let text = fs::read_to_string(&file).expect("machine.toml");
        let mut skipping = false;
        let mut kept = String::new();
        for line in text.lines() {
            if line.starts_with('[') {
                skipping = line.starts_with("[axis.model")
                    || line == "[axis.torque_feed_forward]"
                    || line == "[axis.disturbance_observer]"
                    || line == "[axis.adaptation]";
            }
            if !skipping {
                kept += &line.replace("\"contact-force\"", "\"friction-pulse\"");
                kept.push('\n');
            }
        }
        for (what, by) in edits {
            assert!(
                kept.contains(what),
                "{name}/machine.toml has no {what:?} beside its model"
            );
            kept = kept.replace(what, by);
        }
        fs::write(&file, kept).expect("writing machine.toml");
        bench
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes a file beside the machine.
    pub fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path().join(name);
        fs::write(&path, text).expect("writing a file");
        path
    }
}

/// Whether this PC has a Python for logic that is written in it; says so where it has none.
pub fn has_python() -> bool {
    let found = Command::new("python3").arg("--version").output();
    if let Err(error) = &found {
        eprintln!("skipped: python3: {error}");
    }
    found.is_ok()
}

/// The command under test: `quadrant`, in the tests of the lab `quadrant-lab`, which can do all that it can.
pub const QUADRANT: Option<&str> = match option_env!("CARGO_BIN_EXE_quadrant") {
    None => option_env!("CARGO_BIN_EXE_quadrant-lab"),
    quadrant => quadrant,
};

/// The same, as a command.
pub fn quadrant() -> Command {
    let mut command = Command::new(QUADRANT.expect("a command to test"));
    command.current_dir(root()).stdin(Stdio::null());
    hear_hangups();
    command
}

/// Lets what is started from here end at a hangup, even where the tests themselves were started with `nohup`: a signal that is ignored
/// stays so in children, one with a handler does not. Without a closure in each child it can be started without a copy of this process.
fn hear_hangups() {
    extern "C" fn stay(_: libc::c_int) {}
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // SAFETY: plain system calls; the handler does nothing.
        unsafe {
            let mut now: libc::sigaction = std::mem::zeroed();
            libc::sigaction(libc::SIGHUP, std::ptr::null(), &mut now);
            if now.sa_sigaction == libc::SIG_IGN {
                libc::signal(libc::SIGHUP, stay as *const () as libc::sighandler_t);
            }
        }
    });
}

/// What `quadrant plan` prints.
pub fn plan(machine: &Path, program: &Path, options: &[&str]) -> String {
    let output = quadrant()
        .arg("plan")
        .args([machine, program])
        .args(options)
        .output();
    let output = output.expect("plan");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The setpoints that `quadrant plan --csv` writes, a row of numbers for each scan.
pub fn planned(machine: &Path, program: &Path) -> Vec<Vec<f64>> {
    let csv = machine.join("setpoints.csv");
    plan(machine, program, &["--csv", &csv.display().to_string()]);
    let text = std::fs::read_to_string(&csv).expect("the setpoints");
    let number = |column: &str| column.parse().expect("a number");
    let rows = text.lines().skip(1);
    rows.map(|row| row.split(',').map(number).collect())
        .collect()
}

/// A finished run.
pub struct Run {
    pub output: Output,
    pub out: PathBuf,
    pub cell: String,
    _folder: TempDir,
}

impl Run {
    pub fn status(&self) -> i32 {
        self.output.status.code().unwrap_or(-1)
    }

    pub fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
    }

    pub fn report(&self) -> Value {
        let text = fs::read_to_string(self.out.join("report.json"))
            .unwrap_or_else(|e| panic!("no report.json ({e}); stderr:\n{}", self.stderr()));
        serde_json::from_str(&text).expect("report.json is JSON")
    }

    /// The same, of a run that must have ended well.
    pub fn good_report(&self) -> Value {
        assert_eq!(self.status(), 0, "stderr:\n{}", self.stderr());
        self.report()
    }
}

/// A cell that runs; dropping it ends it.
pub struct LiveCell {
    pub child: Child,
    pub cell: String,
    pub out: PathBuf,
    machine: PathBuf,
    folder: Option<TempDir>,
}

impl LiveCell {
    /// Starts `quadrant run` with a cell of its own.
    pub fn start(machine: &Path, program: &Path, pace: &str) -> LiveCell {
        Self::start_with(machine, program, pace, &[])
    }

    /// The same with more arguments.
    pub fn start_with(machine: &Path, program: &Path, pace: &str, more: &[&str]) -> LiveCell {
        Self::start_as(&unique_cell(), machine, program, pace, more)
    }

    /// The same under the name of a cell that has ended.
    pub fn start_as(
        cell: &str,
        machine: &Path,
        program: &Path,
        pace: &str,
        more: &[&str],
    ) -> LiveCell {
        Self::launch(quadrant(), cell, "run", machine, Some(program), pace, more)
    }

    /// Starts `quadrant up` in real time, with a service manager that listens at `socket`.
    pub fn up_told(cell: &str, machine: &Path, socket: &Path, more: &[&str]) -> LiveCell {
        let mut command = quadrant();
        command.env("NOTIFY_SOCKET", socket);
        Self::launch(command, cell, "up", machine, None, "realtime", more)
    }

    /// Starts `quadrant up` with a cell of its own.
    pub fn up(machine: &Path, pace: &str) -> LiveCell {
        Self::up_as(&unique_cell(), machine, pace)
    }

    /// The same with more arguments.
    pub fn up_with(machine: &Path, pace: &str, more: &[&str]) -> LiveCell {
        let cell = unique_cell();
        Self::launch(quadrant(), &cell, "up", machine, None, pace, more)
    }

    /// The same under the name of a cell that has ended.
    pub fn up_as(cell: &str, machine: &Path, pace: &str) -> LiveCell {
        Self::launch(quadrant(), cell, "up", machine, None, pace, &[])
    }

    fn launch(
        mut launcher: Command,
        cell: &str,
        command: &str,
        machine: &Path,
        program: Option<&Path>,
        pace: &str,
        more: &[&str],
    ) -> LiveCell {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cell = cell.to_string();
        let out = folder.path().join("run");
        let child = launcher
            .arg(command)
            .arg(machine)
            .args(program)
            .args(["--pace", pace, "--cell", &cell, "--out"])
            .arg(&out)
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starting quadrant");
        LiveCell {
            child,
            cell,
            out,
            machine: machine.to_path_buf(),
            folder: Some(folder),
        }
    }

    /// A observer's reader of its feedback, once it can be had.
    pub fn feedback(&mut self) -> (Bus, Reader<Feedback>) {
        let machine = Machine::load(&root().join(&self.machine)).expect("the machine file");
        let place = CellPaths::new(&self.cell).expect("a cell name");
        let started = Instant::now();
        loop {
            // Who enters before the launcher has made its page is in the way of it while it cleans up.
            if SignalPage::open(&place).is_ok_and(|page| page.launcher_pid() == self.child.id())
                && let Ok(bus) = Bus::enter(&place, &machine.shape(), "test", false)
                && let Ok(reader) = bus.feedback_reader(1)
            {
                return (bus, reader);
            }
            assert!(
                started.elapsed() < PATIENCE,
                "cell {} does not come up",
                self.cell
            );
            assert!(
                self.child.try_wait().expect("the launcher").is_none(),
                "the launcher ended before its cell was up"
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until the cell's scans have come to `scan`; the feedback seen then.
    pub fn wait_for_scan(&mut self, scan: u64) -> Feedback {
        self.wait_for(|feedback| feedback.scan >= scan)
    }

    /// Waits until some feedback satisfies `reached`.
    pub fn wait_for(&mut self, reached: impl Fn(&Feedback) -> bool) -> Feedback {
        look_late();
        let (_bus, mut reader) = self.feedback();
        let started = Instant::now();
        loop {
            if let Some(feedback) = reader.newest(u64::MAX)
                && reached(&feedback)
            {
                return feedback;
            }
            assert!(started.elapsed() < PATIENCE, "it never came to that");
            if self.child.try_wait().expect("the launcher").is_some() {
                let said = drain(self.child.stderr.take()).join().unwrap_or_default();
                let said = String::from_utf8_lossy(&said);
                panic!("the run ended before it came to that: {said}");
            }
            look_late();
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Process ids and command lines of the launcher's children.
    pub fn children(&self) -> Vec<(i32, String)> {
        children_of(self.child.id())
    }

    /// The process id of the child whose command line has `role` in it.
    pub fn pid_of(&self, role: &str) -> i32 {
        self.children()
            .into_iter()
            .find(|(_, line)| line.contains(role))
            .unwrap_or_else(|| panic!("no child {role:?} among {:?}", self.children()))
            .0
    }

    /// Waits for a child of this role that is not this one.
    pub fn wait_for_another(&self, role: &str, before: i32) {
        let started = Instant::now();
        let others = || {
            self.children()
                .into_iter()
                .filter(|(pid, _)| *pid != before)
        };
        while !others().any(|(_, line)| line.contains(role)) {
            assert!(started.elapsed() < PATIENCE, "no other {role:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub fn signal_launcher(&self, signal: i32) {
        send(self.child.id() as i32, signal);
    }

    /// Waits for the end of the run.
    pub fn finish(mut self) -> Run {
        let started = Instant::now();
        let stdout = drain(self.child.stdout.take());
        let stderr = drain(self.child.stderr.take());
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("the launcher") {
                break status;
            }
            assert!(started.elapsed() < RUN_PATIENCE, "the run does not end");
            std::thread::sleep(Duration::from_millis(5));
        };
        Run {
            output: Output {
                status,
                stdout: stdout.join().unwrap_or_default(),
                stderr: stderr.join().unwrap_or_default(),
            },
            out: self.out.clone(),
            cell: self.cell.clone(),
            _folder: self.folder.take().expect("still there"),
        }
    }
}

/// Process ids and command lines of the children of a process.
pub fn children_of(parent: u32) -> Vec<(i32, String)> {
    let parent = parent.to_string();
    let mut children = Vec::new();
    for entry in fs::read_dir("/proc").expect("/proc").flatten() {
        let Ok(pid) = entry.file_name().to_string_lossy().parse::<i32>() else {
            continue;
        };
        let Ok(stat) = fs::read_to_string(entry.path().join("stat")) else {
            continue;
        };
        let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
        if after_name.split_whitespace().nth(1) == Some(parent.as_str()) {
            let line = fs::read(entry.path().join("cmdline")).unwrap_or_default();
            let line = String::from_utf8_lossy(&line).replace('\0', " ");
            children.push((pid, line));
        }
    }
    children
}

fn drain(pipe: Option<impl std::io::Read + Send + 'static>) -> std::thread::JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            let _ = pipe.read_to_end(&mut bytes);
        }
        bytes
    })
}

impl Drop for LiveCell {
    fn drop(&mut self) {
        for (pid, _) in self.children() {
            send(pid, libc::SIGCONT);
        }
        if let Ok(None) = self.child.try_wait() {
            let children = self.children();
            for (pid, _) in &children {
                send(*pid, libc::SIGKILL);
            }
            let _ = self.child.kill();
            let _ = self.child.wait();
            // What is cleaned while they still live is not all.
            let lives = |pid: &i32| Path::new(&format!("/proc/{pid}")).exists();
            let started = Instant::now();
            while children.iter().any(|(pid, _)| lives(pid)) && started.elapsed() < PATIENCE / 10 {
                std::thread::sleep(Duration::from_millis(2));
            }
            let _ = quadrant().args(["clean", &self.cell]).output();
        }
    }
}

/// Sends a signal to a process that this test started.
pub fn send(pid: i32, signal: i32) {
    // SAFETY: a plain system call.
    unsafe {
        libc::kill(pid, signal);
    }
}

/// Runs a program to its end in lockstep.
pub fn run(machine: impl AsRef<Path>, program: impl AsRef<Path>) -> Run {
    LiveCell::start(machine.as_ref(), program.as_ref(), "lockstep").finish()
}

/// The same with more options.
pub fn run_with(machine: impl AsRef<Path>, program: impl AsRef<Path>, more: &[&str]) -> Run {
    LiveCell::start_with(machine.as_ref(), program.as_ref(), "lockstep", more).finish()
}

/// What of a cell is in shared memory.
pub fn traces_of(cell: &str) -> Vec<String> {
    let mine = [
        format!("quadrant-{cell}"),
        format!("qd-{cell}_"),
        format!("quadrant-{cell}."),
    ];
    fs::read_dir("/dev/shm")
        .expect("/dev/shm")
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| *name == mine[0] || name.starts_with(&mine[1]) || name.starts_with(&mine[2]))
        .collect()
}

/// A number in a report, by its path (`/axes/0/missed_scans`).
pub fn number(report: &Value, pointer: &str) -> f64 {
    report
        .pointer(pointer)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("the report has no number {pointer}"))
}

/// A text in a report.
pub fn text(report: &Value, pointer: &str) -> String {
    report
        .pointer(pointer)
        .and_then(Value::as_str)
        .unwrap_or_else(|| panic!("the report has no text {pointer}"))
        .to_string()
}

/// A program of so many circles that no test is over before it has done to it what it wants.
pub fn long_program() -> String {
    circles_program(20)
}

/// The same for tests that interrupt it in lockstep, where a busy PC may make minutes of machine time before the test comes to its turn.
pub fn endless_program() -> String {
    circles_program(3000)
}

/// The report of the long program on `xy` in lockstep with nobody else in its cell: one run for all tests that compare theirs with it.
pub fn long_alone() -> &'static Value {
    static ALONE: OnceLock<Value> = OnceLock::new();
    ALONE.get_or_init(|| {
        let bench = Bench::of("xy", &[]);
        let program = bench.file("long.ngc", &long_program());
        run(bench.path(), program).good_report()
    })
}

/// So many full circles.
pub fn circles_program(count: usize) -> String {
    let once = circle_program(25.0, 3000.0, (0.0, 0.0), 0.0);
    let turn = once
        .lines()
        .find(|line| line.starts_with("G3"))
        .unwrap_or_default();
    once.replace(
        "M2\n",
        &format!("{}M2\n", format!("{turn}\n").repeat(count)),
    )
}

/// Full circles with a run-in, around a centre, from a start angle: ccw twice, then cw twice.
pub fn circle_program(radius: f64, feed: f64, centre: (f64, f64), start_deg: f64) -> String {
    circles_each_way(2, radius, feed, centre, start_deg)
}

/// The same, so many times ccw, then cw: once shows all that circles do where nothing is measured at steady reversals.
pub fn circles_each_way(
    times: usize,
    radius: f64,
    feed: f64,
    centre: (f64, f64),
    start_deg: f64,
) -> String {
    let angle = start_deg.to_radians();
    let (dx, dy) = (radius * angle.cos(), radius * angle.sin());
    let (x, y) = (centre.0 + dx, centre.1 + dy);
    let turn = |g: &str| format!("{g} X{x:.5} Y{y:.5} I{:.5} J{:.5} F{feed}\n", -dx, -dy);
    format!(
        "G21 G17 G90 G94\nG0 X{x:.5} Y{y:.5}\nG4 P0.2\n{}G4 P0.2\n{}G4 P0.2\nM2\n",
        turn("G3").repeat(times),
        turn("G2").repeat(times)
    )
}

/// The line that `quadrant tune` says of the dead time of the drives; the command is interrupted as soon as it has.
pub fn dead_time_line(tune: &mut Command) -> String {
    use std::io::BufRead as _;
    let printed = tempfile::tempfile().expect("a file");
    let errors = printed.try_clone().expect("a file");
    let mut child = tune
        .stdout(Stdio::piped())
        .stderr(errors)
        .spawn()
        .expect("quadrant tune");
    let out = std::io::BufReader::new(child.stdout.take().expect("a pipe"));
    let mut lines = out.lines().map_while(Result::ok);
    let line = lines.find(|line| line.starts_with("dead time, scans: "));
    let _ = rustix::process::kill_process(
        rustix::process::Pid::from_child(&child),
        rustix::process::Signal::INT,
    );
    let status = child.wait().expect("an end");
    line.unwrap_or_else(|| {
        use std::io::{Read as _, Seek as _};
        let (mut printed, mut text) = (printed, String::new());
        let _ = printed
            .rewind()
            .and_then(|()| printed.read_to_string(&mut text).map(|_| ()));
        panic!("{status}: {text}")
    })
}

/// What such a line says of an axis, in scans.
pub fn dead_time_of(line: &str, axis: &str) -> f64 {
    let (_, found) = line
        .split_once("found ")
        .unwrap_or_else(|| panic!("{line}"));
    let mut each = found.split([',', ':']).map(str::trim);
    let of = each.find_map(|words| words.strip_prefix(axis)?.trim().parse().ok());
    of.unwrap_or_else(|| panic!("no number for {axis}: {line}"))
}

/// Waits until none of these processes lives.
pub fn wait_until_gone(children: &[(i32, String)]) {
    let started = Instant::now();
    for (pid, line) in children {
        while is_alive(*pid) {
            assert!(
                started.elapsed() < Duration::from_secs(60),
                "{line} lives on without its launcher"
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Whether a process lives; a zombie that nobody reaps yet does not.
pub fn is_alive(pid: i32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|stat| {
        !stat
            .rsplit_once(')')
            .is_some_and(|(_, rest)| rest.trim_start().starts_with('Z'))
    })
}
