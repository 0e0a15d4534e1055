//! Keys that step the override, pressed faster than the cell answers: none of them is lost.

/// Step of a key, in percent.
const STEP: u32 = 10;

/// The override that the keys have asked for, as long as the cell is not there yet.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OverrideSteps {
    wanted: Option<u32>,
    asked: Option<u32>,
}

impl OverrideSteps {
    /// A key; `now` is the override of the cell and `most` the highest that it takes, in percent.
    pub fn step(&mut self, up: bool, now: u32, most: u32) {
        let from = self.wanted.unwrap_or(now);
        self.wanted = Some(match up {
            true => (from + STEP).min(most),
            false => from.saturating_sub(STEP),
        });
    }

    /// What is to be ordered next, in percent; none where nothing is, or it has been.
    pub fn next_order(&mut self) -> Option<u32> {
        if self.wanted == self.asked {
            return None;
        }
        self.asked = self.wanted;
        self.asked
    }

    /// The override of the cell, in percent, while no order is on its way.
    pub fn seen(&mut self, now: u32) {
        if self.wanted == Some(now) {
            *self = OverrideSteps::default();
        }
    }

    /// An order was refused, or not sent: the next key begins from what the cell has.
    pub fn give_up(&mut self) {
        *self = OverrideSteps::default();
    }
}

#[cfg(test)]
mod tests {
    use super::OverrideSteps;

    #[test]
    fn five_keys_before_the_first_answer_are_five_steps() {
        let mut steps = OverrideSteps::default();
        steps.step(false, 100, 100);
        assert_eq!(steps.next_order(), Some(90));
        for _ in 0..4 {
            steps.step(false, 100, 100);
        }
        assert_eq!(steps.next_order(), Some(50));
        assert_eq!(steps.next_order(), None);
        steps.seen(90);
        assert_eq!(steps.next_order(), None, "it is on its way");
        steps.seen(50);
        steps.step(true, 50, 100);
        assert_eq!(steps.next_order(), Some(60));
    }

    #[test]
    fn steps_end_at_0_and_100_and_begin_anew_after_a_refusal() {
        let mut steps = OverrideSteps::default();
        steps.step(true, 100, 100);
        assert_eq!(steps.next_order(), Some(100));
        steps.give_up();
        steps.step(false, 5, 100);
        assert_eq!(steps.next_order(), Some(0));
    }
}
