//! Samples some of whose numbers are wrong, as their readers let them through, for the tests of those readers. Every crate's tests share
//! this file. `SPOILT_SAMPLES=1000000` in the environment: so many in each test.

use bus::sample::{Feedback, MAX_AXES, PATH_AXES};
use bytemuck::Pod;

/// How many a test is to take.
pub fn count(default: u64) -> u64 {
    match std::env::var("SPOILT_SAMPLES") {
        Ok(text) => text.parse().expect("SPOILT_SAMPLES: a whole number"),
        Err(_) => default,
    }
}

/// Numbers drawn, the same in every run.
pub struct Spoiler(u64);

impl Spoiler {
    pub fn new() -> Spoiler {
        Spoiler(0x9e37_79b9_7f4a_7c15)
    }

    pub fn draw(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A sample some of whose words, or halves of them, are wrong in one of the ways that have broken programs.
    pub fn spoilt<T: Pod>(&mut self, sample: &T) -> T {
        let mut wrong = *sample;
        let bytes = bytemuck::bytes_of_mut(&mut wrong);
        for _ in 0..=self.draw() % 4 {
            let width = if self.draw().is_multiple_of(2) { 8 } else { 4 };
            let start = width * (self.draw() as usize % (bytes.len() / width));
            let with = match self.draw() % 6 {
                0 => 0,
                1 => u64::MAX,
                2 => f64::NAN.to_bits(),
                3 => 1 << (self.draw() % 64),
                4 => u64::from_ne_bytes([0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0x7f]),
                _ => self.draw(),
            };
            bytes[start..start + width].copy_from_slice(&with.to_le_bytes()[..width]);
        }
        wrong
    }

    /// A feedback of this scan. What contradicts itself comes to no reader (`Sample::is_sound`).
    pub fn feedback(&mut self, sample: &Feedback) -> Feedback {
        let mut wrong = self.spoilt(sample);
        (wrong.scan, wrong.visible_from) = (sample.scan, sample.scan);
        wrong.axis_count %= MAX_AXES as u32 + 1;
        wrong.path_axes = wrong.path_axes.min(PATH_AXES as u32).min(wrong.axis_count);
        wrong
    }
}
