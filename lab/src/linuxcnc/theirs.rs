//! LinuxCNC's interpreter, by way of `tests/foreign/rs274/trace.py`.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::linuxcnc::trace::{Circle, Place, Step, Trace, Way};

/// Where the script and its tool table are.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/foreign/rs274")
}

/// The tool table that both read.
pub fn tools() -> PathBuf {
    folder().join("tools.tbl")
}

/// Why the comparison cannot be made here, if so.
pub fn missing() -> Option<String> {
    let has = |command: &str, arguments: &[&str]| {
        let mut command = Command::new(command);
        command
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    let find = "import importlib.util, sys; sys.exit(importlib.util.find_spec('gcode') is None)";
    if !has("/usr/bin/python3", &["-c", find]) {
        return Some(
            "LinuxCNC's interpreter is missing: apt install linuxcnc-uspace (Debian)".into(),
        );
    }
    (!has("c++", &["--version"])).then(|| "a C++ compiler is missing: apt install g++".into())
}

/// A running interpreter, for one program after the other.
pub struct Theirs {
    child: Child,
    /// None once nothing more is asked.
    ask: Option<ChildStdin>,
    answer: BufReader<ChildStdout>,
}

impl Theirs {
    pub fn start() -> Theirs {
        let mut command = Command::new("/usr/bin/python3");
        command
            .arg(folder().join("trace.py"))
            .arg("--tools")
            .arg(tools());
        command.args(["--seconds", "5"]);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("running /usr/bin/python3");
        let ask = child.stdin.take();
        let answer = BufReader::new(child.stdout.take().expect("piped"));
        Theirs { child, ask, answer }
    }

    /// What it makes of a program. A crash of theirs is told, and the next program meets a new process.
    pub fn run(&mut self, file: &Path) -> Trace {
        self.begin(file);
        self.finish()
    }

    /// Hands over a program; [`Theirs::finish`] takes the answer.
    pub fn begin(&mut self, file: &Path) {
        // A process that is gone is noticed when its answer is missing.
        if let Some(ask) = &mut self.ask {
            let _ = writeln!(ask, "{}", file.display());
            let _ = ask.flush();
        }
    }

    pub fn finish(&mut self) -> Trace {
        self.finish_or_crash().0
    }

    /// The answer, and whether theirs crashed over it: what else was handed over is lost then.
    pub fn finish_or_crash(&mut self) -> (Trace, bool) {
        let mut reading = Reading::default();
        let mut line = String::new();
        loop {
            line.clear();
            if self.answer.read_line(&mut line).unwrap_or(0) == 0 {
                let status = self.child.wait();
                *self = Theirs::start();
                return (Err(format!("their interpreter crashed: {status:?}")), true);
            }
            let Ok(Value::Array(command)) = serde_json::from_str(&line) else {
                return (Err(format!("unreadable line {line:?}")), false);
            };
            if let Some(ended) = reading.take(&command) {
                return (ended.map(|()| reading.steps), false);
            }
        }
    }
}

impl Drop for Theirs {
    fn drop(&mut self) {
        // At the end of what is asked it removes its folder; a moment later it is ended.
        drop(self.ask.take());
        for _ in 0..200 {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[derive(Default)]
struct Reading {
    steps: Vec<Step>,
    at: Place,
    speed_rpm: f64,
    /// D of G96, while it is in force.
    surface_limit_rpm: Option<f64>,
    clockwise: bool,
    /// The motion follows the spindle.
    follows: bool,
    /// So far for each of its turns.
    pitch_mm: f64,
    /// A rigid tap is back, which is not told yet.
    tapped: bool,
    /// A thread is cut, during which the feed override does not count: no word of ours.
    threads: bool,
}

/// The word for a spindle that is started.
fn turn(clockwise: bool) -> Step {
    let name = if clockwise {
        "clockwise"
    } else {
        "counter-clockwise"
    };
    Step::word(name, &[])
}

fn number(command: &[Value], index: usize) -> f64 {
    command
        .get(index)
        .and_then(Value::as_f64)
        .unwrap_or(f64::NAN)
}

fn place(command: &[Value], index: usize) -> Place {
    let mut place = [f64::NAN; 9];
    let values = command.get(index).and_then(Value::as_array);
    for (slot, value) in place.iter_mut().zip(values.into_iter().flatten()) {
        *slot = value.as_f64().unwrap_or(f64::NAN);
    }
    place
}

impl Reading {
    /// Takes one line; at the end whether there was an error.
    fn take(&mut self, command: &[Value]) -> Option<Result<(), String>> {
        let name = command.first().and_then(Value::as_str).unwrap_or_default();
        match name {
            "rapid" => self.travel(command, Way::Rapid),
            "feed" => self.travel(command, Way::Feed),
            "probe" => self.travel(command, Way::Probe),
            "arc" => self.arc(command),
            "spline" => {
                let to = place(command, 2);
                self.steps.push(Step::Spline {
                    line: number(command, 1) as u32,
                    to,
                });
                self.at = to;
            }
            "dwell" => self.steps.push(Step::Dwell {
                seconds: number(command, 1),
            }),
            "done" => {
                let status = number(command, 1);
                let wrong = command.get(3).and_then(Value::as_str).unwrap_or_default();
                // We take the end of the file for the end of the program, with a note.
                let good = status < 5.0 || wrong.starts_with("File ended with no percent sign");
                return Some(if good {
                    Ok(())
                } else {
                    Err(format!("line {}: {wrong}", number(command, 2)))
                });
            }
            "g5x" | "g92" | "rotation" | "tool length" => {}
            "orient" => self.steps.push(Step::word(name, &[number(command, 2)])),
            "change tool" => self.steps.push(Step::word(name, &[number(command, 2)])),
            "output" | "analogue output" => {
                let motion = command.get(3).and_then(Value::as_str) == Some("motion");
                let values = [
                    number(command, 1),
                    number(command, 2),
                    f64::from(u8::from(motion)),
                ];
                self.steps.push(Step::word(name, &values));
            }
            "message" | "log" => {
                let text = command.get(1).and_then(Value::as_str).unwrap_or_default();
                let text: Vec<&str> = text.split_whitespace().collect();
                self.steps
                    .push(Step::word(&format!("{name} {}", text.join(" ")), &[]));
            }
            "log file" => {}
            _ => self.spindle_word(name, command),
        }
        None
    }

    /// The spindle, and all words that are their numbers.
    fn spindle_word(&mut self, name: &str, command: &[Value]) {
        match name {
            "speed" => {
                self.speed_rpm = number(command, 2);
                self.steps.push(Step::word("speed", &[self.speed_rpm]));
            }
            "clockwise" | "counter-clockwise" | "spindle stop" => {
                self.clockwise = name == "clockwise";
                self.steps.push(Step::word(name, &[]));
            }
            // G97 says no more than the speed, and G96 the same again no more than that.
            "spindle mode" if number(command, 2) == 0.0 => self.surface_limit_rpm = None,
            "spindle mode" => {
                let limit_rpm = Some(number(command, 2));
                if std::mem::replace(&mut self.surface_limit_rpm, limit_rpm) != limit_rpm {
                    self.steps.push(Step::word(name, &[number(command, 2)]));
                }
            }
            "rigid tap" => self.rigid_tap(number(command, 1) as u32, place(command, 2)),
            "synchronised" => {
                self.follows = true;
                self.pitch_mm = number(command, 2);
                if self.steps.last() == Some(&Step::word("feed override", &[0.0])) {
                    self.threads = true;
                    self.steps.pop();
                }
                self.steps.push(Step::word(name, &[number(command, 2)]));
            }
            "not synchronised" => {
                // Said at the end of every program, too.
                if std::mem::take(&mut self.follows) {
                    self.steps.push(Step::word(name, &[]));
                }
                if std::mem::take(&mut self.tapped) {
                    self.steps.push(turn(self.clockwise));
                }
            }
            "feed override" if self.threads => self.threads = false,
            _ => {
                let values: Vec<f64> = command.iter().skip(1).filter_map(Value::as_f64).collect();
                self.steps.push(Step::word(name, &values));
            }
        }
    }

    /// There, the spindle reversed, and back.
    fn rigid_tap(&mut self, line: u32, bottom: Place) {
        let top = self.at;
        let travel = |from: Place, to: Place| Step::Move {
            way: Way::Feed,
            line,
            from,
            to,
            feed: f64::NAN,
            circle: None,
        };
        self.steps.extend([
            travel(top, bottom),
            Step::word("not synchronised", &[]),
            turn(!self.clockwise),
            Step::word("synchronised", &[self.pitch_mm]),
            travel(bottom, top),
        ]);
        self.tapped = true;
    }

    fn feed(&self, command: &[Value], to: &Place) -> f64 {
        if self.follows {
            return f64::NAN;
        }
        // In revolutions (G95) it is per turn of the spindle.
        let turns = if number(command, 5) == 1.0 {
            self.speed_rpm
        } else {
            1.0
        };
        let slides = [0, 1, 2, 6, 7, 8].iter().any(|&axis: &usize| {
            let of = |place: &Place| place.get(axis).copied().unwrap_or_default();
            (of(to) - of(&self.at)).abs() > 1e-12
        });
        turns * number(command, if slides { 3 } else { 4 })
    }

    fn travel(&mut self, command: &[Value], way: Way) {
        let to = place(command, 2);
        self.steps.push(Step::Move {
            way,
            line: number(command, 1) as u32,
            from: self.at,
            to,
            feed: self.feed(command, &to),
            circle: None,
        });
        self.at = to;
    }

    fn arc(&mut self, command: &[Value]) {
        let (to, centre) = (place(command, 2), place(command, 6));
        let direction = |index: usize| {
            let mut unit = [0.0; 3];
            let values = command.get(index).and_then(Value::as_array);
            for (slot, value) in unit.iter_mut().zip(values.into_iter().flatten()) {
                *slot = value.as_f64().unwrap_or(f64::NAN);
            }
            unit
        };
        let plane = [direction(7), direction(8)];
        let turns = number(command, 9) as i32;
        let polar = |point: &Place| {
            let along = |direction: [f64; 3]| {
                (0..3)
                    .map(|at| (point[at] - centre[at]) * direction[at])
                    .sum::<f64>()
            };
            let [first, second] = plane.map(along);
            (f64::hypot(first, second), f64::atan2(second, first))
        };
        let ((start_mm, start_rad), (end_mm, end_rad)) = (polar(&self.at), polar(&to));
        // As LinuxCNC's canonical interface does it, with 1e-6 rad for the end of a full circle.
        let mut sweep_rad = end_rad - start_rad;
        let full = std::f64::consts::TAU;
        if turns > 0 {
            if sweep_rad <= 1e-6 {
                sweep_rad += full;
            }
            sweep_rad += full * f64::from(turns - 1);
        } else {
            if sweep_rad >= -1e-6 {
                sweep_rad -= full;
            }
            sweep_rad += full * f64::from(turns + 1);
        }
        self.steps.push(Step::Move {
            way: Way::Feed,
            line: number(command, 1) as u32,
            from: self.at,
            to,
            feed: turns_feed(self, command),
            circle: Some(Circle {
                centre,
                plane,
                sweep_rad,
                radii_mm: [start_mm, end_mm],
                others: vec![],
            }),
        });
        self.at = to;
    }
}

/// An arc's feed: always along slides.
fn turns_feed(reading: &Reading, command: &[Value]) -> f64 {
    let turns = if number(command, 5) == 1.0 {
        reading.speed_rpm
    } else {
        1.0
    };
    turns * number(command, 3)
}
