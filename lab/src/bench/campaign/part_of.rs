//! A part of a campaign.

use std::str::FromStr;

/// Part I of N, from 1: every Nth of the seeds, so that all parts take about as long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartOf {
    index: u64,
    count: u64,
}

impl PartOf {
    /// All of it.
    pub const WHOLE: PartOf = PartOf { index: 0, count: 1 };

    /// The place of its element of this number in the campaign; none behind the end of a campaign of so many.
    pub fn place(self, number: u64, all: u64) -> Option<u64> {
        let place = number.checked_mul(self.count)?.checked_add(self.index)?;
        (place < all).then_some(place)
    }

    /// How many of so many are its own.
    pub fn share(self, all: u64) -> u64 {
        all.saturating_sub(self.index).div_ceil(self.count)
    }
}

impl Default for PartOf {
    fn default() -> Self {
        PartOf::WHOLE
    }
}

impl FromStr for PartOf {
    type Err = String;

    fn from_str(text: &str) -> Result<PartOf, String> {
        let numbers = text.split_once('/');
        let numbers =
            numbers.and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        match numbers {
            Some((index, count)) if (1..=count).contains(&index) => Ok(PartOf {
                index: index - 1,
                count,
            }),
            _ => Err("must be I/N with I from 1 to N, as 3/8".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_take_every_seed_once_and_nearly_as_many_each() {
        for (all, count) in [(10, 3), (10, 1), (3, 5), (0, 2)] {
            let mut taken = Vec::new();
            for index in 1..=count {
                let part: PartOf = format!("{index}/{count}").parse().expect("a part");
                let own: Vec<u64> = (0..).map_while(|n| part.place(n, all)).collect();
                assert_eq!(
                    own.len() as u64,
                    part.share(all),
                    "{index}/{count} of {all}"
                );
                taken.extend(own);
            }
            taken.sort_unstable();
            assert_eq!(taken, (0..all).collect::<Vec<_>>());
        }
    }

    #[test]
    fn what_is_no_part_is_refused() {
        for text in ["0/3", "4/3", "3", "a/b", "1/0", "-1/2"] {
            assert!(text.parse::<PartOf>().is_err(), "{text}");
        }
    }
}
