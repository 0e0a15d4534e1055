//! Seeded choices, the same for a seed on every PC.

use plant_sim::script::split_mix::SplitMix64;

/// The generator.
#[derive(Debug, Clone)]
pub struct Dice(SplitMix64);

impl Dice {
    /// From a seed.
    pub fn new(seed: u64) -> Dice {
        Dice(SplitMix64(seed))
    }

    /// A whole number from 0 up to and without `end`; 0 if that is 0.
    pub fn below(&mut self, end: u64) -> u64 {
        self.0.bits().checked_rem(end).unwrap_or(0)
    }

    /// From `low` up to and without `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// One of them.
    pub fn pick<'a, T>(&mut self, of: &'a [T]) -> Option<&'a T> {
        of.get(self.below(of.len() as u64) as usize)
    }
}
