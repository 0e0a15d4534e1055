//! What a slave shows of itself, and the data of its objects.

use serde::Serialize;

/// A PDO of a slave.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundPdo {
    /// Its index.
    pub index: u16,
    /// Index, sub-index and bits of its entries.
    pub entries: Vec<(u16, u8, u8)>,
}

/// A slave as it shows itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundSlave {
    /// Its name.
    pub name: String,
    /// Vendor, product code, revision, serial number.
    pub identity: [u32; 4],
    /// Its station address.
    pub address: u16,
    /// AL status in which it was found, before the scan brought it to PRE-OP.
    pub al_status_before: u16,
    /// AL status code that belongs to it; 0 for no error.
    pub al_status_code_before: u16,
    /// Whether it has distributed clocks.
    pub clocks: bool,
    /// Device profile (low 16 bits of object 1000), 402 for drives; none where that cannot be read.
    pub profile: Option<u16>,
    /// PDOs that it receives.
    pub receive: Vec<FoundPdo>,
    /// PDOs that it transmits.
    pub transmit: Vec<FoundPdo>,
    /// Delay of the cable up to it, in ns.
    pub delay_ns: u32,
    /// How it keeps time, where that was asked for.
    pub sync: Option<FoundSync>,
}

/// How a slave keeps time with the others: its clock, and what it says of synchronisation (objects 1C32 and 10F1, ETG.1020); none of what
/// it does not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct FoundSync {
    /// Difference of its clock from the reference, in ns, after the clocks were given some time to agree (register 092Ch).
    pub clock_off_ns: Option<i32>,
    /// Ways of synchronisation that it has, a bit each: 1 with frames, 2 to 4 with SYNC0 and SYNC1 (1C32:4).
    pub kinds: Option<u64>,
    /// Shortest cycle, in ns (1C32:5).
    pub cycle_min_ns: Option<u64>,
    /// Time that it needs to take outputs in, in ns (1C32:6).
    pub taking_in_ns: Option<u64>,
    /// Missed process data that it forgives, three for each (10F1:2).
    pub error_limit: Option<u64>,
    /// Cycles in which process data were missing (1C32:11).
    pub missed: Option<u64>,
    /// Cycles that were too short (1C32:12).
    pub too_short: Option<u64>,
    /// It is out of synchronisation (1C32:32).
    pub has_error: Option<bool>,
}

/// The value of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ObjectValue {
    /// Its size, in bits.
    pub bits: u32,
    /// The value, without a sign.
    pub value: u64,
}

impl ObjectValue {
    /// With the sign that its size gives it.
    pub fn signed(self) -> i64 {
        let unused = 64 - self.bits.clamp(1, 64);
        ((self.value << unused) as i64) >> unused
    }

    /// Whether a number, with or without a sign, can be said in so many bits.
    pub fn holds(bits: u32, value: i64) -> bool {
        let bits = bits.clamp(1, 63);
        (-(1 << (bits - 1))..(1 << bits)).contains(&value)
    }
}

/// The data of an object.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ObjectData {
    /// As they come, the lowest byte of a number first.
    pub bytes: Vec<u8>,
}

impl ObjectData {
    /// As a number; none of more than eight bytes, or of no byte at all.
    pub fn number(&self) -> Option<ObjectValue> {
        if self.bytes.is_empty() || self.bytes.len() > 8 {
            return None;
        }
        let high_first = self.bytes.iter().rev();
        Some(ObjectValue {
            bits: 8 * self.bytes.len() as u32,
            value: high_first.fold(0, |value, byte| value << 8 | u64::from(*byte)),
        })
    }

    /// As a text (a VISIBLE_STRING); none where it holds something else, or nothing.
    pub fn text(&self) -> Option<&str> {
        let text = std::str::from_utf8(&self.bytes).ok()?;
        let text = text.trim_end_matches('\0');
        let shown = !text.is_empty() && text.chars().all(|letter| !letter.is_control());
        shown.then_some(text)
    }
}

/// An object that was written.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Written {
    /// What it held before; none where it cannot be read.
    pub before: Option<ObjectData>,
    /// What it holds afterwards; none where it cannot be read.
    pub after: Option<ObjectData>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_the_sign_that_its_size_gives_it() {
        let of = |bytes: &[u8]| {
            let bytes = bytes.to_vec();
            ObjectData { bytes }.number()
        };
        assert_eq!(of(&[0xFE, 0xFF]).map(ObjectValue::signed), Some(-2));
        assert_eq!(of(&[0xFE]).map(|found| found.value), Some(0xFE));
        assert_eq!(of(&[1, 0, 0]).map(|found| found.bits), Some(24));
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[0; 9]), None);
    }

    #[test]
    fn a_text_is_one_that_can_be_shown() {
        let of = |bytes: &[u8]| ObjectData {
            bytes: bytes.to_vec(),
        };
        assert_eq!(of(b"AM M\0\0").text(), Some("AM M"));
        assert_eq!(of(&[1, 2]).text(), None);
        assert_eq!(of(&[0, 0]).text(), None);
    }

    #[test]
    fn a_number_fits_with_or_without_its_sign() {
        assert!(ObjectValue::holds(8, -128) && ObjectValue::holds(8, 255));
        assert!(!ObjectValue::holds(8, -129) && !ObjectValue::holds(8, 256));
        assert!(ObjectValue::holds(32, 0xFFFF_FFFF) && !ObjectValue::holds(32, 1 << 32));
    }
}
