//! One run: what is done to it, and how long everything takes to return.

use std::fs::{self, File};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::service::Shape;
use machine::Machine;

use super::draw::{Draw, What};
use super::look::Eyes;
use super::{Figures, RETURN_LIMIT, pc, slower};
use crate::support::{LiveCell, quadrant, send};

/// Between two looks.
const LOOK: Duration = Duration::from_millis(1);
/// A run that goes on so long after its ending was drawn is ended by a signal.
const ENDING_LIMIT: Duration = Duration::from_millis(1_000);

/// An operator's command.
pub struct Client {
    pub words: Vec<String>,
    child: Child,
    pub asked: Instant,
    /// Newest scan that had been seen then, and when it returned.
    pub scans: (u64, u64),
    pub status: Option<ExitStatus>,
    pub returned: Option<Instant>,
    pub folder: std::path::PathBuf,
}

impl Client {
    /// What it printed.
    pub fn said(&self) -> (String, String) {
        let of = |name| fs::read_to_string(self.folder.join(name)).unwrap_or_default();
        (of("out"), of("err"))
    }

    pub fn is(&self, word: &str) -> bool {
        self.words[0] == word
    }

    pub fn is_accepted(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }
}

/// A member that was killed.
pub struct Killed {
    pub pid: i32,
    pub line: String,
    /// Nothing had been done yet that ends the run, and its scans went on.
    pub amid: bool,
}

impl Killed {
    pub fn is(&self, role: &str) -> bool {
        self.line.contains(&format!("quadrant {role}"))
    }
}

/// A run.
pub struct Trial {
    pub draw: Draw,
    pub live: LiveCell,
    pub eyes: Option<Eyes>,
    place: CellPaths,
    shape: Shape,
    began: Instant,
    script: Vec<String>,
    stopped: Vec<(i32, Instant)>,
    /// When the last process that was stopped went on.
    released: Instant,
    pub clients: Vec<Client>,
    pub killed: Vec<Killed>,
    pub recorder_was_hit: bool,
    pub signals: u32,
    pub launcher_killed: Option<Instant>,
    /// What ends the run, and since when.
    cause: Option<(&'static str, Instant)>,
    /// A stop that was obeyed after this many clients had asked.
    stop_obeyed: Option<usize>,
    pub ended: Option<ExitStatus>,
    pub figures: Figures,
    hangs: bool,
}

/// What /proc says of a process: dead or not.
fn lives(pid: i32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let state = stat.rsplit_once(") ").map(|(_, rest)| &rest[..1]);
    state.is_some_and(|state| state != "Z")
}

impl Trial {
    /// Runs the run of a seed; what came of it.
    pub fn run(seed: u64) -> Figures {
        let draw = Draw::of(seed);
        let live = if draw.stays {
            LiveCell::up(draw.bench.path(), draw.pace)
        } else {
            LiveCell::start(draw.bench.path(), draw.program.as_ref(), draw.pace)
        };
        let mut trial = Trial {
            place: CellPaths::new(&live.cell).expect("a name"),
            shape: Machine::load(draw.bench.path())
                .expect("the machine")
                .shape(),
            draw,
            live,
            eyes: None,
            began: Instant::now(),
            script: Vec::new(),
            stopped: Vec::new(),
            released: Instant::now(),
            clients: Vec::new(),
            killed: Vec::new(),
            recorder_was_hit: false,
            signals: 0,
            launcher_killed: None,
            cause: None,
            stop_obeyed: None,
            ended: None,
            figures: Figures {
                runs: 1,
                ..Figures::default()
            },
            hangs: false,
        };
        trial.go();
        trial.conclude(seed)
    }

