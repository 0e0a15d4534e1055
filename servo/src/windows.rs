//! The windows of a servo: the one being executed, the one that waits, and the last one refused.

use bus::sample::{Feedback, Setpoint, WindowHeader, WindowId};

use crate::held::{HeldWindow, Refusal, check_itself, check_seam};
use crate::settings::ServoSettings;

/// What a servo holds; all its memory is allocated at the start.
#[derive(Debug, Clone)]
pub(crate) struct Windows {
    /// Being executed.
    pub held: HeldWindow,
    /// The one that it took over from: what was commanded in the scans before it. None where that is not known, or nothing was.
    pub before: HeldWindow,
    /// Accepted, and reported in each command until feedback names or voids it.
    pub pending: HeldWindow,
    /// The last one refused.
    pub refused: WindowId,
}

impl Windows {
    /// None yet.
    pub fn none() -> Windows {
        Windows {
            held: HeldWindow::none(),
            before: HeldWindow::none(),
            pending: HeldWindow::none(),
            refused: WindowId::NONE,
        }
    }

    /// A window became visible in the scan of this feedback.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn offer(
        &mut self,
        settings: &ServoSettings,
        header: &WindowHeader,
        setpoints: &[Setpoint],
        feedback: &Feedback,
    ) -> Result<(), Refusal> {
        self.follow(feedback);
        let id = header.id;
        if !id.is_none() && (id == self.held.id() || id == self.pending.id()) {
            return Ok(());
        }
        let judged = check_itself(settings, header, setpoints, feedback).and_then(|()| {
            if id == feedback.window {
                Ok(())
            } else {
                check_seam(
                    settings,
                    &self.held,
                    &self.pending,
                    header,
                    setpoints,
                    feedback,
                )
            }
        });
        match judged {
            Ok(()) if id == feedback.window => {
                core::mem::swap(&mut self.before, &mut self.held);
                self.held.set(header, setpoints);
                self.forget_stranger();
                Ok(())
            }
            Ok(()) => {
                self.pending.set(header, setpoints);
                Ok(())
            }
            Err(refusal) => {
                self.refused = id;
                Err(refusal)
            }
        }
    }

    /// What was held before the window in force, and is not what that follows, says nothing of the scans before it.
    fn forget_stranger(&mut self) {
        if self.before.id() != self.held.header.predecessor {
            self.before.clear();
        }
    }

    /// Does as the feedback says: the pending window takes over, is void, or waits.
    pub fn follow(&mut self, feedback: &Feedback) {
        if !self.pending.is_none() {
            let id = self.pending.id();
            if feedback.window == id {
                core::mem::swap(&mut self.before, &mut self.held);
                core::mem::swap(&mut self.held, &mut self.pending);
                self.pending.clear();
                self.forget_stranger();
            } else {
                let header = &self.pending.header;
                let missed = feedback.scan >= header.first_scan;
                let orphaned = header.predecessor != feedback.window;
                if feedback.voided == id || missed || orphaned {
                    self.pending.clear();
                }
            }
        }
        if feedback.window.is_none() {
            self.held.clear();
            self.before.clear();
        }
    }

    /// A servo that came late, after the last setpoint of the window in force: it knows all that is left of that window.
    pub fn take_what_is_left(&mut self, feedback: &Feedback) {
        if self.misses(feedback) && feedback.at_rest == 1 {
            self.held.stand(feedback);
            self.before.clear();
        }
    }

    /// Position command of this axis at a setpoint of the window in force; before its first that of the window before.
    pub fn position(&self, axis: usize, setpoint: i64) -> i64 {
        if setpoint >= 0 || self.before.is_none() {
            return self.held.position(axis, setpoint);
        }
        let [begins, began] = [&self.held, &self.before].map(|of| of.header.first_scan);
        let passed = i64::try_from(begins.saturating_sub(began)).unwrap_or(i64::MAX);
        self.before.position(axis, passed.saturating_add(setpoint))
    }

    /// Whether the window in force is not held.
    pub fn misses(&self, feedback: &Feedback) -> bool {
        !feedback.window.is_none() && self.held.id() != feedback.window
    }
}
