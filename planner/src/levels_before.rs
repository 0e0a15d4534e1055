//! What the events before a place of a program leave behind: the levels that they set, each once, in an order that a machine can take
//! them in: the tool, then the spindle, then coolant and outputs.

use bus::sample::{EventCode, ProgramEvent};

/// The levels that the events so far have set.
#[derive(Debug, Clone, Default)]
pub(crate) struct LevelsBefore {
    tool: Option<ProgramEvent>,
    prepared: Option<ProgramEvent>,
    /// S; with a speed that follows the radius, its centre and limit before it.
    speed: Vec<ProgramEvent>,
    turns: Option<ProgramEvent>,
    /// What it was told before the first tool change: it goes on with that where the tool is in already.
    turns_before: Option<ProgramEvent>,
    /// Mist, flood, outputs, overrides and the offset of the tool: the last of each.
    switched: Vec<ProgramEvent>,
    /// Whether a tap is in its thread.
    pub is_in_thread: bool,
}

impl LevelsBefore {
    /// The next event, in the order of the program. Stops, waits and user M-codes leave nothing behind.
    pub fn take(&mut self, event: &ProgramEvent) {
        let Some(code) = EventCode::from_wire(event.code) else {
            return;
        };
        match code {
            EventCode::ToolIs => self.tool = Some(*event),
            EventCode::ToolChange => self.change(event),
            EventCode::ToolPrepare => self.prepared = Some(*event),
            EventCode::SpindleSpeed | EventCode::SurfaceCentre => self.speed = vec![*event],
            EventCode::SurfaceLimit | EventCode::SurfaceSpeed => self.speed.push(*event),
            EventCode::SpindleClockwise
            | EventCode::SpindleCounterClockwise
            | EventCode::SpindleStop
            | EventCode::SpindleOrient => self.turns = Some(*event),
            EventCode::Mist
            | EventCode::Flood
            | EventCode::DigitalOutput
            | EventCode::AnalogOutput
            | EventCode::ToolOffsetOf
            | EventCode::ToolOffset
            | EventCode::Overrides => {
                let one = code == EventCode::ToolOffsetOf;
                let same =
                    |of: &ProgramEvent| of.code == event.code && (one || of.index == event.index);
                self.switched.retain(|of| !same(of));
                self.switched.push(*event);
            }
            EventCode::SpindleCouple => self.is_in_thread = true,
            EventCode::SpindleUncouple => self.is_in_thread = false,
            EventCode::AwaitSpindle
            | EventCode::OptionalStop
            | EventCode::ProgramStop
            | EventCode::PalletStop
            | EventCode::Probe
            | EventCode::ProbeEnd
            | EventCode::AwaitInput
            | EventCode::KeepParameters
            | EventCode::UserCode
            | EventCode::BlockDone
            | EventCode::Abort
            | EventCode::StartAt => {}
        }
    }

    /// For another tool the spindle stands; the one that is in is not changed.
    fn change(&mut self, event: &ProgramEvent) {
        match self.tool {
            Some(tool) if tool.index == event.index => return,
            Some(_) => self.turns_before = None,
            None => self.turns_before = self.turns,
        }
        self.turns = None;
        self.tool = Some(*event);
    }

    /// The events that set these levels, counted from 1; before the last of them the spindle is at its speed.
    pub fn events(&self) -> Vec<ProgramEvent> {
        let goes_on = self.turns_before.filter(|_| self.turns.is_none());
        let mut events: Vec<ProgramEvent> = goes_on.into_iter().chain(self.tool).collect();
        events.extend(self.prepared);
        events.extend(&self.speed);
        events.extend(self.turns);
        events.extend(&self.switched);
        let turning = [
            EventCode::SpindleClockwise as u32,
            EventCode::SpindleCounterClockwise as u32,
        ];
        let turns = self.turns.or(self.turns_before);
        if let Some(turns) = turns.filter(|turns| turning.contains(&turns.code)) {
            events.push(ProgramEvent {
                code: EventCode::AwaitSpindle as u32,
                value: 0.0,
                index: 0,
                ..turns
            });
        }
        for (event, number) in events.iter_mut().zip(1..) {
            event.number = number;
            event.element = 0;
        }
        events
    }
}

