//! The seeds of a campaign, or of a part of it: each once, some at a time.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use anyhow::Context;
use serde::de::DeserializeOwned;

use super::Line;
use crate::options::SeedOptions;

/// Has each seed of the part done, of a campaign of so many.
///
/// # Errors
/// The first failure, with its seed; no further seed is begun after it.
pub(crate) fn each_seed(
    options: &SeedOptions,
    count: u64,
    one: impl Fn(u64) -> anyhow::Result<()> + Sync,
) -> anyhow::Result<()> {
    let next = AtomicU64::new(0);
    let broken: Mutex<Option<anyhow::Error>> = Mutex::new(None);
    std::thread::scope(|threads| {
        for _ in 0..options.jobs {
            threads.spawn(|| {
                let number = || next.fetch_add(1, Ordering::Relaxed);
                while let Some(place) = options.part.place(number(), count) {
                    let seed = options.from.saturating_add(place);
                    if let Err(error) = one(seed) {
                        next.store(count, Ordering::Relaxed);
                        let mut broken = broken.lock().unwrap_or_else(PoisonError::into_inner);
                        broken.get_or_insert(error.context(format!("seed {seed}")));
                        return;
                    }
                }
            });
        }
    });
    let broken = broken.into_inner().unwrap_or_else(PoisonError::into_inner);
    broken.map_or(Ok(()), Err)
}

/// Hands on what became of each seed, from the lines of all parts.
///
/// # Errors
/// A line that is none of this bench.
pub(crate) fn each_found<F: DeserializeOwned>(
    lines: Vec<Line>,
    mut take: impl FnMut(u64, &F),
) -> anyhow::Result<()> {
    for line in lines {
        let found = serde_json::from_value(line.found);
        take(
            line.number,
            &found.with_context(|| format!("seed {}", line.number))?,
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    fn options(part: &str) -> SeedOptions {
        SeedOptions {
            from: 7,
            part: part.parse().expect("a part"),
            lines: None,
            jobs: 3,
        }
    }

    #[test]
    fn each_seed_of_a_part_is_done_once_and_none_is_begun_behind_a_failure() {
        let done = Mutex::new(Vec::new());
        let note = |seed| {
            done.lock().expect("the seeds").push(seed);
            Ok(())
        };
        each_seed(&options("2/3"), 10, note).expect("no failure");
        let mut seeds = done.into_inner().expect("the seeds");
        seeds.sort_unstable();
        assert_eq!(seeds, [8, 11, 14]);
        let begun = AtomicU64::new(0);
        let failed = each_seed(&options("1/1"), 1000, |_| {
            begun.fetch_add(1, Ordering::Relaxed);
            Err(anyhow!("broken"))
        });
        let failed = failed.expect_err("a failure").to_string();
        assert!(failed.starts_with("seed "), "{failed}");
        assert!(begun.into_inner() <= 3);
    }
}
