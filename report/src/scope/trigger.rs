//! What starts a capture: the words for it, and who watches for it, scan by scan.
//!
//! | words | fires in the scan in which |
//! |---|---|
//! | `now` | the scope is ready |
//! | `reversal X`, `reversal X +`, `reversal X -` | the command of X is the first in the other (positive, negative) direction |
//! | `X.torque > 3Nm`, `< …` | the condition comes to hold, or holds when the scope is ready |
//! | `X.velocity rising 0`, `falling …` | the signal goes through the value from below (above) |
//! | `abs X.following_error > 5um` | the same of the magnitude |
//! | `block 12` | the first element at or behind line 12 comes under way |
//! | `scan 2210` | this is the scan |
//! | `trip` | the machine trips |
//! | `mode`, `mode stopped` | the mode changes, or becomes this one |
//! | `order` | mode, feed hold or override change |
//! | `death`, `death servo-X` | a process dies, or this one, as the launcher tells in the roster |
//!
//! A reversal counts from 100 nm in the new direction and is dated back to its first scan, as in the report. A death is dated
//! back to its own scan. Neither is found across scans that were not seen.

use std::collections::VecDeque;

use bus::sample::{Feedback, Mode, Roster};
use console::output::joined;
use machine::{Machine, Process};

use super::error::ScopeError;
use super::signal::{Eyes, Signal};
use crate::align::ScanSet;
use crate::turns::Turns;
use monitor::deaths::Deaths;
use monitor::words::StopCause;

/// Which side of a threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Above it, also from the start.
    Above,
    /// Below it, also from the start.
    Below,
    /// From below to it or above.
    Rising,
    /// From above to it or below.
    Falling,
}

/// What starts a capture.
#[derive(Debug, Clone, PartialEq)]
pub enum Trigger {
    /// Anything.
    Now,
    /// The command of an axis reverses; in this direction, if one is named.
    Reversal {
        /// Index of the axis.
        axis: usize,
        /// −1 or 1.
        direction: Option<i32>,
    },
    /// A signal and a threshold.
    Level {
        /// Which.
        signal: Signal,
        /// Whether its magnitude counts.
        absolute: bool,
        /// Which side.
        side: Side,
        /// In the unit of the signal.
        threshold: f64,
    },
    /// A line of the program is reached.
    Block(u32),
    /// A scan.
    Scan(u64),
    /// The machine trips.
    Trip,
    /// The mode changes; to this one, if one is named.
    Mode(Option<Mode>),
    /// Mode, feed hold or override change.
    Order,
    /// A process dies; this one, if one is named.
    Death(Option<Process>),
}

const WORDS: &str = "now, reversal AXIS [+|-], SIGNAL > VALUE, SIGNAL < VALUE, SIGNAL rising VALUE, SIGNAL falling VALUE (with abs before \
     the signal for its magnitude), block LINE, scan N, trip, mode [WORD], order, death [PROCESS]";

fn wrong(text: &str, what: impl std::fmt::Display) -> ScopeError {
    ScopeError::Input(format!("trigger {text:?}: {what}"))
}

fn axis_of(text: &str, letter: &str, machine: &Machine) -> Result<usize, ScopeError> {
    let mut letters = machine.axes.iter().map(|axis| &axis.name);
    let found = letters
        .clone()
        .position(|name| name.eq_ignore_ascii_case(letter));
    found.ok_or_else(|| {
        let has = joined(letters.by_ref(), ", ");
        wrong(
            text,
            format!("there is no axis {letter:?}: the machine has {has}"),
        )
    })
}

