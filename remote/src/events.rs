//! How all events arrive in order although messages get lost: they are numbered, and who misses one asks for it.

use std::collections::{BTreeMap, VecDeque};

use crate::wire::{EVENTS_MAX, EventHistory, EventReport, FORMAT};

/// Events that a server remembers for those who come late or missed some.
pub const REMEMBERED: usize = 2000;
/// Events that came out of order and wait for those before them; more are asked for again.
const WAITING_MAX: usize = 256;

/// What a server remembers.
#[derive(Debug)]
pub struct History {
    session: u64,
    events: VecDeque<EventReport>,
    count: u64,
}

impl History {
    /// Of a server that has reported nothing yet.
    pub fn new(session: u64) -> Self {
        History {
            session,
            events: VecDeque::new(),
            count: 0,
        }
    }

    /// Numbers an event and remembers it; the oldest goes.
    pub fn add(&mut self, scan: u64, warning: bool, text: String) -> EventReport {
        self.count += 1;
        let event = EventReport {
            format: FORMAT,
            session: self.session,
            number: self.count,
            scan,
            warning,
            text,
        };
        if self.events.len() == REMEMBERED {
            self.events.pop_front();
        }
        self.events.push_back(event.clone());
        event
    }

    /// Gives an event another text; the event if that is news.
    pub fn amend(&mut self, number: u64, text: &str) -> Option<EventReport> {
        let oldest = self.oldest();
        let index = usize::try_from(number.checked_sub(oldest)?).ok()?;
        let event = self.events.get_mut(index).filter(|e| e.text != text)?;
        event.text = text.into();
        Some(event.clone())
    }

    /// Number of the last event.
    pub fn count(&self) -> u64 {
        self.count
    }

    fn oldest(&self) -> u64 {
        self.count + 1 - self.events.len() as u64
    }

    /// What comes after a number, a part at a time.
    pub fn after(&self, number: u64) -> EventHistory {
        let oldest = self.oldest();
        let known = (number.saturating_add(1)).saturating_sub(oldest);
        let skip = usize::try_from(known).unwrap_or(usize::MAX);
        let events = self.events.iter().skip(skip).take(EVENTS_MAX);
        EventHistory {
            format: FORMAT,
            session: self.session,
            oldest,
            events: events.cloned().collect(),
        }
    }
}

/// What a follower hands on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reported {
    /// The next event.
    New(EventReport),
    /// One that was reported before has another text.
    Amended(EventReport),
    /// So many were forgotten by the server before they could be asked for.
    Lost(u64),
}

/// Puts events in order.
#[derive(Debug)]
pub struct Follower {
    /// Number of the next one.
    next: u64,
    /// The highest number that is known to exist.
    known: u64,
    waiting: BTreeMap<u64, EventReport>,
}

impl Default for Follower {
    fn default() -> Self {
        Follower {
            next: 1,
            known: 0,
            waiting: BTreeMap::new(),
        }
    }
}

impl Follower {
    /// Learns that the server has reported so many.
    pub fn there_are(&mut self, count: u64) {
        self.known = self.known.max(count);
    }

    /// The number after which to ask; none if nothing is missing.
    pub fn ask_after(&self) -> Option<u64> {
        (self.known >= self.next).then(|| self.next - 1)
    }

    /// Takes an event in whatever order; hands on what is next now.
    pub fn take(&mut self, event: EventReport, reported: &mut Vec<Reported>) {
        self.there_are(event.number);
        if event.number < self.next {
            reported.push(Reported::Amended(event));
            return;
        }
        if event.number == self.next {
            self.next = self.next.saturating_add(1);
            reported.push(Reported::New(event));
            while let Some(event) = self.waiting.remove(&self.next) {
                self.next = self.next.saturating_add(1);
                reported.push(Reported::New(event));
            }
        } else if self.waiting.len() < WAITING_MAX {
            self.waiting.insert(event.number, event);
        }
    }

    /// Takes an answer.
    pub fn history(&mut self, history: EventHistory, reported: &mut Vec<Reported>) {
        if history.oldest > self.next {
            reported.push(Reported::Lost(history.oldest - self.next));
            self.next = history.oldest;
            self.waiting.retain(|number, _| *number >= history.oldest);
        }
        for event in history.events {
            if event.number >= self.next {
                self.take(event, reported);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn numbers(reported: &[Reported]) -> Vec<u64> {
        let new = reported.iter().filter_map(|reported| match reported {
            Reported::New(event) => Some(event.number),
            _ => None,
        });
        new.collect()
    }

    fn history(count: u64) -> History {
        let mut history = History::new(7);
        for scan in 1..=count {
            history.add(scan, false, format!("event {scan}"));
        }
        history
    }

    #[test]
    fn who_comes_late_asks_its_way_through_all_that_is_remembered_and_knows_what_is_not() {
        let server = history(REMEMBERED as u64 + 50);
        let mut follower = Follower::default();
        follower.there_are(server.count());
        let mut reported = Vec::new();
        while let Some(after) = follower.ask_after() {
            follower.history(server.after(after), &mut reported);
        }
        assert_eq!(reported.first(), Some(&Reported::Lost(50)));
        assert_eq!(
            numbers(&reported),
            (51..=server.count()).collect::<Vec<_>>()
        );
    }

    #[test]
    fn an_amended_event_is_reported_again_without_a_new_number() {
        let mut server = history(3);
        assert_eq!(server.amend(2, "event 2"), None);
        let amended = server.amend(2, "event 2, twice").expect("news");
        let mut follower = Follower::default();
        let mut reported = Vec::new();
        follower.history(history(3).after(0), &mut reported);
        reported.clear();
        follower.take(amended.clone(), &mut reported);
        assert_eq!(reported, [Reported::Amended(amended)]);
        assert_eq!(server.amend(4, "?"), None);
        assert_eq!(server.amend(0, "?"), None);
    }

    #[test]
    fn a_server_that_lies_about_its_numbers_costs_bounded_memory() {
        let mut follower = Follower::default();
        let mut reported = Vec::new();
        for number in 0..100_000u64 {
            let mut event = history(1).add(1, false, String::new());
            event.number = 5 + number * 2;
            follower.take(event, &mut reported);
        }
        assert!(reported.is_empty());
        assert_eq!(follower.waiting.len(), WAITING_MAX);
    }

    proptest! {
        /// Whatever is lost, doubled or overtaken on the way: with asking, each event is reported once and in order.
        #[test]
        fn every_event_is_reported_once_and_in_order(
            count in 1u64..300,
            arrivals in prop::collection::vec(1u64..300, 0..400),
        ) {
            let server = history(count);
            let mut follower = Follower::default();
            let mut reported = Vec::new();
            for number in arrivals.into_iter().filter(|number| *number <= count) {
                let event = server.after(number - 1).events.first().cloned().expect("one");
                follower.take(event, &mut reported);
            }
            follower.there_are(count);
            while let Some(after) = follower.ask_after() {
                follower.history(server.after(after), &mut reported);
            }
            prop_assert_eq!(numbers(&reported), (1..=count).collect::<Vec<_>>());
        }
    }
}
