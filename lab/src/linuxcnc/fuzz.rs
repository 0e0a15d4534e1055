//! The same programs by both interpreters, as many as there is time for.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use crate::linuxcnc::generate::{self, Kinds};
use crate::linuxcnc::theirs::Theirs;
use crate::linuxcnc::verdict::{self, Tally, Verdict};
use crate::linuxcnc::{known, ours};

/// How many programs the other side is ahead of us.
const AHEAD: usize = 6;

/// The most differences that are made small; the rest is counted.
const MINIMISED_MAX: usize = 400;

/// Differences of one kind that are made small.
const OF_ONE_KIND_MAX: usize = 3;

/// A kind of difference: how often, the first seed, the smallest program, what is different.
pub struct Found {
    pub times: usize,
    pub seed: u64,
    pub program: String,
    pub how: String,
}

/// What a round has found.
pub struct Round {
    pub tally: Tally,
    pub known: BTreeMap<&'static str, usize>,
    pub found: BTreeMap<String, Found>,
}

/// Runs the programs of `seeds` through both.
pub fn round(seeds: std::ops::Range<u64>, kinds: Kinds, progress: bool) -> Round {
    let folder = Folder::make();
    let mut theirs = Theirs::start();
    let mut sorting = Sorting {
        small: Theirs::start(),
        minimised: 0,
        seen: BTreeMap::new(),
    };
    let mut round = Round {
        tally: Tally::default(),
        known: BTreeMap::new(),
        found: BTreeMap::new(),
    };
    let begun = Instant::now();
    let mut waiting = std::collections::VecDeque::new();
    let mut next = seeds.start;
    for done in 0_u64.. {
        while next < seeds.end && waiting.len() < AHEAD {
            let text = generate::program(next, kinds);
            let file = folder.write((next % (2 * AHEAD as u64)) as usize, &text);
            theirs.begin(&file);
            waiting.push_back((next, file, text));
            next += 1;
        }
        let Some((seed, file, text)) = waiting.pop_front() else {
            break;
        };
        let mine = ours::run(&file);
        let (trace, crashed) = theirs.finish_or_crash();
        if crashed {
            // Those that were handed over are lost with it.
            waiting.iter().for_each(|(_, file, _)| theirs.begin(file));
        }
        let judged = verdict::compared(trace, mine);
        round.tally.count(&judged);
        if progress && done % 20_000 == 19_999 {
            let rate = done as f64 / begun.elapsed().as_secs_f64();
            eprintln!(
                "{} programs, {rate:.0} in a second, {} kinds of differences",
                done + 1,
                round.found.len()
            );
        }
        sorting.note(&mut round, (seed, &text), &judged.verdict, &folder);
    }
    round
}

/// Differences, sorted by kind and made small.
struct Sorting {
    /// For the small ones.
    small: Theirs,
    minimised: usize,
    /// How often each kind was seen.
    seen: BTreeMap<String, usize>,
}

impl Sorting {
    fn note(
        &mut self,
        round: &mut Round,
        (seed, text): (u64, &str),
        verdict: &Verdict,
        folder: &Folder,
    ) {
        if !matters(verdict) {
            return;
        }
        if let Some(name) = known::reason(text, verdict) {
            *round.known.entry(name).or_default() += 1;
            return;
        }
        let rough = signature(verdict);
        let times = self.seen.entry(rough.clone()).or_default();
        *times += 1;
        if *times > OF_ONE_KIND_MAX || self.minimised >= MINIMISED_MAX {
            let mut found = round.found.values_mut();
            if let Some(found) = found.find(|found| found.how.starts_with(&rough)) {
                found.times += 1;
            }
            return;
        }
        self.minimised += 1;
        let program = minimal(text, &rough, &mut self.small, folder);
        let again = verdict::judge(&mut self.small, &folder.write(99, &program));
        if let Some(name) = known::reason(&program, &again.verdict) {
            *round.known.entry(name).or_default() += 1;
            return;
        }
        let how = format!("{rough}\n{}", again.verdict);
        let key = format!("{rough} [{}]", codes(&program));
        let found = round.found.entry(key).or_insert(Found {
            times: 0,
            seed,
            program,
            how,
        });
        found.times += 1;
    }
}

fn matters(verdict: &Verdict) -> bool {
    match verdict {
        Verdict::Differs(_) | Verdict::RefusedByUs(_) | Verdict::AcceptedOnlyByUs(_) => true,
        Verdict::RefusedByBoth(_, ours) => ours == "PANIC",
        Verdict::Same => false,
    }
}