impl Trigger {
    /// Reads the words.
    ///
    /// # Errors
    /// They are none that are known here, or name what the machine does not have.
    pub fn parse(text: &str, machine: &Machine) -> Result<Trigger, ScopeError> {
        if let Some(level) = Self::level(text, machine)? {
            return Ok(level);
        }
        let words: Vec<&str> = text.split_whitespace().collect();
        let number = |word: &str| -> Result<u64, ScopeError> {
            word.parse()
                .map_err(|_| wrong(text, format!("{word:?} must be a whole number from 0 up")))
        };
        Ok(match words.as_slice() {
            [] => return Err(wrong(text, format!("is empty: must be one of {WORDS}"))),
            ["now"] => Trigger::Now,
            ["trip"] => Trigger::Trip,
            ["order"] => Trigger::Order,
            ["mode"] => Trigger::Mode(None),
            ["mode", word] => {
                let mode = Mode::ALL.iter().find(|mode| mode.word() == *word);
                Trigger::Mode(Some(*mode.ok_or_else(|| {
                    let all = joined(Mode::ALL.map(Mode::word), ", ");
                    wrong(text, format!("there is no mode {word:?}: must be {all}"))
                })?))
            }
            ["reversal", letter, rest @ ..] => Trigger::Reversal {
                axis: axis_of(text, letter, machine)?,
                direction: match rest {
                    [] => None,
                    ["+"] => Some(1),
                    ["-"] => Some(-1),
                    _ => {
                        let right =
                            "behind the axis may stand + or -: the direction after the reversal";
                        return Err(wrong(text, right));
                    }
                },
            },
            ["block", line] => {
                let line = u32::try_from(number(line)?);
                Trigger::Block(line.map_err(|_| wrong(text, "no program has so many lines"))?)
            }
            ["scan", scan] => Trigger::Scan(number(scan)?),
            ["death"] => Trigger::Death(None),
            ["death", process] => {
                let all = Process::all(machine);
                let found = all.iter().find(|known| known.name(machine) == *process);
                Trigger::Death(Some(*found.ok_or_else(|| {
                    let has = joined(all.iter().map(|known| known.name(machine)), ", ");
                    wrong(
                        text,
                        format!("there is no process {process:?}: the machine has {has}"),
                    )
                })?))
            }
            _ => return Err(wrong(text, format!("must be one of {WORDS}"))),
        })
    }

    /// The words of a level; none if they are those of another trigger.
    fn level(text: &str, machine: &Machine) -> Result<Option<Trigger>, ScopeError> {
        let sides = [
            (">", Side::Above),
            ("<", Side::Below),
            (" rising ", Side::Rising),
            (" falling ", Side::Falling),
        ];
        let found = sides.iter().find_map(|(word, side)| {
            let (left, right) = text.split_once(word)?;
            Some((left, right, *side))
        });
        let Some((left, right, side)) = found else {
            return Ok(None);
        };
        let left = left.trim();
        let bars = left
            .strip_prefix('|')
            .and_then(|rest| rest.strip_suffix('|'));
        let magnitude = left.strip_prefix("abs ").or(bars);
        let signal = Signal::parse(magnitude.unwrap_or(left), machine);
        let signal = signal.map_err(|error| wrong(text, error))?;
        let threshold = signal.value(right).map_err(|error| wrong(text, error))?;
        Ok(Some(Trigger::Level {
            threshold,
            absolute: magnitude.is_some(),
            side,
            signal,
        }))
    }

    /// Whether it comes again and again in ordinary motion, so that one can wait for one that is seen whole.
    pub fn comes_again(&self) -> bool {
        matches!(
            self,
            Trigger::Now | Trigger::Reversal { .. } | Trigger::Level { .. }
        )
    }

    /// Whether it can only be known with the path of the program.
    pub fn needs_path(&self) -> bool {
        match self {
            Trigger::Block(_) => true,
            Trigger::Level { signal, .. } => signal.needs_path(),
            _ => false,
        }
    }
}

/// A trigger that has fired.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fired {
    /// Where the capture has its zero.
    pub scan: u64,
    /// What happened, in words.
    pub what: String,
}

/// Watches for a trigger.
#[derive(Debug)]
pub struct Watch {
    trigger: Trigger,
    machine: Machine,
    turns: Vec<Turns<u64>>,
    first_scan: Option<u64>,
    last: Option<Feedback>,
    /// Whether the condition held, once it was known.
    held: Option<bool>,
    deaths: Deaths,
    died: VecDeque<Fired>,
    /// The first ones of all, in words.
    died_in_all: Vec<String>,
    lowest: f64,
    highest: f64,
    last_line: Option<u32>,
}

impl Watch {
    /// Of a machine.
    pub fn new(trigger: Trigger, machine: &Machine) -> Watch {
        let turns = machine
            .axes
            .iter()
            .map(|axis| Turns::new(axis.increment_mm()));
        Watch {
            trigger,
            machine: machine.clone(),
            turns: turns.collect(),
            first_scan: None,
            last: None,
            held: None,
            deaths: Deaths::new(machine),
            died: VecDeque::new(),
            died_in_all: Vec::new(),
            lowest: f64::INFINITY,
            highest: f64::NEG_INFINITY,
            last_line: None,
        }
    }

