//! Values of channels and drives' bits as bits of an image, and back.

use super::keys::ChannelKind;
use crate::field::Field;

/// Where a value lies in the process data of its device, and how its bits are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelCode {
    /// Where its bits are.
    pub field: Field,
    /// What they are.
    pub kind: ChannelKind,
    /// Whether the number can be negative.
    pub signed: bool,
    /// Value of one step.
    pub scale: f64,
    /// Value at 0.
    pub offset: f64,
}

impl ChannelCode {
    /// A switch.
    pub fn bit(at_bits: usize) -> ChannelCode {
        ChannelCode {
            field: Field { at_bits, bits: 1 },
            kind: ChannelKind::Bool,
            signed: false,
            scale: 1.0,
            offset: 0.0,
        }
    }

    /// Its number in the process data of its device, as it comes.
    pub fn number(&self, own: &[u8]) -> i64 {
        match self.signed {
            true => self.field.read_signed(own).into(),
            false => self.field.read(own).into(),
        }
    }

    /// The value that a number stands for.
    pub fn value_of(&self, number: i64) -> f64 {
        match self.kind {
            ChannelKind::Bool | ChannelKind::Int | ChannelKind::Counter => number as f64,
            ChannelKind::Float => number as f64 * self.scale + self.offset,
            ChannelKind::Real => f32::from_bits(number as u32).into(),
        }
    }

    /// Writes the bits of a value into the process data of its device: the nearest that they can show; of what is no number, 0.
    pub fn write(&self, own: &mut [u8], value: f64) {
        let value = if value.is_nan() { 0.0 } else { value };
        let number = match self.kind {
            ChannelKind::Bool => f64::from(u8::from(value != 0.0)),
            ChannelKind::Int | ChannelKind::Counter => libm::round(value),
            ChannelKind::Float => libm::round((value - self.offset) / self.scale),
            ChannelKind::Real => return self.field.write(own, (value as f32).to_bits()),
        };
        let bits = self.field.bits.clamp(1, 32);
        if self.signed {
            self.field.write_signed(own, number as i64);
        } else {
            let most = (1_u64 << bits) - 1;
            self.field.write(own, (number as u64).min(most) as u32);
        }
    }

    /// A count that goes on from one before, whose low bits the field showed then: the shorter way round.
    pub fn counted_on(&self, before: i64, number: i64) -> i64 {
        let unused = 64 - self.field.bits.clamp(1, 64);
        let step = (number.wrapping_sub(before) << unused) >> unused;
        before.saturating_add(step)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn code(at_bits: usize, bits: u32, kind: ChannelKind, signed: bool) -> ChannelCode {
        ChannelCode {
            field: Field { at_bits, bits },
            kind,
            signed,
            scale: 10.0 / 32_768.0,
            offset: 0.0,
        }
    }

    fn read(code: &ChannelCode, own: &[u8]) -> f64 {
        code.value_of(code.number(own))
    }

    #[test]
    fn ten_volts_are_15_bits_and_more_is_cut_to_what_the_terminal_can() {
        let volts = code(16, 16, ChannelKind::Float, true);
        for (value, bytes, back) in [
            (5.0, [0x00, 0x40], 5.0),
            (-10.0, [0x00, 0x80], -10.0),
            (11.0, [0xFF, 0x7F], 10.0 * 32_767.0 / 32_768.0),
            (f64::NAN, [0, 0], 0.0),
        ] {
            let mut own = [0xAA; 6];
            volts.write(&mut own, value);
            assert_eq!(own[2..4], bytes, "{value}");
            assert_eq!((own[1], own[4]), (0xAA, 0xAA), "{value}");
            assert_eq!(read(&volts, &own), back, "{value}");
        }
        let current = ChannelCode {
            scale: 16.0 / 30_000.0,
            offset: 4.0,
            ..code(0, 16, ChannelKind::Float, false)
        };
        let mut own = [0; 2];
        current.write(&mut own, 12.0);
        assert_eq!(u16::from_le_bytes(own), 15_000);
        assert_eq!(read(&current, &own), 12.0);
        current.write(&mut own, 0.0);
        assert_eq!(read(&current, &own), 4.0);
    }

    #[test]
    fn a_real_number_is_taken_as_it_is() {
        let real = code(8, 32, ChannelKind::Real, false);
        let mut own = [0; 5];
        real.write(&mut own, -2.5);
        assert_eq!(own[1..], (-2.5_f32).to_le_bytes());
        assert_eq!(read(&real, &own), -2.5);
    }

    #[test]
    fn a_counter_counts_on_over_the_end_of_its_bits_both_ways() {
        let counter = code(0, 16, ChannelKind::Counter, false);
        assert_eq!(counter.counted_on(65_530, 4), 65_540);
        assert_eq!(counter.counted_on(65_540, 65_530), 65_530);
        assert_eq!(counter.counted_on(3, 3), 3);
        assert_eq!(counter.counted_on(0, 65_535), -1);
        let wide = code(0, 32, ChannelKind::Counter, false);
        assert_eq!(wide.counted_on(1 << 40, 5), (1 << 40) + 5);
    }

    proptest! {
        #[test]
        fn whole_numbers_come_back_from_any_bits_and_no_other_bit_changes(
            at_bits in 0_usize..40, bits in 1_u32..=32, signed: bool, value: i32, fill: u8
        ) {
            let code = code(at_bits, bits, ChannelKind::Int, signed);
            let (low, high) = match signed {
                true => (-(1_i64 << (bits - 1)), (1_i64 << (bits - 1)) - 1),
                false => (0, (1_i64 << bits) - 1),
            };
            let mut own = [fill; 10];
            code.write(&mut own, value.into());
            prop_assert_eq!(code.number(&own), i64::from(value).clamp(low, high));
            for bit in (0..80).filter(|bit| !(at_bits..at_bits + bits as usize).contains(bit)) {
                let one = Field { at_bits: bit, bits: 1 };
                prop_assert_eq!(one.read(&own), one.read(&[fill; 10]));
            }
        }
    }
}
