//! Process data: what goes to a drive and comes back in each cycle, bit by bit.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::cia402::{self, OperatingMode};
use crate::field::Field;

/// A process data object to exchange, and what is in it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Pdo {
    /// Its index: 0x1600 to 0x17FF of what the device receives, 0x1A00 to 0x1BFF of what it transmits.
    #[schemars(extend("minimum" = 0x1600, "maximum" = 0x1BFF))]
    pub index: u16,
    /// Its entries, in the order of their bits.
    #[schemars(length(min = 1, max = 255))]
    pub entries: Vec<Entry>,
}

/// An entry of a PDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Entry {
    /// Index of the object; 0 for a gap.
    #[schemars(extend("minimum" = 0, "maximum" = 0xFFFF, "default" = 0))]
    pub index: u16,
    /// Sub-index of the object.
    #[schemars(extend("minimum" = 0, "maximum" = 255, "default" = 0))]
    pub sub: u8,
    /// Its size.
    #[schemars(extend("unit" = "bits", "minimum" = 1, "maximum" = 65_536))]
    pub bits: u32,
    /// What is sent where the controller has no command for the object: a torque limit, say. In what the device transmits it means
    /// nothing.
    #[schemars(extend("minimum" = -2_147_483_648_i64, "maximum" = 4_294_967_295_i64, "default" = 0))]
    pub value: i64,
}

impl Entry {
    /// An object of so many bits.
    pub fn of(index: u16, sub: u8, bits: u32) -> Entry {
        Entry {
            index,
            sub,
            bits,
            value: 0,
        }
    }

    /// Whether it holds nothing.
    pub fn is_gap(&self) -> bool {
        self.index == 0
    }

    /// It in words.
    pub fn words(&self) -> String {
        if self.is_gap() {
            format!("a gap of {} bits", self.bits)
        } else {
            let object = cia402::number(self.index, self.sub);
            format!("{object} of {} bits", self.bits)
        }
    }
}

/// PDOs as an axis of a drive sees them, from 0: objects of others are gaps.
pub fn of_axis(pdos: &[Pdo], axis: u16) -> Vec<Pdo> {
    let seen = |entry: &Entry| match cia402::seen_by(entry.index, axis) {
        Some(index) => Entry { index, ..*entry },
        None => Entry::of(0, 0, entry.bits),
    };
    let pdos = pdos.iter().map(|pdo| Pdo {
        index: pdo.index,
        entries: pdo.entries.iter().map(seen).collect(),
    });
    pdos.collect()
}

/// Size of PDOs that are sent one behind the other, in bits.
pub fn bits(pdos: &[Pdo]) -> u32 {
    let entries = pdos.iter().flat_map(|pdo| &pdo.entries);
    entries.fold(0, |bits, entry| bits.saturating_add(entry.bits))
}

/// Their size in bytes, begun ones counted.
pub fn bytes(pdos: &[Pdo]) -> u32 {
    bits(pdos).div_ceil(8)
}

/// Where an object begins, in bits from the start of the process data of its direction, and its entry.
pub fn find(pdos: &[Pdo], index: u16, sub: u8) -> Option<(u32, Entry)> {
    let mut at_bits: u32 = 0;
    for entry in pdos.iter().flat_map(|pdo| &pdo.entries) {
        if !entry.is_gap() && (entry.index, entry.sub) == (index, sub) {
            return Some((at_bits, *entry));
        }
        at_bits = at_bits.saturating_add(entry.bits);
    }
    None
}

/// Where an object is in the image of its direction.
pub fn field(pdos: &[Pdo], index: u16, sub: u8) -> Option<Field> {
    let (at_bits, entry) = find(pdos, index, sub)?;
    Some(Field {
        at_bits: at_bits as usize,
        bits: entry.bits,
    })
}

