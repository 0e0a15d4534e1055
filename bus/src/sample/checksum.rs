//! The checksum at the end of a sample: what a bit that flipped in memory, or a stray write, cannot fake.

use bytemuck::{Pod, bytes_of};
use xxhash_rust::xxh3::xxh3_64;

/// XXH3-64 over all bytes of a sample but its last eight, which hold the checksum itself.
pub fn of<T: Pod>(sample: &T) -> u64 {
    let bytes = bytes_of(sample);
    let (said, _) = bytes
        .split_last_chunk::<{ size_of::<u64>() }>()
        .unwrap_or((bytes, &[0; 8]));
    xxh3_64(said)
}

#[cfg(test)]
mod tests {
    use bytemuck::{Zeroable, bytes_of_mut};

    use crate::sample::{AxisCommand, Feedback, PlannerStatus, Roster};
    use crate::service::Sample;

    /// One bit in any byte, the checksum's own among them.
    fn every_flipped_bit_shows<T: Sample + Zeroable>() {
        let mut sample = T::zeroed();
        if let Some(byte) = bytes_of_mut(&mut sample).get_mut(9) {
            *byte = 77;
        }
        assert!(!sample.is_whole(), "nobody has sealed it");
        sample.seal();
        assert!(sample.is_whole());
        for byte in 0..size_of::<T>() {
            let mut flipped = sample;
            if let Some(byte) = bytes_of_mut(&mut flipped).get_mut(byte) {
                *byte ^= 1 << (*byte % 8);
            }
            assert!(!flipped.is_whole(), "byte {byte}");
        }
    }

    #[test]
    fn no_flipped_bit_passes_for_a_sample() {
        every_flipped_bit_shows::<Feedback>();
        every_flipped_bit_shows::<AxisCommand>();
        every_flipped_bit_shows::<PlannerStatus>();
        every_flipped_bit_shows::<Roster>();
    }
}