    /// Takes who takes part.
    pub fn roster(&mut self, roster: &Roster) {
        self.deaths.roster(roster);
        while let Some(death) = self.deaths.next_new() {
            if self.died_in_all.len() < 8 {
                let words = format!("{} in scan {}", death.how, death.scan);
                self.died_in_all.push(words);
            }
            match &self.trigger {
                Trigger::Death(wanted) if wanted.is_none_or(|wanted| wanted == death.process) => {
                    self.died.push_back(Fired {
                        scan: death.scan,
                        what: death.how,
                    });
                }
                _ => {}
            }
        }
    }

    /// Takes one scan, of which at least the feedback is known; what fired, if anything did.
    pub fn scan(&mut self, set: &ScanSet, feedback: &Feedback, eyes: &Eyes) -> Option<Fired> {
        self.first_scan.get_or_insert(feedback.scan);
        self.deaths.scan(feedback.scan);
        let last = self.last.as_ref();
        if last.is_some_and(|last| last.scan + 1 != feedback.scan) {
            self.turns.iter_mut().for_each(Turns::interrupt);
        }
        let mut reversed = None;
        for (axis, turns) in self.turns.iter_mut().enumerate() {
            if let Some(command) = set.command(axis)
                && let Some((scan, direction)) = turns.take(command.position, |_| command.scan)
                && let Trigger::Reversal {
                    axis: wanted,
                    direction: to,
                } = self.trigger
                && wanted == axis
                && to.is_none_or(|to| to == direction)
            {
                reversed = Some((scan, direction));
            }
        }
        if let Some(path) = &eyes.path {
            self.last_line = path.line_of(feedback).or(self.last_line);
        }
        let fired = self.judge(set, feedback, eyes, reversed);
        self.last = Some(*feedback);
        fired
    }

    fn judge(
        &mut self,
        set: &ScanSet,
        feedback: &Feedback,
        eyes: &Eyes,
        reversed: Option<(u64, i32)>,
    ) -> Option<Fired> {
        let now = feedback.scan;
        let here = |what: String| Fired { scan: now, what };
        let last = self.last.as_ref();
        match &self.trigger {
            Trigger::Now => Some(here("now".into())),
            Trigger::Reversal { axis, .. } => {
                let (scan, direction) = reversed?;
                let sign = if direction > 0 { "+" } else { "−" };
                let what = format!("reversal of {} to {sign}", self.machine.axis_name(*axis));
                Some(Fired { scan, what })
            }
            Trigger::Scan(wanted) => {
                let first = last.is_none() && now == *wanted;
                let passed = last.is_some_and(|last| last.scan < *wanted) && now >= *wanted;
                let (scan, what) = (*wanted, format!("scan {wanted}"));
                (first || passed).then_some(Fired { scan, what })
            }
            Trigger::Trip => {
                let tripped = |f: &Feedback| f.mode == Mode::Tripped as u32;
                let trips = tripped(feedback) && last.is_some_and(|last| !tripped(last));
                let cause = StopCause::of(&self.machine, feedback);
                trips.then(|| here(format!("trip: {}", cause.short())))
            }
            Trigger::Mode(wanted) => {
                let becomes = wanted.is_none_or(|wanted| feedback.mode == wanted as u32);
                let changed = last.is_some_and(|last| last.mode != feedback.mode);
                (changed && becomes).then(|| here(format!("mode {}", mode_word(feedback))))
            }
            Trigger::Order => order(last?, feedback).map(here),
            Trigger::Block(line) => {
                let line = *line;
                let reached = self.judge_block(line, feedback, eyes);
                reached.then(|| here(format!("line {line} reached")))
            }
            Trigger::Level { .. } => self.judge_level(eyes, set, feedback).map(here),
            Trigger::Death(_) => self.died.pop_front(),
        }
    }

