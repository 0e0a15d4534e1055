//! A place between two blocks of a program from which a planner can read on without having read what stands before it.

use bytemuck::{Pod, Zeroable};
use xxhash_rust::xxh3::xxh3_64;

use crate::events::EventsBehind;

/// Elements between two places.
pub(crate) const PLACE_ELEMENTS: u32 = 4096;

/// Everything that the path from there on depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Of the program.
    pub program_hash: u64,
    /// The element that comes next.
    pub element: u32,
    /// Length of the path before it, in mm.
    pub start_mm: f64,
    /// The events before it.
    pub events: EventsBehind,
    /// How many answers of the machine the program has had before it.
    pub answers: u32,
    /// Hash of these: with others it is a place of another run.
    pub answers_hash: u64,
    /// What the reader of programs knows.
    pub reading: Vec<u8>,
}

/// As it is kept: this, then what the reader knows.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Head {
    /// Of all that follows.
    checksum: u64,
    program_hash: u64,
    answers_hash: u64,
    start_mm: f64,
    element: u32,
    events_last: u32,
    /// Bit 0: it turns; bit 1: its speed follows the radius.
    spindle: u32,
    spindle_changed_in_line: u32,
    answers: u32,
    messages: u32,
}

const CHECKSUM_BYTES: usize = size_of::<u64>();

impl Place {
    /// As bytes, to be kept.
    pub fn to_bytes(&self) -> Vec<u8> {
        let head = Head {
            checksum: 0,
            program_hash: self.program_hash,
            start_mm: self.start_mm,
            element: self.element,
            events_last: self.events.last,
            spindle: u32::from(self.events.spindle_turns)
                | u32::from(self.events.spindle_by_radius) << 1,
            spindle_changed_in_line: self.events.spindle_changed_in_line,
            answers_hash: self.answers_hash,
            answers: self.answers,
            messages: self.events.messages,
        };
        let mut bytes = bytemuck::bytes_of(&head).to_vec();
        bytes.extend_from_slice(&self.reading);
        let checksum = xxh3_64(bytes.get(CHECKSUM_BYTES..).unwrap_or_default());
        for (byte, of_checksum) in bytes.iter_mut().zip(checksum.to_ne_bytes()) {
            *byte = of_checksum;
        }
        bytes
    }

    /// What was kept; none if it is damaged.
    pub fn from_bytes(bytes: &[u8]) -> Option<Place> {
        let (head, reading) = bytes.split_at_checked(size_of::<Head>())?;
        let head: Head = bytemuck::try_pod_read_unaligned(head).ok()?;
        let checksum = xxh3_64(bytes.get(CHECKSUM_BYTES..)?);
        (head.checksum == checksum && head.start_mm.is_finite()).then(|| Place {
            program_hash: head.program_hash,
            element: head.element,
            start_mm: head.start_mm,
            events: EventsBehind {
                last: head.events_last,
                spindle_turns: head.spindle & 1 != 0,
                spindle_by_radius: head.spindle & 2 != 0,
                spindle_changed_in_line: head.spindle_changed_in_line,
                messages: head.messages,
            },
            answers: head.answers,
            answers_hash: head.answers_hash,
            reading: reading.to_vec(),
        })
    }
}

#[cfg(test)]
#[allow(clippy::expect_used, clippy::indexing_slicing)]
mod tests {
    use super::*;

    #[test]
    fn a_place_comes_back_as_it_was_kept_and_not_at_all_when_a_bit_is_wrong() {
        let place = Place {
            program_hash: 7,
            element: 4100,
            start_mm: 12.5,
            events: EventsBehind {
                last: 3,
                spindle_turns: true,
                spindle_by_radius: true,
                spindle_changed_in_line: 9,
                messages: 5,
            },
            answers: 2,
            answers_hash: 77,
            reading: vec![1, 2, 3],
        };
        let bytes = place.to_bytes();
        assert_eq!(Place::from_bytes(&bytes).as_ref(), Some(&place));
        for bit in 0..bytes.len() * 8 {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Place::from_bytes(&damaged), None, "bit {bit}");
        }
        assert_eq!(Place::from_bytes(&bytes[..20]), None);
    }
}
