//! What a program makes: its path, and what happens along it.

use super::Element;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::program::{BLOCKS_MAX, Event, EventKind, Message, Note, Piece};
use crate::refusal::{Refusal, refuse};

/// The most elements of one path; an arc block makes up to two, a drilling block as many as it has moves.
const ELEMENTS_MAX: u64 = 2 * BLOCKS_MAX as u64;

/// What a program made so far, or made since somebody took it away.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Output {
    /// What is still here.
    #[serde(skip)]
    pub piece: Piece,
    /// How many elements, events and messages there were in all.
    pub counts: Counts,
    /// How many elements there may be.
    pub bound: Bound,
    pub notes: Notes,
    pub straight_feeds: u32,
    pub arc_feeds: u32,
    /// A number in some element is not finite.
    pub is_infinite: bool,
    /// The last motion was in G61.1.
    stopped_exactly: bool,
}

/// How many elements there may be.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub enum Bound {
    /// So many in a program.
    Program(u64),
    /// So many in one block, which begins behind so many.
    Block {
        /// So many.
        most: u64,
        /// Elements before it.
        before: u64,
    },
}

impl Default for Bound {
    fn default() -> Self {
        Bound::Program(ELEMENTS_MAX)
    }
}

/// How many elements, events and messages there were in all.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Counts {
    pub elements: u64,
    /// Those of them that are waits.
    pub dwells: u64,
    pub events: u64,
    pub messages: u64,
}

/// How much there was at a moment.
#[derive(Debug, Clone, Copy)]
pub struct Mark {
    counts: Counts,
    here: [usize; 3],
}

impl Output {
    /// All that was made so far, as a number that grows with it.
    pub fn made(&self) -> u64 {
        self.counts.elements + self.counts.events
    }

    /// The moves among them.
    pub fn moves_made(&self) -> u64 {
        self.counts.elements - self.counts.dwells
    }

    /// A wait.
    pub fn wait(&mut self, dwell: Element) {
        self.add(dwell);
        self.counts.dwells += 1;
    }

    pub fn elements_made(&self) -> u64 {
        self.counts.elements
    }

    /// Adds an element.
    pub fn add(&mut self, element: Element) {
        self.is_infinite |= !element.shape.is_finite();
        self.add_finite(element);
    }

    /// Adds an element whose numbers are known to be finite.
    #[inline]
    pub fn add_finite(&mut self, element: Element) {
        self.piece.elements.push(element);
        self.counts.elements += 1;
    }

    /// Whether the tool rests before a motion: in G61.1 it does before and behind each.
    #[inline]
    pub fn rests_before(&mut self, stops_exactly: bool) -> bool {
        let stopped = std::mem::replace(&mut self.stopped_exactly, stops_exactly);
        stops_exactly || stopped
    }

    pub fn happen(&mut self, line: u32, kind: EventKind) {
        let before_element = self.counts.elements as usize;
        self.piece.events.push(Event {
            line,
            before_element,
            kind,
        });
        self.counts.events += 1;
    }

    /// Something that happens behind the element that comes next.
    pub fn happen_behind_next(&mut self, line: u32, kind: EventKind) {
        self.happen(line, kind);
        if let Some(event) = self.piece.events.last_mut() {
            event.before_element += 1;
        }
    }

    pub fn say(&mut self, line: u32, log_only: bool, text: String) {
        let before_element = self.counts.elements as usize;
        let before_event = self.piece.events.len() as u64;
        self.piece.messages.push(Message {
            line,
            before_element,
            before_event,
            log_only,
            text,
        });
        self.counts.messages += 1;
    }

    /// Refuses elements, or so many more, beyond those that there may be.
    pub fn check_room(&self, more: f64, offset: usize) -> Result<(), Refusal> {
        let made = self.counts.elements;
        let (most, here, of, right) = match self.bound {
            Bound::Program(most) => (most, made, "moves", "split the program"),
            Bound::Block { most, before } => {
                (most, made - before, "moves in one block", "split the block")
            }
        };
        if here as f64 + more <= most as f64 {
            return Ok(());
        }
        let found = if more > 0.0 {
            format!("holes that take the path beyond {most} elements")
        } else {
            format!("more than {most} {of}")
        };
        refuse(offset, found, right)
    }

    /// A block begins, if the elements of one are counted.
    pub fn begin_block(&mut self) {
        if let Bound::Block { before, .. } = &mut self.bound {
            *before = self.counts.elements;
        }
    }

    /// How much there is now.
    pub fn mark(&self) -> Mark {
        let Piece {
            elements,
            events,
            messages,
        } = &self.piece;
        Mark {
            counts: self.counts,
            here: [elements.len(), events.len(), messages.len()],
        }
    }

    /// Takes back what was made since then.
    pub fn take_back(&mut self, mark: &Mark) {
        let [elements, events, messages] = mark.here;
        self.counts = mark.counts;
        self.piece.elements.truncate(elements);
        self.piece.events.truncate(events);
        self.piece.messages.truncate(messages);
    }
}

/// Remarks, one of each kind.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Notes {
    first: BTreeMap<Cow<'static, str>, (u32, u32)>,
}

impl Notes {
    pub fn keep(&mut self, line: u32, text: &'static str) {
        self.first.entry(text.into()).or_insert((line, 0)).1 += 1;
    }

    /// In the order of their lines.
    pub fn by_line(&self) -> Vec<Note> {
        let mut notes: Vec<Note> = self
            .first
            .iter()
            .map(|(text, &(line, count))| Note {
                line,
                count,
                text: text.clone().into_owned(),
            })
            .collect();
        notes.sort_by_key(|note| note.line);
        notes
    }
}
