//! Programs of a cell that stays up: loaded, started, done, discarded.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{Cause, MODES_RESET, Mode, ProgramState, Refused};

use crate::drives::Drives;

use super::orders::{Refusal, whole_number};
use super::{Master, RunEnd};

impl<D: Drives> Master<D> {
    /// Whether the cell ends once the machine is.
    pub(super) fn ends(&self) -> bool {
        self.run_end == RunEnd::AfterProgram
    }

    /// The mode with drives on and no program started.
    pub(super) fn idle_mode(&self) -> Mode {
        if self.ends() {
            Mode::Stopped
        } else {
            Mode::Ready
        }
    }

    /// Takes another program; one that was started and is stopped is discarded, unless that is not meant.
    pub(super) fn order_load(&mut self, number: f64, spares: bool) -> Result<(), Refusal> {
        self.must_stay()?;
        if spares && self.program.is_running() {
            return Err(Refused::Running.into());
        }
        match self.mode {
            Mode::Ready | Mode::Stopped | Mode::Disabled => {}
            Mode::Enabled => return Err(Refused::Running.into()),
            Mode::Stopping | Mode::Finished => return Err(Refused::NotAtRest.into()),
            Mode::Jogging => return Err(Refused::Jogging.into()),
            Mode::Tripped => return Err(Refused::Tripped.into()),
        }
        let number = whole_number(number)?;
        // Numbers go up: a late order does not bring an earlier program back.
        if number <= self.program.load {
            return Err(Refused::BadValue.into());
        }
        if self.mode == Mode::Stopped {
            self.mode = Mode::Ready;
        }
        self.windows.forget_path(self.scan);
        self.auxiliary.forget_program(self.scan);
        if self.program.is_running() {
            self.auxiliary.latches.modes_of_run = MODES_RESET;
        }
        self.forget_program_cause();
        self.program.load = number;
        self.program.state = ProgramState::Loading;
        Ok(())
    }

    /// Begins the program that is loaded, from where the axes are. A hold that is latched stays: nothing moves then before
    /// somebody resumes. Where a number is given, that program is meant and no other; where a line is, it begins there.
    pub(super) fn order_start(&mut self, meant: u32, line: f64) -> Result<(), Refusal> {
        self.must_stay()?;
        let line = whole_number(line)?;
        if meant != 0 && meant != self.program.load {
            return Err(Refused::BadValue.into());
        }
        match self.mode {
            Mode::Ready if !self.is_homed() => return Err(Refused::NotReferenced.into()),
            Mode::Ready if !self.is_within_travel() => return Err(Refused::OutsideTravel.into()),
            Mode::Ready => {}
            Mode::Enabled | Mode::Stopping | Mode::Stopped => return Err(Refused::Running.into()),
            Mode::Finished => return Err(Refused::NotAtRest.into()),
            Mode::Disabled => return Err(Refused::DrivesOff.into()),
            Mode::Jogging => return Err(Refused::Jogging.into()),
            Mode::Tripped => return Err(Refused::Tripped.into()),
        }
        match self.program.state {
            ProgramState::Loaded | ProgramState::Done => {}
            ProgramState::Loading => return Err(Refused::Loading.into()),
            ProgramState::Running => return Err(Refused::Running.into()),
            ProgramState::None => return Err(Refused::NoProgram.into()),
        }
        self.windows.forget_path(self.scan);
        self.auxiliary.forget_program(self.scan);
        self.forget_program_cause();
        self.auxiliary.latches.start_line = line;
        self.program.state = ProgramState::Running;
        self.program.run = self.program.run.saturating_add(1);
        self.waited_scans = 0;
        self.mode = Mode::Enabled;
        Ok(())
    }

    /// Gives up what is left of the program, which is loaded then, from its beginning; axes and drives stay as they are, and no hold is
    /// left. A trip is acknowledged as `enable` does it.
    pub(super) fn order_reset(&mut self) -> Result<(), Refusal> {
        self.must_stay()?;
        match self.program.state {
            ProgramState::None => return Err(Refused::NoProgram.into()),
            ProgramState::Loading => return Err(Refused::Loading.into()),
            ProgramState::Loaded | ProgramState::Running | ProgramState::Done => {}
        }
        match self.mode {
            Mode::Tripped => self.acknowledge(true)?,
            Mode::Disabled => {}
            _ => self.must_rest()?,
        }
        if matches!(self.mode, Mode::Enabled | Mode::Stopped) {
            self.mode = Mode::Ready;
        }
        self.hold = false;
        self.windows.forget_path(self.scan);
        self.auxiliary.forget_program(self.scan);
        self.auxiliary.latches.modes_of_run = MODES_RESET;
        if self.mode == Mode::Ready {
            self.clear_causes();
        }
        self.program.state = ProgramState::Loaded;
        Ok(())
    }

    /// Comes to rest, on the path or where a jog is, then ends the run, also that of a cell that stays up: it was ordered to, or the
    /// launcher is gone. Nothing takes that back.
    pub fn end_after_stop(&mut self) {
        self.run_end = RunEnd::AfterProgram;
        self.ordered_to_end = true;
        if self.mode == Mode::Ready {
            self.mode = Mode::Stopped;
        }
        self.stop();
    }

    /// The program is done, or has given itself up: the machine is ready for it again, from its beginning, or for another one. Why it was
    /// given up is shown until one begins. A program that was stopped otherwise stays where it is.
    pub(super) fn leave_program(&mut self) {
        self.program.state = match (self.mode, self.cause) {
            (Mode::Finished, _) => ProgramState::Done,
            (_, Cause::Abort) => ProgramState::Loaded,
            _ => return,
        };
        self.windows.forget_path(self.scan);
        self.auxiliary.latches.modes_of_run = match self.program.state {
            ProgramState::Done => self.program.run,
            _ => MODES_RESET,
        };
        self.auxiliary.latches.end_program();
        self.mode = Mode::Ready;
    }

    /// The program before could not go on, or has given itself up: another one, or the same once more, can.
    fn forget_program_cause(&mut self) {
        if matches!(self.cause, Cause::Planner | Cause::Abort) {
            self.cause = Cause::None;
            self.cause_scan = 0;
        }
    }

    fn must_stay(&self) -> Result<(), Refusal> {
        if self.ends() {
            return Err(Refused::OneProgram.into());
        }
        Ok(())
    }
}
