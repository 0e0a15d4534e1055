//! Campaigns in parts: every part does its share of the seeds and writes a line of JSON for each; the lines of all parts, in any order,
//! give the totals of one run.

mod lines;
mod merge;
mod part_of;
mod seeds;

use std::fs;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::Path;

use anyhow::Context;
use machine::{Machine, machine_file};
use serde::{Deserialize, Serialize};

pub(crate) use lines::{Line, Lines};
pub use merge::merge;
pub use part_of::PartOf;
pub(crate) use seeds::{each_found, each_seed};

/// What all parts of a campaign have in common; it stands in each line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Campaign {
    /// Which bench.
    pub bench: String,
    /// The machine as it was named.
    pub machine: String,
    /// The machine's name.
    pub name: String,
    /// Names of its axes.
    pub axes: Vec<String>,
    /// Of the texts of its files, and of the program: other ones are another campaign.
    pub settings: String,
    /// The program as it was named, if one was.
    pub program: Option<String>,
    /// The seed that all is drawn from, where seeds are not numbered themselves.
    pub seed: u64,
    /// The first of those that are numbered.
    pub from: u64,
    /// How many there are in all parts together.
    pub count: u64,
}

/// What is asked of a campaign.
pub(crate) struct Asked<'a> {
    pub bench: &'a str,
    pub folder: &'a Path,
    pub program: Option<&'a Path>,
    pub seed: u64,
    pub from: u64,
    pub count: u64,
}

impl Campaign {
    /// Of this machine.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn of(asked: &Asked<'_>, machine: &Machine) -> anyhow::Result<Campaign> {
        let file = machine_file(asked.folder);
        let plant = file.with_file_name("plant.toml");
        let mut hasher = DefaultHasher::new();
        for path in [Some(file.as_path()), Some(&plant), asked.program] {
            let text = path.map(|path| {
                let text = fs::read_to_string(path);
                text.with_context(|| path.display().to_string())
            });
            text.transpose()?.hash(&mut hasher);
        }
        Ok(Campaign {
            bench: asked.bench.into(),
            machine: asked.folder.display().to_string(),
            name: machine.name.clone(),
            axes: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
            settings: format!("{:016x}", hasher.finish()),
            program: asked.program.map(|path| path.display().to_string()),
            seed: asked.seed,
            from: asked.from,
            count: asked.count,
        })
    }
}

/// A number with six digits behind the point, which JSON keeps to the bit.
pub(crate) fn to_keep(number: f64) -> f64 {
    (number * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::to_keep;

    #[test]
    fn numbers_that_are_kept_come_back_to_the_bit() {
        let mut number = 0.1234567890123;
        for _ in 0..2000 {
            number = (number * 997.000_123) % 1000.0;
            let kept = to_keep(number);
            let text = serde_json::to_string(&kept).expect("JSON");
            let back: f64 = serde_json::from_str(&text).expect("a number");
            assert_eq!(back.to_bits(), kept.to_bits(), "{text}");
        }
    }
}
