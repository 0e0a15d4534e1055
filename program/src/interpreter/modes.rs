//! The modes that a block sets, and those that M70 to M73 save and restore.

use super::*;
use machine::MODES_OF_END;
use machine::offsets_file::WORK_OFFSETS;
use serde::{Deserialize, Serialize};

/// What M70 and M73 save (LinuxCNC manual, *M70 Save Modal State*).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedModes {
    plane: (u32, [char; 2], [char; 2]),
    inches: bool,
    incremental: bool,
    arc_absolute: bool,
    diameters: bool,
    feed_mode: FeedMode,
    feed: Option<FeedWord>,
    spindle: Spindle,
    surface: Option<SurfaceSpeed>,
    coolant: [bool; 2],
    feed_override: bool,
    spindle_override: bool,
    returns_to_r: bool,
    path_control: u32,
    path_words: [Option<f64>; 2],
    work_offset: f64,
    /// Length of the tool that counts (G43), all 0 after G49.
    #[serde(with = "snapshot::vector")]
    tool_length: AxisVector,
    tool_length_of: u32,
}

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
        if let Some((number, _)) = words.code(Group::Plane) {
            self.plane = plane_of_code(number);
        }
        if let Some((number, _)) = words.code(Group::Units) {
            self.inches = number == 200;
        }
        if let Some((number, word)) = words.code(Group::Diameter) {
            if number == 70 && self.setup.axis_index('X').is_none() {
                let right = "G7 reads X as a diameter: this machine has no X";
                return Err(Refusal::new(word.offset, "G7", right));
            }
            self.diameters = number == 70;
        }
        if let Some((number, _)) = words.code(Group::PathControl) {
            self.path_control = number;
            self.path_words = [None; 2];
            if number == 640 {
                self.begin_rounding(line, words)?;
            }
        }
        if let Some((number, _)) = words.code(Group::Distance) {
            self.incremental = number == 910;
        }
        if let Some((number, _)) = words.code(Group::ArcDistance) {
            self.arc_absolute = number == 901;
        }
        if let Some((number, word)) = words.code(Group::Motion) {
            self.motion = match number {
                0 => Motion::Rapid,
                10 => Motion::Line,
                20 => Motion::Arc { clockwise: true },
                30 => Motion::Arc { clockwise: false },
                382..=385 if self.setup.probe || self.setup.answers_assumed => {
                    Motion::Probe(number)
                }
                382..=385 => {
                    let found = format!("G{}", word.value);
                    let right = "probing is not supported on this machine: it has no probe ([program] probe in the machine file)";
                    return Err(Refusal::new(word.offset, found, right));
                }
                // G5.3 ends what G5.2 began.
                53 => self.motion,
                other if is_turning(other) => self.motion,
                other => motion_of_code(other),
            };
        }
        self.leave_splines(words)?;
        if let Some((number, _)) = words.code(Group::CycleReturn) {
            self.returns_to_r = number == 990;
            self.return_was_said = true;
        }
        if !matches!(self.motion, Motion::Cycle(_)) {
            self.series = None;
        }
        Ok(())
    }

    /// G93 to G95, and F.
    pub(super) fn feed_words(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        if let Some((number, _)) = words.code(Group::FeedMode) {
            let mode = feed_mode_of_code(number);
            if mode != self.feed_mode {
                // A feed of another kind is none.
                self.feed = None;
            }
            self.feed_mode = mode;
        }
        let Some(feed) = words.value('F') else {
            return Ok(());
        };
        let changes_to = words.code(Group::Units).map(|(number, _)| number == 200);
        if changes_to.is_some_and(|inches| inches != self.inches) {
            let text = if self.inches {
                "F in the block that changes to mm is read in inches: put G21 into a block before it"
            } else {
                "F in the block that changes to inches is read in mm: put G20 into a block before it"
            };
            self.note(line, text);
        }
        // F0 takes the feed away: the next feed motion needs another.
        self.feed = (feed.value > 0.0).then_some(FeedWord {
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
            None => Err(Refusal::new(
                dwell.offset,
                "G4 without P",
                "the time in seconds, such as G4 P0.5",
            )),
            Some(p) if !is_dwell(p.value) => Err(Refusal::new(
                p.offset,
                format!("P{}", p.value),
                dwell_right(),
            )),
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
                    return Err(Refusal::new(word.offset, "M72 without saved modes", right));
                };
                self.restore_modes(line, &saved);
            }
            _ => {
                if self.frames.called().is_none() {
                    let right = "it restores the modes at the end of a subroutine: use M70 and M72";
                    return Err(Refusal::new(word.offset, "M73 outside a subroutine", right));
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
                self.feed = (value > 0.0).then_some(FeedWord {
                    value,
                    unit_mm: self.unit_mm(),
                });
            }
            ('S', _) => self.spindle.speed = value,
            ('P', _) => self.path_words[0] = Some(value),
            ('Q', _) => self.path_words[1] = Some(value),
            ('M', 30) => self.spindle.direction = 1,
            ('M', 40) => self.spindle.direction = -1,
            ('M', 70) => self.coolant[0] = true,
            ('M', _) => self.coolant[1] = true,
            (_, 0) => self.motion = Motion::Rapid,
            (_, 10) => self.motion = Motion::Line,
            (_, 20 | 30) => {
                self.motion = Motion::Arc {
                    clockwise: code == 20,
                };
            }
            (_, 170 | 180 | 190) => self.plane = plane_of_code(code),
            (_, 200 | 210) => self.inches = code == 200,
            (_, 70 | 80) => self.diameters = code == 70,
            (_, 610 | 611 | 640) => {
                self.path_control = code;
                self.path_words = [None; 2];
            }
            (_, 900 | 910) => self.incremental = code == 910,
            (_, 901 | 911) => self.arc_absolute = code == 901,
            (_, 930 | 940 | 950) => self.feed_mode = feed_mode_of_code(code),
            (_, 980 | 990) => self.returns_to_r = code == 990,
            _ => {
                if let Some(system) = work_offset_of_code(code) {
                    self.parameters.set(base::WORK_OFFSET, system);
                }
            }
        }
    }

    /// The modes that the run leaves to the next one, as the words of a block; M2 and M30 leave [`MODES_OF_END`] and what they do not
    /// change. Spindle, coolant, compensation and override end with each run, and so does a motion that is more than a line or an arc.
    pub fn modes_left(&self) -> String {
        let ends = matches!(self.ended, Some(ProgramEnd::M2(_) | ProgramEnd::M30(_)));
        let mut words = vec![if self.inches { "G20" } else { "G21" }.to_owned()];
        let mut when = |is: bool, word: &str| {
            if is {
                words.push(word.to_owned());
            }
        };
        when(self.diameters, "G7");
        when(self.arc_absolute, "G90.1");
        when(self.returns_to_r, "G99");
        words.push(format!("G{}", f64::from(self.path_control) / 10.0));
        let tolerances = ['P', 'Q'].into_iter().zip(self.path_words);
        words.extend(tolerances.filter_map(|(letter, value)| Some(format!("{letter}{}", value?))));
        if self.surface.is_none() && self.spindle.speed != 0.0 {
            words.push(format!("S{}", self.spindle.speed));
        }
        if ends {
            words.push(MODES_OF_END.to_owned());
            return words.join(" ");
        }
        let motion = match self.motion {
            Motion::Rapid | Motion::Line | Motion::Arc { .. } => self.motion_mode() / 10.0,
            _ => 80.0,
        };
        words.push(format!("G{motion} G{}", self.plane.0));
        words.push(if self.incremental { "G91" } else { "G90" }.to_owned());
        let system = self.parameters.get(base::WORK_OFFSET).clamp(1.0, 9.0) as usize - 1;
        words.extend(WORK_OFFSETS.get(system).map(|name| (*name).to_owned()));
        words.push(format!("G{}", self.feed_mode.code()));
        if let Some(feed) = self
            .feed
            .filter(|_| self.feed_mode != FeedMode::InverseTime)
        {
            words.push(format!("F{}", feed.value * feed.unit_mm / self.unit_mm()));
        }
        words.join(" ")
    }

    fn saved_modes(&self) -> SavedModes {
        SavedModes {
            plane: self.plane,
            inches: self.inches,
            incremental: self.incremental,
            arc_absolute: self.arc_absolute,
            diameters: self.diameters,
            feed_mode: self.feed_mode,
            feed: self.feed,
            spindle: self.spindle,
            surface: self.surface,
            coolant: self.coolant,
            feed_override: self.feed_override,
            spindle_override: self.spindle_override,
            returns_to_r: self.returns_to_r,
            path_control: self.path_control,
            path_words: self.path_words,
            work_offset: self.parameters.get(base::WORK_OFFSET),
            tool_length: self.offsets.tool,
            tool_length_of: self.tool.offset_of,
        }
    }

    /// Restores modes; what the machine must do for them happens in this line.
    pub(super) fn restore_modes(&mut self, line: u32, saved: &SavedModes) {
        self.plane = saved.plane;
        self.inches = saved.inches;
        self.incremental = saved.incremental;
        self.arc_absolute = saved.arc_absolute;
        self.diameters = saved.diameters;
        self.feed_mode = saved.feed_mode;
        self.feed = saved.feed;
        self.returns_to_r = saved.returns_to_r;
        self.path_control = saved.path_control;
        self.path_words = saved.path_words;
        self.parameters.set(base::WORK_OFFSET, saved.work_offset);
        // Which length counts is no mode, only whether one does.
        let counts = |length: &AxisVector| *length != AxisVector::zeros();
        if counts(&saved.tool_length) != counts(&self.offsets.tool) {
            self.apply_offset(line, saved.tool_length, saved.tool_length_of);
        }
        self.take_offsets();
        let mode_changes =
            saved.surface.map(|of| of.limit_rpm) != self.surface.map(|of| of.limit_rpm);
        if mode_changes || saved.spindle.speed != self.spindle.speed {
            self.surface = saved.surface;
            self.set_speed(line, saved.spindle.speed);
        }
        if saved.spindle.direction != self.spindle.direction {
            self.turn_spindle(line, saved.spindle.direction);
        }
        if saved.coolant != self.coolant {
            self.set_coolant(line, saved.coolant);
        }
        self.spindle_override = saved.spindle_override;
        if saved.feed_override != self.feed_override {
            self.feed_override = saved.feed_override;
            self.event(line, EventKind::OverridesEnabled(saved.feed_override));
        }
    }
}

