//! The master's side: it starts the others, hands over, and waits for all of them.

use std::process::Child;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use bus::cell::CellPaths;
use bus::member;
use bus::patience::Patience;
use bus::port::{Reader, Writer};
use bus::realtime;
use bus::sample::{AxisCommand, Feedback};
use bus::service::{Bus, SCAN_DEPTH, Shape};
use bus::signal_page::SignalPage;
use bytemuck::Zeroable;
use hdrhistogram::Histogram;
use rustix::process::{Pid, Signal, kill_process};

use super::bare::BareMaster;
use super::pipes::Pipes;
use crate::options::Ball;
use crate::processor_time;
use console::child;
use console::exit::{Failure, Kind, Outcome};
use console::signals::Signals;

/// How often either side looks whether the other is there, and for an interruption.
pub(super) const LOOK_EVERY: Duration = Duration::from_millis(10);
/// How often this side looks whether the others are ready.
const START_LOOK: Duration = Duration::from_millis(2);
/// Longest time another process that was in the cell may take to leave.
const CLEAN_PATIENCE: Duration = Duration::from_secs(1);
/// Scans of a pipe between two looks for an interruption.
const PIPE_SCANS: u32 = 1000;
/// Scans that do not count: ports connect in the first, and processors wake.
const WARM_UP_SCANS: u32 = 200;
/// Longest time that is told from a longer one, in ns.
const LONGEST_NS: u64 = 10_000_000_000;

/// What is played.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Game<'a> {
    /// Servos.
    pub axes: usize,
    /// What is handed over.
    pub ball: Ball,
    /// The processor of the master, then the processors of the servos in turn; one alone is for all.
    pub cores: &'a [usize],
    /// Whether processes wait awake at first, as in lockstep, or asleep, as in realtime.
    pub awake: bool,
    /// Scans that are measured.
    pub scans: u32,
}

/// How it went.
#[derive(Debug, Clone)]
pub(crate) struct Played {
    /// Each scan, in ns.
    scans_ns: Histogram<u64>,
    /// Wall time of all of them, in s.
    wall_s: f64,
    /// Processor time of this side and of the others, in s.
    processor_s: (f64, f64),
}

impl Played {
    /// Takes another round of the same.
    ///
    /// # Errors
    /// Its times do not fit.
    pub fn join(&mut self, other: &Played) -> anyhow::Result<()> {
        self.scans_ns.add(&other.scans_ns)?;
        self.wall_s += other.wall_s;
        self.processor_s.0 += other.processor_s.0;
        self.processor_s.1 += other.processor_s.1;
        Ok(())
    }

    /// That share of the scans took no longer, in µs.
    pub fn us_at(&self, share: f64) -> f64 {
        self.scans_ns.value_at_quantile(share) as f64 * 1e-3
    }

    /// The longest, in µs.
    pub fn us_max(&self) -> f64 {
        self.scans_ns.max() as f64 * 1e-3
    }

    fn per_scan_us(&self, seconds: f64) -> f64 {
        seconds * 1e6 / self.scans_ns.len().max(1) as f64
    }

    /// Wall time of a scan in the mean, in µs.
    pub fn mean_us(&self) -> f64 {
        self.per_scan_us(self.wall_s)
    }

    /// Processor time of all processes per scan, in µs.
    pub fn processor_us(&self) -> f64 {
        self.per_scan_us(self.processor_s.0 + self.processor_s.1)
    }

    /// The same of the master alone.
    pub fn master_us(&self) -> f64 {
        self.per_scan_us(self.processor_s.0)
    }
}

/// The cell of a game has these axes, and nothing else of a machine.
pub(super) fn shape(axes: usize) -> Shape {
    Shape {
        axes: (0..axes).map(|axis| format!("a{axis}")).collect(),
        period_scans: 8,
        has_bus: false,
        has_signals: false,
        has_logic: false,
    }
}

/// How a process of the game waits.
pub(super) fn patience(awake: bool) -> Patience {
    Patience::new(match awake {
        true => member::AWAKE,
        false => Duration::ZERO,
    })
}

/// The core of a servo.
fn core_of(cores: &[usize], axis: usize) -> usize {
    let others = cores.get(1..).filter(|others| !others.is_empty());
    let all = others.unwrap_or(cores);
    all.get(axis % all.len().max(1)).copied().unwrap_or(0)
}

