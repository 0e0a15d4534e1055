//! What happens between the elements of a program's path, as the master is asked for it: numbered, each at the element that comes
//! after it. A pure function of program and machine, so every planner of a run numbers alike.

use std::collections::VecDeque;

use bus::messages::ProgramMessage;
use bus::sample::{
    ANALOG_OUTPUTS, DIGITAL_OUTPUTS, EventCode, OUTPUTS_AHEAD, PROBE_AWAY, PROBE_MUST, ProgramEvent,
};
use machine::{Machine, Spindle};
use path::geometry::{Element, Feed, Path};
use path::window::WindowPlanner;
use program::{Event, EventKind, Message, Program, ProgramEnd, SurfaceSpeed};

use crate::course::window_planner;
use crate::error::{CourseError, EventError};
use crate::in_step::{Pass, Steps};
use crate::messages::{Messages, WAITING_MAX};

#[derive(Debug, Clone, Copy, PartialEq)]
struct Planned {
    event: ProgramEvent,
    /// Q of a user M-code.
    second: f64,
    /// Done in motion; the others are done at rest.
    in_motion: bool,
}

/// The events of a program in the order in which they are done, as far as it is read.
#[derive(Debug, Clone, Default)]
pub struct Events {
    spindle: Option<Spindle>,
    /// X among the axes.
    x_axis: Option<usize>,
    /// Parameters are kept at the end.
    keeps_parameters: bool,
    /// Read, and done before an element that is not read yet.
    waiting: Vec<Planned>,
    spindle_ahead: SpindleAhead,
    /// Messages that are read, each behind so many of those that wait.
    said: VecDeque<(usize, ProgramMessage)>,
    /// Those that the path has still to come to.
    pub messages: Messages,
    /// Those that are not known to be done.
    planned: VecDeque<Planned>,
    /// Number of the last one.
    last: u32,
    /// Numbers and elements of those that are done at rest.
    stops: VecDeque<(u32, u32)>,
    /// Elements that are not read yet and rest before they begin: a question, or its end, comes before them.
    rests_at: Vec<u32>,
    /// The question that was read last: its number, and whether it is a probe's.
    pub question: Option<(u32, bool)>,
    /// The element that the last probe ended in that is done.
    pub probed: Option<u32>,
    /// Some of them were let go: for another run they are read again.
    forgotten: bool,
    /// What is in step with the spindle.
    steps: Steps,
    /// What is travelled in step with the spindle, in order.
    pub passes: VecDeque<Pass>,
}

/// What the events of the elements ahead depend on, where none waits for its element.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EventsBehind {
    /// Number of the last event.
    pub last: u32,
    /// Whether the spindle has been told to turn.
    pub spindle_turns: bool,
    /// Whether its speed follows the radius.
    pub spindle_by_radius: bool,
    /// Line in which it was given a speed or direction that no feed has waited for; 0 for none.
    pub spindle_changed_in_line: u32,
    /// How many messages there were.
    pub messages: u32,
}

