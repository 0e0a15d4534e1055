//! Why drives are silent, as far as the wire tells.

use bus::drive_codes::Silence;
use bus::drive_page::Inputs;

use super::cia402_drives::WireAnswer;

/// What cycle after cycle tells of it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SilenceSeen {
    /// Late answers that had been counted when one came in time last.
    late_before: u64,
    /// What is known best of the cycles in a row that were not answered.
    told: Option<Silence>,
}

impl SilenceSeen {
    /// Takes what came of a cycle; why a drive that is silent in it is. Of cycles in a row the reason that says most counts.
    pub fn take(&mut self, answer: WireAnswer, inputs: &Inputs) -> Silence {
        let anybody = || inputs.slaves.iter().any(|of| of.answered == 1);
        let now = match answer {
            WireAnswer::Down => Silence::BusDown,
            WireAnswer::OwnerSilent => Silence::Owner,
            WireAnswer::Answered if anybody() => Silence::Alone,
            WireAnswer::Answered => Silence::Nobody,
            WireAnswer::Missed if inputs.no_link == 1 => Silence::NoLink,
            WireAnswer::Missed if inputs.counts.late > self.late_before => Silence::Late,
            WireAnswer::Missed => Silence::Nobody,
        };
        let told = match answer {
            WireAnswer::Answered | WireAnswer::Down => now,
            WireAnswer::Missed | WireAnswer::OwnerSilent => {
                self.told.map_or(now, |before| before.min(now))
            }
        };
        if answer == WireAnswer::Answered {
            self.late_before = inputs.counts.late;
        }
        self.told = (answer != WireAnswer::Answered).then_some(told);
        told
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn of_cycles_in_a_row_the_reason_that_says_most_is_told_until_one_is_answered() {
        let mut seen = SilenceSeen::default();
        let mut inputs = Inputs::zeroed();
        let mut take = |answer, late: u64, no_link: u64| {
            inputs.counts.late = late;
            inputs.no_link = no_link;
            seen.take(answer, &inputs)
        };
        use WireAnswer::{Answered, Down, Missed, OwnerSilent};
        assert_eq!(take(Answered, 3, 0), Silence::Nobody);
        assert_eq!(take(OwnerSilent, 3, 0), Silence::Owner);
        assert_eq!(take(Missed, 3, 0), Silence::Nobody);
        assert_eq!(take(Missed, 4, 0), Silence::Late);
        assert_eq!(take(OwnerSilent, 4, 0), Silence::Late);
        assert_eq!(take(Missed, 4, 1), Silence::NoLink);
        assert_eq!(take(Down, 4, 0), Silence::BusDown);
        take(Answered, 4, 0);
        assert_eq!(take(Missed, 4, 0), Silence::Nobody);
    }
}