#[cfg(test)]
#[allow(clippy::indexing_slicing)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What a machine with a tool in shows that obeys events one after another: tool, prepared, speed, turning, coolant, an output,
    /// overrides.
    fn shown(tool: u32, events: &[ProgramEvent]) -> [f64; 8] {
        let mut shown = [0.0; 8];
        shown[0] = f64::from(tool);
        for event in events {
            match EventCode::from_wire(event.code) {
                Some(EventCode::ToolIs) => shown[0] = f64::from(event.index),
                Some(EventCode::ToolChange) => {
                    // The spindle stands for another tool.
                    if shown[0] != f64::from(event.index) {
                        shown[3] = 0.0;
                    }
                    shown[0] = f64::from(event.index);
                }
                Some(EventCode::ToolPrepare) => shown[1] = f64::from(event.index),
                Some(EventCode::SpindleSpeed) => shown[2] = event.value,
                Some(EventCode::SpindleClockwise) => shown[3] = 1.0,
                Some(EventCode::SpindleCounterClockwise) => shown[3] = -1.0,
                Some(EventCode::SpindleStop) => shown[3] = 0.0,
                Some(EventCode::Mist) => shown[4] = event.value,
                Some(EventCode::Flood) => shown[5] = event.value,
                Some(EventCode::DigitalOutput) => shown[6] = event.value * f64::from(event.index),
                Some(EventCode::Overrides) => shown[7] = event.value,
                _ => {}
            }
        }
        shown
    }

    fn event() -> impl Strategy<Value = ProgramEvent> {
        let codes = prop_oneof![
            Just(EventCode::ToolChange),
            Just(EventCode::ToolPrepare),
            Just(EventCode::SpindleSpeed),
            Just(EventCode::SpindleClockwise),
            Just(EventCode::SpindleCounterClockwise),
            Just(EventCode::SpindleStop),
            Just(EventCode::Mist),
            Just(EventCode::Flood),
            Just(EventCode::DigitalOutput),
            Just(EventCode::Overrides),
            Just(EventCode::OptionalStop),
            Just(EventCode::UserCode),
            Just(EventCode::AwaitSpindle),
        ];
        (codes, 0u32..3, 0u32..2).prop_map(|(code, index, on)| ProgramEvent {
            code: code as u32,
            index: match code {
                EventCode::DigitalOutput => 1,
                EventCode::ToolChange | EventCode::ToolPrepare => index,
                _ => 0,
            },
            value: f64::from(on),
            ..ProgramEvent::default()
        })
    }

    proptest! {
        #[test]
        fn the_levels_are_those_of_all_events_done_one_after_another(
            tool in 0u32..3,
            events in prop::collection::vec(event(), 0..40),
        ) {
            let mut levels = LevelsBefore::default();
            events.iter().for_each(|event| levels.take(event));
            let once = levels.events();
            prop_assert_eq!(shown(tool, &once), shown(tool, &events));
            prop_assert!(once.iter().zip(1..).all(|(event, number)| event.number == number));
            prop_assert!(once.len() <= 9);
        }
    }

    #[test]
    fn a_tap_that_is_not_out_is_in_its_thread() {
        let of = |code: EventCode| ProgramEvent {
            code: code as u32,
            ..ProgramEvent::default()
        };
        let mut levels = LevelsBefore::default();
        levels.take(&of(EventCode::SpindleCouple));
        assert!(levels.is_in_thread);
        levels.take(&of(EventCode::SpindleUncouple));
        assert!(!levels.is_in_thread);
    }
}
