//! The modal interpreter: blocks of words become path elements and events.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use path::geometry::{
    AxisVector, Element, Feed, MAX_AXES, RotaryAxes, Shape, displacement_length_mm,
};

use machine::{KeptParameters, Tool, is_always_kept};

use crate::arc::{ArcBlock, ArcTolerance, Circle};
use crate::compensation::Compensation;
use crate::cycles::{Cycle, Series};
use crate::expression::{Lookup, Target};
use crate::frames::{Frame, Frames};
use crate::letters::AXIS_LETTERS;
use crate::offsets::Offsets;
use crate::parameters::{NUMBER_MAX, Parameters, acts_in_fanuc, base};
use crate::program::{EventKind, ProgramEnd, Setup};
use crate::question::Question;
use crate::reader::{CommentKind, Line};
use crate::refusal::{Refusal, if_none, refuse};
use crate::snapshot;
use crate::splines::{Spline, SplineState};
use crate::state::{
    Carried, FeedMode, FeedWord, Happening, InSpindle, ModalState, Motion, Spindle, plane_of_code,
};
use crate::straight::{Axes, TRAVEL_ROUNDING};
use crate::surface::{FeedPerTurn, SurfaceSpeed};
use crate::threading::InStep;
use crate::words::{Group, Words};

mod arcs;
mod beside;
mod drilling;
mod machine_words;
mod modal;
mod modes;
mod names;
mod offsets;
mod once;
mod output;
mod path_mode;
mod questions;
mod say;
mod splines;
mod straight;
mod surface;
mod threads;
mod tool_words;
mod travel;
mod turning;
mod use_of_words;

pub use modal::Modal;
pub use output::{Bound, Counts, Output};
pub use turning::is_turning;

const MM_PER_INCH: f64 = 25.4;

/// What is said of a parameter that would act in Fanuc's language.
const ACTS_IN_FANUC: &str = "a parameter that sets an output (#1100 to #1135), an offset (#2001 to #2999) or a counter of parts (#3901, #3902) in Fanuc's language: here it is the program's own and sets nothing";

/// The state of a program at a block, and what it made so far. All that later blocks depend on is in here; a copy goes on from the
/// same place.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Interpreter {
    #[serde(skip)]
    pub setup: Arc<Setup>,
    #[serde(skip)]
    rotary: RotaryAxes,
    #[serde(skip)]
    axes: Axes,
    motion: Motion,
    modes: ModalState,
    /// What drilling cycles in a row keep; none between them.
    series: Option<Series>,
    splines: SplineState,
    /// G98 or G99 was said.
    return_was_said: bool,
    /// The last motion was in G61.1.
    stops_exactly: bool,
    tool: InSpindle,
    #[serde(with = "snapshot::tools")]
    tools: Arc<Vec<Tool>>,
    offsets: Offsets,
    /// Where the program is, in machine coordinates; the tool too, unless it stands beside.
    #[serde(with = "snapshot::vector")]
    position: AxisVector,
    /// Where the tool stands if it is beside that.
    #[serde(with = "snapshot::maybe_vector")]
    stands: Option<AxisVector>,
    /// The radius compensation that is on.
    beside: Option<Box<Compensation<Carried, Happening>>>,
    parameters: Parameters,
    /// What the program asks the machine, and how many answers it has had.
    #[serde(skip)]
    asked: Option<Question>,
    answers_taken: usize,
    /// Between PROBEOPEN and PROBECLOSE.
    logs_probes: bool,
    /// #<_value>, and whether the last subroutine returned one.
    returned: (f64, bool),
    pub frames: Frames,
    pub state_known: bool,
    /// A bit for each axis that a block was refused for, as long as it is outside its travel.
    #[serde(skip)]
    told_outside: u32,
    /// The line that is read, counted from 1.
    #[serde(skip)]
    pub line: u32,
    pub ended: Option<ProgramEnd>,
    pub output: Output,
}

impl Interpreter {
    pub fn new(setup: &Arc<Setup>, start: AxisVector) -> Self {
        let mut rotary = [false; MAX_AXES];
        for (flag, axis) in rotary.iter_mut().zip(&setup.axes) {
            *flag = axis.rotary;
        }
        let mut interpreter = Self {
            setup: setup.clone(),
            rotary,
            axes: Axes::of(setup),
            tools: Arc::new(setup.tools.clone()),
            position: start,
            state_known: true,
            ..Self::default()
        };
        if setup.tolerance_mm > 0.0 {
            interpreter.modes.path_control = 640;
        }
        interpreter.set_first_offsets();
        interpreter.begin();
        interpreter
    }

    /// Takes what a snapshot leaves out from a fresh one.
    pub fn complete(&mut self, fresh: &Self) {
        self.setup = fresh.setup.clone();
        self.rotary = fresh.rotary;
        self.axes = fresh.axes.clone();
        if self.tools == fresh.tools {
            self.tools = fresh.tools.clone();
        }
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
        self.show_position_parameters();
        (self.parameters, self.output)
    }