/// The words of a block of modes; none in place of one that is no mode.
fn mode_words(modes: &str) -> impl Iterator<Item = Option<(char, f64)>> {
    modes.split_whitespace().map(|word| {
        let letter = word.chars().next()?;
        let value: f64 = word.get(letter.len_utf8()..)?.parse().ok()?;
        let code = (value * 10.0).round() as u32;
        let known = match letter {
            'F' | 'S' | 'P' | 'Q' => true,
            'M' => matches!(code, 30 | 40 | 70 | 80),
            'G' => {
                matches!(
                    code,
                    0 | 10
                        | 20
                        | 30
                        | 70
                        | 80
                        | 170
                        | 180
                        | 190
                        | 200
                        | 210
                        | 400
                        | 610
                        | 611
                        | 640
                        | 800
                        | 900
                        | 901
                        | 910
                        | 911
                        | 930
                        | 940
                        | 950
                        | 970
                        | 980
                        | 990
                ) || work_offset_of_code(code).is_some()
            }
            _ => false,
        };
        (known && (0.0..1e9).contains(&value)).then_some((letter, value))
    })
}

/// What is no mode in a block that a run is to begin with.
pub fn unknown_mode(modes: &str) -> Option<&str> {
    let mut words = modes.split_whitespace().zip(mode_words(modes));
    words.find_map(|(word, known)| known.is_none().then_some(word))
}

