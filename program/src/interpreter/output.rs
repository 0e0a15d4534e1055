//! What a program makes: its path, and what happens along it.

use super::*;

/// Everything that a program made so far.
#[derive(Debug, Clone, Default)]
pub struct Output {
    pub path: Path,
    pub events: Vec<Event>,
    pub messages: Vec<Message>,
    pub notes: Notes,
    pub straight_feeds: u32,
    pub arc_feeds: u32,
}

/// Remarks, one of each kind.
#[derive(Debug, Clone, Default)]
pub struct Notes {
    first: BTreeMap<&'static str, (u32, u32)>,
}

impl Notes {
    pub fn keep(&mut self, line: u32, text: &'static str) {
        self.first.entry(text).or_insert((line, 0)).1 += 1;
    }

    /// In the order of their lines.
    pub fn by_line(&self) -> Vec<Note> {
        let mut notes: Vec<Note> = self
            .first
            .iter()
            .map(|(&text, &(line, count))| Note {
                line,
                count,
                text: text.to_owned(),
            })
            .collect();
        notes.sort_by_key(|note| note.line);
        notes
    }
}
