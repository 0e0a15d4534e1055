//! The checksum at the end of a sample: what a bit that flipped in memory, or a stray write, cannot fake.

use bytemuck::{Pod, bytes_of};
use xxhash_rust::xxh3::xxh3_64;

/// XXH3-64 over so many bytes of a sample from its beginning, but for its last eight, which hold the checksum itself.
pub fn of<T: Pod>(sample: &T, used_bytes: usize) -> u64 {
    let said = size_of::<T>() - size_of::<u64>();
    xxh3_64(
        bytes_of(sample)
            .get(..used_bytes.min(said))
            .unwrap_or_default(),
    )
}

#[cfg(test)]
mod tests {
    use bytemuck::{Zeroable, bytes_of_mut};

    use crate::sample::{AxisCommand, Feedback, PlannerStatus, Roster};
    use crate::service::Sample;

    /// One bit in any byte, the checksum's own among them.
    fn every_flipped_bit_shows<T: Sample + Zeroable>(set: impl Fn(&mut T)) {
        let mut sample = T::zeroed();
        set(&mut sample);
        if let Some(byte) = bytes_of_mut(&mut sample).get_mut(9) {
            *byte = 77;
        }
        assert!(!sample.is_whole(), "nobody has sealed it");
        sample.seal();
        assert!(sample.is_whole());
        let used = sample.used_bytes().min(size_of::<T>() - size_of::<u64>());
        for byte in (0..used).chain(size_of::<T>() - size_of::<u64>()..size_of::<T>()) {
            let mut flipped = sample;
            if let Some(byte) = bytes_of_mut(&mut flipped).get_mut(byte) {
                *byte ^= 1 << (*byte % 8);
            }
            assert!(!flipped.is_whole(), "byte {byte}");
        }
    }

    #[test]
    fn no_flipped_bit_passes_for_a_sample() {
        every_flipped_bit_shows::<Feedback>(|feedback| feedback.axis_count = 3);
        every_flipped_bit_shows::<AxisCommand>(|_| {});
        every_flipped_bit_shows::<PlannerStatus>(|_| {});
        every_flipped_bit_shows::<Roster>(|_| {});
    }
}