    fn go(&mut self) {
        let steps = std::mem::take(&mut self.draw.steps);
        for (pause, what) in steps {
            self.pass(pause);
            self.act(&what);
        }
        let (pause, what) = self.draw.ending.clone();
        self.pass(pause);
        self.await_clients();
        self.act(&what);
        self.pass(ENDING_LIMIT);
        self.await_clients();
        // Whatever it has come to, this ends it.
        if self.goes_on() && !self.is_caused() {
            self.act(&What::Signal(libc::SIGTERM));
        }
        while self.goes_on() {
            self.tick();
        }
        self.await_clients();
    }

    fn is_caused(&self) -> bool {
        self.cause.is_some() || self.launcher_killed.is_some()
    }

    /// The launcher has not ended, nor shown that it never will.
    fn goes_on(&self) -> bool {
        self.ended.is_none() && !self.hangs
    }

    pub fn violated(&mut self, text: &str) {
        let at = self.began.elapsed().as_millis();
        self.figures.violations.push(format!("{at} ms: {text}"));
    }

    fn pass(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until && self.goes_on() {
            self.tick();
        }
    }

    fn await_clients(&mut self) {
        while self.clients.iter().any(|client| client.status.is_none()) {
            self.tick();
        }
    }

    /// Since when something that was caused then has had time to return.
    pub(super) fn had_time_since(&self, cause: Instant) -> Option<Instant> {
        self.stopped.is_empty().then_some(cause.max(self.released))
    }

    /// Whether something takes too long that was caused then.
    pub(super) fn is_overdue(&mut self, cause: Instant) -> bool {
        let Some(since) = self.had_time_since(cause) else {
            return false;
        };
        let took = since.elapsed().saturating_sub(pc::stood_since(since));
        took > RETURN_LIMIT && took > RETURN_LIMIT.mul_f64(slower())
    }

    pub(super) fn returned(&mut self, what: &str, cause: Instant) {
        if let Some(since) = self.had_time_since(cause) {
            self.figures.returned(what, since.elapsed());
            self.figures.late += u64::from(since.elapsed() > RETURN_LIMIT);
        }
    }

    fn tick(&mut self) {
        std::thread::sleep(LOOK);
        self.look();
        self.release();
        self.look_after_clients();
        self.look_after_launcher();
    }

    fn look(&mut self) {
        if self.eyes.is_none() && self.ended.is_none() {
            let launcher = self.live.child.id();
            self.eyes = Eyes::enter(&self.place, &self.shape, launcher);
        }
        let Some(eyes) = &mut self.eyes else { return };
        eyes.look();
        if eyes.is_over() && self.cause.is_none() {
            self.cause = Some(("its last scan", Instant::now()));
        }
    }

    fn release(&mut self) {
        let now = Instant::now();
        let before = self.stopped.len();
        self.stopped.retain(|(pid, until)| {
            if *until <= now {
                send(*pid, libc::SIGCONT);
            }
            *until > now
        });
        if self.stopped.len() < before {
            self.released = now;
        }
    }

    fn look_after_clients(&mut self) {
        let scan = self.eyes.as_ref().map_or(0, Eyes::scan);
        for index in 0..self.clients.len() {
            let client = &mut self.clients[index];
            if client.status.is_some() {
                continue;
            }
            let (asked, what) = (client.asked, client.words.join(" "));
            if let Some(status) = client.child.try_wait().expect("a client") {
                client.status = Some(status);
                client.returned = Some(Instant::now());
                client.scans.1 = scan;
                let word = client.words[0].clone();
                self.returned(&word, asked);
                self.take_answer(index);
            } else if self.is_overdue(asked) {
                let _ = self.clients[index].child.kill();
                let status = self.clients[index].child.wait().expect("a client");
                self.clients[index].status = Some(status);
                self.violated(&format!("{what} does not return"));
            }
        }
    }