/// What an event is on the wire; none if the master has no part in it.
fn wire(kind: &EventKind) -> Option<(EventCode, u32, f64, bool)> {
    let switch = |on: bool| f64::from(u8::from(on));
    Some(match *kind {
        EventKind::SpindleSpeedRpm(rpm) => (EventCode::SpindleSpeed, 0, rpm, false),
        EventKind::SpindleClockwise => (EventCode::SpindleClockwise, 0, 0.0, false),
        EventKind::SpindleCounterClockwise => (EventCode::SpindleCounterClockwise, 0, 0.0, false),
        EventKind::SpindleStop => (EventCode::SpindleStop, 0, 0.0, false),
        EventKind::SpindleOrient(degrees) => (EventCode::SpindleOrient, 0, degrees, false),
        EventKind::Mist(on) => (EventCode::Mist, 0, switch(on), false),
        EventKind::Flood(on) => (EventCode::Flood, 0, switch(on), false),
        EventKind::ToolPrepare(tool) => (EventCode::ToolPrepare, tool, 0.0, false),
        EventKind::ToolChange(tool) => (EventCode::ToolChange, tool, 0.0, false),
        EventKind::OptionalStop => (EventCode::OptionalStop, 0, 0.0, false),
        EventKind::ProgramStop => (EventCode::ProgramStop, 0, 0.0, false),
        EventKind::PalletStop => (EventCode::PalletStop, 0, 0.0, false),
        EventKind::DigitalOutput {
            index,
            on,
            synchronised,
        } => (EventCode::DigitalOutput, index, switch(on), synchronised),
        EventKind::AnalogOutput {
            index,
            value,
            synchronised,
        } => (EventCode::AnalogOutput, index, value, synchronised),
        EventKind::UserCode { code, p, .. } => (EventCode::UserCode, code, p, false),
        EventKind::OverridesEnabled(on) => (EventCode::Overrides, 0, switch(on), false),
        EventKind::SpindleCoupled(mm_per_turn) => (EventCode::SpindleCouple, 0, mm_per_turn, false),
        EventKind::SpindleUncoupled => (EventCode::SpindleUncouple, 0, 0.0, false),
        EventKind::ToolIs(tool) => (EventCode::ToolIs, tool, 0.0, false),
        EventKind::Probe { away, must } => {
            let away = if away { PROBE_AWAY } else { 0 };
            let must = if must { PROBE_MUST } else { 0 };
            (EventCode::Probe, away | must, 0.0, false)
        }
        EventKind::ProbeEnd => (EventCode::ProbeEnd, 0, 0.0, false),
        EventKind::AwaitInput { asked, timeout_s } => {
            (EventCode::AwaitInput, asked.wire(), timeout_s, false)
        }
        EventKind::ToolOffsetOf(tool) => (EventCode::ToolOffsetOf, tool, 0.0, true),
        EventKind::ToolOffset { axis, value } => (EventCode::ToolOffset, axis, value, true),
        // What follows the spindle is the planner's; a cutting speed is three events.
        EventKind::SpindleFollowed(_) | EventKind::SpindleReleased | EventKind::SurfaceSpeed(_) => {
            return None;
        }
    })
}

/// Whether an event may have the program wait for the operator.
fn may_hold(code: EventCode) -> bool {
    matches!(
        code,
        EventCode::ProgramStop
            | EventCode::OptionalStop
            | EventCode::PalletStop
            | EventCode::ToolChange
    )
}

fn is_of_offset(code: u32) -> bool {
    code == EventCode::ToolOffset as u32 || code == EventCode::ToolOffsetOf as u32
}

fn is_of_spindle(kind: &EventKind) -> bool {
    matches!(
        kind,
        EventKind::SpindleSpeedRpm(_)
            | EventKind::SurfaceSpeed(_)
            | EventKind::SpindleClockwise
            | EventKind::SpindleCounterClockwise
            | EventKind::SpindleStop
            | EventKind::SpindleOrient(_)
    )
}

/// Whether the events of a program do nothing on this machine: it has no spindle, and they are of the spindle alone.
pub fn acts_on(machine: &Machine, kind: &EventKind) -> bool {
    has_part(machine.spindle.as_ref(), kind)
}

/// Whether a spindle has a part in it, or none is needed.
fn has_part(spindle: Option<&Spindle>, kind: &EventKind) -> bool {
    let of_tap = matches!(
        kind,
        EventKind::SpindleCoupled(_) | EventKind::SpindleUncoupled
    );
    match spindle {
        Some(spindle) => spindle.encoder_counts_per_turn > 0 || !of_tap,
        None => !of_tap && !is_of_spindle(kind),
    }
}

