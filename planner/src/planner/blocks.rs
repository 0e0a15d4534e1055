//! Single block: the path rests at the end of each block until the master has latched the stop there and somebody has resumed.

use bus::sample::{EventCode, Feedback, ProgramEvent};
use path::profile::PathState;

use super::{From, Planner};

impl Planner {
    /// Elements of the path up to the end of the block that this state rests at, if single block is on and has not stopped there.
    pub(super) fn block_to_stop_behind(
        &self,
        state: &PathState,
        feedback: &Feedback,
    ) -> Option<u32> {
        let elements = self.course.as_ref()?.block_end(state)?;
        let is_new = elements > feedback.auxiliary.levels.blocks_done;
        (feedback.inputs.single_block() && is_new).then_some(elements)
    }

    /// The end of a block as the master is told of it.
    pub(super) fn block_done(&self, elements: u32, feedback: &Feedback) -> ProgramEvent {
        ProgramEvent {
            code: EventCode::BlockDone as u32,
            element: elements,
            line: self.line(feedback),
            ..ProgramEvent::default()
        }
    }

    /// Whether rapids stand, and what comes next is one.
    pub(super) fn waits_for_rapids(
        &self,
        state: &PathState,
        returns: bool,
        feedback: &Feedback,
    ) -> bool {
        let course = self.course.as_ref();
        feedback.inputs.rapid_override_percent() == 0
            && (returns || course.is_some_and(|course| course.is_before_rapid(state)))
    }

    /// Where the next window starts, which stays there if a block is to be stopped behind; none if the window in force does that already.
    pub(super) fn waiting_behind_block(&self, from: From, feedback: &Feedback) -> Option<From> {
        if from.returns {
            return Some(from);
        }
        let waits = self.block_to_stop_behind(&from.state, feedback).is_some();
        let in_force = feedback.window == self.in_force.header.id && !self.in_force.returns;
        let stays = in_force && self.in_force.states.last() == Some(&from.state);
        if waits && stays && !from.starts {
            return None;
        }
        let state = PathState {
            waits_for_start: waits,
            ..from.state
        };
        Some(From { state, ..from })
    }
}