    /// What an order that was obeyed means for the end of the run.
    fn take_answer(&mut self, index: usize) {
        let client = &self.clients[index];
        let (code, word) = (
            client.status.and_then(|s| s.code()),
            client.words[0].clone(),
        );
        let line = format!("{} returned {code:?}", client.words.join(" "));
        let accepted = client.is_accepted();
        self.note(&line);
        let brings_on = ["resume", "enable", "start", "jog"].contains(&word.as_str());
        if accepted && word == "stop" && !self.draw.stays {
            // What was asked before it returned may be obeyed after it.
            let open = self.clients.iter().any(|c| c.status.is_none());
            if !open && self.cause.is_none() {
                self.cause = Some(("stop", Instant::now()));
                self.stop_obeyed = Some(self.clients.len());
            }
        }
        if accepted && brings_on && self.stop_obeyed.take().is_some() {
            self.cause = None;
        }
    }

    fn look_after_launcher(&mut self) {
        if self.ended.is_some() {
            return;
        }
        if let Some(status) = self.live.child.try_wait().expect("the launcher") {
            self.ended = Some(status);
            self.note(&format!("the run has ended: {status}"));
            if let Some((what, since)) = self.cause
                && self.launcher_killed.is_none()
            {
                let what = format!("run after {what}");
                self.returned(&what, since);
            }
            if let Some(eyes) = &mut self.eyes {
                eyes.look();
            }
            return;
        }
        let (what, since) = self.cause.unwrap_or(("its start", self.began));
        let came_up = self.eyes.as_ref().is_some_and(|eyes| eyes.newest.is_some());
        if (self.cause.is_some() || !came_up) && self.is_overdue(since) {
            self.hangs = true;
            self.violated(&format!("the run has not returned after {what}"));
        }
    }

    fn note(&mut self, text: &str) {
        let scan = self.eyes.as_ref().map_or(0, Eyes::scan);
        let at = self.began.elapsed().as_millis();
        self.script.push(format!("{at:>6} ms, scan {scan}: {text}"));
    }

    /// Processes of the group.
    fn members(&self) -> Vec<(i32, String)> {
        let mut members = self.live.children();
        members.retain(|(pid, line)| line.contains("--index") && lives(*pid));
        members.sort();
        members
    }

    fn act(&mut self, what: &What) {
        if !self.goes_on() || self.launcher_killed.is_some() {
            return;
        }
        Figures::count(&mut self.figures.done, &what.word());
        match what {
            What::Kill(which) => self.kill(*which),
            What::Stop(which, time) => {
                let members = self.members();
                if !members.is_empty() {
                    let one = members[*which as usize % members.len()].clone();
                    self.stop(&[one], *time);
                }
            }
            What::StopLauncher(time) => {
                let launcher = (self.live.child.id() as i32, "launcher".to_string());
                self.stop(&[launcher], *time);
            }
            What::StopAll(time) => {
                let mut all = vec![(self.live.child.id() as i32, "launcher".to_string())];
                all.extend(self.members());
                self.stop(&all, *time);
            }
            What::Signal(signal) => {
                self.note(&format!("signal {signal}"));
                self.live.signal_launcher(*signal);
                self.signals += 1;
                if self.cause.is_none_or(|(what, _)| what == "stop") {
                    self.cause = Some(("a signal", Instant::now()));
                    self.stop_obeyed = None;
                }
            }
            What::KillLauncher => {
                self.note("the launcher is killed");
                self.live.signal_launcher(libc::SIGKILL);
                self.launcher_killed = Some(Instant::now());
                self.cause = self.launcher_killed.map(|at| ("SIGKILL", at));
            }
            What::Ask(words) => self.ask(words),
            What::AskAndWait(words) => {
                // A cell that is not up yet takes no orders.
                while self.goes_on() && self.eyes.as_ref().is_none_or(|e| e.newest.is_none()) {
                    self.tick();
                }
                self.ask(words);
                self.await_clients();
            }
        }
    }