/// The plane of ten times a code: its number, axis letters, and the offset letters that belong to them.
fn plane_of_code(code: u32) -> (u32, [char; 2], [char; 2]) {
    match code {
        180 => (18, ['Z', 'X'], ['K', 'I']),
        190 => (19, ['Y', 'Z'], ['J', 'K']),
        _ => (17, ['X', 'Y'], ['I', 'J']),
    }
}

fn feed_mode_of_code(code: u32) -> FeedMode {
    match code {
        930 => FeedMode::InverseTime,
        950 => FeedMode::PerRevolution,
        _ => FeedMode::PerMinute,
    }
}

/// The number of a work offset, 1 for G54, of ten times its code.
fn work_offset_of_code(code: u32) -> Option<f64> {
    let name = format!("G{}", f64::from(code) / 10.0);
    let index = WORK_OFFSETS.iter().position(|known| **known == name)?;
    Some(index as f64 + 1.0)
}

/// The motion of a code of cycles, splines or threads, given ten times its number; none of G80.
pub(super) fn motion_of_code(number: u32) -> Motion {
    Cycle::of_code(number)
        .map(Motion::Cycle)
        .or_else(|| Spline::of_code(number).map(Motion::Spline))
        .or_else(|| InStep::of_code(number).map(Motion::InStep))
        .unwrap_or(Motion::None)
}
