//! A second user of the same PC: neither sees, stops, cleans or hinders the cells of the other, and each is told so.

use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::geteuid;
use tempfile::TempDir;

use crate::support::{
    Bench, LiveCell, circle_program, long_program, quadrant, root, traces_of, unique_cell,
};

/// The second user, `nobody` on most systems.
const OTHER: &str = "65534";
/// What is answered at all is answered by then.
const SOON: Duration = Duration::from_secs(3);

/// An order without `--cell` goes to the only cell of its user: one test at a time is the second user.
static ONE: Mutex<()> = Mutex::new(());

/// The second user, with a copy of the program and a folder of its own.
struct Other {
    folder: TempDir,
    _alone: MutexGuard<'static, ()>,
}

impl Other {
    /// Nothing where this test may not become another user.
    fn new() -> Option<Other> {
        let setpriv = Command::new("setpriv").arg("--version").output();
        if !geteuid().is_root() || setpriv.is_err() {
            eprintln!("SKIPPED: only the superuser, with `setpriv`, can become another user");
            return None;
        }
        let alone = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().expect("a folder");
        fs::set_permissions(folder.path(), Permissions::from_mode(0o777)).expect("opening it");
        let program = folder.path().join("quadrant");
        let original = env!("CARGO_BIN_EXE_quadrant");
        if fs::hard_link(original, &program).is_err() {
            fs::copy(original, &program).expect("a copy of the program");
        }
        let xy = folder.path().join("xy");
        fs::create_dir(&xy).expect("a machine's folder");
        for name in ["machine.toml", "plant.toml"] {
            fs::copy(root().join("machines/xy").join(name), xy.join(name)).expect("a copy");
        }
        Some(Other {
            folder,
            _alone: alone,
        })
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path().join(name);
        fs::write(&path, text).expect("a file");
        path
    }

    /// A program of the second user's.
    fn command(&self, program: &Path) -> Command {
        let mut command = Command::new("setpriv");
        let user = [format!("--reuid={OTHER}"), format!("--regid={OTHER}")];
        command.args(user).arg("--clear-groups").arg(program);
        command.current_dir(self.path()).stdin(Stdio::null());
        command
    }

    /// `quadrant` of the second user's.
    fn quadrant(&self) -> Command {
        self.command(&self.path().join("quadrant"))
    }

    /// Starts a long run of the second user's and waits until it moves.
    fn run(&self, cell: &str) -> Running<'_> {
        let program = self.file("long.ngc", &long_program());
        let child = self
            .quadrant()
            .args(["run", "xy"])
            .arg(program)
            .args(["--cell", cell, "--out", "out"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("a run");
        let running = Running {
            other: self,
            cell: cell.to_string(),
            child: Some(child),
        };
        let since = Instant::now();
        while !running.ask(&["status"]).status.success() {
            assert!(since.elapsed() < 10 * SOON, "it does not come up");
            std::thread::sleep(Duration::from_millis(20));
        }
        running
    }
}

/// A cell of the second user's.
struct Running<'a> {
    other: &'a Other,
    cell: String,
    child: Option<std::process::Child>,
}

