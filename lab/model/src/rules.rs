//! What must never happen, judged after every step.

use bus::sample::{AxisCommand, Feedback, Job, Mode, WindowId};

use crate::bench::{LENGTH_BEFORE_MM, STEP_MAX_MM};
use crate::cell::Cell;

/// A rule that was broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Broken {
    /// An axis was driven by another window, or another setpoint, than the feedback names.
    Window,
    /// The drive of an axis heard the other servo although the active one had answered well.
    TwoWriters,
    /// The tool left the path, went back on it or skipped a part of it.
    Path,
    /// A command or a window of a process that the roster does not name.
    Incarnation,
    /// A run that had ended went on, was started again, or took an order.
    Ended,
    /// A scan was published twice.
    Scan,
    /// A machine that was ordered to stop, and reported so, moved on by itself.
    Stop,
}

/// What the rules remember.
#[derive(Debug, Clone, Copy, Default)]
pub struct Ghost {
    /// The first rule that was broken.
    pub broken: Option<Broken>,
    /// How far the tool has come along the path, in mm.
    pub progress_mm: f64,
    /// The window in force before.
    pub window: WindowId,
    /// The last feedback has been published.
    pub ended: bool,
    /// A stop was ordered and accepted, and nobody has ordered to go on since.
    pub stopped: bool,
    /// An order to go on was accepted in the last scan.
    pub went_on: bool,
    /// Incarnation of the servo whose command was taken last, by place.
    pub taken: [u32; 4],
    /// Scans without motion off the path, up to [`STILL_MAX`].
    pub still: u8,
}

/// After so many scans at rest on the way back to the path nothing but a counter changes: faults are the same as before.
pub const STILL_MAX: u8 = 8;

impl Cell {
    /// Judges a feedback that is about to be published.
    pub fn judge_feedback(&mut self, feedback: &Feedback) {
        if self
            .feedback
            .is_some_and(|before| before.scan >= feedback.scan)
        {
            self.broken(Broken::Scan);
        }
        // Resumed at the programmed end, a program is finished at once.
        let finished = feedback.mode == Mode::Finished as u32;
        if self.ghost.ended || feedback.last == 1 && self.ghost.went_on && !finished {
            self.broken(Broken::Ended);
        }
        self.ghost.ended |= feedback.last == 1;
        self.judge_path(feedback);
        self.judge_stop(feedback);
        self.judge_rest(feedback);
        self.ghost.window = feedback.window;
    }

    /// The setpoints that are executed are the path, in order and without a gap.
    fn judge_path(&mut self, feedback: &Feedback) {
        if feedback.window.is_none() || feedback.tag.is_off_path() {
            return;
        }
        let before_mm = LENGTH_BEFORE_MM.get(feedback.tag.element as usize);
        let at_mm = before_mm.map(|before| before + feedback.tag.distance_mm);
        let from_mm = self.ghost.progress_mm;
        let good = at_mm
            .is_some_and(|at| at >= from_mm - 1e-9 && at <= from_mm + STEP_MAX_MM * 1.001 + 1e-9);
        if !good {
            self.broken(Broken::Path);
        }
        self.ghost.progress_mm = at_mm.unwrap_or(from_mm);
        let window = self.window(feedback.window).map(|window| window.header);
        let begins = feedback.window != self.ghost.window;
        let follows = window.is_some_and(|header| {
            header.predecessor == self.ghost.window
                && (!header.predecessor.is_none() || header.epoch == feedback.epoch)
        });
        if begins && !follows {
            self.broken(Broken::Path);
        }
    }

    /// Who was ordered to stop takes no further window.
    fn judge_stop(&mut self, feedback: &Feedback) {
        let another = feedback.window != self.ghost.window && !feedback.window.is_none();
        let moves = feedback.mode == Mode::Enabled as u32;
        if self.ghost.stopped && (another || moves) {
            self.broken(Broken::Stop);
        }
    }

