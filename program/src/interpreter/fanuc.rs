//! Fanuc's variables, and the words of its blocks that LinuxCNC has no words for.

use machine::Dialect;
use serde::{Deserialize, Serialize};

use super::{Done, EventKind, Interpreter, Line, ProgramEnd, Refusal, Words, base, refuse};
use crate::fanuc::{Beside, Modes, Variable};
use crate::meaning::MORE_WORK;
use crate::refusal::wrong;
use crate::state::Motion;

/// What an interpreter knows of a program in Fanuc's language beside what it knows of all.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Fanuc {
    /// Modes that LinuxCNC has not.
    pub modes: Modes,
    /// G66: the macro that is called behind each motion.
    pub modal: Option<MacroCall>,
    /// A block of axis words alone means more than a straight motion.
    pub reads_words: bool,
}

/// A call of a macro.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MacroCall {
    /// Label of the program that is called.
    pub label: String,
    /// How often.
    pub repeats: u64,
    /// Its local variables; none of a subprogram by M98, which has those of its caller.
    pub locals: Option<Vec<Option<f64>>>,
    /// How many subroutines were in force where it was said.
    pub depth: usize,
}

impl Interpreter {
    /// Whether the program is in Fanuc's language.
    pub fn is_fanuc(&self) -> bool {
        self.state.equipment().dialect == Dialect::Fanuc
    }

    /// The index among the nine letters of an axis of the machine.
    fn letter_of(&self, number: u32, axis: usize) -> Result<u32, Refusal> {
        let letter = self.state.equipment().place_in_nine(axis);
        letter.map(|letter| letter as u32).ok_or_else(|| {
            let axes = self.state.equipment().axes.len();
            let right = format!("this machine has {axes} axes, counted from 1");
            Refusal::new(0, format!("#{number}, of axis {}", axis + 1), right)
        })
    }

    /// The value of a variable, no number where it is vacant.
    pub(super) fn variable(&self, number: u32) -> Result<f64, Refusal> {
        let state = &self.state;
        let parameters = state.parameters();
        let modes = state.in_force();
        Ok(match Variable::of(number)? {
            Variable::Vacant => f64::NAN,
            Variable::Own(number) => parameters.if_set(number).unwrap_or(f64::NAN),
            Variable::Alarm | Variable::Stop | Variable::Switch => {
                let right =
                    "it is set: #3000=1 (TEXT) gives the program up, #3006=1 (TEXT) stops it";
                return wrong(format!("#{number}, which has no value"), right);
            }
            Variable::Code(group) => self.code_of_group(group),
            Variable::Word('F') => modes.feed.map_or(0.0, |feed| feed.value),
            Variable::Word('H') => f64::from(state.tools().offset_of),
            Variable::Word('S') => modes.spindle.speed,
            Variable::Word(_) => {
                let tools = state.tools();
                f64::from(tools.prepared.unwrap_or(tools.in_spindle))
            }
            Variable::MoreWorkInForce => f64::from(state.more_work().unwrap_or(0)),
            Variable::Place(axis) => state.position_of(self.letter_of(number, axis)? as usize),
            Variable::MachinePlace(axis) => {
                self.letter_of(number, axis)?;
                state.axes_place().get(axis).copied().unwrap_or(0.0) / state.unit_of(axis)
            }
            Variable::Skipped(axis) => parameters.get(base::PROBED + self.letter_of(number, axis)?),
            Variable::Applied(axis) => {
                let applied = parameters.get(base::APPLIED + self.letter_of(number, axis)?);
                applied / state.unit_of(axis)
            }
            Variable::Length(tool) => state.tool_value(tool, false)? / modes.unit_mm(),
            Variable::Radius(tool) => state.tool_value(tool, true)? / modes.unit_mm(),
            Variable::Work(system, axis) => {
                let letter = self.letter_of(number, axis)?;
                parameters.get(base::G54 + 20 * system + letter) / state.unit_of(axis)
            }
            Variable::MoreWork(system, axis) => {
                let letter = self.letter_of(number, axis)?;
                parameters.get(MORE_WORK + 20 * system + letter) / state.unit_of(axis)
            }
        })
    }

    /// The code in force of a group of Fanuc's (B-64304EN, 16.2: #4001 to #4016).
    fn code_of_group(&self, group: u32) -> f64 {
        let modes = self.state.in_force();
        let either = |first: bool, yes: f64, no: f64| if first { yes } else { no };
        let cycle = matches!(modes.motion(), Motion::Cycle(_));
        let motion = modes.motion_code() / 10.0;
        match group {
            1 => either(cycle, 0.0, motion),
            2 => f64::from(modes.plane.0),
            3 => either(modes.incremental, 91.0, 90.0),
            5 => f64::from(modes.feed_mode as u32) / 10.0,
            6 => either(modes.inches, 20.0, 21.0),
            7 => f64::from(self.route.compensation_code()) / 10.0,
            8 => either(self.state.applies_offset(), 43.0, 49.0),
            9 => either(cycle, motion, 80.0),
            10 => either(modes.returns_to_r, 99.0, 98.0),
            12 => either(self.fanuc.modal.is_some(), 66.0, 67.0),
            13 => either(modes.surface.is_some(), 96.0, 97.0),
            14 => match self.state.more_work() {
                Some(_) => 54.1,
                None => 54.0 + self.state.work_offset() as f64,
            },
            15 => f64::from(modes.path_control) / 10.0,
            _ => either(self.state.offsets().is_turned_about(), 68.0, 69.0),
        }
    }