impl Running<'_> {
    /// A command of its owner's to it.
    fn ask(&self, command: &[&str]) -> Output {
        let mut asked = self.other.quadrant();
        asked.args(command).args(["--cell", &self.cell]);
        asked.output().expect("a command")
    }

    /// Its owner stops it.
    fn stop(mut self) {
        let stopped = self.ask(&["stop"]);
        assert!(stopped.status.success(), "{}", words(&stopped));
        let child = self.child.take().expect("once only");
        let ended = child.wait_with_output().expect("its end");
        assert_eq!(ended.status.code(), Some(1), "{}", words(&ended));
        assert_eq!(traces_of(&self.cell), Vec::<String>::new());
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            self.ask(&["stop"]);
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn words(output: &Output) -> String {
    let both = [&output.stdout, &output.stderr];
    both.map(|bytes| String::from_utf8_lossy(bytes)).concat()
}

/// Each of these is refused soon, and the reason is whose cell it is.
fn all_refused(command: impl Fn() -> Command, cell: &str, owner: &str) {
    let all: [&[&str]; 9] = [
        &["status", "--cell", cell],
        &["monitor", "--once", "--cell", cell],
        &["stop", "--cell", cell],
        &["hold", "--cell", cell],
        &["down", "--cell", cell],
        &["override", "50%", "--cell", cell],
        &["iceoryx-config", "--cell", cell],
        &["scope", "--signal", "X.position", "--cell", cell],
        &["clean", cell],
    ];
    for arguments in all {
        let asked = Instant::now();
        let refused = command().args(arguments).output().expect("a command");
        let printed = words(&refused);
        assert!(asked.elapsed() < SOON, "{arguments:?}");
        assert!(!refused.status.success(), "{arguments:?}: {printed}");
        let belongs = format!("belongs to user {owner}");
        assert!(printed.contains(&belongs), "{arguments:?}: {printed}");
        assert!(
            !printed.contains("does not run"),
            "{arguments:?}: {printed}"
        );
    }
}

#[test]
fn a_cell_of_another_user_is_said_to_be_his_and_left_alone() {
    let Some(other) = Other::new() else { return };
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(100);
    let name = cell.cell.clone();
    all_refused(|| other.quadrant(), &name, "0");
    let short = other.file("short.ngc", "G1 X1 F600\nM2\n");
    let mut run = other.quadrant();
    run.args(["run", "xy"]).arg(short);
    let run = run
        .args(["--cell", &name, "--out", "no"])
        .output()
        .expect("a run");
    assert_eq!(run.status.code(), Some(3), "{}", words(&run));
    assert!(words(&run).contains("belongs to user 0"), "{}", words(&run));
    let unnamed = other.quadrant().arg("stop").output().expect("a stop");
    assert_eq!(unnamed.status.code(), Some(1), "{}", words(&unnamed));
    let says = words(&unnamed);
    assert!(
        says.contains(&name) && says.contains("under another user"),
        "{says}"
    );
    let stop = quadrant().args(["stop", "--cell", &name]).output();
    assert!(stop.expect("a stop").status.success());
    assert_eq!(cell.finish().status(), 1);
    assert_eq!(traces_of(&name), Vec::<String>::new());
}

/// What the superuser opens there would stay in the way of the cell's owner.
#[test]
fn the_superuser_too_uses_the_cell_of_another_as_that_user_only() {
    let Some(other) = Other::new() else { return };
    let running = other.run(&unique_cell());
    all_refused(quadrant, &running.cell, OTHER);
    for name in traces_of(&running.cell) {
        let found = fs::symlink_metadata(Path::new("/dev/shm").join(&name));
        let user = found.ok().map(|found| found.uid().to_string());
        assert!(user.is_none_or(|user| user == OTHER), "{name}");
    }
    running.stop();
}

#[test]
fn two_users_have_their_cells_side_by_side() {
    let Some(other) = Other::new() else { return };
    let theirs = other.run(&unique_cell());
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut ours = LiveCell::start(bench.path(), &program, "realtime");
    ours.wait_for_scan(100);
    // Whoever names none means the only one of his own.
    let status = other.quadrant().args(["status", "--json"]).output();
    let status = status.expect("a status");
    assert!(status.status.success(), "{}", words(&status));
    assert!(words(&status).contains(&theirs.cell), "{}", words(&status));
    theirs.stop();
    let stop = quadrant().args(["stop", "--cell", &ours.cell]).output();
    assert!(stop.expect("a stop").status.success());
    assert_eq!(ours.finish().status(), 1);
}

/// Files of another user, of names as the cell has: while it runs they change nothing, and at its end what is the cell's own goes.
#[test]
fn a_foreign_file_of_the_cells_name_keeps_nothing_of_its_own_from_being_removed() {
    let Some(other) = Other::new() else { return };
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(100);
    let name = cell.cell.clone();
    let foreign: Vec<String> = (0..8).map(|n| format!("qd-{name}_foreign{n}")).collect();
    let precious = other.file("precious", "mine");
    for (index, file) in foreign.iter().enumerate() {
        let path = Path::new("/dev/shm").join(file);
        if index % 2 == 0 {
            fs::write(&path, "theirs").expect("a file");
        } else {
            symlink(&precious, &path).expect("a link");
        }
        let user = OTHER.parse().ok();
        std::os::unix::fs::lchown(&path, user, user).expect("giving it away");
    }
    // Clients come and go beside them.
    let status = quadrant().args(["status", "--cell", &name]).output();
    let status = status.expect("a status");
    assert!(status.status.success(), "{}", words(&status));
    let run = cell.finish();
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let mut left = traces_of(&name);
    left.sort();
    let again = || {
        let mut again = quadrant();
        again.arg("run").arg(bench.path()).arg(&program);
        again.args(["--pace", "lockstep", "--cell", &name, "--out"]);
        again
            .arg(bench.path().join("again"))
            .output()
            .expect("a run")
    };
    let refused = again();
    let cleaned = quadrant().args(["clean", &name]).output().expect("clean");
    let mut still = traces_of(&name);
    still.sort();
    for file in &foreign {
        fs::remove_file(Path::new("/dev/shm").join(file)).expect("removing it");
    }
    let _ = quadrant().args(["clean", &name]).output();
    assert_eq!(left, foreign, "what the run has left");
    assert_eq!(still, foreign, "after clean and a run that is refused");
    for refused in [refused, cleaned] {
        assert_eq!(refused.status.code(), Some(3), "{}", words(&refused));
        assert!(words(&refused).contains("foreign"), "{}", words(&refused));
        assert!(words(&refused).contains(OTHER), "{}", words(&refused));
    }
    assert_eq!(fs::read_to_string(&precious).expect("still there"), "mine");
    assert_eq!(traces_of(&name), Vec::<String>::new());
}

/// A folder of the cell's name that somebody else has made, and a link to a folder.
#[test]
fn a_foreign_folder_or_link_in_the_cells_place_is_named_and_stays() {
    let Some(other) = Other::new() else { return };
    let name = unique_cell();
    let place = PathBuf::from(format!("/dev/shm/quadrant-{name}"));
    let target = other.path().join("target");
    fs::create_dir(&target).expect("a folder");
    other.file("target/owner.lock", "precious");
    for is_link in [false, true] {
        let made = match is_link {
            true => other
                .command(Path::new("/bin/ln"))
                .arg("-s")
                .arg(&target)
                .arg(&place)
                .status(),
            false => other.command(Path::new("/bin/mkdir")).arg(&place).status(),
        };
        assert!(made.expect("a command").success());
        for arguments in [
            ["status", "--cell", &name].as_slice(),
            &["stop", "--cell", &name],
            &["clean", &name],
        ] {
            let refused = quadrant().args(arguments).output().expect("a command");
            assert!(!refused.status.success(), "{arguments:?}");
            let printed = words(&refused);
            let why = if is_link {
                "is not a folder"
            } else {
                "belongs to user"
            };
            assert!(printed.contains(why), "{arguments:?}: {printed}");
        }
        let metadata = fs::symlink_metadata(&place).expect("still there");
        assert_eq!(metadata.file_type().is_symlink(), is_link);
        let _ = fs::remove_dir(&place).or_else(|_| fs::remove_file(&place));
    }
    let lock = fs::read_to_string(target.join("owner.lock"));
    assert_eq!(lock.expect("still there"), "precious");
}

#[test]
fn the_doctor_looks_at_the_pc_for_another_user_too() {
    let Some(other) = Other::new() else { return };
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(100);
    let output = other
        .quadrant()
        .args(["doctor", "--seconds", "1", "--json"])
        .output();
    let output = output.expect("a doctor");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let must = json["grade"] == "must-be-changed";
    assert_eq!(output.status.code(), Some(if must { 3 } else { 0 }));
    let stop = quadrant().args(["stop", "--cell", &cell.cell]).output();
    assert!(stop.expect("a stop").status.success());
    assert_eq!(cell.finish().status(), 1);
}
