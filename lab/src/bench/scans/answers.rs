//! What a master sees of a cell that answers as it did on a tape.

use std::convert::Infallible;
use std::sync::Arc;

use bus::sample::{
    Feedback, Instruments, OperatorRequest, OperatorResponse, Roster, Setpoint, WindowHeader,
};
use master::saved::Latches;
use master::{Answered, Answers, Drives, Flow, MasterPorts};

use super::tape::Tape;
use crate::cell::{Queue, Window};

/// Ports of such a master.
pub(super) struct AnswersAgain<'a> {
    tape: &'a Tape,
    done: usize,
    answers: Answers,
    windows: Queue<Arc<Window>>,
    /// The feedback of the scan in progress is that of the tape.
    pub agrees: bool,
}

impl<'a> AnswersAgain<'a> {
    pub fn new(tape: &'a Tape) -> AnswersAgain<'a> {
        AnswersAgain {
            tape,
            done: 0,
            answers: Answers::of_axes(tape.roster.places().len()),
            windows: Queue::new(),
            agrees: true,
        }
    }
}

impl MasterPorts for AnswersAgain<'_> {
    type Error = Infallible;

    fn roster(&self) -> &Roster {
        &self.tape.roster
    }

    fn read_roster(&mut self) {}

    fn begin_scan(&mut self, feedback: &Feedback, _ask_planner: bool) -> Flow {
        let Some(scan) = self.tape.scans.get(self.done) else {
            return Flow::Leave;
        };
        // The whole of it is compared at the end alone: it would cost as much as the master.
        self.agrees = feedback.scan == scan.feedback.scan && feedback.mode == scan.feedback.mode;
        if self.done + 1 == self.tape.scans.len() {
            self.agrees &= *feedback == *scan.feedback;
        }
        Flow::GoOn
    }

    fn publish_instruments(&mut self, instruments: &Instruments) {
        std::hint::black_box(instruments);
    }

    fn save(&mut self, _latches: &Latches, _drives: &impl Drives) {}

    fn latch(&mut self, _latches: &Latches) {}

    fn await_answers(&mut self, _scan: u64, _ask_planner: bool) -> Result<Answered, Infallible> {
        self.answers.clear();
        if let Some(scan) = self.tape.scans.get(self.done) {
            let answers = self.answers.commands.iter_mut();
            for (answer, command) in answers.zip(&scan.commands) {
                if let Some(of_first) = answer.first_mut() {
                    *of_first = Some(*command);
                }
            }
            self.answers.planner = scan.status;
            for window in &scan.windows {
                self.windows.push(Arc::clone(window));
            }
        }
        self.done += 1;
        Ok(Answered::Scan { overrun_scans: 0 })
    }

    fn answers(&self) -> &Answers {
        &self.answers
    }

    fn serve_orders(
        &mut self,
        _scan: u64,
        _judge: impl FnMut(&OperatorRequest) -> (OperatorResponse, Latches),
    ) {
    }

    fn launcher_lives(&mut self, _scan: u64) -> Option<bool> {
        Some(true)
    }

    fn for_each_window(
        &mut self,
        scan: u64,
        mut offer: impl FnMut(&WindowHeader, &[Setpoint], &Roster),
    ) {
        while let Some(window) = self.windows.next(scan) {
            offer(&window.header, &window.setpoints, &self.tape.roster);
        }
    }

    fn finish(&mut self, _scan: u64) {}

    fn leave(&mut self) {}
}
