//! What a block makes, in its order: words and cycles become a list of these before any of them is done.

use path::geometry::{AxisVector, Feed};

use crate::program::EventKind;

/// One thing that a block makes.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    /// A remark, kept once of a kind.
    Note(&'static str),
    /// Something beside the axes.
    Event(EventKind),
    /// A wait, in s.
    Dwell(f64),
    /// A straight move of all axes to a place of the machine.
    Move(AxisVector, Feed),
}

/// What a block makes, in order.
#[derive(Debug, Clone, Default)]
pub struct Acts(pub Vec<Act>);

impl Acts {
    /// Adds a remark.
    pub fn note(&mut self, text: &'static str) {
        self.0.push(Act::Note(text));
    }

    /// Adds something beside the axes.
    pub fn event(&mut self, kind: EventKind) {
        self.0.push(Act::Event(kind));
    }

    /// Adds a wait, in s.
    pub fn dwell(&mut self, seconds: f64) {
        self.0.push(Act::Dwell(seconds));
    }

    /// Adds a straight move.
    pub fn go(&mut self, to: AxisVector, feed: Feed) {
        self.0.push(Act::Move(to, feed));
    }
}
