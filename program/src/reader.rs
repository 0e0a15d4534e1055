//! From one line of text to a block: words with their values and places, parameters that it sets, comments that say something, or
//! a word of program flow.

use crate::expression::{Cursor, Lookup, Target};
use crate::flow::{FlowWord, read_flow_word};

/// The most words of one block: twice what can be in one without conflict. Bounds the memory of a hostile line.
const WORDS_MAX: usize = 64;

/// A letter with its number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Word {
    /// Upper case, A to Z, or one of `@` `^` `$`.
    pub letter: char,
    /// The number after it.
    pub value: f64,
    /// Byte offset of the letter in the line.
    pub offset: usize,
    /// Byte offset behind the number.
    pub end: usize,
}

/// What a comment asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommentKind {
    /// MSG: shown to the operator as it stands.
    Message,
    /// DEBUG: the same as PRINT, unless #5599 is 0.
    Debug,
    /// PRINT: shown to the operator, parameters replaced by their values.
    Print,
    /// LOG: written into the log, parameters replaced by their values.
    Log,
    /// LOGOPEN, LOGAPPEND, LOGCLOSE: no file but the run's own is written.
    LogFile,
    /// PROBEOPEN: from here on what a probe finds is written into the log.
    ProbeOpen,
    /// PROBECLOSE: from here on it is not.
    ProbeClose,
    /// ABORT: the program is given up, parameters of its text replaced by their values.
    Abort,
    /// ABORT without a comma at once behind it: it does nothing.
    NoAbort,
    /// PY, PYRUN, PYRELOAD: refused.
    Python,
}

/// The words of comments that ask for something, with what stands behind each of them (LinuxCNC manual, *G Code Overview*: comments;
/// interp_convert.cc, `convert_comment`; emccanon.cc, `COMMENT`). Their case means nothing.
const COMMENT_WORDS: [(&str, &str, CommentKind); 14] = [
    ("msg", ",", CommentKind::Message),
    ("debug", ",", CommentKind::Debug),
    ("print", ",", CommentKind::Print),
    ("log", ",", CommentKind::Log),
    ("logopen", ",", CommentKind::LogFile),
    ("logappend", ",", CommentKind::LogFile),
    ("logclose", "", CommentKind::LogFile),
    ("probeopen", " ", CommentKind::ProbeOpen),
    ("probeclose", "", CommentKind::ProbeClose),
    ("abort", ",", CommentKind::Abort),
    ("abort", "", CommentKind::NoAbort),
    ("py", ",", CommentKind::Python),
    ("pyrun", ",", CommentKind::Python),
    ("pyreload", "", CommentKind::Python),
];

/// What one line holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Line {
    /// Its words in order.
    pub words: Vec<Word>,
    /// A `/` stands before the first word (block delete).
    pub block_delete: bool,
    /// It is a `%` line: beginning or end of the program.
    pub percent: bool,
    /// A number was written with blanks inside it.
    pub blanks_in_number: bool,
    /// Parameters that it sets, in order.
    pub assignments: Vec<(Target, f64)>,
    /// Comments that say something, with their text.
    pub comments: Vec<(CommentKind, String)>,
    /// A word of program flow: an O-word.
    pub flow: Option<FlowWord>,
}

impl Line {
    fn clear(&mut self) {
        self.words.clear();
        self.block_delete = false;
        self.percent = false;
        self.blanks_in_number = false;
        self.assignments.clear();
        self.comments.clear();
        self.flow = None;
    }

    /// Nothing is to be done.
    pub fn is_empty(&self) -> bool {
        !self.is_block() && self.comments.is_empty()
    }

