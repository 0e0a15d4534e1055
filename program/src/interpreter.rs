//! The modal interpreter: blocks of words become path elements and events.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

use path::geometry::{
    AxisVector, Element, Feed, MAX_AXES, RotaryAxes, Shape, displacement_length_mm,
};

use machine::{KeptParameters, Tool, is_always_kept};

use crate::arc::{ArcBlock, ArcTolerance, Circle};
use crate::compensation::Compensation;
use crate::cycles::{Cycle, CycleBlock, PECKS_MAX, Series, Step};
use crate::execution::BLOCKS_MAX;
use crate::expression::{Lookup, Target};
use crate::frames::{Frame, Frames};
use crate::letters::AXIS_LETTERS;
use crate::parameters::{NUMBER_MAX, Parameters, acts_in_fanuc, base};
use crate::program::{Event, EventKind, Message, Note, ProgramEnd, Setup};
use crate::question::Question;
use crate::reader::{CommentKind, Line};
use crate::snapshot;
use crate::words::{Group, Refusal, Words};
use beside::{Carried, Happening};
use offsets::Offsets;
use splines::{Spline, SplineState};
use straight::Axes;
use threads::InStep;

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
pub use modes::{SavedModes, unknown_mode};
pub use output::{Bound, Output};
pub use surface::SurfaceSpeed;
pub use turning::is_turning;

const MM_PER_INCH: f64 = 25.4;

/// What a position may exceed the travel by and count as rounding: 1 nm.
const TRAVEL_ROUNDING: f64 = 1e-6;

/// The most elements of one path; an arc block makes up to two, a drilling block as many as it has moves.
pub const ELEMENTS_MAX: u64 = 2 * BLOCKS_MAX as u64;

/// What is said of a parameter that would act in Fanuc's language.
const ACTS_IN_FANUC: &str = "a parameter that sets an output (#1100 to #1135), an offset (#2001 to #2999) or a counter of parts (#3901, #3902) in Fanuc's language: here it is the program's own and sets nothing";

/// The most holes of one drilling block.
const REPEATS_MAX: f64 = 10_000.0;

/// The most turns of one arc.
const TURNS_MAX: f64 = 10_000.0;

/// Motion mode (modal group 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Motion {
    /// G80, and before the first motion word.
    None,
    Rapid,
    Line,
    Arc {
        clockwise: bool,
    },
    /// G38.2 to G38.5: ten times its number.
    Probe(u32),
    Cycle(Cycle),
    Spline(Spline),
    InStep(InStep),
}

/// What F means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum FeedMode {
    /// G94: length per minute.
    PerMinute,
    /// G93: blocks per minute.
    InverseTime,
    /// G95: length per revolution of the spindle.
    PerRevolution,
}

impl FeedMode {
    /// Number of its code.
    fn code(self) -> u32 {
        match self {
            FeedMode::InverseTime => 93,
            FeedMode::PerMinute => 94,
            FeedMode::PerRevolution => 95,
        }
    }
}

/// An F word: its value, and the length of its unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FeedWord {
    pub value: f64,
    pub unit_mm: f64,
}

/// What is known of the spindle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Spindle {
    /// S: in rev/min, in G96 in m/min or feet/min.
    pub speed: f64,
    /// 1 clockwise, −1 counter-clockwise, 0 stopped.
    pub direction: i32,
}

/// Which tool is where, and the length that is taken off it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct InSpindle {
    /// T: the next one.
    pub prepared: Option<u32>,
    /// The one in the spindle; 0 for none.
    pub number: u32,
    /// The one whose offset is applied; 0 where it is none's.
    pub offset_of: u32,
}

/// The state of a program at a block, and what it made so far. All that later blocks depend on is in here; a copy goes on from the
/// same place.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Interpreter {
    #[serde(skip)]
    pub setup: Arc<Setup>,
    #[serde(skip)]
    rotary: RotaryAxes,
    #[serde(skip)]
    axes: Axes,
    motion: Motion,
    /// Axis letters of the plane: first, second; with the offset letters that belong to them.
    plane: (u32, [char; 2], [char; 2]),
    inches: bool,
    incremental: bool,
    arc_absolute: bool,
    /// X words are diameters (G7).
    diameters: bool,
    feed_mode: FeedMode,
    feed: Option<FeedWord>,
    spindle: Spindle,
    /// G96.
    surface: Option<SurfaceSpeed>,
    coolant: [bool; 2],
    /// M50.
    feed_override: bool,
    /// M51.
    spindle_override: bool,
    /// What drilling cycles in a row keep; none between them.
    series: Option<Series>,
    splines: SplineState,
    returns_to_r: bool,
    /// G98 or G99 was said.
    return_was_said: bool,
    path_control: u32,
    /// P and Q of G64, in mm; none where nothing is said.
    path_words: [Option<f64>; 2],
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
    output: Output,
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
            motion: Motion::None,
            plane: (17, ['X', 'Y'], ['I', 'J']),
            inches: false,
            incremental: false,
            arc_absolute: false,
            diameters: false,
            feed_mode: FeedMode::PerMinute,
            feed: None,
            spindle: Spindle::default(),
            surface: None,
            coolant: [false; 2],
            feed_override: true,
            spindle_override: true,
            series: None,
            splines: SplineState::default(),
            returns_to_r: false,
            return_was_said: false,
            path_control: if setup.tolerance_mm > 0.0 { 640 } else { 610 },
            path_words: [None; 2],
            stops_exactly: false,
            tool: InSpindle::default(),
            tools: Arc::new(setup.tools.clone()),
            offsets: Offsets::default(),
            position: start,
            stands: None,
            beside: None,
            parameters: Parameters::default(),
            asked: None,
            answers_taken: 0,
            logs_probes: false,
            returned: (0.0, false),
            frames: Frames::default(),
            state_known: true,
            told_outside: 0,
            line: 0,
            ended: None,
            output: Output::default(),
        };
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

    /// What was made so far, as a number that grows with it.
    pub fn made(&self) -> u64 {
        self.output.made()
    }

    /// Everything that was made, for whoever takes it away.
    pub fn output(&mut self) -> &mut Output {
        &mut self.output
    }

    /// The remarks so far.
    pub fn notes(&self) -> Vec<Note> {
        self.output.notes.by_line()
    }

    /// How many elements were made.
    pub fn elements_made(&self) -> u64 {
        self.output.elements_made()
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
        if self.inches { MM_PER_INCH } else { 1.0 }
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
        let one = |refusal| vec![refusal];
        self.check_words_used(words).map_err(one)?;
        self.check_beside(words).map_err(one)?;
        self.feed_words(line, words).map_err(one)?;
        self.machine_words(line, words).map_err(one)?;
        if let Some(seconds) = self.dwell_seconds(line, words).map_err(one)?
            && seconds > 0.0
        {
            self.happen(Happening::Dwell(line, seconds));
        }
        self.modes(line, words).map_err(one)?;
        self.compensation_words(line, words)?;
        self.tool_length(line, words).map_err(one)?;
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
