//! What is noted of named inputs and outputs: alarms that come, go and are acknowledged, and signals that an operator forces.

use bus::port::Reader;
use bus::sample::{SIGNALS_MAX, SignalSet, Signals, has_bit};
use machine::Machine;

/// Looks at the signals of a cell.
#[derive(Debug)]
pub struct SignalWatch {
    reader: Reader<Signals>,
    alarms: u64,
    unacknowledged: u64,
    forced: SignalSet,
}

/// What is to be said now.
#[derive(Debug, PartialEq, Eq)]
pub struct Noted {
    /// The scan it was seen in.
    pub scan: u64,
    /// Word of the event.
    pub event: &'static str,
    /// For people.
    pub words: String,
    /// Whether it is news that somebody has to see to.
    pub urgent: bool,
}

impl SignalWatch {
    /// From now on.
    pub fn new(reader: Reader<Signals>) -> SignalWatch {
        SignalWatch {
            reader,
            alarms: 0,
            unacknowledged: 0,
            forced: SignalSet::default(),
        }
    }

    /// Looks at the newest sample.
    pub fn look(&mut self, machine: &Machine) -> Vec<Noted> {
        match self.reader.newest(u64::MAX) {
            Some(newest) => self.compare(&newest, machine),
            None => Vec::new(),
        }
    }

    fn compare(&mut self, newest: &Signals, machine: &Machine) -> Vec<Noted> {
        let mut noted = Vec::new();
        let mut note = |event, words, urgent| {
            noted.push(Noted {
                scan: newest.scan,
                event,
                words,
                urgent,
            });
        };
        for (index, alarm) in machine.alarms.iter().enumerate() {
            let (number, text, remedy) = (alarm.number, &alarm.text, &alarm.remedy);
            let [was, is] = [self.alarms, newest.alarms].map(|set| has_bit(set, index));
            let sets = [self.unacknowledged, newest.unacknowledged];
            let [was_new, is_new] = sets.map(|set| has_bit(set, index));
            if is && !was || is_new && !was_new && !is {
                let what_to_do = if remedy.is_empty() {
                    String::new()
                } else {
                    format!(": {remedy}")
                };
                note("alarm", format!("alarm {number}, {text}{what_to_do}"), true);
            }
            if was && !is {
                note(
                    "alarm over",
                    format!("alarm {number}, {text}: is over"),
                    false,
                );
            }
            if was_new && !is_new {
                note(
                    "alarm acknowledged",
                    format!("alarm {number}, {text}: acknowledged"),
                    false,
                );
            }
        }
        for (index, signal) in machine.signals.iter().enumerate().take(SIGNALS_MAX) {
            let name = &signal.name;
            match (self.forced.has(index), newest.forced.has(index)) {
                (false, true) => {
                    let value = newest.values().get(index).copied().unwrap_or_default();
                    note(
                        "signal forced",
                        format!("signal {name} is forced to {value}"),
                        false,
                    );
                }
                (true, false) => note(
                    "signal released",
                    format!("signal {name} follows its source again"),
                    false,
                ),
                _ => {}
            }
        }
        self.alarms = newest.alarms;
        self.unacknowledged = newest.unacknowledged;
        self.forced = newest.forced;
        noted
    }
}
