//! Programs of a cell that stays up: loaded, started, done, discarded.

use bus::sample::{Cause, EndedRun, Mode, OperatorRequest, Order, ProgramState, Refused};

use crate::drives::Drives;

use super::Master;
use super::axis_unit::AxisUnit;
use super::orders::{Refusal, whole_number};
use super::program::TypedBlocks;

impl<D: Drives> Master<D> {
    /// Takes another program; one that was started and is stopped is discarded.
    pub(super) fn order_load(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        self.must_stay()?;
        if request.session != 0 {
            return self.order_typed_blocks(request);
        }
        match self.mode() {
            Mode::Ready | Mode::Stopped | Mode::Disabled => {}
            Mode::Enabled => return Err(Refused::Running.into()),
            Mode::Stopping | Mode::Finished => return Err(Refused::NotAtRest.into()),
            Mode::Jogging => return Err(Refused::Jogging.into()),
            Mode::Tripped => return Err(Refused::Tripped.into()),
        }
        let number = whole_number(request.value)?;
        // Numbers go up: a late order does not bring an earlier program back.
        if number <= self.program.load() {
            return Err(Refused::BadValue.into());
        }
        if self.mode() == Mode::Stopped {
            self.modes.enter(Mode::Ready);
        }
        if self.program.is_running() {
            self.auxiliary.discard_program();
            self.note_end(Some(Order::Load));
        }
        self.read_program(number, None);
        Ok(())
    }

    /// Takes typed-in blocks, which begin as soon as they are read. The program that is loaded lies under another number too, by
    /// which it is read again behind them.
    fn order_typed_blocks(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        self.may_begin()?;
        let is_loaded = match self.program.state() {
            ProgramState::Loaded | ProgramState::Done => true,
            ProgramState::None => false,
            ProgramState::Loading => return Err(Refused::Loading.into()),
            ProgramState::Running => return Err(Refused::Running.into()),
        };
        let number = whole_number(request.value)?;
        let before = request.deadline_scans;
        // The other number is that of the program which is loaded now, and numbers go up.
        let is_of_loaded = request.session == self.program.load().saturating_add(1);
        if !is_of_loaded || number <= self.program.load() || before != 0 && before <= number {
            return Err(Refused::BadValue.into());
        }
        let typed = TypedBlocks {
            before: if is_loaded { before } else { 0 },
            end_program: request.axis == 1,
        };
        self.read_program(number, Some(typed));
        Ok(())
    }

    /// The planner is to read what lies under this number.
    fn read_program(&mut self, number: u32, typed: Option<TypedBlocks>) {
        self.windows.forget_path(self.scan);
        self.auxiliary.forget_program(self.scan);
        self.forget_program_cause();
        self.program.read_from(number, typed);
    }

    /// Typed-in blocks begin once they are read, where the machine is ready for them all that time. They are over once they are done, or
    /// the machine has stopped, tripped or been switched off.
    pub(super) fn step_typed_blocks(&mut self) {
        if !self.program.is_typed() {
            return;
        }
        match (self.program.state(), self.mode()) {
            (ProgramState::Loading, Mode::Ready) => {}
            (ProgramState::Loaded, _) if self.may_begin().is_ok() => self.begin_program(0),
            (ProgramState::Running, Mode::Disabled) => self.leave_typed_blocks(),
            (ProgramState::Running, Mode::Tripped) if self.modes.has_settled() => {
                self.leave_typed_blocks();
            }
            (ProgramState::Running, _) => {}
            _ => self.program.end_typed_blocks(),
        }
    }

    /// Typed-in blocks that were begun are given up.
    pub(super) fn leave_typed_blocks(&mut self) {
        if self.program.is_typed() && self.program.is_running() {
            self.leave_program();
        }
    }

    /// Begins the program that is loaded, from where the axes are. A hold that is latched stays: nothing moves then before
    /// somebody resumes. Where a number is given, that program is meant and no other; where a line is, it begins there.
    pub(super) fn order_start(&mut self, meant: u32, line: f64) -> Result<(), Refusal> {
        self.must_stay()?;
        let line = whole_number(line)?;
        if meant != 0 && meant != self.program.load() {
            return Err(Refused::BadValue.into());
        }
        self.may_begin()?;
        match self.program.state() {
            ProgramState::Loaded | ProgramState::Done => {}
            ProgramState::Loading => return Err(Refused::Loading.into()),
            ProgramState::Running => return Err(Refused::Running.into()),
            ProgramState::None => return Err(Refused::NoProgram.into()),
        }
        self.begin_program(line);
        Ok(())
    }

