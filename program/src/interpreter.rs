//! The interpreter: the order in which the words of a block take effect, and what a program knows from block to block.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use machine::{KeptParameters, is_always_kept};
use path::geometry::AxisVector;

use crate::act::Acts;
use crate::expression::Target;
use crate::frames::{Frame, Frames};
use crate::meaning::{Drilling, Modal, Splines, State, input_asked, output_switched};
use crate::parameters::{NUMBER_MAX, Parameters, acts_in_fanuc, base};
use crate::program::{EventKind, ProgramEnd, Setup};
use crate::reader::{CommentKind, Corner, Line};
use crate::refusal::{Done, Refusal, refuse};
use crate::route::{Output, Route};
use crate::state::SavedModes;
use crate::words::{Group, Words};

mod corner;
mod fanuc;
mod motion;
mod names;
mod questions;
mod say;

pub use corner::CornerAhead;
use fanuc::Fanuc;
pub use fanuc::MacroCall;
use questions::Questions;
use say::{BESIDE_O_WORD, remark_of, with_values};

/// What is said of a parameter that would act in Fanuc's language.
const ACTS_IN_FANUC: &str = "a parameter that sets an output (#1100 to #1135), an offset (#2001 to #2999) or a counter of parts (#3901, #3902) in Fanuc's language: here it is the program's own and sets nothing";

/// The state of a program at a block, and what it made so far. All that later blocks depend on is in here; a copy goes on from the
/// same place.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Interpreter {
    state: State,
    drilling: Drilling,
    splines: Splines,
    pub route: Route,
    questions: Questions,
    /// #<_value>, and whether the last subroutine returned one.
    returned: (f64, bool),
    pub frames: Frames,
    pub state_known: bool,
    /// The line that is read, counted from 1.
    #[serde(skip)]
    pub line: u32,
    /// The same in its own file.
    #[serde(skip)]
    pub line_of_file: u32,
    pub ended: Option<ProgramEnd>,
    /// What only programs in Fanuc's language have.
    pub fanuc: Fanuc,
    /// The corner at the end of the block that is done.
    #[serde(skip)]
    corner: Option<Box<(Corner, CornerAhead)>>,
}

impl Interpreter {
    pub fn new(setup: &Arc<Setup>, start: AxisVector) -> Self {
        let mut interpreter = Self {
            state: State::new(setup, start),
            state_known: true,
            ..Self::default()
        };
        if interpreter.is_fanuc() {
            interpreter.tell_plain_blocks();
        }
        interpreter
    }

    /// Takes what a snapshot leaves out from a fresh one.
    pub fn complete(&mut self, fresh: &Self) {
        self.state.complete(&fresh.state);
    }

    /// The state that words are read in.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Notes what a program left open at its end.
    pub fn note_open(&mut self) {
        if let Some(line) = self.splines.open_since() {
            let text = "the spline that G5.2 begins has no G5.3: it is not made";
            self.note(line, text);
        }
    }

    /// What the program made, and its parameters at the end.
    pub fn finish(mut self) -> (Parameters, Output) {
        self.note_open();
        self.state.show_position_parameters();
        (self.state.parameters().clone(), self.route.output)
    }

    /// Whether M2 or M30 has ended the program.
    fn ends_by_word(&self) -> bool {
        matches!(self.ended, Some(ProgramEnd::M2(_) | ProgramEnd::M30(_)))
    }

    /// The parameters that outlive the run: those that always do, and those that were kept before. M2 and M30 leave G54 in force.
    pub fn kept_parameters(&self) -> KeptParameters {
        let named = &self.state.equipment().parameters;
        let kept = |number: &u32| is_always_kept(*number) || named.contains_key(number);
        let value = |number: u32| match number {
            base::WORK_OFFSET if self.ends_by_word() => 1.0,
            _ => self.state.parameters().get(number),
        };
        let beyond = named.keys().copied().filter(|number| *number > NUMBER_MAX);
        let numbers = (1..=NUMBER_MAX).filter(kept).chain(beyond);
        numbers.map(|number| (number, value(number))).collect()
    }

