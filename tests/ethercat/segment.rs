//! A network namespace with a virtual cable, a segment of foreign drives at its one end, and `quadrant` at the other.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::TempDir;

use crate::support::{QUADRANT, root, unique_cell};

/// The end of the cable that machines/xy-ethercat names.
pub const MASTER: &str = "ecat-master";
/// The other one.
pub const DRIVES: &str = "ecat-drives";

/// Segments share two processors: one at a time.
static ONE: Mutex<()> = Mutex::new(());

/// Python with the drives of am-sdk; none, and why, where it is not there.
fn python() -> Option<PathBuf> {
    let named = std::env::var_os("QUADRANT_PYTHON").map(PathBuf::from);
    let own = root().join("target/foreign/bin/python");
    let python = named.unwrap_or_else(|| if own.exists() { own } else { "python3".into() });
    let has = Command::new(&python).args(["-c", "import am_sdk"]).output();
    if has.is_ok_and(|has| has.status.success()) {
        return Some(python);
    }
    let shown = python.display();
    eprintln!("SKIPPED: {shown} lacks the foreign drives: pip install am-sdk==0.2.0");
    None
}

/// What holds the namespace; it ends with the test, whatever becomes of that.
struct Holder {
    child: Child,
    /// What `nsenter` needs to enter it.
    enter: Vec<String>,
}

/// The cable, then one word, then silence until the test closes the pipe.
const CABLE: &str = "ip link add ecat-master type veth peer name ecat-drives && \
    for end in ecat-master ecat-drives; do \
    sysctl -qw net.ipv6.conf.$end.disable_ipv6=1 2>/dev/null; ip link set $end up || exit 1; done && \
    echo ready && exec cat";

impl Holder {
    fn new() -> Option<Holder> {
        for rights in [&[][..], &["--map-root-user"][..]] {
            let child = Command::new("unshare")
                .args(rights)
                .args(["--net", "sh", "-c", CABLE])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::null())
                .spawn();
            let Ok(mut child) = child else {
                break;
            };
            let mut ready = [0; 5];
            let out = child.stdout.as_mut().expect("a pipe");
            if out.read_exact(&mut ready).is_ok() && ready == *b"ready" {
                let mut enter = vec![format!("--target={}", child.id()), "--net".into()];
                if !rights.is_empty() {
                    enter.extend(["--user".into(), "--preserve-credentials".into()]);
                }
                return Some(Holder { child, enter });
            }
            let _ = child.wait();
        }
        eprintln!(
            "SKIPPED: unshare, ip or the right to make a network namespace is missing (Debian: util-linux, iproute2)"
        );
        None
    }
}

impl Drop for Holder {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A namespace in which segments are started, one after the other.
pub struct Network {
    holder: Holder,
    python: PathBuf,
    _alone: MutexGuard<'static, ()>,
}

impl Network {
    /// None, and why it is skipped, where something is missing.
    pub fn new() -> Option<Network> {
        let alone = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        Some(Network {
            python: python()?,
            holder: Holder::new()?,
            _alone: alone,
        })
    }

    /// A command inside.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("nsenter");
        command
            .args(&self.holder.enter)
            // Whatever becomes of the test, nothing is left.
            .args(["--", "setpriv", "--pdeathsig", "KILL", "--"])
            .arg(program)
            .current_dir(root())
            .stdin(Stdio::null());
        command
    }

    /// The same for a segment: one that is busy is looked for in vain, so where it may, it goes before everything else.
    pub fn first_command(&self, priority: &str, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let first = Command::new("chrt").args(["-f", "1", "true"]).output();
        if !first.is_ok_and(|first| first.status.success()) {
            return self.command(program);
        }
        let mut command = self.command("chrt");
        command.args(["-f", priority]).arg(program);
        command
    }

    /// `quadrant` inside.
    pub fn quadrant(&self, arguments: &[&str]) -> Output {
        let mut command = self.command(QUADRANT.expect("quadrant"));
        command.args(arguments).output().expect("running quadrant")
    }

