//! What happens between the elements of a program's path, as the master is asked for it: numbered, each at the element that comes
//! after it. A pure function of program and machine, so every planner of a run numbers alike.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{ANALOG_OUTPUTS, DIGITAL_OUTPUTS, EventCode, OUTPUTS_AHEAD, ProgramEvent};
use control::path::{Feed, Path};
use machine::{Machine, Spindle};
use program::{Event, EventKind};

/// An event that this machine cannot do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {found}: {right}")]
pub struct EventError {
    /// Line of the program.
    pub line: u32,
    /// What was found.
    pub found: String,
    /// What would be right.
    pub right: String,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Planned {
    event: ProgramEvent,
    /// Done in motion; the others are done at rest.
    in_motion: bool,
}

/// The events of a program, in the order in which they are done.
#[derive(Debug, Clone, Default)]
pub struct Events {
    planned: Vec<Planned>,
    /// For each of them, the first from it on that is done at rest; one more.
    stop_from: Vec<u32>,
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
        EventKind::OverridesEnabled(on) => (EventCode::Overrides, 0, switch(on), false),
        // M61 tells the program alone; motion in step with the spindle is refused before.
        EventKind::ToolIs(_) | EventKind::SpindleFollowed(_) | EventKind::SpindleReleased => {
            return None;
        }
    })
}

fn is_of_spindle(kind: &EventKind) -> bool {
    matches!(
        kind,
        EventKind::SpindleSpeedRpm(_)
            | EventKind::SpindleClockwise
            | EventKind::SpindleCounterClockwise
            | EventKind::SpindleStop
            | EventKind::SpindleOrient(_)
    )
}

