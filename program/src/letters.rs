//! Letters of words.

/// Letters that can name an axis, in the order of the parameters and of the tool table.
pub const AXIS_LETTERS: &str = "XYZABCUVW";
