//! An operator who waits until the machine rests, and then does what it says.

use bus::sample::{Feedback, Mode, OperatorRequest, Order, Refused};
use launcher::hints;
use machine::Restart;

use crate::cell::InProcessCell;

/// Orders in one run after which a machine that still rests does not go on.
const ORDERS_MAX: usize = 24;
/// Refusals in a row that a moment's wait should have ended.
const REFUSALS_MAX: u32 = 3;

/// Obeys the hints of a run.
#[derive(Debug)]
pub struct Operator {
    restart: Restart,
    given: Vec<(u64, Order)>,
    refusals: u32,
}

impl Operator {
    /// Of a cell with this policy.
    pub fn new(restart: Restart) -> Operator {
        Operator {
            restart,
            given: Vec::new(),
            refusals: 0,
        }
    }

    /// The orders given so far, each with its scan.
    pub fn given(self) -> Vec<(u64, Order)> {
        self.given
    }

    /// The last order, which was obeyed unless it was refused.
    pub fn last(&self) -> Option<Order> {
        let obeyed = self.refusals == 0;
        self.given
            .last()
            .filter(|_| obeyed)
            .map(|(_, order)| *order)
    }

    /// Gives a machine that rests the next order that it asks for.
    ///
    /// # Errors
    /// It says nothing, or refuses what it asks for: in words.
    pub fn obey(&mut self, cell: &mut InProcessCell, feedback: &Feedback) -> Result<(), String> {
        let state = state(feedback);
        let held_by_override = feedback.mode == Mode::Enabled as u32
            && feedback.hold == 0
            && feedback.override_percent == 0;
        let (order, value) = if held_by_override {
            (Order::Override, 100.0)
        } else {
            let hint = hints::waits_for(feedback, &self.restart);
            let order = hint.and_then(|hint| hint.orders.first().copied());
            let order =
                order.ok_or_else(|| format!("hangs, and nothing says what to do: {state}"))?;
            (order, 0.0)
        };
        if self.given.len() >= ORDERS_MAX {
            let last: Vec<&str> = self
                .given
                .iter()
                .rev()
                .take(3)
                .map(|(_, o)| o.word())
                .collect();
            return Err(format!(
                "does not go on, whatever it is ordered ({}): {state}",
                last.join(", ")
            ));
        }
        self.given.push((feedback.scan, order));
        let answer = cell.order(&OperatorRequest {
            order: order as u32,
            value,
            ..OperatorRequest::default()
        });
        match Refused::from_wire(answer.reason) {
            Some(Refused::Not) => self.refusals = 0,
            Some(Refused::NotReady | Refused::NotAtRest) if self.refusals < REFUSALS_MAX => {
                self.refusals += 1
            }
            reason => {
                let why = reason.map_or("for an unknown reason", Refused::words);
                let word = order.word();
                return Err(format!("asks for {word} and refuses it: {why}; {state}"));
            }
        }
        Ok(())
    }
}

/// Where a run stands that does not go on.
pub fn state(feedback: &Feedback) -> String {
    let mode = Mode::from_wire(feedback.mode).map_or("in no mode", Mode::word);
    let window = if feedback.window.is_none() {
        "no window"
    } else {
        "a window"
    };
    format!(
        "{mode}, hold {}, at rest {}, {window} in epoch {}, element {} at {} mm, left at element {}, cause {}",
        feedback.hold,
        feedback.at_rest,
        feedback.epoch,
        feedback.tag.element,
        feedback.tag.distance_mm,
        feedback.interrupted_at.element,
        feedback.cause,
    )
}
