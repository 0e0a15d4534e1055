//! The process that asks the logic of a machine: once in so many periods it hands on what all signals show, and publishes what the logic
//! says. The logic itself is a program of the machine builder, run as its child; it never touches shared memory.

mod program;

use std::path::PathBuf;
use std::time::Duration;

use bus::cell::{CellError, CellPaths};
use bus::member::{Boundaries, Member, MemberError, Pace, Slot};
use bus::port::{Reader, Writer};
use bus::realtime::Priority;
use bus::sample::{
    Feedback, LOGIC_HOLD, LOGIC_INHIBIT, LOGIC_STOP, LOGIC_TRIP, LogicAnswer, Mode, ProgramState,
    Signals, with_bit,
};
use bus::service::SCAN_DEPTH;
use bytemuck::Zeroable;
use machine::settings_file::SettingsFileError;
use machine::{Machine, SetBy};
use quadrant_logic::protocol::{Answer, Hello, PROTOCOL, Question, SignalOfMachine};

use program::{Program, Said};

/// How the process is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// Longest wait for an answer in lockstep.
    pub answer_limit: Duration,
}

/// Why it cannot take part.
#[derive(Debug, thiserror::Error)]
pub enum LogicError {
    /// The cell refuses it.
    #[error(transparent)]
    Member(#[from] MemberError),
    /// The cell refuses a port.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The machine file cannot be read.
    #[error(transparent)]
    File(#[from] SettingsFileError),
    /// The machine has no logic of its own.
    #[error("the machine file has no [logic]")]
    None,
    /// The program of the logic does not begin.
    #[error("the logic does not begin: {0}")]
    Program(String),
}

struct Ports {
    feedback: Reader<Feedback>,
    signals: Option<Reader<Signals>>,
    answers: Writer<LogicAnswer>,
    boundaries: Boundaries,
    last: Option<u64>,
}

/// The logic, as the cell sees it.
struct Asked {
    machine: Machine,
    pace: Pace,
    deadline: Duration,
    answer_limit: Duration,
    folder: PathBuf,
    /// Where the module for Python is.
    modules: PathBuf,
    cell: String,
    program: Option<Program>,
    starts: u32,
    /// Scans in which it was started again.
    restarts: Vec<u64>,
    given_up: bool,
    /// What is published of it.
    said: LogicAnswer,
    /// What signals show; none before they show anything.
    values: Option<Vec<f64>>,
}

/// Asks the logic until the cell ends.
///
/// # Errors
/// [`LogicError`].
pub fn run(options: &Options) -> Result<(), LogicError> {
    let machine = Machine::load(&options.slot.machine)?;
    let settings = machine.logic.clone().ok_or(LogicError::None)?;
    let every = machine.logic_every_scans().ok_or(LogicError::None)?;
    let member = Member::enter(options.slot.clone(), "logic", &machine.shape())?;
    let bus = &member.bus;
    let mut ports = Ports {
        feedback: bus.feedback_reader(SCAN_DEPTH)?,
        signals: bus.signals_reader(SCAN_DEPTH)?,
        answers: bus.logic_writer()?.ok_or(LogicError::None)?,
        boundaries: Boundaries::every(every, options.slot.pace == Pace::Lockstep),
        last: options.slot.after_scan,
    };
    let folder = machine.logic_folder(&options.slot.machine);
    let mut asked = Asked {
        pace: options.slot.pace,
        deadline: Duration::from_secs_f64(settings.deadline_ms * 1e-3),
        answer_limit: options.answer_limit,
        folder: folder.ok_or(LogicError::None)?,
        modules: modules_in(&CellPaths::new(&options.slot.cell)?)?,
        cell: options.slot.cell.clone(),
        program: None,
        starts: options.slot.incarnation.saturating_sub(1),
        restarts: Vec::new(),
        given_up: false,
        said: LogicAnswer {
            incarnation: options.slot.incarnation,
            count: machine.signals.len() as u32,
            ..LogicAnswer::zeroed()
        },
        // A machine without signals has nothing to wait for.
        values: machine.signals.is_empty().then(Vec::new),
        machine,
    };
    asked.start().map_err(LogicError::Program)?;
    let first = asked.program.as_mut();
    let first = first.map(|program| program.await_ready(options.answer_limit, &|| member.ending()));
    match first {
        Some(Err(why)) => return Err(LogicError::Program(why)),
        Some(Ok(false)) if !member.ending() => {
            let why = format!(
                "it has not said that it is ready within {:?}",
                options.answer_limit
            );
            return Err(LogicError::Program(why));
        }
        _ => {}
    }
    member.ready(Priority::Ordinary);
    while cycle(&mut asked, &mut ports, &member) {}
    Ok(())
}

/// The module that a logic in Python imports.
const PYTHON_MODULE: &str = include_str!("../../python/quadrant_logic.py");

/// Puts the module for Python into the cell's folder; where it is.
fn modules_in(place: &CellPaths) -> Result<PathBuf, LogicError> {
    let folder = place.folder().join("python");
    let made = std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(folder.join("quadrant_logic.py"), PYTHON_MODULE));
    let why = |error| LogicError::Program(format!("{}: {error}", folder.display()));
    made.map_err(why)?;
    Ok(folder)
}

/// One question and its answer; false when it is time to leave.
fn cycle(asked: &mut Asked, ports: &mut Ports, member: &Member) -> bool {
    let signal = member.page.planner_signal();
    let Some(feedback) = member.next_feedback(signal, &mut ports.feedback, ports.last) else {
        return false;
    };
    let feedback = *feedback;
    ports.last = Some(feedback.scan);
    if feedback.last == 1 {
        return false;
    }
    if !ports.boundaries.asks(feedback.scan) {
        return true;
    }
    if let Some(signals) = ports
        .signals
        .as_mut()
        .and_then(|reader| reader.newest(feedback.scan))
    {
        asked.values = Some(signals.values().to_vec());
    }
    asked.ask(&feedback, &|| member.ending());
    ports.answers.send(&asked.said);
    member.answered(feedback.scan);
    true
}

impl Asked {
    /// Starts the program of the logic, with nothing set.
    fn start(&mut self) -> Result<(), String> {
        self.starts += 1;
        let settings = self.machine.logic.as_ref().ok_or("there is none")?;
        let period_s =
            self.machine.logic_every_scans().unwrap_or(1) as f64 * self.machine.scan_period_s();
        let signals = self.machine.signals.iter().map(|signal| SignalOfMachine {
            name: signal.name.clone(),
            kind: signal.kind.word().into(),
            unit: signal.unit.clone(),
            logic: signal.from.by == Some(SetBy::Logic),
        });
        let hello = Hello {
            quadrant_logic: PROTOCOL,
            machine: self.machine.name.clone(),
            cell: self.cell.clone(),
            starts: self.starts,
            period_s,
            signals: signals.collect(),
            alarms: self
                .machine
                .alarms
                .iter()
                .map(|alarm| alarm.number)
                .collect(),
        };
        self.said.sets = Default::default();
        self.program = Some(Program::start(
            &settings.command,
            &self.folder,
            &self.modules,
            &hello,
        )?);
        Ok(())
    }