    /// Whether the machine is ready for a program.
    fn may_begin(&self) -> Result<(), Refusal> {
        let refused = match self.mode() {
            Mode::Ready if !self.axes.are_homed() => Refused::NotReferenced,
            Mode::Ready if !self.axes.are_within_travel() => Refused::OutsideTravel,
            Mode::Ready => return self.signals_allow(true),
            Mode::Enabled | Mode::Stopping | Mode::Stopped => Refused::Running,
            Mode::Finished => Refused::NotAtRest,
            Mode::Disabled => Refused::DrivesOff,
            Mode::Jogging => Refused::Jogging,
            Mode::Tripped => Refused::Tripped,
        };
        Err(refused.into())
    }

    /// Begins what is loaded, at a line where one is given.
    fn begin_program(&mut self, line: u32) {
        self.windows.forget_path(self.scan);
        self.auxiliary.forget_program(self.scan);
        self.forget_program_cause();
        self.auxiliary.seek_line(line);
        self.program.begin();
        self.modes.enable();
    }

    /// Gives up what is left of the program, which is loaded then, from its beginning; axes and drives stay as they are, and no hold is
    /// left. A trip is acknowledged as `enable` does it.
    pub(super) fn order_reset(&mut self) -> Result<(), Refusal> {
        self.must_stay()?;
        match self.program.state() {
            ProgramState::None => return Err(Refused::NoProgram.into()),
            ProgramState::Loading => return Err(Refused::Loading.into()),
            ProgramState::Loaded | ProgramState::Running | ProgramState::Done => {}
        }
        // Why it has stopped is known until it is acknowledged.
        let ended = self.end_of_run(self.scan, Some(Order::Reset));
        match self.mode() {
            Mode::Tripped => self.acknowledge(true)?,
            Mode::Disabled => {}
            _ => self.must_rest()?,
        }
        if self.program.is_running() {
            self.program.note_end(ended);
        }
        if matches!(self.mode(), Mode::Enabled | Mode::Stopped) {
            self.modes.enter(Mode::Ready);
        }
        self.modes.release();
        self.windows.forget_path(self.scan);
        self.auxiliary.forget_program(self.scan);
        self.auxiliary.discard_program();
        if self.mode() == Mode::Ready {
            self.clear_causes();
        }
        // Typed-in blocks that ended with the trip have left the program from before to be read again.
        if matches!(
            self.program.state(),
            ProgramState::Running | ProgramState::Done
        ) {
            self.program.end(false, self.scan);
        }
        self.program.end_typed_blocks();
        Ok(())
    }

    /// How a run that ends now does, in its last scan.
    pub(super) fn end_of_run(&self, scan: u64, order: Option<Order>) -> EndedRun {
        let ended = self.modes.end_run(scan, order);
        let axis = self.axes.get(ended.cause_axis as usize);
        EndedRun {
            drive_code: axis.map_or(0, AxisUnit::fault_code),
            ..ended
        }
    }

    /// The run that was begun ends in this scan.
    fn note_end(&mut self, order: Option<Order>) {
        let ended = self.end_of_run(self.scan, order);
        self.program.note_end(ended);
    }

    /// Comes to rest, on the path or where a jog is, then ends the run, also that of a cell that stays up: it was ordered to, or the
    /// launcher is gone; whether for the loss of a process. Nothing takes that back.
    pub fn end_after_stop(&mut self, for_loss: bool) {
        self.modes.order_end(for_loss);
        if self.mode() == Mode::Ready {
            self.modes.enter(Mode::Stopped);
        }
        self.stop();
    }

    /// The program is done, or has given itself up: the machine is ready for it again, from its beginning, or for another one. Why it was
    /// given up is shown until one begins. A program that was stopped otherwise stays where it is; typed-in blocks are given up.
    pub(super) fn leave_program(&mut self) {
        let done = self.mode() == Mode::Finished;
        if !done && self.modes.cause() != Cause::Abort && !self.program.is_typed() {
            return;
        }
        self.windows.forget_path(self.scan);
        if done {
            let leaves_spindle = self.program.leaves_spindle();
            self.auxiliary.end_run(self.program.run(), leaves_spindle);
        } else {
            self.auxiliary.discard_program();
        }
        self.note_end(None);
        self.program.end(done, self.scan);
        if self.program.is_typed() {
            // It was for them.
            self.modes.release();
        }
        self.program.end_typed_blocks();
        if matches!(self.mode(), Mode::Finished | Mode::Stopped) {
            self.modes.enter(Mode::Ready);
        }
    }

    /// The program before could not go on, or has given itself up: another one, or the same once more, can.
    fn forget_program_cause(&mut self) {
        self.modes
            .forget(&[Cause::Planner, Cause::Abort, Cause::ProbeJogged]);
    }

    fn must_stay(&self) -> Result<(), Refusal> {
        if self.modes.ends() {
            return Err(Refused::OneProgram.into());
        }
        Ok(())
    }
}