/// A verdict without its numbers.
fn signature(verdict: &Verdict) -> String {
    let text = match verdict {
        Verdict::Differs(how) => {
            let kind = |side: &str| {
                side.split([' ', '.'])
                    .filter(|w| w.chars().next().is_some_and(char::is_alphabetic))
                    .take(4)
                    .collect::<Vec<_>>()
                    .join(" ")
            };
            let (theirs, ours) = how.split_once(" | ").unwrap_or((how, ""));
            format!("differs: {} | {}", kind(theirs), kind(ours))
        }
        other => other.to_string(),
    };
    let mut kept: String = text
        .chars()
        .filter(|c| !c.is_ascii_digit() && !".-+".contains(*c))
        .collect();
    kept.truncate(
        kept.char_indices()
            .nth(110)
            .map_or(kept.len(), |(at, _)| at),
    );
    kept
}

/// The codes and functions of a program.
fn codes(program: &str) -> String {
    let mut found = std::collections::BTreeSet::new();
    for line in program.to_ascii_uppercase().lines() {
        let mut rest = line;
        while let Some(at) = rest.find(['G', 'M']) {
            let number: String = rest[at + 1..]
                .chars()
                .take_while(|c| c.is_ascii_digit() || *c == '.')
                .collect();
            if !number.is_empty() {
                found.insert(format!("{}{number}", &rest[at..=at]));
            }
            rest = &rest[at + 1..];
        }
    }
    found.into_iter().collect::<Vec<_>>().join(" ")
}

/// The smallest program found with the same difference: lines, then words, are left out.
fn minimal(text: &str, wanted: &str, theirs: &mut Theirs, folder: &Folder) -> String {
    let mut holds = |program: &str| {
        let judged = verdict::judge(theirs, &folder.write(98, program));
        matters(&judged.verdict) && signature(&judged.verdict) == wanted
    };
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut size = lines.len().div_ceil(2).max(1);
    loop {
        let mut at = 0;
        while at < lines.len() {
            let mut fewer = lines.clone();
            let gone: Vec<String> = fewer.drain(at..(at + size).min(lines.len())).collect();
            if !gone.iter().any(|line| counts(line))
                && !fewer.is_empty()
                && holds(&(fewer.join("\n") + "\n"))
            {
                lines = fewer;
            } else {
                at += size;
            }
        }
        if size == 1 {
            break;
        }
        size = size.div_ceil(2);
    }
    for index in 0..lines.len() {
        if counts(&lines[index]) {
            continue;
        }
        let mut at = 0;
        loop {
            let words: Vec<&str> = lines[index].split(' ').collect();
            if at >= words.len() || words.len() < 2 {
                break;
            }
            let mut fewer = words.clone();
            fewer.remove(at);
            let mut changed = lines.clone();
            changed[index] = fewer.join(" ");
            if holds(&(changed.join("\n") + "\n")) {
                lines = changed;
            } else {
                at += 1;
            }
        }
    }
    lines.join("\n") + "\n"
}

/// Whether a loop might be endless without it.
fn counts(line: &str) -> bool {
    let line = line.to_ascii_lowercase();
    line.contains("+1]") || line.contains("while") || line.contains("g98") || line.contains("g99")
}

/// Where the programs lie; gone at the end.
pub struct Folder(PathBuf);

impl Folder {
    pub fn make() -> Folder {
        let shared = Path::new("/dev/shm");
        let base = if shared.is_dir() {
            shared.to_owned()
        } else {
            std::env::temp_dir()
        };
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let path = base.join(format!("quadrant-fuzz-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder for programs");
        Folder(path)
    }

    pub fn write(&self, index: usize, text: &str) -> PathBuf {
        let file = self.0.join(format!("{index}.ngc"));
        std::fs::write(&file, text).expect("writing a program");
        file
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl std::fmt::Display for Round {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "{}", self.tally)?;
        for (reason, times) in &self.known {
            writeln!(to, "known: {times} × {reason}")?;
        }
        let mut found: Vec<_> = self.found.iter().collect();
        found.sort_by_key(|(_, found)| std::cmp::Reverse(found.times));
        for (key, found) in found {
            writeln!(
                to,
                "\n## {} × {key} (seed {})\n{}\n{}",
                found.times, found.seed, found.how, found.program
            )?;
        }
        Ok(())
    }
}
