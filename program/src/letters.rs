//! Letters of words.

/// Letters that can name an axis.
pub const AXIS_LETTERS: &str = "XYZABCUVW";
