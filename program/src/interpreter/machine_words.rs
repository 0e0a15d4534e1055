//! Words for what is beside the axes: spindle, coolant, outputs, stops.

use super::*;

/// The most digital and analogue outputs, as LinuxCNC has them by default.
const OUTPUTS_MAX: f64 = 63.0;

impl Interpreter {
    /// S, T, M words up to the coolant, in the order of execution.
    pub(super) fn machine_words(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        self.spindle_mode(words)?;
        if let Some(speed) = words.value('S') {
            self.set_speed(line, speed.value);
        }
        if let Some(tool) = words.value('T') {
            self.prepare_tool(line, tool)?;
        }
        self.input_output(line, words)?;
        self.change_tool(line, words)?;
        self.spindle_words(line, words)?;
        self.saved_mode_words(line, words)?;
        match words.code(Group::Coolant) {
            Some((70, _)) => self.set_coolant(line, [true, self.modes.coolant[1]]),
            Some((80, _)) => self.set_coolant(line, [self.modes.coolant[0], true]),
            Some(_) => self.set_coolant(line, [false; 2]),
            None => {}
        }
        self.override_words(line, words);
        self.user_code(line, words)
    }

    /// M100 to M199.
    fn user_code(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::User) else {
            return Ok(());
        };
        let code = number / 10;
        if !self.setup.user_codes {
            let right = "user M-codes run a program of the machine builder: the machine file names their folder ([program] user_codes)";
            return refuse(word.offset, format!("M{code}"), right);
        }
        let value = |letter| words.value(letter).map_or(-1.0, |word| word.value);
        let (p, q) = (value('P'), value('Q'));
        self.event(line, EventKind::UserCode { code, p, q });
        Ok(())
    }

    /// Turns the spindle: 1 clockwise, −1 counter-clockwise, 0 stops it.
    pub(super) fn turn_spindle(&mut self, line: u32, direction: i32) {
        self.modes.spindle.direction = direction;
        let kind = match direction {
            0 => EventKind::SpindleStop,
            1 => EventKind::SpindleClockwise,
            _ => EventKind::SpindleCounterClockwise,
        };
        self.event(line, kind);
    }

    fn spindle_words(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::Spindle) else {
            return Ok(());
        };
        if let Some(spindle) = words.value('$').filter(|spindle| spindle.value != 0.0) {
            return spindle.refuse("there is one spindle, $0");
        }
        match number {
            30 => self.turn_spindle(line, 1),
            40 => self.turn_spindle(line, -1),
            50 => self.turn_spindle(line, 0),
            _ => {
                let Some(angle) = words.value('R') else {
                    let right = "the angle in degrees, such as M19 R90";
                    return refuse(word.offset, "M19 without R", right);
                };
                self.modes.spindle.direction = 0;
                self.event(line, EventKind::SpindleOrient(angle.value));
            }
        }
        Ok(())
    }

    /// Mist, flood.
    pub(super) fn set_coolant(&mut self, line: u32, coolant: [bool; 2]) {
        let [mist, flood] = coolant;
        // M9 says so even where nothing is on: levels that are set twice do no harm.
        let off = coolant == [false; 2];
        if mist != self.modes.coolant[0] || off {
            self.event(line, EventKind::Mist(mist));
        }
        if flood != self.modes.coolant[1] || off {
            self.event(line, EventKind::Flood(flood));
        }
        self.modes.coolant = coolant;
    }

    fn override_words(&mut self, line: u32, words: &Words) {
        let Some((number, _)) = words.code(Group::Overrides) else {
            return;
        };
        let on = words.value('P').is_none_or(|p| p.value != 0.0);
        match number {
            480 | 490 => {
                self.modes.feed_override = number == 480;
                self.modes.spindle_override = number == 480;
                self.event(line, EventKind::OverridesEnabled(self.modes.feed_override));
            }
            500 => {
                self.modes.feed_override = on;
                self.event(line, EventKind::OverridesEnabled(on));
            }
            510 => {
                self.modes.spindle_override = on;
                let text = "M51 has no effect: the speed of the spindle has no override";
                self.note(line, text);
            }
            _ => {
                let text =
                    "M52 and M53 (adaptive feed, feed stop) have no effect: there is no such input";
                self.note(line, text);
            }
        }
    }

    /// M62 to M68.
    fn input_output(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::InputOutput) else {
            return Ok(());
        };
        let which = |letter: char| {
            let code = number / 10;
            let right = format!("its number, such as M{code} {letter}0");
            let found = format!("M{code} without {letter}");
            let index = words.whole(letter, "a whole number", 0.0..=OUTPUTS_MAX)?;
            index.ok_or_else(|| Refusal::new(word.offset, found, right))
        };
        let kind = match number {
            620..=650 => EventKind::DigitalOutput {
                index: which('P')?,
                on: number == 620 || number == 640,
                synchronised: number < 640,
            },
            670 | 680 => EventKind::AnalogOutput {
                index: which('E')?,
                value: words.value('Q').map_or(0.0, |q| q.value),
                synchronised: number == 670,
            },
            _ => return self.await_input(line, words, word.offset),
        };
        self.event(line, kind);
        Ok(())
    }

    /// M0, M1, M60: at the end of the block.
    pub(super) fn stop_words(&mut self, line: u32, words: &Words) {
        let kind = match words.code(Group::Stop) {
            Some((0, _)) => EventKind::ProgramStop,
            Some((10, _)) => EventKind::OptionalStop,
            Some((600, _)) => EventKind::PalletStop,
            _ => return,
        };
        self.event(line, kind);
    }
}