/// What is sent where there is no command: fields of what the device receives, and their values.
pub fn constants(receive: &[Pdo]) -> Vec<(Field, i64)> {
    let mut at_bits = 0;
    let mut constants = Vec::new();
    for entry in receive.iter().flat_map(|pdo| &pdo.entries) {
        let bits = entry.bits;
        if !entry.is_gap() && entry.value != 0 && bits <= 32 {
            constants.push((Field { at_bits, bits }, entry.value));
        }
        at_bits += bits as usize;
    }
    constants
}

/// Which of these objects (sub-index 0) are not there.
pub fn missing(pdos: &[Pdo], objects: &[u16]) -> Vec<u16> {
    let mut objects = objects.to_vec();
    objects.retain(|index| find(pdos, *index, 0).is_none());
    objects
}

/// Whether process data in both directions holds what a mode cannot do without.
pub fn holds(receive: &[Pdo], transmit: &[Pdo], mode: OperatingMode) -> bool {
    missing(receive, mode.receive_needed()).is_empty()
        && missing(transmit, mode.transmit_needed()).is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_gaps() -> Vec<Pdo> {
        let entries = [
            Entry::of(0x6040, 0, 16),
            Entry::of(0x2601, 0, 1),
            Entry::of(0, 0, 7),
            Entry::of(0x60FF, 0, 32),
        ];
        vec![Pdo {
            index: 0x1600,
            entries: entries.to_vec(),
        }]
    }

    #[test]
    fn gaps_of_bits_count_and_are_never_found() {
        let pdos = with_gaps();
        assert_eq!((bits(&pdos), bytes(&pdos)), (56, 7));
        assert_eq!(find(&pdos, 0x60FF, 0), Some((24, Entry::of(0x60FF, 0, 32))));
        assert_eq!(find(&pdos, 0, 0), None);
    }

    #[test]
    fn the_second_pdo_begins_where_the_first_ends() {
        let mut pdos = with_gaps();
        pdos.extend(with_gaps());
        pdos[1].entries[0] = Entry::of(0x6060, 0, 8);
        assert_eq!(find(&pdos, 0x6060, 0), Some((56, Entry::of(0x6060, 0, 8))));
    }

    #[test]
    fn an_axis_of_a_drive_sees_its_own_objects_where_they_are() {
        let mut pdos = with_gaps();
        pdos.push(Pdo {
            index: 0x1610,
            entries: vec![Entry::of(0x6840, 0, 16), Entry::of(0x68FF, 0, 32)],
        });
        let [first, second] = [0, 1].map(|axis| of_axis(&pdos, axis));
        assert_eq!(
            find(&first, 0x60FF, 0),
            Some((24, Entry::of(0x60FF, 0, 32)))
        );
        assert_eq!(find(&first, 0x6840, 0), None);
        assert_eq!(
            find(&second, 0x6040, 0),
            Some((56, Entry::of(0x6040, 0, 16)))
        );
        assert_eq!(
            find(&second, 0x60FF, 0),
            Some((72, Entry::of(0x60FF, 0, 32)))
        );
        assert_eq!(
            find(&second, 0x2601, 0),
            Some((16, Entry::of(0x2601, 0, 1)))
        );
        assert_eq!(bits(&second), bits(&pdos));
    }

    #[test]
    fn a_mode_misses_its_target() {
        let pdos = with_gaps();
        assert!(missing(&pdos, OperatingMode::Csv.receive_needed()).is_empty());
        assert_eq!(
            missing(&pdos, OperatingMode::Cst.receive_needed()),
            [0x6071]
        );
        assert!(!holds(&pdos, &[], OperatingMode::Csv));
    }

    #[test]
    fn sizes_beyond_all_bounds_do_not_overflow() {
        let entry = Entry::of(0x2000, 0, u32::MAX);
        let pdos = vec![Pdo {
            index: 0x1600,
            entries: vec![entry; 3],
        }];
        assert_eq!(bits(&pdos), u32::MAX);
        assert_eq!(find(&pdos, 0x6040, 0), None);
    }
}
