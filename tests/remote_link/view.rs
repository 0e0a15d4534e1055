//! Those who look on, as children of a test.

use std::cell::RefCell;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::{LiveCell, quadrant, send};

const PATIENCE: Duration = Duration::from_secs(60);

/// A host on which something can be started.
pub trait Place {
    /// Starts a command there.
    fn spawn(&self, command: &mut Command) -> Child;
    /// Starts a cell there, in real time.
    fn cell(&self, machine: &Path, program: &Path) -> LiveCell;

    /// Starts a server beside a cell.
    fn serve(&self, cell: &str, listen: &str) -> Ends {
        let mut command = quadrant();
        command.args(["remote", "serve", "--cell", cell, "--listen", listen]);
        let mut child = self.spawn(command.stdout(Stdio::piped()).stderr(Stdio::inherit()));
        let mut line = String::new();
        let out = child.stdout.take().expect("its output");
        let _ = BufReader::new(out).read_line(&mut line);
        let ends = Ends(RefCell::new(child));
        assert!(line.contains("read only"), "the server printed {line:?}");
        ends
    }
}

/// The host that the tests run on.
pub struct ThisHost;

impl Place for ThisHost {
    fn spawn(&self, command: &mut Command) -> Child {
        command.spawn().expect("starting quadrant")
    }

    fn cell(&self, machine: &Path, program: &Path) -> LiveCell {
        LiveCell::start(machine, program, "realtime")
    }
}

/// A child that is ended with its owner.
pub struct Ends(RefCell<Child>);

impl Drop for Ends {
    fn drop(&mut self) {
        let mut child = self.0.borrow_mut();
        send(child.id() as i32, libc::SIGCONT);
        let _ = child.kill();
        let _ = child.wait();
    }
}

/// `quadrant monitor --json` into a file.
pub struct Lines {
    child: Ends,
    file: PathBuf,
}

impl Lines {
    pub fn of(place: &dyn Place, folder: &Path, name: &str, more: &[&str]) -> Lines {
        let file = folder.join(format!("{name}.jsonl"));
        let mut command = quadrant();
        command.args(["monitor", "--json"]).args(more);
        command.stdout(File::create(&file).expect("a file"));
        let child = place.spawn(command.stderr(Stdio::inherit()));
        Lines {
            child: Ends(RefCell::new(child)),
            file,
        }
    }

    /// All lines so far.
    pub fn all(&self) -> Vec<Value> {
        let file = File::open(&self.file).expect("its file");
        let lines = BufReader::new(file).lines().map_while(Result::ok);
        // The last one may not be whole yet.
        lines
            .filter_map(|line| serde_json::from_str(&line).ok())
            .collect()
    }

    pub fn last(&self) -> Value {
        self.all().pop().unwrap_or(Value::Null)
    }

    /// Waits for the first line of which that is true.
    pub fn until(&self, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        let started = Instant::now();
        let already = self.all().len().saturating_sub(20);
        loop {
            if let Some(line) = self
                .all()
                .into_iter()
                .skip(already)
                .find(|line| is_so(line))
            {
                return line;
            }
            let ended = self.child.0.borrow_mut().try_wait().expect("a child");
            assert!(
                started.elapsed() < PATIENCE && ended.is_none(),
                "never: {what} (ended: {ended:?}); the last line: {}",
                self.last()
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn signal(&self, signal: i32) {
        send(self.child.0.borrow().id() as i32, signal);
    }

    /// Waits until it ends by itself.
    pub fn ended(&self) -> ExitStatus {
        let started = Instant::now();
        loop {
            if let Some(status) = self.child.0.borrow_mut().try_wait().expect("a child") {
                return status;
            }
            assert!(started.elapsed() < PATIENCE, "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
