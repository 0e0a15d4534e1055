//! What is done to a run, from its seed.

use std::time::Duration;

use plant_sim::script::rng::Rng;

use crate::size;
use crate::support::{Bench, circle_program};

/// Longest pause between two things that are done, and longest stop of a process, in ms.
const PAUSE_MS: u64 = 500;
const STOP_MS: u64 = 1_300;
/// Things that are done to a run, at most.
const STEPS_MAX: u64 = 6;
/// Longest wait for what a run comes to by itself, in ms.
const ENDING_MS: u64 = 3_000;

/// What is done.
#[derive(Debug, Clone)]
pub enum What {
    /// A member is killed: one of those that are there, by this number.
    Kill(u64),
    /// A member is stopped for a while.
    Stop(u64, Duration),
    /// All of them and the launcher are stopped for a while.
    StopAll(Duration),
    /// The launcher is stopped for a while.
    StopLauncher(Duration),
    /// The launcher is asked to end.
    Signal(i32),
    /// The launcher is killed.
    KillLauncher,
    /// An operator's command.
    Ask(Vec<String>),
    /// An operator's command that is waited for.
    AskAndWait(Vec<String>),
}

impl What {
    /// The word for it.
    pub fn word(&self) -> String {
        match self {
            What::Kill(_) => "kill".into(),
            What::Stop(..) => "stop a process".into(),
            What::StopAll(_) => "stop all".into(),
            What::StopLauncher(_) => "stop launcher".into(),
            What::Signal(signal) => format!("signal {signal}"),
            What::KillLauncher => "kill launcher".into(),
            What::Ask(words) | What::AskAndWait(words) => words[0].clone(),
        }
    }
}

/// A run and what is done to it.
pub struct Draw {
    pub pace: &'static str,
    /// `quadrant up`, not `run`.
    pub stays: bool,
    pub bench: Bench,
    pub program: String,
    /// Words of `[restart]`.
    pub planner: &'static str,
    pub servo: &'static str,
    pub master: &'static str,
    pub monitor: &'static str,
    /// Axes with a standby.
    pub standby: [bool; 2],
    pub patient: bool,
    pub steps: Vec<(Duration, What)>,
    /// What ends it, after so long, unless it has ended before.
    pub ending: (Duration, What),
}

fn words(of: &[&str]) -> Vec<String> {
    of.iter().map(|word| word.to_string()).collect()
}

fn ask(rng: &mut Rng, stays: bool, program: &str) -> Vec<String> {
    let both: [&[&str]; 11] = [
        &["status", "--json"],
        &["status", "--json"],
        &["hold"],
        &["resume"],
        &["resume"],
        &["enable"],
        &["disable"],
        &["override", "70%"],
        &["stop"],
        &["monitor", "--once", "--json"],
        &["jog", "X", "3"],
    ];
    match rng.below(17) {
        11 => words(&["down"]),
        12 if stays => words(&["load", program]),
        13 | 14 if stays => words(&["start"]),
        15 if stays => words(&["reset"]),
        16 if stays => words(&["mdi", "G91 G1 X0.5 F6000"]),
        other => words(both[other as usize % both.len()]),
    }
}

fn step(rng: &mut Rng, stays: bool, program: &str) -> What {
    let which = rng.bits();
    let time = Duration::from_millis(10 + rng.below(STOP_MS));
    match rng.below(40) {
        0..12 => What::Kill(which),
        12..16 => What::Stop(which, time),
        16 => What::StopAll(time),
        17..19 => What::StopLauncher(time),
        19..21 => What::Signal(signal(rng)),
        21 => What::KillLauncher,
        _ => What::Ask(ask(rng, stays, program)),
    }
}

fn signal(rng: &mut Rng) -> i32 {
    let signals = [libc::SIGTERM, libc::SIGINT, libc::SIGHUP];
    *rng.pick(&signals).unwrap_or(&libc::SIGTERM)
}

/// Circles for some 2 s of scans, so often.
fn program(turns: usize) -> String {
    let once = circle_program(4.0, 3000.0, (0.0, 0.0), 0.0);
    let turn = once.lines().find(|line| line.starts_with("G3"));
    let turn = format!("{}\n", turn.unwrap_or_default());
    once.replace("M2\n", &format!("{}M2\n", turn.repeat(turns)))
}

fn bench(rng: &mut Rng, draw: &mut Draw) -> Bench {
    let words = ["resume", "wait", "end"];
    draw.planner = rng.pick(&words).unwrap_or(&"end");
    draw.servo = rng.pick(&words).unwrap_or(&"end");
    draw.master = if rng.one_in(3) { "end" } else { "wait" };
    draw.monitor = if rng.one_in(3) { "leave" } else { "restart" };
    draw.standby = [rng.one_in(2), rng.one_in(2)];
    draw.patient = !rng.one_in(4);
    let restart = format!(
        "[restart]\nplanner = \"{}\"\nservo = \"{}\"\nmaster = \"{}\"\nmonitor = \"{}\"\n\n[scan]\n",
        draw.planner, draw.servo, draw.master, draw.monitor
    );
    let mut edits = vec![("[scan]\n", restart.as_str())];
    for (axis, standby) in [
        ("name = \"X\"\n", "name = \"X\"\nstandby = true\n"),
        ("name = \"Y\"\n", "name = \"Y\"\nstandby = true\n"),
    ]
    .into_iter()
    .zip(draw.standby)
    .filter_map(|(edit, standby)| standby.then_some(edit))
    {
        edits.push((axis, standby));
    }
    if draw.patient {
        edits.push(("watchdog_scans = 50 ", "watchdog_scans = 1000 "));
    }
    Bench::of("xy", &edits)
}

impl Draw {
    /// The run of a seed.
    pub fn of(seed: u64) -> Draw {
        let mut rng = Rng::new(seed);
        let lockstep = seed % 2 == 1;
        let stays = rng.one_in(3) || size::number("UP", 0, 0) == 1;
        let mut draw = Draw {
            pace: if lockstep { "lockstep" } else { "realtime" },
            stays,
            bench: Bench::of("xy", &[]),
            program: String::new(),
            planner: "",
            servo: "",
            master: "",
            monitor: "",
            standby: [false; 2],
            patient: true,
            steps: Vec::new(),
            ending: (Duration::ZERO, What::KillLauncher),
        };
        draw.bench = bench(&mut rng, &mut draw);
        let turns = if lockstep { 40 } else { 0 };
        let file = draw.bench.file("circles.ngc", &program(turns));
        draw.program = file.display().to_string();
        if stays {
            for order in [&["enable"][..], &["load", &draw.program], &["start"]] {
                draw.steps
                    .push((Duration::ZERO, What::AskAndWait(words(order))));
            }
        }
        for _ in 0..1 + rng.below(STEPS_MAX) {
            let pause = Duration::from_micros(rng.below(PAUSE_MS * 1000));
            let what = step(&mut rng, stays, &draw.program);
            // A kill may come while the cell is being started.
            let at = match (stays, rng.one_in(6)) {
                (true, true) => rng.below(draw.steps.len() as u64 + 1) as usize,
                _ => draw.steps.len(),
            };
            draw.steps.insert(at, (pause, what));
        }
        let wait = Duration::from_millis(rng.below(ENDING_MS));
        let ending = match rng.below(10) {
            0..3 => What::Ask(words(&["stop"])),
            3..6 => What::Signal(signal(&mut rng)),
            6..8 => What::Ask(words(&["down"])),
            8 => What::KillLauncher,
            _ => What::Kill(rng.bits()),
        };
        draw.ending = (wait, ending);
        draw
    }
}
