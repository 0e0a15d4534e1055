//! The modes that a block sets, and those that M70 to M73 save and restore.

use super::*;
use crate::state::SavedModes;
use crate::words::{READ_BY, group_of, mode_words};
use machine::MODES_OF_END;
use machine::offsets_file::WORK_OFFSETS;

/// The longest dwell, in s: more than a day.
const DWELL_MAX_S: f64 = 100_000.0;

/// What is right of the time of a dwell.
pub(super) fn dwell_right() -> String {
    format!("a time is 0 to {DWELL_MAX_S} s; M0 waits for the operator")
}

/// Whether a dwell may have this time, in s.
pub(super) fn is_dwell(seconds: f64) -> bool {
    (0.0..=DWELL_MAX_S).contains(&seconds)
}

impl Interpreter {
    /// The modes of a block, in their order.
    pub(super) fn modes(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        if let Some((70, word)) = words.code(Group::Diameter)
            && self.setup.axis_index('X').is_none()
        {
            let right = "G7 reads X as a diameter: this machine has no X";
            return refuse(word.offset, "G7", right);
        }
        for group in READ_BY {
            if let Some((number, _)) = words.code(group) {
                self.set_mode(group, number);
            }
        }
        if matches!(words.code(Group::PathControl), Some((640, _))) {
            self.begin_rounding(line, words)?;
        }
        self.return_was_said |= words.code(Group::CycleReturn).is_some();
        if let Some((number, word)) = words.code(Group::Motion) {
            if matches!(number, 382..=385) && !self.setup.probe && !self.setup.answers_assumed {
                let right = "probing is not supported on this machine: it has no probe ([program] probe in the machine file)";
                return word.refuse(right);
            }
            // G5.3 ends what G5.2 began.
            if number != 53 && !is_turning(number) {
                self.motion = Motion::of_code(number);
            }
        }
        self.leave_splines(words)?;
        if !matches!(self.motion, Motion::Cycle(_)) {
            self.series = None;
        }
        Ok(())
    }

    /// G93 to G95, and F.
    pub(super) fn feed_words(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        if let Some((number, _)) = words.code(Group::FeedMode) {
            let before = self.modes.feed_mode;
            self.set_mode(Group::FeedMode, number);
            if self.modes.feed_mode != before {
                // A feed of another kind is none.
                self.modes.feed = None;
            }
        }
        let Some(feed) = words.value('F') else {
            return Ok(());
        };
        let changes_to = words.code(Group::Units).map(|(number, _)| number == 200);
        if changes_to.is_some_and(|inches| inches != self.modes.inches) {
            let text = if self.modes.inches {
                "F in the block that changes to mm is read in inches: put G21 into a block before it"
            } else {
                "F in the block that changes to inches is read in mm: put G20 into a block before it"
            };
            self.note(line, text);
        }
        // F0 takes the feed away: the next feed motion needs another.
        self.modes.feed = (feed.value > 0.0).then_some(FeedWord {
            value: feed.value,
            unit_mm: self.unit_mm(),
        });
        Ok(())
    }

    /// Seconds that G4 waits.
    pub(super) fn dwell_seconds(
        &mut self,
        line: u32,
        words: &Words,
    ) -> Result<Option<f64>, Refusal> {
        let Some((40, dwell)) = words.code(Group::Once) else {
            return Ok(None);
        };
        match words.value('P') {
            None => refuse(
                dwell.offset,
                "G4 without P",
                "the time in seconds, such as G4 P0.5",
            ),
            Some(p) if !is_dwell(p.value) => p.refuse(dwell_right()),
            Some(p) => {
                if p.value >= 100.0 && p.value.fract() == 0.0 {
                    let text = "G4 P is in seconds; Fanuc's P without a point is in milliseconds";
                    self.note(line, text);
                }
                Ok(Some(p.value))
            }
        }
    }