    /// Sets a variable; no number takes its value away. `remark` is the comment of the block.
    pub fn assign_variable(
        &mut self,
        number: u32,
        value: f64,
        remark: &str,
    ) -> Result<(), Refusal> {
        let line = self.line;
        let filled = if value.is_nan() { 0.0 } else { value };
        let variable = Variable::of(number)?;
        let shifts = matches!(variable, Variable::Work(..) | Variable::MoreWork(..));
        if shifts && self.state.is_tilted() {
            let found = format!("#{number} in a tilted plane (G68.2)");
            return refuse(0, found, "G69 before it ends the plane");
        }
        match variable {
            Variable::Own(number) if value.is_nan() => self.state.own_parameters().clear(number),
            Variable::Own(number) => self.state.own_parameters().set(number, value),
            Variable::Alarm => {
                let text = format!("alarm {} {remark}", 3000.0 + filled);
                self.route.output.say(line, false, text.trim().to_owned());
                self.ended = Some(ProgramEnd::Abort(line));
            }
            Variable::Stop => {
                self.route.output.say(line, false, remark.to_owned());
                self.event(line, EventKind::ProgramStop);
            }
            Variable::Switch => self.note(
                line,
                "#3003 and #3004 have no effect: single block, hold and overrides stay the operator's",
            ),
            Variable::Length(tool) => self.state.set_tool_value(tool, false, filled)?,
            Variable::Radius(tool) => self.state.set_tool_value(tool, true, filled)?,
            Variable::Work(system, axis) => {
                let letter = self.letter_of(number, axis)?;
                self.state
                    .set_offset_along(base::G54 + 20 * system, letter, axis, filled);
            }
            Variable::MoreWork(system, axis) => {
                let letter = self.letter_of(number, axis)?;
                self.state
                    .set_offset_along(MORE_WORK + 20 * system, letter, axis, filled);
            }
            other => return other.check_settable(number),
        }
        Ok(())
    }

    /// A block whose words were put in LinuxCNC's: what those have no words for, then the block.
    pub fn run_translated(
        &mut self,
        line: u32,
        block: &Line,
        beside: &Beside,
        words: &mut Words,
    ) -> Done {
        for note in &beside.notes {
            self.note(line, note);
        }
        if self.state_known {
            if beside.turns_back {
                self.state.turn_about(None);
                self.state.change_plane(None);
            }
            let shifts = beside.turn.is_some() || beside.more_work.is_some();
            if self.state.is_tilted() && (shifts || beside.sets_more_work.is_some()) {
                let found = "G68 or G54.1 in a tilted plane (G68.2)";
                return refuse(0, found, "G69 before it ends the plane");
            }
            if let Some((number, value)) = beside.sets {
                self.assign_variable(number, value, "")?;
            }
            if let Some((number, axes)) = &beside.sets_more_work {
                let first = MORE_WORK + 20 * (number - 1);
                for word in axes {
                    let Some(axis) = self.state.equipment().axis_index(word.letter) else {
                        return word.refuse("an axis of this machine");
                    };
                    let letter = self.letter_of(0, axis)?;
                    self.state.set_offset_along(first, letter, axis, word.value);
                }
            }
            if beside.more_work.is_some() {
                self.state.choose_more_work(beside.more_work);
            }
            if beside.turn.is_some() {
                self.state.turn_about(beside.turn);
            }
        }
        let before = self.state.in_force().motion();
        self.drilling.only_keeps = beside.only_keeps;
        let result = self.run_block(line, block, words);
        self.drilling.only_keeps = false;
        if beside.motion_stays && !matches!(before, Motion::Cycle(_)) {
            self.state.move_by(before);
        }
        if let Some(code) = beside.motion_behind {
            self.state.move_by(Motion::of_code(code));
        }
        result
    }

    /// Says which blocks mean more than a straight motion.
    pub fn tell_plain_blocks(&mut self) {
        self.fanuc.reads_words = self.fanuc.modes.polar
            || self.fanuc.modal.is_some()
            || self.state.owes()
            || self.state.equipment().standard_decimal_point;
    }

    /// A refusal of a G-code that is not done while a macro is called by each motion.
    pub fn refuse_second_modal(&self, offset: usize) -> Result<(), Refusal> {
        match self.fanuc.modal {
            None => Ok(()),
            Some(_) => refuse(offset, "G66 while G66 is in force", "G67 before it"),
        }
    }
}
