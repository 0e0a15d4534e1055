//! What a program says, in order: each text at the element that comes behind it. A pure function of the program, so every planner of a
//! run numbers alike.

use std::collections::VecDeque;

use bus::messages::ProgramMessage;
use program::Message;

/// Texts that wait for the path at a time; with more the oldest are dropped, and readers count the numbers that are missing.
pub const WAITING_MAX: usize = 65_536;
/// Texts that are written in one period; where the path comes to more at once, the last of them.
const AT_A_TIME: usize = 512;

/// A text that the path has not come to.
#[derive(Debug, Clone)]
struct Waiting {
    message: ProgramMessage,
    /// The first element behind it.
    element: u32,
    /// Number of the last event at rest before it.
    events: u32,
}

/// The texts that the path has still to come to.
#[derive(Debug, Clone, Default)]
pub struct Messages {
    /// Number of the last one that was read.
    last: u32,
    /// Of the last one that the path has come to.
    pub passed: u32,
    waiting: VecDeque<Waiting>,
    /// So many of them, from the front, are written where readers find them.
    written: usize,
}

impl Messages {
    /// Those behind so many.
    pub fn after(last: u32) -> Messages {
        Messages {
            last,
            passed: last,
            ..Messages::default()
        }
    }

    /// How many were read.
    pub fn last(&self) -> u32 {
        self.last
    }

    /// The next text, with its number.
    pub fn number(&mut self, message: &Message) -> ProgramMessage {
        self.last = self.last.saturating_add(1);
        let plain = |c: char| if c.is_control() { ' ' } else { c };
        ProgramMessage {
            number: self.last,
            line: message.line,
            log_only: message.log_only,
            text: message.text.chars().map(plain).collect(),
        }
    }

    /// Puts a text before an element and behind an event.
    pub fn push(&mut self, message: ProgramMessage, element: u32, events: u32) {
        if self.waiting.len() >= WAITING_MAX {
            self.waiting.remove(self.written);
        }
        self.waiting.push_back(Waiting {
            message,
            element,
            events,
        });
    }

    /// Texts that are to be written now: those before `until_element`, and those that are due.
    pub fn write(
        &mut self,
        until_element: u32,
        is_due: impl Fn(u32, u32) -> bool,
        out: &mut Vec<ProgramMessage>,
    ) {
        let due = self
            .waiting
            .partition_point(|at| is_due(at.element, at.events));
        if let Some(first) = due.checked_sub(AT_A_TIME).filter(|at| *at > self.written) {
            self.waiting.drain(self.written..first);
        }
        let next = self.waiting.iter().skip(self.written).take(AT_A_TIME);
        let near = |at: &&Waiting| at.element <= until_element || is_due(at.element, at.events);
        out.extend(next.take_while(near).map(|at| at.message.clone()));
        self.written += out.len();
    }

    /// Lets go of those that are due: they are not to be published.
    pub fn skip(&mut self, is_due: impl Fn(u32, u32) -> bool) {
        while self.pass_next(&is_due) {}
    }

    /// The path comes to those that are written and due; `is_due` judges by the element and the event that they stand between.
    pub fn pass(&mut self, is_due: impl Fn(u32, u32) -> bool) {
        while self.written > 0 && self.pass_next(&is_due) {}
    }

    /// The path comes to the next one, if it is due.
    fn pass_next(&mut self, is_due: &impl Fn(u32, u32) -> bool) -> bool {
        let next = self.waiting.front();
        let Some(next) = next.filter(|next| is_due(next.element, next.events)) else {
            return false;
        };
        self.passed = next.message.number;
        self.waiting.pop_front();
        self.written = self.written.saturating_sub(1);
        true
    }
}

#[cfg(test)]
#[allow(clippy::expect_used, clippy::indexing_slicing)]
mod tests {
    use super::*;

    fn message(line: u32) -> Message {
        Message {
            line,
            before_element: 0,
            before_event: 0,
            log_only: false,
            text: format!("line {line}\u{1b}[2J"),
        }
    }

    fn read(messages: &mut Messages, line: u32, element: u32, events: u32) {
        let numbered = messages.number(&message(line));
        messages.push(numbered, element, events);
    }

    #[test]
    fn a_text_is_passed_only_once_it_is_written_and_its_place_is_reached() {
        let mut messages = Messages::default();
        for (line, element) in [(1, 0), (2, 3), (3, 9)] {
            read(&mut messages, line, element, 0);
        }
        messages.pass(|_, _| true);
        assert_eq!(messages.passed, 0);
        let mut out = Vec::new();
        messages.write(3, |_, _| false, &mut out);
        assert_eq!(out.len(), 2);
        messages.pass(|element, _| element <= 2);
        assert_eq!(messages.passed, 1);
        messages.pass(|_, _| true);
        assert_eq!(messages.passed, 2);
        out.clear();
        messages.write(3, |_, _| true, &mut out);
        assert_eq!(out.len(), 1);
        assert_eq!(&*out[0].text, "line 3 [2J", "nothing commands a terminal");
    }

    #[test]
    fn a_flood_of_texts_takes_bounded_memory_and_keeps_its_numbers() {
        let mut messages = Messages::default();
        for line in 0..1_000_000 {
            read(&mut messages, line, 1, 0);
        }
        assert_eq!(messages.waiting.len(), WAITING_MAX);
        assert_eq!(messages.last(), 1_000_000);
        let mut out = Vec::new();
        messages.write(1, |_, _| true, &mut out);
        messages.pass(|_, _| true);
        assert_eq!(out.len(), AT_A_TIME);
        assert_eq!(messages.passed, 1_000_000, "the last one is said");
        read(&mut messages, 7, 2, 0);
        let mut out = Vec::new();
        messages.write(2, |_, _| true, &mut out);
        assert_eq!(out[0].number, 1_000_001);
    }
}
