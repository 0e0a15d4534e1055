//! From one line of text to words: a letter and a number each, with their place.

/// The largest number a word may have, in whatever unit; far beyond any machine, far within exact arithmetic.
const NUMBER_MAX: f64 = 1e9;

/// The most words of one block: twice what can be in one without conflict. Bounds the memory of a hostile line.
const WORDS_MAX: usize = 64;

/// A letter with its number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Word {
    /// Upper case, A to Z.
    pub letter: char,
    /// The number after it.
    pub value: f64,
    /// Byte offset of the letter in the line.
    pub offset: usize,
    /// Byte offset behind the number.
    pub end: usize,
}

/// What one line holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Line {
    /// Its words in order.
    pub words: Vec<Word>,
    /// A `/` stands before the first word (block delete).
    pub block_delete: bool,
    /// It is a `%` line: beginning or end of the program.
    pub percent: bool,
}

/// A line that cannot be read: where, what was found, what would be right.
#[derive(Debug, Clone, PartialEq)]
pub struct Unreadable {
    /// Byte offset in the line.
    pub offset: usize,
    /// What was found.
    pub found: String,
    /// What would be right.
    pub right: String,
}

/// Reads one line, without its line end. Time is linear in its length.
pub fn read_line(text: &str) -> Result<Line, Unreadable> {
    let unreadable = |offset, found: String, right: &str| {
        Err(Unreadable {
            offset,
            found,
            right: right.to_owned(),
        })
    };
    // Before comments are skipped: an editor shows the text behind a lone carriage return as a line of its own, and a
    // comment before it must not swallow that line.
    if let Some(offset) = text.find('\r') {
        return unreadable(
            offset,
            "a carriage return inside a line".into(),
            "end lines with LF or CR LF",
        );
    }
    let bytes = text.as_bytes();
    let mut line = Line::default();
    let mut offset = 0;
    while let Some(&byte) = bytes.get(offset) {
        match byte {
            b' ' | b'\t' => offset += 1,
            b';' => break,
            b'(' => offset = comment_end(text, offset)?,
            b'/' if line.words.is_empty() && !line.block_delete => {
                line.block_delete = true;
                offset += 1;
            }
            b'%' if line.words.is_empty() && !line.percent && !line.block_delete => {
                line.percent = true;
                offset += 1;
            }
            _ if line.percent => {
                return unreadable(
                    offset,
                    format!("{} on a % line", shown(text, offset)),
                    "% stands alone on its line",
                );
            }
            letter if letter.is_ascii_alphabetic() => {
                if line.words.len() >= WORDS_MAX {
                    let found = format!("more than {WORDS_MAX} words");
                    return unreadable(
                        offset,
                        found,
                        "one block is one line; break it into several",
                    );
                }
                let word = read_word(text, offset)?;
                offset = word.end;
                line.words.push(word);
            }
            _ => return unreadable(offset, shown(text, offset), instead_of(byte)),
        }
    }
    Ok(line)
}

/// What would be right where no word can begin.
fn instead_of(byte: u8) -> &'static str {
    match byte {
        b'#' | b'[' | b']' | b'=' => {
            "parameters and expressions are not supported; write plain numbers"
        }
        b'<' | b'>' => "names and subroutines are not supported; write the moves out",
        b')' => "no comment is open here",
        b'0'..=b'9' | b'.' | b'+' | b'-' => {
            "a number must follow its letter, without spaces inside it"
        }
        b'/' => "block delete (/) belongs before the first word",
        _ => "a block is made of letters with numbers, such as G1 X12.5 F600",
    }
}

/// Offset behind the comment that opens at `offset`.
fn comment_end(text: &str, offset: usize) -> Result<usize, Unreadable> {
    let inside = text.get(offset + 1..).unwrap_or_default();
    let unreadable = |found: &str, at: usize, right: &str| {
        Err(Unreadable {
            offset: at,
            found: found.to_owned(),
            right: right.to_owned(),
        })
    };
    match inside.find(['(', ')']) {
        Some(length) if inside.as_bytes().get(length) == Some(&b')') => Ok(offset + 1 + length + 1),
        Some(length) => unreadable(
            "( inside a comment",
            offset + 1 + length,
            "comments do not nest; close with ) first",
        ),
        None => unreadable(
            "a comment that is not closed",
            offset,
            "close it with ) on the same line",
        ),
    }
}

