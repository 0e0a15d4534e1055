//! What a planner tells: where the path is, what happens there, what the program says, what it keeps at its end.

use bus::sample::{EventCode, Feedback, PlannerStatus, ProgramEvent, ProgramState};
use bus::user_codes::{CallId, UserCall};
use path::profile::PathState;

use super::Planner;
use crate::ahead::Course;
use crate::kept_parameters::Left;
use crate::situation::Situation;

impl Planner {
    /// What the program says around where the tool is: texts that the windows on the way may pass, and those that the path has come to.
    pub(super) fn say(&mut self, feedback: &Feedback) {
        self.messages.clear();
        // What stands behind a stop is said once somebody has resumed.
        let rests = self.rests_on_path(feedback).filter(|state| {
            feedback.hold == 0 && self.block_to_stop_behind(state, feedback).is_none()
        });
        // Texts carry the number of the run: before it has begun that is the one before.
        let runs = feedback.program == ProgramState::Running as u32
            && self.run == Some((feedback.load, feedback.run));
        let Some(tag) = Situation::of(feedback).tool_at.filter(|_| runs) else {
            return;
        };
        let published = [&self.in_force, &self.pending];
        let last = published.iter().filter_map(|window| window.states.last());
        let last = last.map(|state| state.element).max();
        let Some(course) = &mut self.course else {
            return;
        };
        let done = feedback.auxiliary.events_done;
        let within = tag.distance_mm > 0.0 || tag.dwell_remaining_scans > 0;
        let windows = &course.windows;
        let is_due = |element: u32, events: u32| {
            let begun = tag.element > element || tag.element == element && within;
            let before = rests.is_some_and(|state| windows.is_held_back(&state, element));
            begun || done > events || done == events && before
        };
        let until = last.unwrap_or(0).max(tag.element).saturating_add(1);
        let messages = &mut course.events.messages;
        if feedback.auxiliary.start_line != 0 {
            messages.skip(is_due);
            return;
        }
        messages.write(until, is_due, &mut self.messages);
        messages.pass(is_due);
    }

    /// The state that the axes rest in on the program's path, with nothing on the way.
    pub(super) fn rests_on_path(&self, feedback: &Feedback) -> Option<PathState> {
        let in_force = &self.in_force;
        let rests = feedback.at_rest == 1
            && !feedback.window.is_none()
            && feedback.window == in_force.header.id
            && !in_force.returns
            && self.pending.is_none();
        in_force.state_in(feedback.scan).filter(|_| rests)
    }

    /// The event that the path rests for now, on the program's path and with nothing on the way.
    fn event(&self, feedback: &Feedback) -> Option<ProgramEvent> {
        let situation = Situation::of(feedback);
        if situation.seeks_line.is_some() {
            return self.event_to_start(feedback);
        }
        let course = self.course.as_ref()?;
        if self.trouble.is_some() {
            return None;
        }
        let state = self.rests_on_path(feedback)?;
        if let Some(elements) = self.block_to_stop_behind(&state, feedback) {
            return Some(self.block_done(elements, feedback));
        }
        if situation.hold {
            return None;
        }
        let next = course.events.at_rest(feedback.auxiliary.events_done)?;
        course
            .windows
            .is_held_back(&state, next.element)
            .then_some(*next)
    }

    /// The line that the tool is in.
    pub(super) fn line(&self, feedback: &Feedback) -> u32 {
        let path = self.course.as_ref().map(|course| course.windows.path());
        let element = path.and_then(|path| path.get(Situation::of(feedback).tool_element()));
        element.map_or(0, |element| element.line)
    }

    pub(super) fn status(&self, feedback: &Feedback) -> PlannerStatus {
        let (path_length_mm, path_done_mm, program_hash) =
            self.course
                .as_ref()
                .map_or((0.0, 0.0, self.sought_hash()), |course| {
                    let path = course.windows.path();
                    // Off the path, what is done is what was done when it was left.
                    let tag = Situation::of(feedback).tool_at;
                    let tag = tag.unwrap_or(feedback.interrupted_at);
                    let behind = path.get(tag.element);
                    let before_mm = behind.map_or(0.0, |_| path.length_before_mm(tag.element));
                    let whole_mm = match course.is_over() {
                        true => path.length_mm(),
                        false => 0.0,
                    };
                    (whole_mm, before_mm + tag.distance_mm, course.program_hash)
                });
        let last = if self.pending.is_none() {
            &self.in_force
        } else {
            &self.pending
        };
        PlannerStatus {
            scan: feedback.scan,
            visible_from: feedback.scan.saturating_add(1),
            program_hash,
            published: last.header.id,
            path_length_mm,
            path_done_mm,
            incarnation: self.incarnation,
            finished: last.header.ends_program,
            cause: self.cause() as u32,
            windows: self.sequence,
            load: self.load,
            line: self.line(feedback),
            messages: self
                .course
                .as_ref()
                .map_or(0, |course| course.events.messages.passed),
            answered: self.answers.last().map_or(0, |kept| kept.answer.number),
            event: self.event(feedback).unwrap_or_default(),
            outputs_ahead: self
                .course
                .as_ref()
                .map_or_else(Default::default, |course| {
                    course.events.ahead(feedback.auxiliary.events_done)
                }),
            ..PlannerStatus::default()
        }
    }

    /// The user M-code that is to have run before this status is published, if the program rests before one that runs a program.
    pub(super) fn user_call(
        &self,
        status: &PlannerStatus,
        feedback: &Feedback,
    ) -> Option<UserCall> {
        let event = &status.event;
        let course = self.course.as_ref()?;
        let by_machine = self.machine.functions.machine_codes();
        let runs = event.code == EventCode::UserCode as u32 && !by_machine.contains(&event.index);
        runs.then(|| UserCall {
            id: CallId {
                load: feedback.load,
                run: feedback.run,
                event: event.number,
            },
            code: event.index,
            p: event.value,
            q: course.events.second_value(event.number),
            line: event.line,
        })
    }

    /// What is to be kept before this status is published, if the program is at its end.
    pub(super) fn to_keep(&self, status: &PlannerStatus) -> Option<Left> {
        let ends = status.event.code == EventCode::KeepParameters as u32;
        let course = self.course.as_ref().filter(|_| ends);
        course.map(Course::left)
    }
}
