//! Seeded random numbers that are the same for a seed on every PC: the one generator of fault scripts, soak and benches.

use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng as _, SeedableRng};

/// Distance of two states of the generator.
const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

/// SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014).
#[derive(Debug, Clone)]
pub struct Rng(SplitMix64);

impl Rng {
    /// The generator of a seed.
    pub fn new(seed: u64) -> Rng {
        Rng(SplitMix64::seed_from_u64(seed))
    }

    /// The generator of a seed after its first `count` numbers.
    pub fn after(seed: u64, count: u64) -> Rng {
        Rng::new(seed.wrapping_add(count.wrapping_mul(STEP)))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A whole number in `low..=high`: the next bits scaled to the range.
    pub fn within(&mut self, low: u64, high: u64) -> u64 {
        let count = u128::from(high.saturating_sub(low)) + 1;
        low + ((u128::from(self.bits()) * count) >> 64) as u64
    }

    /// A whole number in `0..end`; 0 if `end` is 0.
    pub fn below(&mut self, end: u64) -> u64 {
        self.within(0, end.saturating_sub(1))
    }

    /// A number from `low` up to and without `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// True once in so many cases.
    pub fn one_in(&mut self, count: u64) -> bool {
        self.below(count) == 0
    }

    /// One element of a list.
    pub fn pick<'a, T>(&mut self, of: &'a [T]) -> Option<&'a T> {
        of.get(self.below(of.len() as u64) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_of_seed_0_are_those_of_the_reference_implementation() {
        let mut rng = Rng::new(0);
        let reference = [
            0xE220_A839_7B1D_CDAF,
            0x6E78_9E6A_A1B9_65F4,
            0x06C4_5D18_8009_454F,
        ];
        assert_eq!([rng.bits(), rng.bits(), rng.bits()], reference);
        assert_eq!(Rng::after(0, 2).bits(), reference[2]);
    }

    #[test]
    fn every_number_of_a_range_comes_and_no_other() {
        let mut rng = Rng::new(7);
        let drawn: Vec<u64> = (0..300).map(|_| rng.within(500, 520)).collect();
        assert!((500..=520).all(|number| drawn.contains(&number)));
        assert!(drawn.iter().all(|number| (500..=520).contains(number)));
        assert_eq!((rng.within(9, 9), rng.below(0)), (9, 0));
        assert!((0..300).all(|_| (-1.0..2.0).contains(&rng.between(-1.0, 2.0))));
        assert_eq!(rng.pick::<u8>(&[]), None);
    }
}
