//! Why a program is refused: a place in a line, what was found there, and what would be right.

use bus::numbers::short_numbers;

/// One reason to refuse a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Byte offset in the line.
    pub offset: usize,
    /// What was found.
    pub found: String,
    /// What would be right.
    pub right: String,
    /// Position and modes behind the block are known all the same: later blocks can be judged by them.
    pub state_stays_known: bool,
}

impl Refusal {
    pub fn new(offset: usize, found: impl Into<String>, right: impl Into<String>) -> Self {
        Self {
            offset,
            found: short_numbers(found.into()),
            right: short_numbers(right.into()),
            state_stays_known: false,
        }
    }

    /// The same at a byte of the line.
    pub fn at(self, offset: usize) -> Self {
        Self { offset, ..self }
    }
}

/// A block that is done, or all that it is refused for.
pub type Done = Result<(), Vec<Refusal>>;

/// One refusal where a block may have several.
impl From<Refusal> for Vec<Refusal> {
    fn from(refusal: Refusal) -> Self {
        vec![refusal]
    }
}

/// Refuses what was found at a byte of a line.
pub fn refuse<T, E: From<Refusal>>(
    offset: usize,
    found: impl Into<String>,
    right: impl Into<String>,
) -> Result<T, E> {
    Err(Refusal::new(offset, found, right).into())
}

/// The same where it has no place of its own: what computes a motion knows none.
pub fn wrong<T>(found: impl Into<String>, right: impl Into<String>) -> Result<T, Refusal> {
    refuse(0, found, right)
}

/// A result that depends on nothing being wrong.
pub fn if_none(refusals: Vec<Refusal>) -> Done {
    if refusals.is_empty() {
        Ok(())
    } else {
        Err(refusals)
    }
}

/// The character at an offset as a person can read it.
pub fn shown(text: &str, offset: usize) -> String {
    match text.get(offset..).and_then(|rest| rest.chars().next()) {
        None => "the end of the line".into(),
        Some(character) if character.is_control() => {
            format!("a control character (U+{:04X})", u32::from(character))
        }
        Some(character) => format!("'{character}'"),
    }
}

/// Column of a byte offset, counted from 1 in characters.
pub fn column(text: &str, offset: usize) -> u32 {
    let before = text
        .char_indices()
        .take_while(|&(at, _)| at < offset)
        .count();
    u32::try_from(before).unwrap_or(u32::MAX - 1) + 1
}