fn judge(line: u32, kind: &EventKind, spindle: Option<&Spindle>) -> Result<(), EventError> {
    let refuse = |found: String, right: String| Err(EventError { line, found, right });
    match *kind {
        EventKind::SpindleSpeedRpm(rpm) => {
            let Some(spindle) = spindle else {
                return Ok(());
            };
            let (low, high) = (spindle.speed_min_rpm, spindle.speed_max_rpm);
            if rpm == 0.0 || (low..=high).contains(&rpm) {
                return Ok(());
            }
            refuse(
                format!("S{rpm}"),
                format!("the spindle of this machine turns at {low} to {high} rev/min"),
            )
        }
        EventKind::SurfaceSpeed(SurfaceSpeed {
            limit_rpm: Some(rpm),
            ..
        }) if spindle.is_some_and(|spindle| rpm < spindle.speed_min_rpm) => refuse(
            format!("D{rpm}"),
            format!(
                "the spindle of this machine turns no slower than {} rev/min",
                spindle.map_or(0.0, |spindle| spindle.speed_min_rpm)
            ),
        ),
        EventKind::SpindleFollowed(_) if spindle.is_none_or(|s| s.encoder_counts_per_turn == 0) => refuse(
            "a motion in step with the spindle (G33, G33.1, G76)".into(),
            "no axis of this machine follows its spindle, which has no encoder: G84 taps with a holder that gives way"
                .into(),
        ),
        EventKind::DigitalOutput { index, .. } if index as usize >= DIGITAL_OUTPUTS => refuse(
            format!("digital output {index}"),
            format!("there are outputs 0 to {}", DIGITAL_OUTPUTS - 1),
        ),
        EventKind::AnalogOutput { index, .. } if index as usize >= ANALOG_OUTPUTS => refuse(
            format!("analogue output {index}"),
            format!("there are outputs 0 to {}", ANALOG_OUTPUTS - 1),
        ),
        _ => Ok(()),
    }
}

/// Whether the spindle has been given a speed or direction that no feed has waited for yet.
#[derive(Debug, Clone, Copy, Default)]
struct SpindleAhead {
    turns: bool,
    /// It follows an axis, and turns by itself only afterwards.
    coupled: bool,
    /// Its speed follows the radius: behind each rapid it is another one.
    by_radius: bool,
    changed_in_line: Option<u32>,
}

impl SpindleAhead {
    /// A spindle that turns already may be on its way to its speed.
    fn at_beginning(machine: &Machine) -> SpindleAhead {
        let turns = machine.spindle.is_some() && machine.beginning.spindle_turns();
        SpindleAhead {
            turns,
            changed_in_line: turns.then_some(1),
            ..SpindleAhead::default()
        }
    }

    /// Behind a rapid, the next feed waits for a speed that follows the radius.
    fn meet(&mut self, element: &Element) {
        let rapid = element.length_mm > 0.0 && element.feed == Feed::Rapid;
        if rapid && self.by_radius && self.turns && !self.coupled {
            self.changed_in_line.get_or_insert(element.line);
        }
    }

    fn heed(&mut self, line: u32, kind: &EventKind) {
        match kind {
            EventKind::SpindleSpeedRpm(_) | EventKind::SurfaceSpeed(_) => {
                self.by_radius = matches!(kind, EventKind::SurfaceSpeed(_));
                if self.turns {
                    self.changed_in_line = Some(line);
                }
            }
            EventKind::SpindleClockwise | EventKind::SpindleCounterClockwise => {
                self.turns = true;
                self.changed_in_line = Some(line);
            }
            EventKind::SpindleStop | EventKind::SpindleOrient(_) | EventKind::ToolChange(_) => {
                self.turns = false;
                self.changed_in_line = None;
            }
            EventKind::SpindleCoupled(_) => self.coupled = true,
            EventKind::SpindleUncoupled => {
                self.coupled = false;
                self.changed_in_line = self.turns.then_some(line);
            }
            _ => {}
        }
        if self.coupled {
            self.changed_in_line = None;
        }
    }
}

/// The place of X in the axis that the spindle turns about, the limit, and the cutting speed, which puts them in force.
fn surface_events(surface: &SurfaceSpeed, x_axis: u32) -> [(EventCode, u32, f64, bool); 3] {
    [
        (EventCode::SurfaceCentre, x_axis, surface.centre_mm, false),
        (
            EventCode::SurfaceLimit,
            0,
            surface.limit_rpm.unwrap_or(0.0),
            false,
        ),
        (EventCode::SurfaceSpeed, x_axis, surface.m_min, false),
    ]
}