    /// The modes that the run leaves to the next one, as the words of a block.
    pub fn modes_left(&self) -> String {
        self.state.modes_left(self.ends_by_word())
    }

    /// The state that the blocks so far have left.
    pub fn modal(&self) -> Modal {
        self.state.modal(self.route.compensation_code())
    }

    /// Keeps a remark, once of a kind, for its first line.
    pub fn note(&mut self, line: u32, text: &'static str) {
        self.route.note(line, text);
    }

    fn event(&mut self, line: u32, kind: EventKind) {
        self.route.event(&self.state, line, kind);
    }

    /// Lets words change the state, and does what that makes.
    fn change<R>(&mut self, line: u32, words: impl FnOnce(&mut State, &mut Acts) -> R) -> R {
        let mut acts = Acts::default();
        let result = words(&mut self.state, &mut acts);
        self.route.perform(&mut self.state, line, acts);
        result
    }

    /// Does one block; its refusals, none if it is done.
    pub fn run_block(&mut self, line: u32, block: &Line, words: &mut Words) -> Done {
        words.sort(block, self.state.equipment())?;
        if self.state_known {
            self.execute(line, words)?;
        }
        // A block before was refused: what this one would do is not known, only where the program ends.
        match words.code(Group::Stop) {
            Some((20, _)) => self.ended = Some(ProgramEnd::M2(line)),
            Some((300, _)) => self.ended = Some(ProgramEnd::M30(line)),
            _ => {}
        }
        Ok(())
    }

    /// The words of a block in the order of NIST §3.8 and LinuxCNC's manual (*Order of Execution*).
    fn execute(&mut self, line: u32, words: &mut Words) -> Done {
        self.state.check_words_used(words)?;
        self.route.check_words(&self.state, words)?;
        self.state.check_tool_centre(words)?;
        self.change(line, |state, acts| state.feed_words(words, acts));
        self.change(line, |state, acts| state.speed_and_tool(words, acts))?;
        self.inputs_and_outputs(line, words)?;
        self.change(line, |state, acts| state.change_and_turn(words, acts))?;
        self.saved_mode_words(line, words)?;
        self.change(line, |state, acts| state.coolant_and_codes(words, acts))?;
        self.change(line, |state, acts| state.dwell(words, acts))?;
        self.change(line, |state, acts| state.mode_words(words, acts))?;
        let motion = self.state.in_force().motion();
        self.splines.leave(words, motion)?;
        self.drilling.leave(motion);
        self.radius_words(line, words)?;
        let length = *self.state.offsets().tool();
        self.change(line, |state, acts| state.tool_length(words, acts))?;
        if words.code(Group::ToolLength).is_some() {
            self.drilling
                .lengthen(&(self.state.offsets().tool() - length));
        }
        self.state.work_offset_words(words);
        self.once(line, words)?;
        self.change(line, |state, acts| state.follow_centre(acts));
        self.travel(line, words)?;
        self.stop_words(line, words)
    }

    /// M62 to M68.
    fn inputs_and_outputs(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        if let Some(kind) = output_switched(words)? {
            self.event(line, kind);
        }
        match input_asked(words)? {
            Some((asked, timeout_s)) => self.await_input(line, asked, timeout_s),
            None => Ok(()),
        }
    }

    /// M70, M72, M73: the modes are saved, restored, or both around a subroutine; M71 forgets them.
    fn saved_mode_words(&mut self, line: u32, words: &Words) -> Result<(), Refusal> {
        let Some((number, word)) = words.code(Group::ModalState) else {
            return Ok(());
        };
        let saved = self.state.saved_modes();
        match number {
            700 => self.frames.here().saved = Some((saved, false)),
            710 => self.frames.here().saved = None,
            720 => {
                let Some((saved, _)) = self.frames.here().saved.clone() else {
                    let right = "M70 or M73 before it, in the same subroutine";
                    return refuse(word.offset, "M72 without saved modes", right);
                };
                self.change(line, |state, acts| state.restore(&saved, acts));
            }
            _ => {
                if self.frames.called.is_empty() {
                    let right = "it restores the modes at the end of a subroutine: use M70 and M72";
                    return refuse(word.offset, "M73 outside a subroutine", right);
                }
                self.frames.here().saved = Some((saved, true));
            }
        }
        Ok(())
    }

