//! The named inputs and outputs of a machine, as the master publishes them each scan.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::table;

/// The most signals that a machine can have.
pub const SIGNALS_MAX: usize = 128;

/// The most alarms that a machine can have.
pub const ALARMS_MAX: usize = 64;

/// Whether a bit of a set is in it.
pub fn has_bit(set: u64, index: usize) -> bool {
    let bit = u32::try_from(index).ok();
    bit.and_then(|bit| set.checked_shr(bit)).unwrap_or(0) & 1 == 1
}

/// A set with a bit taken in, or out.
pub fn with_bit(set: u64, index: usize, is_in: bool) -> u64 {
    let bit = u32::try_from(index).ok();
    let bit = bit.and_then(|bit| 1u64.checked_shl(bit)).unwrap_or(0);
    if is_in { set | bit } else { set & !bit }
}

/// A bit for each signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/SignalSet/1")]
#[repr(C)]
pub struct SignalSet {
    /// Bits of the first 64, and of the rest.
    pub words: [u64; SIGNALS_MAX / 64],
}
table!(SignalSet: words);

impl SignalSet {
    /// Whether this signal is in it.
    pub fn has(&self, index: usize) -> bool {
        let word = self.words.get(index / 64);
        word.is_some_and(|word| has_bit(*word, index % 64))
    }

    /// Takes a signal in, or out.
    pub fn set(&mut self, index: usize, is_in: bool) {
        if let Some(word) = self.words.get_mut(index / 64) {
            *word = with_bit(*word, index % 64, is_in);
        }
    }

    /// Whether there is none in it.
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|word| *word == 0)
    }
}

/// What all signals show in a scan, in the order of the machine file: 0 or 1 of a switch, a number of the others.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("quadrant/Signals/1")]
#[repr(C)]
pub struct Signals {
    /// The scan at whose end inputs were read, and in which outputs were commanded.
    pub scan: u64,
    /// First scan in which a reader may act on it.
    pub visible_from: u64,
    /// Signals whose source is lost: they have the value that the machine file names for that.
    pub lost: SignalSet,
    /// Signals that an operator holds at a value, whatever their source says.
    pub forced: SignalSet,
    /// Alarms that are there, a bit each in the order of the machine file.
    pub alarms: u64,
    /// Alarms that nobody has acknowledged since they came.
    pub unacknowledged: u64,
    /// Of each alarm, the scan in which it came last; 0 of one that never did.
    pub alarm_scans: [u64; ALARMS_MAX],
    /// Signals in use.
    pub count: u32,
    /// Alarms in use.
    pub alarm_count: u32,
    /// The values.
    pub values: [f64; SIGNALS_MAX],
}
table!(
    Signals: scan, visible_from, lost, forced, alarms, unacknowledged, alarm_scans, count, alarm_count,
    values @ Signals,
);

impl Signals {
    /// The values of the signals there are.
    pub fn values(&self) -> &[f64] {
        self.values
            .get(..self.count as usize)
            .unwrap_or(&self.values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_what_was_put_in_and_nothing_beyond_its_end() {
        let mut set = SignalSet::default();
        assert!(set.is_empty());
        for index in [0, 63, 64, SIGNALS_MAX - 1, SIGNALS_MAX, usize::MAX] {
            set.set(index, true);
            assert_eq!(set.has(index), index < SIGNALS_MAX, "{index}");
        }
        assert!(!set.has(1) && !set.has(65));
        set.set(63, false);
        assert!(!set.has(63) && set.has(64));
    }
}