impl Events {
    /// None yet, of a program on a machine.
    pub fn new(machine: &Machine) -> Events {
        Events {
            spindle: machine.spindle,
            x_axis: machine.axes.iter().position(|axis| axis.name == "X"),
            keeps_parameters: machine.keeps_parameters(),
            steps: Steps::new(machine),
            spindle_ahead: SpindleAhead::at_beginning(machine),
            ..Events::default()
        }
    }

    /// Those that come after what is behind.
    pub fn after(machine: &Machine, behind: &EventsBehind) -> Events {
        let line = behind.spindle_changed_in_line;
        Events {
            last: behind.last,
            messages: Messages::after(behind.messages),
            spindle_ahead: SpindleAhead {
                turns: behind.spindle_turns,
                coupled: false,
                by_radius: behind.spindle_by_radius,
                changed_in_line: (line > 0).then_some(line),
            },
            ..Events::new(machine)
        }
    }

    /// All of a whole program, which makes its path rest where they are done at rest.
    ///
    /// # Errors
    /// The machine cannot do one of them.
    pub fn of(machine: &Machine, events: &[Event], path: &mut Path) -> Result<Events, EventError> {
        let mut all = Events::new(machine);
        let mut events = events.iter().peekable();
        for (number, element) in (0u32..).zip(path.elements.iter_mut()) {
            while let Some(event) = events.next_if(|event| event.before_element <= number as usize)
            {
                all.read(event)?;
            }
            all.meet(number, element)?;
        }
        for event in events {
            all.read(event)?;
        }
        all.end_program(path.elements.len() as u32, ProgramEnd::FileEnd);
        Ok(all)
    }

    /// What the rest depends on; none while events wait for their element.
    pub fn behind(&self) -> Option<EventsBehind> {
        let nothing = self.waiting.is_empty()
            && self.said.is_empty()
            && self.rests_at.is_empty()
            && !self.steps.is_under_way();
        nothing.then(|| EventsBehind {
            last: self.last,
            spindle_turns: self.spindle_ahead.turns,
            spindle_by_radius: self.spindle_ahead.by_radius,
            spindle_changed_in_line: self.spindle_ahead.changed_in_line.unwrap_or(0),
            messages: self.messages.last(),
        })
    }

    /// The next event, before the element that it is done before.
    ///
    /// # Errors
    /// The machine cannot do it.
    pub fn read(&mut self, event: &Event) -> Result<(), EventError> {
        if !has_part(self.spindle.as_ref(), &event.kind) {
            return Ok(());
        }
        judge(event.line, &event.kind, self.spindle.as_ref())?;
        let probes = matches!(event.kind, EventKind::Probe { .. });
        if probes && let Some(line) = self.spindle_ahead.changed_in_line.take() {
            self.wait(line, (EventCode::AwaitSpindle, 0, 0.0, false));
        }
        self.steps.read(event)?;
        if let Some(of_wire) = wire(&event.kind) {
            self.wait(event.line, of_wire);
        }
        if let EventKind::SurfaceSpeed(surface) = &event.kind {
            for of_wire in surface_events(surface, self.x_axis.unwrap_or(0) as u32) {
                self.wait(event.line, of_wire);
            }
        }
        if let (EventKind::UserCode { q, .. }, Some(planned)) =
            (event.kind, self.waiting.last_mut())
        {
            planned.second = q;
        }
        if self.spindle.is_some() {
            self.spindle_ahead.heed(event.line, &event.kind);
        }
        let asks = probes || matches!(event.kind, EventKind::AwaitInput { .. });
        if asks || event.kind == EventKind::ProbeEnd {
            // Nothing behind it is known before the answer is: what waits is done here, whoever reads on when.
            let element = event.before_element as u32;
            self.end(element);
            self.rests_at.push(element);
        }
        if asks {
            self.question = Some((self.last, probes));
        }
        Ok(())
    }

    /// The next message, behind the events that were read before it.
    pub fn say(&mut self, message: &Message) {
        let at_rest = self.waiting.iter().filter(|planned| !planned.in_motion);
        let said = self.messages.number(message);
        if self.said.len() >= WAITING_MAX {
            self.said.pop_front();
        }
        self.said.push_back((at_rest.count(), said));
    }

