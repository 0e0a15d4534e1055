//! The motion digest: what the machine was reported and did, scan by scan.
//!
//! It covers scan, applied command, window, setpoint, encoder and table position of every axis; not roles, misses, roster or
//! standbys. Two runs with the same motion have the same digest, whoever computed it.

use bus::sample::{MAX_AXES, WindowId};
use xxhash_rust::xxh3::xxh3_128;

use crate::drives::DriveCommand;

/// Words of one axis: kind and up to three values of the command, encoder, table.
const AXIS_WORDS: usize = 6;
/// Words of a scan before its axes: the digest before (two), scan, window, setpoint.
const HEAD_WORDS: usize = 5;

/// A chain of XXH3-128: each scan's value is the hash of the one before and of what happened in the scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MotionDigest {
    value: u128,
    words: [u64; HEAD_WORDS + AXIS_WORDS * MAX_AXES],
    used: usize,
}

impl Default for MotionDigest {
    fn default() -> Self {
        Self::new()
    }
}

impl MotionDigest {
    /// Of nothing yet.
    pub fn new() -> MotionDigest {
        MotionDigest {
            value: 0,
            words: [0; HEAD_WORDS + AXIS_WORDS * MAX_AXES],
            used: 0,
        }
    }

    /// Goes on from a value that [`MotionDigest::end`] gave.
    pub fn resume(&mut self, [high, low]: [u64; 2]) {
        self.value = u128::from(high) << 64 | u128::from(low);
    }

    /// The value so far, high and low half.
    pub fn value(&self) -> [u64; 2] {
        [(self.value >> 64) as u64, self.value as u64]
    }

    fn push(&mut self, words: &[u64]) {
        for (place, word) in self.words.iter_mut().skip(self.used).zip(words) {
            *place = *word;
        }
        self.used += words.len();
    }

    /// Begins a scan.
    pub fn begin(&mut self, scan: u64, window: WindowId, setpoint: u32) {
        self.used = 0;
        let value = self.value;
        self.push(&[
            (value >> 64) as u64,
            value as u64,
            scan,
            window.checksum,
            u64::from(setpoint),
        ]);
    }

    /// Takes in one axis after its motion.
    pub fn axis(&mut self, command: &DriveCommand, encoder: i64, table_mm: f64) {
        let (kind, [a, b, c]) = command.parts();
        self.push(&[kind, a.to_bits(), b.to_bits()]);
        if matches!(command, DriveCommand::Position { .. }) {
            self.push(&[c.to_bits()]);
        }
        self.push(&[encoder as u64, table_mm.to_bits()]);
    }

    /// Ends the scan; the value so far, high and low half.
    pub fn end(&mut self) -> (u64, u64) {
        let used = self.words.get(..self.used).unwrap_or(&self.words);
        self.value = xxh3_128(bytemuck::cast_slice(used));
        let [high, low] = self.value();
        (high, low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest_of(scans: &[(u64, i64, f64)]) -> (u64, u64) {
        let mut digest = MotionDigest::new();
        let mut value = (0, 0);
        for &(scan, encoder, table_mm) in scans {
            digest.begin(scan, WindowId::NONE, 0);
            digest.axis(&DriveCommand::Disabled, encoder, table_mm);
            value = digest.end();
        }
        value
    }

    #[test]
    fn one_bit_in_any_scan_changes_all_that_follows() {
        let same = digest_of(&[(0, 1, 0.5), (1, 2, 0.6), (2, 3, 0.7)]);
        assert_eq!(same, digest_of(&[(0, 1, 0.5), (1, 2, 0.6), (2, 3, 0.7)]));
        assert_ne!(same, digest_of(&[(0, 1, 0.5), (1, 2, 0.6), (2, 4, 0.7)]));
        assert_ne!(
            same,
            digest_of(&[
                (0, 1, f64::from_bits(0.5f64.to_bits() + 1)),
                (1, 2, 0.6),
                (2, 3, 0.7)
            ])
        );
        assert_ne!(same, digest_of(&[(0, 1, 0.5), (2, 2, 0.6), (2, 3, 0.7)]));
    }
}
