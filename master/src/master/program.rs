//! The program of a cell: loaded, started, done; and when a run ends by itself.
use bus::sample::{EndedRun, Feedback, Mode, ProgramState};

use crate::saved::Latches;

/// Typed-in blocks in [`Latches::typed`], and those that M2 or M30 ends.
const TYPED: u32 = 1;
const TYPED_WITH_END: u32 = 2;

/// When a run ends without an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunEnd {
    /// Never by itself: a cell that stays up, in which programs are loaded and started.
    WhenOrdered,
    /// When its one program is done, or the machine has stopped or tripped, and stands.
    AfterProgram,
}

/// The program of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Loaded {
    /// Its number; 0 is the one that the cell was started with, if it was with one.
    load: u32,
    state: ProgramState,
    /// Programs started so far.
    run: u32,
    /// Typed-in blocks have its place.
    typed: Option<TypedBlocks>,
    /// The first scan whose feedback shows that its last run is over.
    over_from: u64,
    /// The run that ended last.
    ended: EndedRun,
}

/// Typed-in blocks: they begin as soon as they are read, and are never the program that `start` begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TypedBlocks {
    /// Number under which the program that was loaded before is read again behind them; 0 where none was.
    pub before: u32,
    /// M2 or M30 ends them: spindle and coolant go off.
    pub end_program: bool,
}

impl Loaded {
    /// A cell that ends with its program has started it; one that stays up has none.
    pub fn new(run_end: RunEnd) -> Loaded {
        let (state, run) = match run_end {
            RunEnd::AfterProgram => (ProgramState::Running, 1),
            RunEnd::WhenOrdered => (ProgramState::None, 0),
        };
        Loaded {
            load: 0,
            state,
            run,
            typed: None,
            over_from: 0,
            ended: EndedRun::default(),
        }
    }

    /// Goes on where a master before this one left.
    pub fn resume(&mut self, latches: &Latches) {
        self.load = latches.load;
        self.run = latches.run;
        self.ended = latches.ended;
        self.typed = (latches.typed != 0).then_some(TypedBlocks {
            before: latches.typed_before,
            end_program: latches.typed == TYPED_WITH_END,
        });
        self.state = match ProgramState::from_wire(latches.program) {
            // What was started was counted.
            Some(ProgramState::Running) if latches.run == 0 => ProgramState::None,
            state => state.unwrap_or(ProgramState::None),
        };
    }

    /// What the feedback shows of it.
    pub fn tell(&self, feedback: &mut Feedback) {
        feedback.load = self.load;
        feedback.program = self.state as u32;
        feedback.run = self.run;
        feedback.ended = self.ended;
    }

    /// What must outlive this master.
    pub fn latch(&self, latches: &mut Latches) {
        latches.load = self.load;
        latches.program = self.state as u32;
        latches.run = self.run;
        latches.ended = self.ended;
        (latches.typed, latches.typed_before) = self.typed_latches();
    }

    pub fn load(&self) -> u32 {
        self.load
    }

    /// Whether an answer is to a feedback that shows this program, and no run of it that is over since.
    pub fn is_meant(&self, load: u32, scan: u64) -> bool {
        load == self.load && scan >= self.over_from
    }

    pub fn state(&self) -> ProgramState {
        self.state
    }

    pub fn run(&self) -> u32 {
        self.run
    }

    /// Whether typed-in blocks have its place.
    pub fn is_typed(&self) -> bool {
        self.typed.is_some()
    }

    /// The planner is to read what lies under this number.
    pub fn read_from(&mut self, number: u32, typed: Option<TypedBlocks>) {
        self.load = number;
        self.state = ProgramState::Loading;
        self.typed = typed;
    }

    /// It is started: one run more.
    pub fn begin(&mut self) {
        self.state = ProgramState::Running;
        self.run = self.run.saturating_add(1);
    }

    /// It is over in this scan: done, or given up and loaded from its beginning.
    pub fn end(&mut self, done: bool, scan: u64) {
        self.over_from = scan.saturating_add(1);
        self.state = if done {
            ProgramState::Done
        } else {
            ProgramState::Loaded
        };
    }

    /// Its run ended so.
    pub fn note_end(&mut self, ended: EndedRun) {
        self.ended = EndedRun {
            run: self.run,
            ..ended
        };
    }

    /// The typed-in blocks as they are saved: whether there are any and M2 ends them, and the number of the program before.
    fn typed_latches(&self) -> (u32, u32) {
        self.typed.map_or((0, 0), |typed| {
            let kind = if typed.end_program {
                TYPED_WITH_END
            } else {
                TYPED
            };
            (kind, typed.before)
        })
    }

    /// Whether spindle and coolant go on behind its end.
    pub fn leaves_spindle(&self) -> bool {
        self.typed.is_some_and(|typed| !typed.end_program)
    }

    /// Typed-in blocks are over: the program from before is read again, or none is loaded.
    pub fn end_typed_blocks(&mut self) {
        let Some(typed) = self.typed.take() else {
            return;
        };
        self.state = match typed.before {
            0 => ProgramState::None,
            before => {
                self.load = before;
                ProgramState::Loading
            }
        };
    }

    /// Whether it was started and is not done.
    pub fn is_running(&self) -> bool {
        self.state == ProgramState::Running
    }

    /// The planner has read it, or cannot; one that came back may refuse what the one before had read.
    pub fn read(&mut self, good: bool, mode: Mode) {
        let waits = !matches!(mode, Mode::Enabled | Mode::Stopping | Mode::Finished);
        match self.state {
            ProgramState::Loading if good => self.state = ProgramState::Loaded,
            ProgramState::Loading => self.state = ProgramState::None,
            ProgramState::Loaded | ProgramState::Done if !good && waits => {
                self.state = ProgramState::None;
            }
            _ => {}
        }
    }
}