    fn wait(&mut self, line: u32, of_wire: (EventCode, u32, f64, bool)) {
        let (code, index, value, in_motion) = of_wire;
        if is_of_offset(code as u32) {
            // The last one before a motion is the one that counts.
            let one = code == EventCode::ToolOffsetOf;
            let same = |of: &ProgramEvent| of.code == code as u32 && (one || of.index == index);
            self.waiting
                .retain(|planned| !planned.in_motion || !same(&planned.event));
        }
        if may_hold(code) {
            // The operator reads the offset while the program waits for him.
            self.offsets_at_rest();
        }
        self.waiting.push(Planned {
            in_motion,
            second: 0.0,
            event: ProgramEvent {
                value,
                code: code as u32,
                index,
                line,
                ..ProgramEvent::default()
            },
        });
    }

    /// The next element: what waits is done before it if it moves or waits, and makes it rest before it unless that is done in motion.
    ///
    /// # Errors
    /// More outputs before one motion than the master can be told of.
    pub fn meet(&mut self, number: u32, element: &mut Element) -> Result<(), EventError> {
        if !element.is_dwell() && element.length_mm <= 0.0 {
            return Ok(());
        }
        let before = self.rests_at.len();
        self.rests_at.retain(|at| *at > number);
        element.rests_before |= self.rests_at.len() < before;
        let feeds = element.length_mm > 0.0 && element.feed != Feed::Rapid;
        if feeds && let Some(line) = self.spindle_ahead.changed_in_line.take() {
            self.wait(line, (EventCode::AwaitSpindle, 0, 0.0, false));
        }
        self.spindle_ahead.meet(element);
        self.offsets_give_way();
        let in_motion = self.waiting.iter().filter(|planned| planned.in_motion);
        if let Some(one_too_many) = in_motion.clone().nth(OUTPUTS_AHEAD) {
            return Err(EventError {
                line: one_too_many.event.line,
                found: format!("more than {OUTPUTS_AHEAD} outputs before one motion"),
                right: "M62, M63 and M67 set at most so many where a motion begins".into(),
            });
        }
        element.rests_before |= in_motion.count() < self.waiting.len();
        let pass = self.steps.meet(number, element)?;
        let ended = self.steps.take_ended();
        element.rests_before |= pass.is_some() || ended;
        self.passes.extend(pass);
        self.couple_along(element)?;
        self.plan_waiting(number);
        Ok(())
    }

    /// An offset of the tool is set in motion where the master can be told of it beside the outputs, else at rest.
    fn offsets_give_way(&mut self) {
        let in_motion = self.waiting.iter().filter(|planned| planned.in_motion);
        if in_motion.count() > OUTPUTS_AHEAD {
            self.offsets_at_rest();
        }
    }

    fn offsets_at_rest(&mut self) {
        let of_offset = |planned: &&mut Planned| is_of_offset(planned.event.code);
        for planned in self.waiting.iter_mut().filter(of_offset) {
            planned.in_motion = false;
        }
    }

    /// A tap goes along the axis of its first motion.
    fn couple_along(&mut self, element: &Element) -> Result<(), EventError> {
        let couples =
            |planned: &&mut Planned| planned.event.code == EventCode::SpindleCouple as u32;
        for planned in self.waiting.iter_mut().filter(couples) {
            if let Some((axis, sign)) = self.steps.axis_of(element)? {
                planned.event.index = axis;
                planned.event.value *= sign;
            }
        }
        Ok(())
    }

    /// The program ends so behind so many elements: once everything is done its parameters are kept.
    pub fn end_program(&mut self, elements: u32, end: ProgramEnd) {
        if self.keeps_parameters {
            self.wait(end.line(), (EventCode::KeepParameters, 0, 0.0, false));
        }
        if let ProgramEnd::Abort(line) = end {
            self.wait(line, (EventCode::Abort, 0, 0.0, false));
        }
        self.end(elements);
    }

    /// Nothing is read behind so many elements: what waits is done there, at rest.
    pub fn end(&mut self, elements: u32) {
        for planned in &mut self.waiting {
            planned.in_motion = false;
        }
        self.plan_waiting(elements);
    }