    /// What a server inside answers to GET.
    pub fn get(&self, url: &str) -> String {
        const GET: &str =
            "import sys, urllib.request as r; print(r.urlopen(sys.argv[1]).read().decode())";
        let mut command = self.command(&self.python);
        let output = command.args(["-c", GET, url]).output().expect("python");
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{url}: {errors}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// `ip link set` inside.
    pub fn set_link(&self, arguments: &[&str]) {
        let mut command = self.command("ip");
        let done = command.args(["link", "set"]).args(arguments).status();
        assert!(done.expect("ip").success(), "ip link set {arguments:?}");
    }

    /// Runs a program on a machine in lockstep until it ends.
    pub fn run(&self, machine: &Path, program: &Path) -> Output {
        let out = tempfile::tempdir().expect("a folder");
        let (machine, program) = (machine.to_string_lossy(), program.to_string_lossy());
        let out = out.path().join("run");
        let out = out.to_string_lossy();
        let cell = unique_cell();
        let arguments = ["run", &machine, &program, "--out", &out, "--cell", &cell];
        self.quadrant(&arguments)
    }

    /// Starts a segment with these options of `segment.py`, in lockstep.
    pub fn segment(&self, options: &[&str]) -> Segment {
        self.segment_of("--lockstep", "1", options)
    }

    /// Starts one whose drives run by their own clock.
    pub fn live_segment(&self, options: &[&str]) -> Segment {
        // Before the cell: a drive does not wait for the PC.
        self.segment_of("--clock", "70", options)
    }

    fn segment_of(&self, pace: &str, priority: &str, options: &[&str]) -> Segment {
        let folder = tempfile::tempdir().expect("a folder");
        let record = folder.path().join("record.csv");
        let scripts = root().join("tests/foreign/ethercat");
        let mut child = self
            .first_command(priority, &self.python)
            .current_dir(&scripts)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .args(["segment.py", DRIVES, pace, "--record"])
            .arg(&record)
            .arg("--control")
            .arg(folder.path().join("control"))
            .args(options)
            .stdout(Stdio::piped())
            .spawn()
            .expect("a segment");
        let mut line = String::new();
        let mut out = BufReader::new(child.stdout.take().expect("a pipe"));
        out.read_line(&mut line).expect("a line of the segment");
        assert!(
            line.contains(DRIVES),
            "{options:?}: the segment says {line:?}"
        );
        Segment {
            child: Some(child),
            _printed: out,
            record,
            folder,
        }
    }
}

/// A running segment.
pub struct Segment {
    child: Option<Child>,
    /// What it prints; it ends when nobody can read that any more.
    _printed: BufReader<ChildStdout>,
    record: PathBuf,
    folder: TempDir,
}

/// How many of the drives' steps in a record were made in "operation enabled".
pub fn enabled_steps(record: &str) -> usize {
    record.lines().filter(|row| is_enabled(row)).count()
}

/// What a row of a record says of a drive's statusword.
pub fn is_enabled(row: &str) -> bool {
    /// Operation enabled, of the bits of the state.
    const ENABLED: u32 = 0x27;
    let word = row.split(',').nth(7).and_then(|word| word.parse().ok());
    word.is_some_and(|word: u32| word & 0x6F == ENABLED)
}

impl Segment {
    /// Gives it an order (`control.py`); its answer.
    pub fn order(&self, words: &str) -> String {
        let own = self.folder.path().join("answer");
        let port = UnixDatagram::bind(&own).expect("a port");
        let order = port.send_to(words.as_bytes(), self.folder.path().join("control"));
        order.unwrap_or_else(|error| panic!("{words}: {error}"));
        let mut answer = [0; 65536];
        let length = port.recv(&mut answer).expect("an answer");
        fs::remove_file(own).expect("its port");
        let answer = String::from_utf8_lossy(&answer[..length]).into_owned();
        assert!(!answer.starts_with("error"), "{words}: {answer}");
        answer
    }

    /// Whether its drives have made steps already.
    pub fn is_driven(&self) -> bool {
        fs::metadata(&self.record).is_ok_and(|record| record.len() > 0)
    }

    /// Its record so far.
    pub fn recorded(&self) -> String {
        fs::read_to_string(&self.record).expect("the record")
    }

    /// Ends it; its record, a row for each step of a drive.
    pub fn end(mut self) -> String {
        self.stop();
        fs::read_to_string(&self.record).expect("the record")
    }

    fn stop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let id = rustix::process::Pid::from_child(&child);
            // It closes its record.
            let _ = rustix::process::kill_process(id, rustix::process::Signal::TERM);
            let _ = child.wait();
        }
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        self.stop();
    }
}

/// machines/xy-ethercat in a folder of its own, text of its files replaced; every edit must match.
pub fn machine(machine_edits: &[(&str, &str)], drive_edits: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("drives")).expect("a folder");
    let from = root().join("machines/xy-ethercat");
    for (name, edits) in [
        ("machine.toml", machine_edits),
        ("drives/am-m.toml", drive_edits),
    ] {
        let mut text = fs::read_to_string(from.join(name)).expect("a shipped file");
        for (what, by) in edits {
            assert!(text.contains(what), "{name} has no {what:?}");
            text = text.replace(what, by);
        }
        fs::write(folder.path().join(name), &text).expect("writing");
        if name.starts_with("drives/") {
            // A smaller drive of the same vendor, for machines that name it.
            let text = text.replace("product_code = 3", "product_code = 2");
            fs::write(folder.path().join("drives/am-s.toml"), text).expect("writing");
        }
    }
    folder
}

/// The key of a drive in the shipped machine file.
pub const DRIVE_FILE: &str = "file = \"drives/am-m.toml\"";

/// Writes these keys in place of [`DRIVE_FILE`], axis by axis.
pub fn set_drive_keys(folder: &Path, keys: [&str; 3]) {
    let file = folder.join("machine.toml");
    let text = fs::read_to_string(&file).expect("the machine file");
    let mut parts = text.split(DRIVE_FILE);
    let mut made = parts.next().unwrap_or_default().to_string();
    for (keys, part) in keys.into_iter().zip(parts) {
        made += keys;
        made += part;
    }
    fs::write(&file, made).expect("writing");
}

/// A program that stands for a moment.
pub fn program(folder: &Path) -> PathBuf {
    let path = folder.join("stand.ngc");
    fs::write(&path, "G4 P0.1\nM2\n").expect("writing");
    path
}