/// Whether the events of a program do nothing on this machine: it has no spindle, and they are of the spindle alone.
pub fn acts_on(machine: &Machine, kind: &EventKind) -> bool {
    machine.spindle.is_some() || !is_of_spindle(kind)
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
        EventKind::SpindleFollowed(_) => refuse(
            "a motion in step with the spindle (G33, G33.1, G76)".into(),
            "no axis of this machine follows its spindle: G84 taps with a holder that gives way"
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

/// The first element from this one on that moves or waits; the number of elements for none.
fn next_that_acts(path: &Path, element: usize) -> usize {
    let ahead = path.elements.iter().enumerate().skip(element);
    let mut acts = ahead.filter(|(_, element)| element.is_dwell() || element.length_mm > 0.0);
    acts.next().map_or(path.elements.len(), |(index, _)| index)
}

/// The first feed from this element on, and before that one.
fn first_feed(path: &Path, from: usize, before: usize) -> Option<usize> {
    let ahead = path.elements.iter().enumerate().take(before).skip(from);
    let mut feeds =
        ahead.filter(|(_, element)| element.length_mm > 0.0 && element.feed != Feed::Rapid);
    feeds.next().map(|(index, _)| index)
}

/// Whether the spindle has been given a speed or direction that no feed has waited for yet.
#[derive(Debug, Default)]
struct SpindleAhead {
    turns: bool,
    changed_in_line: Option<u32>,
}

impl SpindleAhead {
    fn heed(&mut self, line: u32, kind: &EventKind) {
        match kind {
            EventKind::SpindleSpeedRpm(_) if self.turns => self.changed_in_line = Some(line),
            EventKind::SpindleClockwise | EventKind::SpindleCounterClockwise => {
                self.turns = true;
                self.changed_in_line = Some(line);
            }
            EventKind::SpindleStop | EventKind::SpindleOrient(_) | EventKind::ToolChange(_) => {
                self.turns = false;
                self.changed_in_line = None;
            }
            _ => {}
        }
    }
}

impl Events {
    /// Those of a program on a machine.
    ///
    /// # Errors
    /// The machine cannot do one of them.
    pub fn of(machine: &Machine, events: &[Event], path: &Path) -> Result<Events, EventError> {
        let mut planned: Vec<Planned> = Vec::with_capacity(events.len());
        let mut spindle = SpindleAhead::default();
        let push = |planned: &mut Vec<Planned>, line, at: usize, of_wire| {
            let (code, index, value, in_motion): (EventCode, u32, f64, bool) = of_wire;
            let element = next_that_acts(path, at);
            planned.push(Planned {
                // Without a motion to begin it is done at the end.
                in_motion: in_motion && element < path.elements.len(),
                event: ProgramEvent {
                    value,
                    code: code as u32,
                    index,
                    line,
                    element: element as u32,
                    ..ProgramEvent::default()
                },
            });
        };
        let acting = events.iter().filter(|event| acts_on(machine, &event.kind));
        let mut acting = acting.peekable();
        while let Some(event) = acting.next() {
            judge(event.line, &event.kind, machine.spindle.as_ref())?;
            if let Some(of_wire) = wire(&event.kind) {
                push(&mut planned, event.line, event.before_element, of_wire);
            }
            if machine.spindle.is_some() {
                spindle.heed(event.line, &event.kind);
            }
            let next = acting.peek().map_or(usize::MAX, |next| next.before_element);
            if let Some(line) = spindle.changed_in_line
                && let Some(feed) = first_feed(path, event.before_element, next)
            {
                spindle.changed_in_line = None;
                let of_wire = (EventCode::AwaitSpindle, 0, 0.0, false);
                push(&mut planned, line, feed, of_wire);
            }
        }
        Self::numbered(planned)
    }

    /// In order: at one element those at rest first, then those of its motion.
    fn numbered(mut planned: Vec<Planned>) -> Result<Events, EventError> {
        planned.sort_by_key(|planned| (planned.event.element, planned.in_motion));
        for (number, planned) in (1u32..).zip(planned.iter_mut()) {
            planned.event.number = number;
        }
        let mut stop_from = vec![planned.len() as u32; planned.len() + 1];
        let mut next = planned.len() as u32;
        for (index, (slot, planned)) in stop_from.iter_mut().zip(&planned).enumerate().rev() {
            if !planned.in_motion {
                next = index as u32;
            }
            *slot = next;
        }
        for many in planned.windows(OUTPUTS_AHEAD + 1) {
            if let [first, .., last] = many
                && first.in_motion
                && last.in_motion
                && first.event.element == last.event.element
            {
                return Err(EventError {
                    line: last.event.line,
                    found: format!("more than {OUTPUTS_AHEAD} outputs before one motion"),
                    right: "M62, M63 and M67 set at most so many where a motion begins".into(),
                });
            }
        }
        Ok(Events { planned, stop_from })
    }

    /// Makes the path rest where they are done at rest.
    pub fn mark(&self, path: &mut Path) {
        for planned in self.planned.iter().filter(|planned| !planned.in_motion) {
            if let Some(element) = path.elements.get_mut(planned.event.element as usize) {
                element.rests_before = true;
            }
        }
    }

    /// The next event that is done at rest.
    pub fn next_stop(&self, done: u32) -> Option<&ProgramEvent> {
        let index = *self.stop_from.get(done as usize)?;
        let planned = self.planned.get(index as usize)?;
        Some(&planned.event)
    }

    /// The first element that is not begun before something is done at rest.
    pub fn until_element(&self, done: u32) -> u32 {
        self.next_stop(done).map_or(u32::MAX, |event| event.element)
    }

    /// The next event, if it is done at rest.
    pub fn at_rest(&self, done: u32) -> Option<&ProgramEvent> {
        let planned = self.planned.get(done as usize)?;
        (!planned.in_motion).then_some(&planned.event)
    }

    /// The next outputs that are set in motion.
    pub fn ahead(&self, done: u32) -> [ProgramEvent; OUTPUTS_AHEAD] {
        let mut ahead = [ProgramEvent::default(); OUTPUTS_AHEAD];
        let next = self.planned.iter().skip(done as usize);
        let next = next.take_while(|planned| planned.in_motion);
        for (slot, planned) in ahead.iter_mut().zip(next) {
            *slot = planned.event;
        }
        ahead
    }

    /// The element of the first output in motion that the master is not told of yet: no window goes so far.
    pub fn first_untold(&self, done: u32) -> u32 {
        let index = (done as usize).saturating_add(OUTPUTS_AHEAD);
        let untold = self.planned.get(index);
        untold.map_or(u32::MAX, |planned| planned.event.element)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.planned.is_empty()
    }
}

#[cfg(test)]
mod tests;