    /// The parameters that outlive the run: those that always do, and those that were kept before. M2 and M30 leave G54 in force.
    pub fn kept_parameters(&self) -> KeptParameters {
        let named = &self.setup.parameters;
        let kept = |number: &u32| is_always_kept(*number) || named.contains_key(number);
        let ends_by_word = matches!(self.ended, Some(ProgramEnd::M2(_) | ProgramEnd::M30(_)));
        let value = |number: u32| match number {
            base::WORK_OFFSET if ends_by_word => 1.0,
            _ => self.parameters.get(number),
        };
        let numbers = (1..=NUMBER_MAX).filter(kept);
        numbers.map(|number| (number, value(number))).collect()
    }

    /// The tools, as the program has changed them.
    pub fn tools(&self) -> &[Tool] {
        &self.tools
    }

    /// Keeps a remark, once of a kind, for its first line.
    pub fn note(&mut self, line: u32, text: &'static str) {
        self.output.notes.keep(line, text);
    }

    fn event(&mut self, line: u32, kind: EventKind) {
        self.happen(Happening::Event(line, kind));
    }

    /// Program units to mm.
    fn unit_mm(&self) -> f64 {
        if self.modes.inches { MM_PER_INCH } else { 1.0 }
    }

    /// Does one block in the order of NIST §3.8 and LinuxCNC's manual (*Order of Execution*); its refusals, none if it is done.
    pub fn run_block(
        &mut self,
        line: u32,
        block: &Line,
        words: &mut Words,
    ) -> Result<(), Vec<Refusal>> {
        words.sort(block, &self.setup)?;
        if !self.state_known {
            // A block before was refused: what this one would do is not known, only where the program ends.
            self.end_by(line, words);
            return Ok(());
        }
        self.execute(line, words)
    }

    fn execute(&mut self, line: u32, words: &mut Words) -> Result<(), Vec<Refusal>> {
        self.check_words_used(words)?;
        self.check_beside(words)?;
        self.feed_words(line, words)?;
        self.machine_words(line, words)?;
        if let Some(seconds) = self.dwell_seconds(line, words)?
            && seconds > 0.0
        {
            self.happen(Happening::Dwell(line, seconds));
        }
        self.modes(line, words)?;
        self.compensation_words(line, words)?;
        self.tool_length(line, words)?;
        self.work_offset_words(words);
        self.once(line, words)?;
        self.follow_centre(line);
        self.travel(line, words)?;
        self.stop_words(line, words);
        if let Some((20 | 300, word)) = words.code(Group::Stop) {
            self.leave_contour(words, word.offset)?;
        }
        self.end_by(line, words);
        Ok(())
    }

    /// Ends the program if the block says so.
    fn end_by(&mut self, line: u32, words: &Words) {
        match words.code(Group::Stop) {
            Some((20, _)) => self.ended = Some(ProgramEnd::M2(line)),
            Some((300, _)) => self.ended = Some(ProgramEnd::M30(line)),
            _ => {}
        }
    }

    /// How many names have a value here.
    pub fn names(&self) -> usize {
        self.parameters.names() + self.frames.current().named.len()
    }

    /// Sets a parameter.
    pub fn assign(&mut self, target: Target, value: f64) {
        match target {
            Target::Numbered(number) => {
                if acts_in_fanuc(number) {
                    self.note(self.line, ACTS_IN_FANUC);
                }
                self.parameters.set(number, value);
            }
            Target::Named(name) if name.starts_with('_') => self.parameters.set_named(name, value),
            Target::Named(name) => {
                self.frames.here().named.insert(name, value);
            }
        }
    }

    /// Passes the arguments of a call: #1 to #30 are its own from here on.
    pub fn pass(&mut self, arguments: &[f64]) {
        let mut kept = [0.0; crate::flow::ARGUMENTS_MAX];
        for (index, slot) in kept.iter_mut().enumerate() {
            let number = index as u32 + 1;
            *slot = self.parameters.get(number);
            let argument = arguments.get(index).copied().unwrap_or(0.0);
            self.parameters.set(number, argument);
        }
        self.frames.here().kept = kept;
    }

    /// Leaves the subroutine in force; none if there is none.
    pub fn leave(&mut self, returned: Option<f64>) -> Option<Frame> {
        let mut frame = self.frames.pop()?;
        self.returned = (returned.unwrap_or(0.0), returned.is_some());
        if frame.arguments {
            for (number, value) in (1u32..).zip(frame.kept) {
                self.parameters.set(number, value);
            }
        }
        if let Some((saved, true)) = frame.saved.take() {
            self.restore_modes(frame.called_from.line as u32 + 1, &saved);
        }
        Some(frame)
    }
}