    /// Whether the first element at or behind a line comes under way.
    fn judge_block(&mut self, line: u32, feedback: &Feedback, eyes: &Eyes) -> bool {
        let Some(path) = &eyes.path else {
            // Before a program is started nothing of it is reached.
            self.held = feedback.window.is_none().then_some(false);
            return false;
        };
        let known = path.is_of(feedback);
        let element = path.first_element_of(line);
        let holds = known && element.is_some_and(|first| feedback.tag.element >= first);
        // Off the path nothing is left or reached.
        if !known && self.held.is_some() {
            return false;
        }
        let before = self.held.replace(holds);
        holds && before == Some(false)
    }

    /// What a level that fires has done, in words.
    fn judge_level(&mut self, eyes: &Eyes, set: &ScanSet, feedback: &Feedback) -> Option<String> {
        let Trigger::Level {
            signal,
            absolute,
            side,
            threshold,
        } = &self.trigger
        else {
            return None;
        };
        let value = eyes.see(signal, set, feedback);
        let value = if *absolute { value.abs() } else { value };
        if value.is_nan() {
            // Nothing is crossed where nothing is known.
            self.held = None;
            return None;
        }
        self.lowest = self.lowest.min(value);
        self.highest = self.highest.max(value);
        let (holds, word) = match side {
            Side::Above => (value > *threshold, "above"),
            Side::Below => (value < *threshold, "below"),
            Side::Rising => (value >= *threshold, "rising through"),
            Side::Falling => (value <= *threshold, "falling through"),
        };
        let before = self.held.replace(holds);
        let fires = match side {
            Side::Above | Side::Below => holds && before != Some(true),
            Side::Rising | Side::Falling => holds && before == Some(false),
        };
        let bar = if *absolute { "|" } else { "" };
        let (name, unit) = (&signal.name, signal.unit.shown);
        let what = format!("{bar}{name}{bar} {word} {threshold} {unit}");
        fires.then(|| what.trim_end().into())
    }

    /// What was seen in place of the trigger, for who has waited in vain.
    pub fn seen_instead(&self) -> String {
        let (Some(first), Some(last)) = (self.first_scan, &self.last) else {
            return "no scan was seen".into();
        };
        let range = format!("scans {first} to {} were seen", last.scan);
        let more = match &self.trigger {
            Trigger::Now => "none of them was ready".to_string(),
            Trigger::Reversal { .. } => {
                let axes = self.turns.iter().enumerate();
                let counts = axes.map(|(axis, turns)| {
                    format!("{} {}", self.machine.axis_name(axis), turns.count)
                });
                format!("with reversals: {}", joined(counts, ", "))
            }
            Trigger::Level { signal, .. } if self.lowest > self.highest => {
                format!("in none of them {} was known", signal.name)
            }
            Trigger::Level {
                signal, absolute, ..
            } => format!(
                "with {}{} from {:.3} to {:.3} {}",
                if *absolute { "magnitudes of " } else { "" },
                signal.name,
                self.lowest,
                self.highest,
                signal.unit.shown
            ),
            Trigger::Block(_) => match self.last_line {
                Some(line) => format!("the last with line {line} under way"),
                None => "with no line of a known program under way".into(),
            },
            Trigger::Scan(_) | Trigger::Trip | Trigger::Mode(_) | Trigger::Order => {
                let trip = if last.mode == Mode::Tripped as u32 {
                    format!(" ({})", StopCause::of(&self.machine, last).short())
                } else {
                    String::new()
                };
                format!("the last with mode {}{trip}", mode_word(last))
            }
            Trigger::Death(_) if self.died_in_all.is_empty() => "nobody died".into(),
            Trigger::Death(_) => self.died_in_all.join("; "),
        };
        format!("{range}, {more}")
    }
}

/// What of mode, feed hold and override has changed, in words.
fn order(last: &Feedback, feedback: &Feedback) -> Option<String> {
    let mode = (last.mode != feedback.mode).then(|| format!("mode {}", mode_word(feedback)));
    let hold = (last.hold != feedback.hold).then(|| match feedback.hold {
        1 => "feed hold".to_string(),
        _ => "feed hold released".into(),
    });
    let percent = feedback.override_percent;
    let percent = (last.override_percent != percent).then(|| format!("override {percent} %"));
    let changed: Vec<String> = [mode, hold, percent].into_iter().flatten().collect();
    (!changed.is_empty()).then(|| changed.join(", "))
}

fn mode_word(feedback: &Feedback) -> &'static str {
    Mode::from_wire(feedback.mode).map_or("unknown", Mode::word)
}