    /// It does more than say something.
    pub fn is_block(&self) -> bool {
        let mut comments = self.comments.iter();
        !self.words.is_empty()
            || !self.assignments.is_empty()
            || self.flow.is_some()
            || comments.any(|(kind, _)| *kind == CommentKind::Abort)
    }
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

/// Reads one line, without its line end, into `line`. Time is linear in its length.
pub fn read_line(text: &str, lookup: &impl Lookup, line: &mut Line) -> Result<(), Unreadable> {
    line.clear();
    let unreadable = |offset, found: String, right: &str| {
        Err(Unreadable {
            offset,
            found,
            right: right.to_owned(),
        })
    };
    // Before comments are skipped: an editor shows the text behind a lone carriage return as a line of its own, and a
    // comment before it must not swallow that line.
    if let Some(offset) = text.bytes().position(|byte| byte == b'\r') {
        return unreadable(
            offset,
            "a carriage return inside a line".into(),
            "end lines with LF or CR LF",
        );
    }
    let bytes = text.as_bytes();
    let mut cursor = Cursor::new(text, 0);
    while let Some(&byte) = bytes.get(cursor.offset) {
        let offset = cursor.offset;
        match byte {
            b' ' | b'\t' => cursor.offset += 1,
            b';' if text.starts_with(";py,") => return Err(refused_python("py", offset)),
            b';' => break,
            b'(' => {
                let end = comment_end(text, offset)?;
                let inside = text.get(offset + 1..end - 1).unwrap_or_default();
                line.comments.extend(active_comment(inside, offset)?);
                cursor.offset = end;
            }
            b'/' if line.words.is_empty() && !line.block_delete => {
                line.block_delete = true;
                cursor.offset += 1;
            }
            b'%' if line.words.is_empty() && !line.percent && !line.block_delete => {
                line.percent = true;
                cursor.offset += 1;
            }
            _ if line.percent => {
                let found = format!("{} on a % line", shown(text, offset));
                return unreadable(offset, found, "% stands alone on its line");
            }
            b'#' => line.assignments.push(read_assignment(&mut cursor, lookup)?),
            b'o' | b'O' if line.words.iter().all(|word| word.letter == 'N') => {
                line.flow = Some(read_flow_word(&mut cursor, lookup)?);
            }
            letter if letter.is_ascii_alphabetic() || matches!(letter, b'@' | b'^' | b'$') => {
                if line.words.len() >= WORDS_MAX {
                    let found = format!("more than {WORDS_MAX} words");
                    let right = "one block is one line; break it into several";
                    return unreadable(offset, found, right);
                }
                if let Some(flow) = &line.flow {
                    let found = format!("{} behind {}", shown(text, offset), flow.shown());
                    return unreadable(offset, found, "an O-word stands alone in its block");
                }
                line.words.push(read_word(&mut cursor, lookup)?);
            }
            _ => return unreadable(offset, shown(text, offset), instead_of(byte)),
        }
    }
    line.blanks_in_number = cursor.blanks_in_number;
    Ok(())
}

/// Reads the parameter that is set next, and its value.
fn read_assignment(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<(Target, f64), Unreadable> {
    let offset = cursor.offset;
    let unreadable = |found, right| Unreadable {
        offset,
        found,
        right,
    };
    let target = cursor.target(lookup)?;
    let refused = |(found, right)| unreadable(found, right);
    lookup.check_settable(&target).map_err(refused)?;
    if !cursor.take(b'=') {
        let right = "a parameter is set with =, such as #1=5, or used behind a letter, such as X#1";
        return Err(unreadable("a parameter by itself".into(), right.into()));
    }
    Ok((target, cursor.value(lookup)?))
}

/// Reads the word whose letter is next; a plain number of few digits without the detour over text.
fn read_word(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<Word, Unreadable> {
    let offset = cursor.offset;
    let letter = char::from(cursor.peek()).to_ascii_uppercase();
    cursor.offset += 1;
    cursor.skip_blanks();
    let value = cursor.value(lookup).map_err(|mut unreadable| {
        if unreadable.offset == cursor.offset && unreadable.right.starts_with("a number") {
            unreadable.found = format!("{letter} followed by {}", unreadable.found);
        }
        unreadable
    })?;
    Ok(Word {
        letter,
        value,
        offset,
        end: cursor.offset,
    })
}

/// What would be right where no word can begin.
fn instead_of(byte: u8) -> &'static str {
    match byte {
        b'[' | b']' | b'=' => "a value stands behind its letter, such as X[1+2], or behind #1=",
        b'<' | b'>' => "a name stands behind # or O, such as #<depth> or O<pocket>",
        b')' => "no comment is open here",
        b'0'..=b'9' | b'.' | b'+' | b'-' => "a number must follow its letter",
        b'/' => "block delete (/) belongs before the first word",
        _ => "a block is made of letters with numbers, such as G1 X12.5 F600",
    }
}

/// Offset behind the comment that opens at `offset`.
pub fn comment_end(text: &str, offset: usize) -> Result<usize, Unreadable> {
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

/// What the inside of a comment asks for, if anything. Blanks may stand before its word, and none between the word and its comma.
fn active_comment(
    inside: &str,
    offset: usize,
) -> Result<Option<(CommentKind, String)>, Unreadable> {
    let inside = inside.trim_start();
    let length = inside
        .find(|c: char| !c.is_ascii_alphabetic())
        .unwrap_or(inside.len());
    let (word, rest) = inside.split_at(length);
    let found = COMMENT_WORDS.iter().find(|(of, behind, _)| {
        word.eq_ignore_ascii_case(of)
            && match *behind {
                "" => rest.trim_start().is_empty() || rest.trim_start().starts_with(','),
                behind => rest.starts_with(behind) || rest.is_empty() && behind == " ",
            }
    });
    let Some((_, behind, kind)) = found else {
        return Ok(None);
    };
    if *kind == CommentKind::Python {
        return Err(refused_python(word, offset));
    }
    let text = rest.get(behind.len()..).unwrap_or_default();
    Ok(Some((*kind, text.trim().to_owned())))
}

/// Python in a comment.
fn refused_python(word: &str, offset: usize) -> Unreadable {
    let right = "O-words and expressions compute, user M-codes (M100 to M199) run programs of the machine builder";
    Unreadable {
        offset,
        found: format!(
            "a comment of {}, which runs Python in LinuxCNC",
            word.to_uppercase()
        ),
        right: right.to_owned(),
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

#[cfg(test)]
mod tests;
