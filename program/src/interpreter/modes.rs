//! The modes that a block sets, and those that M70 to M73 save and restore.

use super::*;
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
            self.plane = match number {
                180 => (18, ['Z', 'X'], ['K', 'I']),
                190 => (19, ['Y', 'Z'], ['J', 'K']),
                _ => (17, ['X', 'Y'], ['I', 'J']),
            };
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
            let mode = match number {
                930 => FeedMode::InverseTime,
                950 => FeedMode::PerRevolution,
                _ => FeedMode::PerMinute,
            };
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
            self.offsets.tool = saved.tool_length;
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

/// The motion of a code of cycles, splines or threads, given ten times its number; none of G80.
pub(super) fn motion_of_code(number: u32) -> Motion {
    Cycle::of_code(number)
        .map(Motion::Cycle)
        .or_else(|| Spline::of_code(number).map(Motion::Spline))
        .or_else(|| InStep::of_code(number).map(Motion::InStep))
        .unwrap_or(Motion::None)
}
