//! The fuzz targets over their kept inputs and changes of them: a short round of what `.ci/fuzz` does for as long as one likes.

use std::fs;
use std::time::{Duration, Instant};

use crate::support::root;

#[path = "../fuzz/src/samples.rs"]
mod samples;
#[path = "../fuzz/src/targets.rs"]
mod targets;

/// Inputs that are tried of each target, at most, and for how long.
const INPUTS: usize = 3000;
const TIME: Duration = Duration::from_secs(4);
/// Nothing that an input of some kB says takes longer.
const ONE: Duration = Duration::from_secs(5);

/// Numbers that look random and are the same on every PC.
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 as usize % most.max(1)
    }
}

/// One of the seeds with some of its bytes changed, doubled, removed or taken from another.
fn changed(dice: &mut Dice, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut input = seeds[dice.below(seeds.len())].clone();
    for _ in 0..=dice.below(4) {
        let at = dice.below(input.len() + 1);
        let to = (at + dice.below(24)).min(input.len());
        match dice.below(5) {
            0 if at < input.len() => input[at] ^= 1 << dice.below(8),
            1 if at < input.len() => input[at] = b"0123456789.-eE=[]\"\n\xff"[dice.below(20)],
            2 => drop(input.drain(at..to)),
            3 => {
                let piece = input[at..to].to_vec();
                input.splice(at..at, piece);
            }
            _ => {
                let other = &seeds[dice.below(seeds.len())];
                let from = dice.below(other.len() + 1);
                let piece = other[from..(from + 16).min(other.len())].to_vec();
                input.splice(at..at, piece);
            }
        }
    }
    input
}

fn seeds(target: &str) -> Vec<Vec<u8>> {
    let folder = root().join("fuzz/seeds").join(target);
    let mut files: Vec<_> = fs::read_dir(&folder)
        .expect("seeds")
        .flatten()
        .map(|e| e.path())
        .collect();
    files.sort();
    files
        .iter()
        .map(|file| fs::read(file).expect("a seed"))
        .collect()
}

#[test]
fn no_input_of_any_fuzz_target_panics_or_takes_long() {
    for (name, target) in targets::TARGETS {
        let seeds = seeds(name);
        assert!(!seeds.is_empty(), "{name} has no seeds");
        let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
        let began = Instant::now();
        let mut tried = 0;
        while tried < INPUTS && began.elapsed() < TIME {
            let input = match seeds.get(tried) {
                Some(seed) => seed.clone(),
                None => changed(&mut dice, &seeds),
            };
            let since = Instant::now();
            if std::panic::catch_unwind(|| target(&input)).is_err() || since.elapsed() > ONE {
                let folder = root().join("target/fuzz-found");
                let file = folder.join(format!("{name}-{tried}"));
                fs::create_dir_all(&folder).expect("a folder");
                fs::write(&file, &input).expect("the input");
                panic!("{name}: see {}, {:?}", file.display(), since.elapsed());
            }
            tried += 1;
        }
        println!("{name}: {tried} inputs in {:?}", began.elapsed());
    }
}