    /// M0, M1, M60, M2 and M30: at the end of the block.
    fn stop_words(&mut self, line: u32, words: &Words) -> Done {
        let Some((number, word)) = words.code(Group::Stop) else {
            return Ok(());
        };
        match number {
            0 => self.event(line, EventKind::ProgramStop),
            10 => self.event(line, EventKind::OptionalStop),
            600 => self.event(line, EventKind::PalletStop),
            20 | 300 => return self.leave_contour(line, words, word.offset),
            _ => {}
        }
        Ok(())
    }

    /// How many names have a value here.
    pub fn names(&self) -> usize {
        self.state.parameters().names() + self.frames.current().named.len()
    }

    /// Sets a parameter.
    pub fn assign(&mut self, target: Target, value: f64) {
        match target {
            Target::Numbered(number) => {
                if acts_in_fanuc(number) {
                    self.note(self.line, ACTS_IN_FANUC);
                }
                self.state.own_parameters().set(number, value);
            }
            Target::Named(name) if name.starts_with('_') => {
                self.state.own_parameters().set_named(name, value);
            }
            Target::Named(name) => {
                self.frames.here().named.insert(name, value);
            }
        }
    }

    /// Does what the comments of a line ask for, up to an ABORT.
    pub fn obey_comments(&mut self, comments: &[(CommentKind, String)], beside_o_word: bool) {
        for (kind, text) in comments {
            if beside_o_word {
                self.note(self.line, BESIDE_O_WORD);
            } else if self.ended.is_none() {
                self.obey_comment(*kind, text);
            }
        }
    }

    fn obey_comment(&mut self, kind: CommentKind, text: &str) {
        let line = self.line;
        if let Some(remark) = remark_of(kind) {
            self.note(line, remark);
        }
        match kind {
            CommentKind::Message => self.route.output.say(line, false, text.to_owned()),
            CommentKind::Debug if self.state.parameters().get(base::DEBUG_SHOWN) <= 0.0 => {}
            CommentKind::Debug | CommentKind::Print | CommentKind::Log => {
                let text = with_values(text, self);
                self.route.output.say(line, kind == CommentKind::Log, text);
            }
            CommentKind::ProbeOpen => self.questions.log_probes(true),
            CommentKind::ProbeClose => self.questions.log_probes(false),
            CommentKind::Abort => {
                let text = with_values(text, self);
                self.route.output.say(line, false, text);
                self.ended = Some(ProgramEnd::Abort(line));
            }
            // The reader refuses Python.
            CommentKind::LogFile | CommentKind::NoAbort | CommentKind::Python => {}
        }
    }

    /// Passes the arguments of a call: #1 and those behind it, as many as there are, are its own from here on.
    pub fn pass(&mut self, arguments: impl Iterator<Item = Option<f64>>) {
        let parameters = self.state.own_parameters();
        let mut kept = vec![];
        for (number, argument) in (1..).zip(arguments) {
            kept.push(parameters.if_set(number));
            parameters.put(number, argument);
        }
        self.frames.here().kept = kept;
    }

    /// Leaves the subroutine in force; none if there is none.
    pub fn leave(&mut self, returned: Option<f64>) -> Option<Frame> {
        let mut frame = self.frames.called.pop()?;
        if frame.arguments {
            for (number, value) in (1..).zip(std::mem::take(&mut frame.kept)) {
                self.state.own_parameters().put(number, value);
            }
        }
        let line = frame.called_from.line as u32 + 1;
        self.end_pass(line, frame.saved.take(), returned);
        Some(frame)
    }

    /// A subroutine ends, or a pass of it: modes that M73 has saved in it are restored.
    pub fn end_pass(
        &mut self,
        line: u32,
        saved: Option<(SavedModes, bool)>,
        returned: Option<f64>,
    ) {
        self.returned = (returned.unwrap_or(0.0), returned.is_some());
        if let Some((saved, true)) = saved {
            self.change(line, |state, acts| state.restore(&saved, acts));
        }
    }
}