    /// Asks about this scan; what is said of it stands in `said`.
    fn ask(&mut self, feedback: &Feedback, ending: &dyn Fn() -> bool) {
        let scan = feedback.scan;
        self.said.scan = scan;
        self.said.visible_from = scan + 1;
        let answered = self.answer(feedback, ending);
        let is_there = matches!(answered, Ok(true));
        self.said.answers = u32::from(is_there);
        if !is_there {
            self.said.requests = 0;
            self.said.alarms = 0;
        }
        if let Err(why) = answered {
            // Said once: its end is why the next question finds nobody.
            tracing::error!("the logic is lost: {why}");
            self.program = None;
        }
    }

    /// Whether it has answered; false while it is being started.
    fn answer(&mut self, feedback: &Feedback, ending: &dyn Fn() -> bool) -> Result<bool, String> {
        let lockstep = self.pace == Pace::Lockstep;
        if self.program.is_none() {
            if !self.may_start(feedback.scan) {
                return Ok(false);
            }
            self.start()?;
        }
        let Some(program) = &mut self.program else {
            return Ok(false);
        };
        if !program.is_ready() {
            let limit = if lockstep {
                self.answer_limit
            } else {
                Duration::ZERO
            };
            if !program.await_ready(limit, ending)? {
                return Ok(false);
            }
        }
        let Some(values) = self.values.clone() else {
            // There is nothing to ask about yet: it is there, and sets nothing.
            return Ok(true);
        };
        let question = Question {
            scan: feedback.scan,
            time_s: feedback.scan as f64 * self.machine.scan_period_s(),
            mode: Mode::from_wire(feedback.mode)
                .map_or("unknown", Mode::word)
                .into(),
            hold: feedback.hold == 1,
            program: ProgramState::from_wire(feedback.program)
                .map_or("unknown", ProgramState::word)
                .into(),
            run: feedback.run,
            tool: feedback.auxiliary.tool,
            values,
        };
        program.ask(&question)?;
        let limit = if lockstep {
            self.answer_limit
        } else {
            self.deadline
        };
        match program.hear(limit, ending)? {
            Said::Answer(answer) => self.take(&answer, feedback.scan).map(|()| true),
            Said::Nothing => Err(format!(
                "no answer to scan {} within {limit:?}",
                feedback.scan
            )),
            Said::Leaving => Ok(false),
        }
    }

