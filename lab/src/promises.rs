//! What an operator was answered holds, whoever dies after the answer: a hold until somebody resumes, a stop until somebody brings
//! the machine on again. Pure: fed with answers and feedbacks, in order.

use bus::sample::{Feedback, Mode, Order};

use crate::invariants::{Violation, Violations};

/// Judges one run.
#[derive(Debug, Default)]
pub struct Promises {
    held: bool,
    stopped: bool,
    violations: Violations,
}

impl Promises {
    /// An order was obeyed.
    pub fn obeyed(&mut self, order: Order) {
        match order {
            Order::Hold => self.held = true,
            Order::Stop | Order::Down | Order::EmergencyStop => self.stopped = true,
            Order::Resume => (self.held, self.stopped) = (false, false),
            Order::Reset => (self.held, self.stopped) = (false, false),
            Order::Enable | Order::Start => self.stopped = false,
            Order::Override
            | Order::Disable
            | Order::Jog
            | Order::JogOn
            | Order::JogRenew
            | Order::Wheel
            | Order::Home
            | Order::Load
            | Order::OptionalStop
            | Order::SingleBlock
            | Order::RapidOverride
            | Order::JogOverride
            | Order::Signal
            | Order::SignalForce
            | Order::SignalRelease
            | Order::Acknowledge => {}
        }
    }

    /// The feedback that comes after these answers.
    pub fn take(&mut self, feedback: &Feedback) {
        if feedback.mode != Mode::Enabled as u32 {
            return;
        }
        let broken = [
            (self.held && feedback.hold == 0, "hold"),
            (self.stopped, "stop"),
        ];
        for (_, what) in broken.into_iter().filter(|(is_broken, _)| *is_broken) {
            let words = format!("a {what} that was answered is forgotten");
            self.violations.say(feedback.scan, words);
        }
    }

    /// What must not be.
    pub fn end(self) -> Vec<Violation> {
        self.violations.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn broken(orders: &[Order], mode: Mode, hold: u32) -> usize {
        let mut promises = Promises::default();
        orders.iter().for_each(|order| promises.obeyed(*order));
        promises.take(&Feedback {
            mode: mode as u32,
            hold,
            ..Feedback::zeroed()
        });
        promises.end().len()
    }

    #[test]
    fn an_answered_hold_or_stop_that_the_machine_forgets_is_seen() {
        assert_eq!(broken(&[Order::Hold], Mode::Enabled, 0), 1);
        assert_eq!(broken(&[Order::Hold], Mode::Enabled, 1), 0);
        assert_eq!(broken(&[Order::Hold, Order::Resume], Mode::Enabled, 0), 0);
        assert_eq!(broken(&[Order::Stop], Mode::Enabled, 0), 1);
        assert_eq!(broken(&[Order::Stop], Mode::Stopping, 0), 0);
        assert_eq!(broken(&[Order::Stop, Order::Enable], Mode::Enabled, 1), 0);
    }
}