/// Reads the word whose letter is at `offset`.
fn read_word(text: &str, offset: usize) -> Result<Word, Unreadable> {
    let bytes = text.as_bytes();
    let byte_at = |at: usize| bytes.get(at).copied().unwrap_or(b' ');
    let letter = char::from(byte_at(offset)).to_ascii_uppercase();
    let mut start = offset + 1;
    while start < bytes.len() && matches!(byte_at(start), b' ' | b'\t') {
        start += 1;
    }
    let mut end = start;
    if matches!(byte_at(end), b'+' | b'-') {
        end += 1;
    }
    let (mut digits, mut points) = (0, 0);
    while byte_at(end).is_ascii_digit() || (byte_at(end) == b'.' && points == 0) {
        if byte_at(end) == b'.' {
            points += 1
        } else {
            digits += 1
        }
        end += 1;
    }
    let unreadable = |offset, found: String, right: &str| {
        Err(Unreadable {
            offset,
            found,
            right: right.to_owned(),
        })
    };
    if letter == 'O' {
        let right =
            "program numbers and subroutines (O-words) are not supported; write the moves out";
        return unreadable(offset, "O".into(), right);
    }
    if digits == 0 {
        let next = shown(text, start);
        let right = match byte_at(start) {
            b'#' | b'[' => "parameters and expressions are not supported; write plain numbers",
            _ => "a number must follow, such as 12.5 or -.5",
        };
        return unreadable(offset, format!("{letter} followed by {next}"), right);
    }
    let number = text.get(start..end).unwrap_or_default();
    match number.parse::<f64>() {
        Ok(value) if value.abs() <= NUMBER_MAX => Ok(Word {
            letter,
            value,
            offset,
            end,
        }),
        _ => unreadable(
            offset,
            format!("{letter} with a number of {} characters", end - start),
            "at most 1e9",
        ),
    }
}

/// The character at an offset as a person can read it.
fn shown(text: &str, offset: usize) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn words(text: &str) -> Vec<(char, f64)> {
        read_line(text)
            .unwrap()
            .words
            .iter()
            .map(|word| (word.letter, word.value))
            .collect()
    }

    #[test]
    fn words_need_no_spaces_and_no_upper_case() {
        assert_eq!(
            words("g1x5.Y-3z+.5"),
            [('G', 1.0), ('X', 5.0), ('Y', -3.0), ('Z', 0.5)]
        );
        assert_eq!(words("\tG 01  X 1.25 ; rest G2"), [('G', 1.0), ('X', 1.25)]);
    }

    #[test]
    fn comments_are_skipped_wherever_they_stand() {
        assert_eq!(words("(a) G1 (b; ü) X2 ( c )"), [('G', 1.0), ('X', 2.0)]);
    }

    #[test]
    fn numbers_keep_their_full_precision() {
        assert_eq!(words("X219.123456789")[0].1, 219.123_456_789);
    }

    #[test]
    fn percent_and_block_delete_are_recognised() {
        assert!(read_line("  % (start)").unwrap().percent);
        assert!(read_line("/G1X1").unwrap().block_delete);
    }

    #[test]
    fn each_malformed_line_is_refused_at_its_place() {
        for (text, offset) in [
            ("G1 X", 3),
            ("G1 X-", 3),
            ("G1 X.", 3),
            ("G1 X1.2.3", 7),
            ("G1 X--1", 3),
            ("G1 X1 2", 6),
            ("G1 (open", 3),
            ("G1 (a(b)", 5),
            ("G1 X#1", 3),
            ("#1=5", 0),
            ("G1 X[1+2]", 3),
            ("o100 sub", 0),
            ("G1 X1 )", 6),
            ("G1 X5*33", 5),
            ("% G1", 2),
            ("G1 / X1", 3),
            ("5 X1", 0),
            ("; ok\rG1 X5", 4),
            ("G1 \u{e4}", 3),
        ] {
            assert_eq!(read_line(text).unwrap_err().offset, offset, "{text}");
        }
    }

    #[test]
    fn a_number_too_large_is_refused() {
        assert!(read_line(&format!("X{}", "9".repeat(400))).is_err());
    }

    #[test]
    fn a_line_of_endless_words_is_refused() {
        assert_eq!(read_line(&"G1".repeat(1000)).unwrap_err().offset, 128);
    }

    #[test]
    fn columns_count_characters_not_bytes() {
        assert_eq!(column("(äö) Q", "(äö) ".len()), 6);
    }

    proptest! {
        #[test]
        fn any_line_is_read_or_refused_inside_itself(text in "\\PC{0,60}") {
            match read_line(&text) {
                Ok(line) => prop_assert!(line.words.iter().all(|word| word.end <= text.len())),
                Err(unreadable) => prop_assert!(unreadable.offset <= text.len()),
            }
        }
    }
}
