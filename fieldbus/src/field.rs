//! Fields of an image: numbers of so many bits that begin at any bit.

/// A number of up to 32 bits in an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Where it begins, in bits from the start of the image.
    pub at_bits: usize,
    /// Its size, in bits, 1 to 32.
    pub bits: u32,
}

impl Field {
    fn mask(self) -> u64 {
        (1_u64 << self.bits.min(32)) - 1
    }

    /// Its bits; 0 where the image ends before.
    pub fn read(self, image: &[u8]) -> u32 {
        let (byte, shift) = (self.at_bits / 8, self.at_bits % 8);
        let rest = image.get(byte..).unwrap_or(&[]);
        let mut word = [0; 8];
        for (to, from) in word.iter_mut().zip(rest) {
            *to = *from;
        }
        ((u64::from_le_bytes(word) >> shift) & self.mask()) as u32
    }

    /// The same as a signed number.
    pub fn read_signed(self, image: &[u8]) -> i32 {
        let unused = 32 - self.bits.clamp(1, 32);
        ((self.read(image) << unused) as i32) >> unused
    }

    /// Writes the low bits of a number; a field that the image does not hold stays unwritten.
    pub fn write(self, image: &mut [u8], value: u32) {
        let (byte, shift) = (self.at_bits / 8, self.at_bits % 8);
        let bytes = (shift + self.bits.min(32) as usize).div_ceil(8);
        let Some(place) = image.get_mut(byte..byte + bytes) else {
            return;
        };
        let mut word = [0; 8];
        for (to, from) in word.iter_mut().zip(place.iter()) {
            *to = *from;
        }
        let mask = self.mask() << shift;
        let value = (u64::from(value) << shift) & mask;
        let word = (u64::from_le_bytes(word) & !mask | value).to_le_bytes();
        for (to, from) in place.iter_mut().zip(word) {
            *to = from;
        }
    }

    /// Writes a signed number, cut to what the field can hold.
    pub fn write_signed(self, image: &mut [u8], value: i64) {
        let most = (1_i64 << (self.bits.clamp(1, 32) - 1)) - 1;
        self.write(image, value.clamp(-most - 1, most) as u32);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_written_is_read_and_no_other_bit_changes(
            at_bits in 0_usize..80, bits in 1_u32..=32, value: u32, fill: u8
        ) {
            let field = Field { at_bits, bits };
            let mut image = [fill; 14];
            field.write(&mut image, value);
            let kept = if bits == 32 { value } else { value & ((1 << bits) - 1) };
            prop_assert_eq!(field.read(&image), kept);
            let before = [fill; 14];
            for bit in (0..14 * 8).filter(|bit| !(at_bits..at_bits + bits as usize).contains(bit)) {
                let one = Field { at_bits: bit, bits: 1 };
                prop_assert_eq!(one.read(&image), one.read(&before));
            }
        }

        #[test]
        fn a_signed_number_is_cut_to_its_field(bits in 1_u32..=32, value in -1_i64 << 40..1_i64 << 40) {
            let field = Field { at_bits: 3, bits };
            let mut image = [0; 9];
            field.write_signed(&mut image, value);
            let most = (1_i64 << (bits - 1)) - 1;
            prop_assert_eq!(i64::from(field.read_signed(&image)), value.clamp(-most - 1, most));
        }
    }

    #[test]
    fn a_field_beyond_the_image_reads_as_0_and_is_not_written() {
        let field = Field {
            at_bits: 60,
            bits: 16,
        };
        let mut image = [0xFF; 8];
        field.write(&mut image, 0);
        assert_eq!(image, [0xFF; 8]);
        assert_eq!(field.read(&image), 0xF);
    }
}
