//! Whether a process grows: what it holds is compared with what it held once it had settled.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// A process that takes part has all that it needs after this: it connects with its first looks.
const SETTLED_AFTER: Duration = Duration::from_secs(1);
/// So many more files may be open than at first: a connection is on its way here and there.
pub const FILES_MAX: usize = 16;

/// What a process holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Held {
    pub kb: u64,
    pub files: usize,
}

impl Held {
    fn is_too_much_over(self, first: Held, most_kb: u64) -> bool {
        self.kb > first.kb + most_kb || self.files > first.files + FILES_MAX
    }
}

#[derive(Debug)]
struct Known {
    takes_part_since: Instant,
    /// What it held when it had settled.
    first: Option<Held>,
    /// Said once.
    is_said: bool,
}

/// The processes of a cell.
#[derive(Debug, Default)]
pub struct Growth {
    known: HashMap<i32, Known>,
}

impl Growth {
    /// Whether a process holds more than it may: what comes and goes with clients may take a while to go.
    pub fn exceeds(&self, pid: i32, held: Held, most_kb: u64) -> bool {
        let first = self.known.get(&pid).and_then(|known| known.first);
        first.is_some_and(|first| held.is_too_much_over(first, most_kb))
    }

    /// Takes what a process that takes part holds `now`: by how much it has grown since it had settled, and, once for each
    /// process, whether that is too much.
    pub fn take(&mut self, pid: i32, held: Held, most_kb: u64, now: Instant) -> (Held, bool) {
        let known = self.known.entry(pid).or_insert(Known {
            takes_part_since: now,
            first: None,
            is_said: false,
        });
        if now.duration_since(known.takes_part_since) < SETTLED_AFTER {
            return (Held::default(), false);
        }
        let first = *known.first.get_or_insert(held);
        let grown = Held {
            kb: held.kb.saturating_sub(first.kb),
            files: held.files.saturating_sub(first.files),
        };
        let is_too_much = held.is_too_much_over(first, most_kb);
        let is_new = is_too_much && !std::mem::replace(&mut known.is_said, is_too_much);
        (grown, is_new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looks(held: &[(u64, Held)]) -> Vec<bool> {
        let (mut growth, began) = (Growth::default(), Instant::now());
        let looks = held.iter().map(|(ms, held)| {
            let now = began + Duration::from_millis(*ms);
            growth.take(1, *held, 4096, now).1
        });
        looks.collect()
    }

    #[test]
    fn a_process_on_its_way_up_is_not_one_that_grows() {
        let (early, up) = (
            Held {
                kb: 9_000,
                files: 10,
            },
            Held {
                kb: 41_000,
                files: 63,
            },
        );
        assert_eq!(looks(&[(0, early), (1200, up), (5000, up)]), [false; 3]);
    }

    #[test]
    fn a_process_that_grows_later_is_seen_and_said_once() {
        let first = Held {
            kb: 40_000,
            files: 60,
        };
        let kb = Held {
            kb: 44_097,
            ..first
        };
        let files = Held { files: 77, ..first };
        for grown in [kb, files] {
            let all = looks(&[(0, first), (1200, first), (2000, grown), (3000, grown)]);
            assert_eq!(all, [false, false, true, false], "{grown:?}");
        }
    }
}