    fn kill(&mut self, which: u64) {
        let members = self.members();
        if members.is_empty() {
            return;
        }
        let (pid, line) = members[which as usize % members.len()].clone();
        self.note(&format!("kill {pid}: {line}"));
        let up = self.eyes.as_ref().is_some_and(|e| e.newest.is_some());
        self.recorder_was_hit |= line.contains("quadrant recorder");
        self.killed.push(Killed {
            pid,
            amid: up && self.cause.is_none(),
            line: line.clone(),
        });
        send(pid, libc::SIGKILL);
        let ends = !self.draw.stays
            && ((line.contains("quadrant planner") && self.draw.planner == "end")
                || (line.contains("quadrant plant-sim") && self.draw.master == "end"));
        if ends && up && self.cause.is_none() {
            self.cause = Some(("a death", Instant::now()));
        }
    }

    fn stop(&mut self, whom: &[(i32, String)], time: Duration) {
        for (pid, line) in whom {
            self.note(&format!(
                "{pid} is stopped for {} ms: {line}",
                time.as_millis()
            ));
            self.recorder_was_hit |= line.contains("quadrant recorder");
            send(*pid, libc::SIGSTOP);
            self.stopped.push((*pid, Instant::now() + time));
        }
    }

    fn ask(&mut self, words: &[String]) {
        if self.ended.is_some() {
            return;
        }
        self.note(&words.join(" "));
        let folder = self
            .draw
            .bench
            .path()
            .join(format!("client-{}", self.clients.len()));
        fs::create_dir(&folder).expect("a folder");
        let file = |name| Stdio::from(File::create(folder.join(name)).expect("a file"));
        let scan = self.eyes.as_ref().map_or(0, Eyes::scan);
        let child = quadrant()
            .args(words)
            .args(["--cell", &self.live.cell])
            .stdout(file("out"))
            .stderr(file("err"))
            .spawn()
            .expect("a client");
        self.clients.push(Client {
            words: words.to_vec(),
            child,
            asked: Instant::now(),
            scans: (scan, scan),
            status: None,
            returned: None,
            folder,
        });
    }

    /// Judges what was said, and what is left.
    fn conclude(mut self, seed: u64) -> Figures {
        for (pid, _) in std::mem::take(&mut self.stopped) {
            send(pid, libc::SIGCONT);
        }
        let (hangs, killed) = (self.hangs, self.launcher_killed);
        self.judge_clients();
        if killed.is_some() {
            self.judge_killed_launcher();
        } else if !hangs {
            self.judge_end();
        }
        let head = format!(
            "seed {seed}, {} {}, planner {}, servo {}, master {}, monitor {}, standby {:?}, patient {}",
            self.draw.pace,
            if self.draw.stays { "up" } else { "run" },
            self.draw.planner,
            self.draw.servo,
            self.draw.master,
            self.draw.monitor,
            self.draw.standby,
            self.draw.patient
        );
        let mut figures = std::mem::take(&mut self.figures);
        let ending = match (hangs, killed, self.ended) {
            (true, ..) => "hangs".to_string(),
            (_, Some(_), _) => "launcher killed".into(),
            (.., status) => format!("{:?}", status.and_then(|s| s.code())),
        };
        Figures::count(&mut figures.endings, &ending);
        if !figures.violations.is_empty() {
            let violations = std::mem::take(&mut figures.violations).join("\n  ");
            let said = self.all_that_was_said();
            figures.violations.push(format!(
                "{head}\n  {violations}\n{}\n{said}",
                self.script.join("\n")
            ));
        }
        figures
    }

    fn all_that_was_said(&mut self) -> String {
        let mut said = String::new();
        for client in &self.clients {
            let (out, err) = client.said();
            let out: String = out.chars().take(300).collect();
            said += &format!(
                "- {}: {:?} {out} {err}\n",
                client.words.join(" "),
                client.status
            );
        }
        let events = fs::read_to_string(self.live.out.join("events.jsonl")).unwrap_or_default();
        said += &events;
        if self.ended.is_some()
            && let Some(mut stderr) = self.live.child.stderr.take()
        {
            let mut text = String::new();
            let _ = std::io::Read::read_to_string(&mut stderr, &mut text);
            said += &text;
        }
        said
    }
}
