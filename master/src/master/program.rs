//! The program of a cell: loaded, started, done; and when a run ends by itself.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{Mode, ProgramState};

use crate::saved::Latches;

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
    pub load: u32,
    /// How far it is.
    pub state: ProgramState,
    /// Programs started so far.
    pub run: u32,
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
        }
    }

    /// Goes on where a master before this one left.
    pub fn resume(&mut self, latches: &Latches) {
        self.load = latches.load;
        self.run = latches.run;
        self.state = match ProgramState::from_wire(latches.program) {
            // What was started was counted.
            Some(ProgramState::Running) if latches.run == 0 => ProgramState::None,
            state => state.unwrap_or(ProgramState::None),
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
