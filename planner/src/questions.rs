//! What a program asks, and what the machine has answered: kept for planners to come, so that all of a run read the same program.
//!
//! An answer is in three places. The master latches it before the feedback shows it, but only the last one. The planner appends it to a
//! file in the cell's folder before it reads on; so whichever of the two is killed, it is in the other. Until
//! the planner has said that it keeps the answer, the master wants no motion.

use bus::sample::{Answer, AnswerOutcome, Feedback};
use bytemuck::{Pod, Zeroable};
use machine::Machine;
use path::pivot::OutOfReach;
use xxhash_rust::xxh3::xxh3_64;

/// An answer as it is kept.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct KeptAnswer {
    /// What the master said.
    pub answer: Answer,
    /// 1 of a probe, 0 of an input.
    pub probes: u32,
    /// Its place in the run, counted from 0.
    pub index: u32,
    /// Of all that stands before it.
    checksum: u64,
}

/// Bytes of one that is kept.
pub const KEPT_BYTES: usize = size_of::<KeptAnswer>();

impl KeptAnswer {
    /// The answer in a feedback to the event of this number; none as long as it is not there.
    pub fn of(feedback: &Feedback, number: u32, probes: bool, index: u32) -> Option<KeptAnswer> {
        let answer = feedback.answer;
        let outcome = AnswerOutcome::from_wire(answer.outcome)?;
        let known = matches!(outcome, AnswerOutcome::Given | AnswerOutcome::Missed);
        let behind = number.saturating_add(u32::from(probes));
        let done = feedback.auxiliary.events_done >= behind;
        let mut kept = KeptAnswer {
            answer,
            probes: u32::from(probes),
            index,
            checksum: 0,
        };
        kept.checksum = kept.sum();
        (known && done && answer.number == number).then_some(kept)
    }

    fn sum(&self) -> u64 {
        let bytes = bytemuck::bytes_of(self);
        xxh3_64(
            bytes
                .get(..KEPT_BYTES - size_of::<u64>())
                .unwrap_or_default(),
        )
    }

    /// As the program takes it.
    ///
    /// # Errors
    /// The axes are where no program can go on from.
    pub fn for_program(&self, machine: &Machine) -> Result<program::Answer, OutOfReach> {
        program::Answer::said(machine, &self.answer, self.probes != 0)
    }
}

/// Hash of answers, in order.
pub(crate) fn hash_of(answers: &[KeptAnswer]) -> u64 {
    xxh3_64(bytemuck::cast_slice(answers))
}

/// The answers in a file, up to the first that is not whole: its writer was killed over it, and the next one writes it again.
pub fn kept_in(bytes: &[u8]) -> Vec<KeptAnswer> {
    let records = bytes.chunks_exact(KEPT_BYTES);
    let kept = records.map(bytemuck::pod_read_unaligned::<KeptAnswer>);
    let whole = |(index, kept): &(usize, KeptAnswer)| {
        kept.checksum == kept.sum() && kept.index as usize == *index
    };
    kept.enumerate()
        .take_while(whole)
        .map(|(_, kept)| kept)
        .collect()
}

#[cfg(test)]
#[allow(clippy::expect_used, clippy::indexing_slicing, clippy::panic)]
mod tests {
    use super::*;

    fn feedback(outcome: AnswerOutcome, done: u32) -> Feedback {
        let mut feedback = Feedback::zeroed();
        feedback.answer = Answer {
            value: 0.5,
            scan: 77,
            tripped: [1_000, -2_000, 3_000, 0, 0, 0, 0, 0, 0],
            rests: [1_500, -2_000, 3_000, 0, 0, 0, 0, 0, 0],
            number: 4,
            outcome: outcome as u32,
        };
        feedback.auxiliary.events_done = done;
        feedback
    }

    #[test]
    fn an_answer_is_taken_once_it_is_known_and_counted_and_to_the_question_alone() {
        use AnswerOutcome::{Awaited, Early, Given, Lost, Missed};
        for (outcome, done, number, taken) in [
            (Given, 5, 4, true),
            (Missed, 5, 4, true),
            (Given, 4, 4, false),
            (Given, 5, 3, false),
            (Given, 5, 6, false),
            (Awaited, 5, 4, false),
            (Early, 5, 4, false),
            (Lost, 5, 4, false),
        ] {
            let kept = KeptAnswer::of(&feedback(outcome, done), number, true, 0);
            assert_eq!(kept.is_some(), taken, "{outcome:?} {done} {number}");
        }
        assert!(KeptAnswer::of(&feedback(Given, 4), 4, false, 0).is_some());
    }

    #[test]
    fn a_file_is_read_up_to_the_record_that_is_not_whole() {
        let kept: Vec<KeptAnswer> = (0..3)
            .map(|index| {
                let feedback = feedback(AnswerOutcome::Given, 9);
                KeptAnswer::of(&feedback, 4, true, index).expect("an answer")
            })
            .collect();
        let bytes: Vec<u8> = bytemuck::cast_slice(&kept).to_vec();
        assert_eq!(kept_in(&bytes), kept);
        for length in 0..bytes.len() {
            assert_eq!(kept_in(&bytes[..length]).len(), length / KEPT_BYTES);
        }
        for bit in 0..bytes.len() * 8 {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            let record = bit / 8 / KEPT_BYTES;
            assert_eq!(kept_in(&damaged), kept[..record], "bit {bit}");
        }
    }

    #[test]
    fn places_reach_the_program_in_mm() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
        let machine = Machine::load(&folder).expect("the machine");
        let kept = |outcome| {
            let kept = KeptAnswer::of(&feedback(outcome, 9), 4, true, 0).expect("an answer");
            kept.for_program(&machine).expect("a place")
        };
        let mm = machine.axes[0].increment_mm();
        let program::Answer::Tripped { at, rests } = kept(AnswerOutcome::Given) else {
            panic!("it has tripped")
        };
        assert_eq!((at[0], rests[0], at[2]), (1e3 * mm, 1.5e3 * mm, 3e3 * mm));
        let missed = kept(AnswerOutcome::Missed);
        assert!(matches!(missed, program::Answer::Missed { rests } if rests[0] == 1.5e3 * mm));
    }
}