    /// Whether it is started again: as often in a time as the machine file lets any process be.
    fn may_start(&mut self, scan: u64) -> bool {
        let policy = &self.machine.restart;
        let within = (policy.within_s / self.machine.scan_period_s()) as u64;
        self.restarts
            .retain(|then| scan.saturating_sub(*then) < within);
        if self.restarts.len() >= policy.restarts_max as usize {
            if !std::mem::replace(&mut self.given_up, true) {
                tracing::error!("the logic was lost too often: it is not started again for now");
            }
            return false;
        }
        self.given_up = false;
        self.restarts.push(scan);
        true
    }

    /// Takes an answer, if all that it says can be.
    fn take(&mut self, answer: &Answer, scan: u64) -> Result<(), String> {
        if answer.scan != scan {
            return Err(format!("it answers scan {}, asked was {scan}", answer.scan));
        }
        for (name, value) in &answer.set {
            let index = self.machine.signal(name);
            let signal = index.and_then(|index| self.machine.signals.get(index));
            let own = signal.filter(|signal| signal.from.by == Some(SetBy::Logic));
            let (Some(index), Some(signal)) = (index, own) else {
                return Err(format!("it sets {name:?}, which is no signal of the logic"));
            };
            if !signal.kind.can_show(*value) {
                return Err(format!(
                    "it sets {name} to {value}: a {} cannot be that",
                    signal.kind.word()
                ));
            }
            self.said.sets.set(index, true);
            if let Some(slot) = self.said.values.get_mut(index) {
                *slot = *value;
            }
        }
        let mut alarms = 0;
        for number in &answer.alarms {
            let known = self
                .machine
                .alarms
                .iter()
                .position(|alarm| alarm.number == *number);
            let Some(index) = known else {
                return Err(format!(
                    "it raises alarm {number}: the machine file has none of that number"
                ));
            };
            alarms = with_bit(alarms, index, true);
        }
        self.said.alarms = alarms;
        let requests = [
            (answer.hold, LOGIC_HOLD),
            (answer.stop, LOGIC_STOP),
            (answer.inhibit, LOGIC_INHIBIT),
            (answer.trip, LOGIC_TRIP),
        ];
        let asked = requests.into_iter().filter(|(asks, _)| *asks);
        self.said.requests = asked.fold(0, |bits, (_, bit)| bits | bit);
        Ok(())
    }
}