    /// M70, M72, M73: the modes are saved, restored, or both around a subroutine; M71 forgets them.
    pub(super) fn saved_mode_words(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::ModalState) else {
            return Ok(());
        };
        match number {
            700 => self.frames.here().saved = Some((self.saved_modes(), false)),
            710 => self.frames.here().saved = None,
            720 => {
                let Some((saved, _)) = self.frames.here().saved.clone() else {
                    let right = "M70 or M73 before it, in the same subroutine";
                    return refuse(word.offset, "M72 without saved modes", right);
                };
                self.restore_modes(line, &saved);
            }
            _ => {
                if self.frames.called().is_none() {
                    let right = "it restores the modes at the end of a subroutine: use M70 and M72";
                    return refuse(word.offset, "M73 outside a subroutine", right);
                }
                self.frames.here().saved = Some((self.saved_modes(), true));
            }
        }
        Ok(())
    }

    /// The tool, the offset and the modes that the run begins with.
    pub(super) fn begin(&mut self) {
        self.begin_with_tool();
        let setup = Arc::clone(&self.setup);
        for (letter, value) in mode_words(&setup.beginning.modes).flatten() {
            self.take_mode(letter, value);
        }
        self.take_offsets();
    }

    fn take_mode(&mut self, letter: char, value: f64) {
        let code = (value * 10.0).round() as u32;
        match (letter, code) {
            ('F', _) => {
                self.modes.feed = (value > 0.0).then_some(FeedWord {
                    value,
                    unit_mm: self.unit_mm(),
                });
            }
            ('S', _) => self.modes.spindle.speed = value,
            ('P', _) => self.modes.path_words[0] = Some(value),
            ('Q', _) => self.modes.path_words[1] = Some(value),
            ('M', 30) => self.modes.spindle.direction = 1,
            ('M', 40) => self.modes.spindle.direction = -1,
            ('M', 70) => self.modes.coolant[0] = true,
            ('M', _) => self.modes.coolant[1] = true,
            (_, 0..=30) => self.motion = Motion::of_code(code),
            _ => match group_of('G', code) {
                Some(Group::WorkOffset) => self.set_work_offset_of(code),
                Some(group) => self.set_mode(group, code),
                None => {}
            },
        }
    }

    /// Puts a code in force that says how later words are read.
    fn set_mode(&mut self, group: Group, number: u32) {
        let modes = &mut self.modes;
        match group {
            Group::Plane => modes.plane = plane_of_code(number),
            Group::Units => modes.inches = number == 200,
            Group::Diameter => modes.diameters = number == 70,
            Group::PathControl => {
                modes.path_control = number;
                modes.path_words = [None; 2];
            }
            Group::Distance => modes.incremental = number == 910,
            Group::ArcDistance => modes.arc_absolute = number == 901,
            Group::FeedMode => {
                modes.feed_mode = FeedMode::of_code(number).unwrap_or(FeedMode::PerMinute);
            }
            Group::CycleReturn => modes.returns_to_r = number == 990,
            _ => {}
        }
    }

    /// The modes that the run leaves to the next one, as the words of a block; M2 and M30 leave [`MODES_OF_END`] and what they do not
    /// change. Spindle, coolant, compensation and override end with each run, and so does a motion that is more than a line or an arc.
    pub fn modes_left(&self) -> String {
        let ends = matches!(self.ended, Some(ProgramEnd::M2(_) | ProgramEnd::M30(_)));
        let mut words = vec![if self.modes.inches { "G20" } else { "G21" }.to_owned()];
        let mut when = |is: bool, word: &str| {
            if is {
                words.push(word.to_owned());
            }
        };
        when(self.modes.diameters, "G7");
        when(self.modes.arc_absolute, "G90.1");
        when(self.modes.returns_to_r, "G99");
        words.push(format!("G{}", f64::from(self.modes.path_control) / 10.0));
        let tolerances = ['P', 'Q'].into_iter().zip(self.modes.path_words);
        words.extend(tolerances.filter_map(|(letter, value)| Some(format!("{letter}{}", value?))));
        if self.modes.surface.is_none() && self.modes.spindle.speed != 0.0 {
            words.push(format!("S{}", self.modes.spindle.speed));
        }
        if ends {
            words.push(MODES_OF_END.to_owned());
            return words.join(" ");
        }
        let motion = match self.motion {
            Motion::Rapid | Motion::Line | Motion::Arc { .. } => self.motion_mode() / 10.0,
            _ => 80.0,
        };
        words.push(format!("G{motion} G{}", self.modes.plane.0));
        words.push(if self.modes.incremental { "G91" } else { "G90" }.to_owned());
        let system = self.parameters.get(base::WORK_OFFSET).clamp(1.0, 9.0) as usize - 1;
        words.extend(WORK_OFFSETS.get(system).map(|name| (*name).to_owned()));
        words.push(self.modes.feed_mode.to_string());
        if let Some(feed) = self
            .modes
            .feed
            .filter(|_| self.modes.feed_mode != FeedMode::InverseTime)
        {
            words.push(format!("F{}", feed.value * feed.unit_mm / self.unit_mm()));
        }
        words.join(" ")
    }

    fn saved_modes(&self) -> SavedModes {
        SavedModes {
            modes: self.modes,
            work_offset: self.parameters.get(base::WORK_OFFSET),
            tool_length: self.offsets.tool,
            tool_length_of: self.tool.offset_of,
        }
    }

    pub(super) fn restore_modes(&mut self, line: u32, of: &SavedModes) {
        let (saved, before) = (of.modes, self.modes);
        self.modes = ModalState {
            spindle: before.spindle,
            surface: before.surface,
            coolant: before.coolant,
            ..saved
        };
        self.parameters.set(base::WORK_OFFSET, of.work_offset);
        // Which length counts is no mode, only whether one does.
        let counts = |length: &AxisVector| *length != AxisVector::zeros();
        if counts(&of.tool_length) != counts(&self.offsets.tool) {
            self.apply_offset(line, of.tool_length, of.tool_length_of);
        }
        self.take_offsets();
        let limit_rpm = |modes: &ModalState| modes.surface.map(|of| of.limit_rpm);
        let mode_changes = limit_rpm(&saved) != limit_rpm(&before);
        if mode_changes || saved.spindle.speed != before.spindle.speed {
            self.modes.surface = saved.surface;
            self.set_speed(line, saved.spindle.speed);
        }
        if saved.spindle.direction != before.spindle.direction {
            self.turn_spindle(line, saved.spindle.direction);
        }
        if saved.coolant != before.coolant {
            self.set_coolant(line, saved.coolant);
        }
        if saved.feed_override != before.feed_override {
            self.event(line, EventKind::OverridesEnabled(saved.feed_override));
        }
    }
}