    fn judge_rest(&mut self, feedback: &Feedback) {
        let before = self.feedback.map(|before| before.axes);
        let same = before.is_some_and(|before| {
            let mut pairs = before.iter().zip(&feedback.axes);
            pairs.all(|(b, a)| b.command_position == a.command_position)
        });
        let waits = same && feedback.tag.is_off_path() && !feedback.window.is_none();
        self.ghost.still = if waits {
            (self.ghost.still + 1).min(STILL_MAX)
        } else {
            0
        };
    }

    /// A window that the master has accepted is of the planner that the roster names then.
    pub fn judge_windows(&mut self, known: [WindowId; 2], now: [WindowId; 2]) {
        let planner = self.roster.living(Job::Planner, 0, 0);
        let incarnation = planner.map(|planner| planner.incarnation);
        let of_another = |id: &WindowId| !id.is_none() && Some(id.incarnation) != incarnation;
        let mut news = now.iter().filter(|id| !known.contains(id));
        if news.any(of_another) {
            self.broken(Broken::Incarnation);
        }
    }

    /// Judges what was taken in the scan of `feedback`, which `next` shows, on the axes that followed a servo.
    pub fn judge_taken(
        &mut self,
        feedback: &Feedback,
        next: &Feedback,
        followed: [bool; 2],
        commands: &[Option<AxisCommand>; 4],
    ) {
        let takes_over = next.window != feedback.window && !next.window.is_none();
        for (axis, followed) in followed.into_iter().enumerate() {
            let shown = next.axes[axis];
            if takes_over && !self.holds(axis, shown.taken_role, next.window) {
                self.broken(Broken::Window);
            }
            // Nobody's was: the drive holds the last one, or the master commands the axis.
            if !followed {
                continue;
            }
            let place = axis * 2 + shown.taken_role as usize;
            let Some(command) = commands[place] else {
                // Nobody answered, and somebody's answer was taken.
                self.broken(Broken::Incarnation);
                continue;
            };
            let named = self.roster.living(Job::Servo, axis, shown.taken_role);
            let named = named.is_some_and(|named| named.incarnation == shown.taken_incarnation);
            if !named || shown.taken_incarnation < self.ghost.taken[place] {
                self.broken(Broken::Incarnation);
            }
            self.ghost.taken[place] = shown.taken_incarnation;
            self.judge_switch(feedback, axis, shown.taken_role, commands);
            self.judge_setpoint(feedback, axis, &command);
        }
    }

    /// Whether the active servo of an axis holds a window.
    fn holds(&self, axis: usize, role: u32, window: WindowId) -> bool {
        let mut servos = self.servos.iter();
        let active = servos.find(|s| s.axis == axis && s.role == role as usize);
        active.is_some_and(|s| s.servo.windows().iter().any(|header| header.id == window))
    }

    /// The switch stays where it is as long as the active servo answers.
    fn judge_switch(
        &mut self,
        feedback: &Feedback,
        axis: usize,
        role: u32,
        commands: &[Option<AxisCommand>; 4],
    ) {
        let before = feedback.axes[axis];
        let active = self.roster.living(Job::Servo, axis, before.taken_role);
        let Some(active) = active.filter(|_| before.taken_role != role) else {
            return;
        };
        let answered = commands[axis * 2 + before.taken_role as usize]
            .is_some_and(|c| c.cause == 0 && c.incarnation == active.incarnation);
        if answered && is_closed(feedback) && before.taken_incarnation == active.incarnation {
            self.broken(Broken::TwoWriters);
        }
    }

    /// An axis that is driven along a window is at its setpoint.
    fn judge_setpoint(&mut self, feedback: &Feedback, axis: usize, command: &AxisCommand) {
        if !is_closed(feedback) || feedback.window.is_none() || command.cause != 0 {
            return;
        }
        let setpoint = self.window(feedback.window).and_then(|window| {
            let last = window.setpoints.len().saturating_sub(1);
            window.setpoints.get((feedback.setpoint as usize).min(last))
        });
        let good = setpoint.is_some_and(|s| s.position[axis] == command.position);
        if command.held != feedback.window || !good {
            self.broken(Broken::Window);
        }
    }
}

/// Whether the loops are closed.
fn is_closed(feedback: &Feedback) -> bool {
    !matches!(
        Mode::from_wire(feedback.mode),
        Some(Mode::Disabled | Mode::Tripped) | None
    )
}