impl Game<'_> {
    /// Plays it.
    ///
    /// # Errors
    /// The others cannot be started, or one of them ends.
    pub fn play(&self, signals: &Signals) -> Result<Played, Failure> {
        let place = CellPaths::new(&format!("pong-{}", std::process::id())).environment()?;
        let mut others = Others {
            all: Vec::new(),
            signals,
        };
        let before = realtime::processors();
        let played = self.play_with(&mut others, &place);
        realtime::stay_on_all(&before);
        if !others.end() {
            // What it has left goes.
            place.own(CLEAN_PATIENCE).environment()?;
        }
        played
    }

    fn play_with(&self, others: &mut Others<'_>, place: &CellPaths) -> Result<Played, Failure> {
        for axis in 0..self.axes {
            let core = core_of(self.cores, axis).to_string();
            let ball = clap::ValueEnum::to_possible_value(&self.ball);
            let ball = ball.context("a ball without a name").environment()?;
            let mut command = child::command("bench-pong");
            command
                .args(["--cell", place.name(), "--core", &core])
                .args(["--axes", &self.axes.to_string()])
                .args(["--axis", &axis.to_string()])
                .args(["--ball", ball.get_name()]);
            if self.awake {
                command.arg("--awake");
            }
            if self.ball == Ball::Pipe {
                command
                    .stdin(std::process::Stdio::piped())
                    .stdout(std::process::Stdio::piped());
            }
            let child = command.spawn().context("starting the other side");
            others.all.push(child.environment()?);
        }
        let core = self.cores.first().copied().unwrap_or(0);
        if self.ball == Ball::Pipe {
            let mut pipes = Pipes::of(&mut others.all).environment()?;
            realtime::stay_on_all(&[core]);
            return self.count(others, |others, scan| {
                if scan.is_multiple_of(PIPE_SCANS) {
                    others.look()?;
                }
                pipes.round_trip().environment()
            });
        }
        let page = others.ready(place)?;
        let mut ports = Ports::open(place, self).environment()?;
        realtime::stay_on_all(&[core]);
        let patience = patience(self.awake);
        self.count(others, |others, scan| {
            let seen = page.master_signal().count();
            page.expect_answers(self.axes as u32);
            ports.send(scan);
            page.scan_signal().raise();
            let is_answered = || page.master_signal().count() != seen;
            while !patience.try_for(is_answered) && !is_answered() {
                page.master_signal().wait(seen, LOOK_EVERY);
                if page.master_signal().count() == seen {
                    others.look()?;
                }
            }
            ports.receive().environment()
        })
    }

    /// Measures all scans.
    fn count(
        &self,
        others: &mut Others<'_>,
        mut scan: impl FnMut(&mut Others<'_>, u32) -> Outcome,
    ) -> Result<Played, Failure> {
        let mut scans_ns = Histogram::new_with_max(LONGEST_NS, 3).environment()?;
        for number in 0..WARM_UP_SCANS {
            scan(others, number)?;
        }
        let before = (processor_time::of_thread_s(), others.processor_s());
        let started = Instant::now();
        let mut began = started;
        for number in 0..self.scans {
            scan(others, WARM_UP_SCANS + number)?;
            let now = Instant::now();
            scans_ns.saturating_record((now - began).as_nanos() as u64);
            began = now;
        }
        let wall_s = started.elapsed().as_secs_f64();
        let after = (processor_time::of_thread_s(), others.processor_s());
        Ok(Played {
            scans_ns,
            wall_s,
            processor_s: (after.0 - before.0, after.1 - before.1),
        })
    }
}

/// The processes of the servos.
struct Others<'a> {
    all: Vec<Child>,
    signals: &'a Signals,
}

impl Others<'_> {
    /// Waits until each has said that it is there.
    fn ready(&mut self, place: &CellPaths) -> Result<SignalPage, Failure> {
        loop {
            if let Ok(page) = SignalPage::open(place)
                && (0..self.all.len()).all(|axis| page.ready_incarnation(axis) == 1)
            {
                return Ok(page);
            }
            self.look()?;
            std::thread::sleep(START_LOOK);
        }
    }

    /// Whether they are all there, and nobody interrupts.
    fn look(&mut self) -> Outcome {
        if self.signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        for child in &mut self.all {
            if let Some(status) = child.try_wait().environment()? {
                return Err(anyhow!("the other side ended with {status}")).environment();
            }
        }
        Ok(())
    }

    fn processor_s(&self) -> f64 {
        let times = self.all.iter();
        times
            .filter_map(|child| processor_time::of_living_threads_s(child.id()))
            .sum()
    }

    /// Ends the processes, the one of the first axis last: it owns the cell. Whether all ended well.
    fn end(&mut self) -> bool {
        let mut well = true;
        for child in self.all.iter_mut().rev() {
            // Of one that waits at a pipe.
            drop(child.stdin.take());
            let _ = kill_process(Pid::from_child(child), Signal::TERM);
            well &= child.wait().is_ok_and(|status| status.success());
        }
        well
    }
}

/// What this side sends and receives beside the ring.
enum Ports {
    None,
    Samples(Box<SamplePorts>),
    Bare(Box<BareMaster>),
}

struct SamplePorts {
    _bus: Bus,
    feedback: Feedback,
    out: Writer<Feedback>,
    commands: Vec<Reader<AxisCommand>>,
}

impl Ports {
    fn open(place: &CellPaths, game: &Game<'_>) -> anyhow::Result<Ports> {
        match game.ball {
            Ball::Ring | Ball::Pipe => Ok(Ports::None),
            Ball::Bare => Ok(Ports::Bare(Box::new(BareMaster::open(place, game.axes)?))),
            Ball::Sample => {
                let bus = Bus::enter(place, &shape(game.axes), "ping", false)?;
                let commands = (0..game.axes)
                    .map(|axis| bus.command_reader(axis, 0, SCAN_DEPTH))
                    .collect::<Result<_, _>>()?;
                Ok(Ports::Samples(Box::new(SamplePorts {
                    out: bus.feedback_writer()?,
                    commands,
                    feedback: Feedback {
                        axis_count: game.axes as u32,
                        ..Feedback::zeroed()
                    },
                    _bus: bus,
                })))
            }
        }
    }

    fn send(&mut self, scan: u32) {
        match self {
            Ports::None => {}
            Ports::Samples(ports) => {
                ports.feedback.scan = scan.into();
                ports.feedback.visible_from = ports.feedback.scan;
                ports.out.send(&ports.feedback);
            }
            Ports::Bare(bare) => bare.send(scan),
        }
    }

    fn receive(&mut self) -> anyhow::Result<()> {
        let all_sent = match self {
            Ports::None => true,
            Ports::Samples(ports) => ports
                .commands
                .iter_mut()
                .all(|command| std::hint::black_box(command.any()).is_some()),
            Ports::Bare(bare) => bare.receive(),
        };
        match all_sent {
            true => Ok(()),
            false => Err(anyhow!("the other side sent nothing")),
        }
    }
}