    /// Numbers what waits: first those at rest, then those of the motion.
    fn plan_waiting(&mut self, element: u32) {
        self.waiting.sort_by_key(|planned| planned.in_motion);
        for (behind, said) in self.said.drain(..) {
            let events = self.last.saturating_add(behind as u32);
            self.messages.push(said, element, events);
        }
        for mut planned in self.waiting.drain(..) {
            self.last += 1;
            planned.event.number = self.last;
            planned.event.element = element;
            if !planned.in_motion {
                self.stops.push_back((self.last, element));
            }
            self.planned.push_back(planned);
        }
    }

    /// Lets go of the passes before an element.
    pub fn forget_passes(&mut self, element: u32) {
        while self
            .passes
            .front()
            .is_some_and(|pass| pass.element < element)
        {
            self.passes.pop_front();
            self.forgotten = true;
        }
    }

    /// Whether a run has done, said or let go some of them: another run does not find all.
    pub fn has_begun(&self) -> bool {
        self.forgotten || self.messages.passed > 0
    }

    /// Lets go of those that are done.
    pub fn forget(&mut self, done: u32) {
        let is_done = |planned: &Planned| planned.event.number <= done;
        while self.planned.front().is_some_and(is_done) {
            let Some(planned) = self.planned.pop_front() else {
                break;
            };
            self.forgotten = true;
            if planned.event.code == EventCode::ProbeEnd as u32 {
                self.probed = planned.event.element.checked_sub(1);
            }
        }
        while self.stops.front().is_some_and(|stop| stop.0 <= done) {
            self.stops.pop_front();
        }
    }

    /// Lets go of all messages.
    pub fn forget_messages(&mut self) {
        self.said.clear();
        self.messages = Messages::after(self.messages.last());
    }

    /// The one of this number.
    fn planned(&self, number: u32) -> Option<&Planned> {
        let first = self.planned.front()?.event.number;
        self.planned.get(number.checked_sub(first)? as usize)
    }

    /// The first element that is not begun before something is done at rest.
    pub fn until_element(&self, done: u32) -> u32 {
        let next = self.stops.partition_point(|stop| stop.0 <= done);
        self.stops.get(next).map_or(u32::MAX, |stop| stop.1)
    }

    /// The next event, if it is done at rest.
    pub fn at_rest(&self, done: u32) -> Option<&ProgramEvent> {
        let planned = self.planned(done.checked_add(1)?)?;
        (!planned.in_motion).then_some(&planned.event)
    }

    /// The first one that is not known to be done, and whether it is done in motion.
    pub fn next(&self) -> Option<(ProgramEvent, bool)> {
        let planned = self.planned.front()?;
        Some((planned.event, planned.in_motion))
    }

    /// Q of the user M-code of this number.
    pub fn second_value(&self, number: u32) -> f64 {
        self.planned(number).map_or(0.0, |planned| planned.second)
    }

    /// The next outputs that are set in motion.
    pub fn ahead(&self, done: u32) -> [ProgramEvent; OUTPUTS_AHEAD] {
        let mut ahead = [ProgramEvent::default(); OUTPUTS_AHEAD];
        for (slot, number) in ahead.iter_mut().zip(done.saturating_add(1)..) {
            match self.planned(number) {
                Some(planned) if planned.in_motion => *slot = planned.event,
                _ => break,
            }
        }
        ahead
    }

    /// The element of the first output in motion that the master is not told of yet: no window goes so far.
    pub fn first_untold(&self, done: u32) -> u32 {
        let untold = self.planned(done.saturating_add(OUTPUTS_AHEAD as u32 + 1));
        untold.map_or(u32::MAX, |planned| planned.event.element)
    }

    /// Whether nothing is left to be done.
    pub fn is_empty(&self) -> bool {
        self.planned.is_empty()
    }
}

/// A planner of windows along the path of a program that rests where events want it, and the events.
///
/// # Errors
/// [`CourseError`].
pub fn course(machine: &Machine, program: Program) -> Result<(WindowPlanner, Events), CourseError> {
    let Program {
        mut path,
        start,
        events,
        ..
    } = program;
    let events = Events::of(machine, &events, &mut path)?;
    Ok((window_planner(machine, path, start)?, events))
}

#[cfg(test)]
mod tests;
