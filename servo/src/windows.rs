//! The windows of a servo: the one being executed, the one that waits, and the last one refused.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{Feedback, Setpoint, WindowHeader, WindowId};

use crate::held::{HeldWindow, Refusal, check_itself, check_seam};
use crate::settings::ServoSettings;

/// What a servo holds; all its memory is allocated at the start.
#[derive(Debug, Clone)]
pub(crate) struct Windows {
    /// Being executed.
    pub held: HeldWindow,
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
                Ok(&mut self.held)
            } else {
                check_seam(
                    settings,
                    &self.held,
                    &self.pending,
                    header,
                    setpoints,
                    feedback,
                )
                .map(|()| &mut self.pending)
            }
        });
        match judged {
            Ok(slot) => {
                slot.set(header, setpoints);
                Ok(())
            }
            Err(refusal) => {
                self.refused = id;
                Err(refusal)
            }
        }
    }

    /// Does as the feedback says: the pending window takes over, is void, or waits.
    pub fn follow(&mut self, feedback: &Feedback) {
        if !self.pending.is_none() {
            let id = self.pending.id();
            if feedback.window == id {
                core::mem::swap(&mut self.held, &mut self.pending);
                self.pending.clear();
            } else {
                let header = self.pending.header();
                let missed = feedback.scan >= header.first_scan;
                let orphaned = header.predecessor != feedback.window;
                if feedback.voided == id || missed || orphaned {
                    self.pending.clear();
                }
            }
        }
        if feedback.window.is_none() {
            self.held.clear();
        }
    }

    /// A servo that came late, after the last setpoint of the window in force: it knows all that is left of that window.
    pub fn take_what_is_left(&mut self, feedback: &Feedback) {
        if self.misses(feedback) && feedback.at_rest == 1 {
            self.held.stand(feedback);
        }
    }

    /// Whether the window in force is not held.
    pub fn misses(&self, feedback: &Feedback) -> bool {
        !feedback.window.is_none() && self.held.id() != feedback.window
    }
}
