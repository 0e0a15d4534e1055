//! From one line of text to a block: words with their values and places, parameters that it sets, comments that say something, or
//! a word of program flow.

use std::fmt::{self, Display};

use machine::Dialect;

use crate::expression::{Cursor, Lookup, Target, comment_end};
use crate::flow::{FlowWord, read_flow_word};
use crate::refusal::{Refusal, refuse, shown};

/// The most words of one block: twice what can be in one without conflict. Bounds the memory of a hostile line.
const WORDS_MAX: usize = 64;

/// A letter with its number.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Word {
    /// Upper case, A to Z, or one of `@` `^` `$`.
    pub letter: char,
    /// The number after it.
    pub value: f64,
    /// Byte offset of the letter in the line.
    pub offset: usize,
}

impl Word {
    /// Refuses the word as it stands.
    pub fn refuse<T, E: From<Refusal>>(self, right: impl Into<String>) -> Result<T, E> {
        refuse(self.offset, self.to_string(), right)
    }
}

impl Display for Word {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}{}", self.letter, self.value)
    }
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
    /// In Fanuc's language, the block that it goes on with.
    pub jump: Option<Jump>,
    /// In Fanuc's language, what becomes of the corner behind it.
    pub corner: Option<Corner>,
    /// In Fanuc's language, its first comment.
    pub remark: String,
    /// In Fanuc's language, the letters whose numbers have a decimal point, as bits.
    pub pointed: u32,
    /// In Fanuc's language, the letters whose values are computed, as bits.
    pub computed: u32,
    /// In Fanuc's language, it writes to a device or names variables, and does nothing here.
    pub writes: bool,
}

/// A jump to a block by its N-number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Jump {
    /// The number.
    pub number: u32,
    /// Byte offset of the word in the line.
    pub offset: usize,
}

/// What is put between a straight block and the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// An arc (`,R`) or a chamfer (`,C`).
    pub rounds: bool,
    /// Radius of the arc, or length that the chamfer takes off both blocks, in the unit of the program.
    pub size: f64,
    /// The size has no decimal point, and is not computed.
    pub is_plain: bool,
    /// Byte offset of the word in the line.
    pub offset: usize,
}

impl Line {
    pub fn clear(&mut self) {
        self.jump = None;
        self.corner = None;
        self.remark.clear();
        self.pointed = 0;
        self.computed = 0;
        self.writes = false;
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
            || self.jump.is_some()
            || self.writes
            || comments.any(|(kind, _)| *kind == CommentKind::Abort)
    }
}

/// Reads one line, without its line end, into `line`. Time is linear in its length.
pub fn read_line(text: &str, lookup: &impl Lookup, line: &mut Line) -> Result<(), Refusal> {
    line.clear();
    // Before comments are skipped: an editor shows the text behind a lone carriage return as a line of its own, and a
    // comment before it must not swallow that line.
    if let Some(offset) = text.bytes().position(|byte| byte == b'\r') {
        let right = "end lines with LF or CR LF";
        return refuse(offset, "a carriage return inside a line", right);
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
                // Controls with several switches number them; here one is for all.
                if matches!(cursor.peek(), b'1'..=b'9') {
                    cursor.offset += 1;
                }
            }
            b'%' if line.words.is_empty() && !line.percent && !line.block_delete => {
                line.percent = true;
                cursor.offset += 1;
            }
            _ if line.percent => {
                let found = format!("{} on a % line", shown(text, offset));
                return refuse(offset, found, "% stands alone on its line");
            }
            b'#' => line.assignments.push(read_assignment(&mut cursor, lookup)?),
            b'o' | b'O' if line.words.iter().all(|word| word.letter == 'N') => {
                line.flow = Some(read_flow_word(&mut cursor, lookup)?);
            }
            letter if letter.is_ascii_alphabetic() || matches!(letter, b'@' | b'^' | b'$') => {
                if line.words.len() >= WORDS_MAX {
                    let found = format!("more than {WORDS_MAX} words");
                    let right = "one block is one line; break it into several";
                    return refuse(offset, found, right);
                }
                if let Some(flow) = &line.flow {
                    let found = format!("{} behind {}", shown(text, offset), flow.shown());
                    return refuse(offset, found, "an O-word stands alone in its block");
                }
                line.words.push(read_word(&mut cursor, lookup)?);
            }
            _ => return refuse(offset, shown(text, offset), instead_of(byte)),
        }
    }
    line.blanks_in_number = cursor.blanks_in_number;
    Ok(())
}

/// Reads the parameter that is set next, and its value.
pub fn read_assignment(
    cursor: &mut Cursor,
    lookup: &impl Lookup,
) -> Result<(Target, f64), Refusal> {
    let offset = cursor.offset;
    let target = cursor.target(lookup)?;
    lookup
        .check_settable(&target)
        .map_err(|wrong| wrong.at(offset))?;
    if !cursor.take(b'=') {
        let right = "a parameter is set with =, such as #1=5, or used behind a letter, such as X#1";
        return refuse(offset, "a parameter by itself", right);
    }
    let value = match lookup.dialect() {
        Dialect::LinuxCnc => cursor.value(lookup)?,
        Dialect::Fanuc => cursor.open_expression(lookup)?,
    };
    Ok((target, value))
}

/// Reads the word whose letter is next; a plain number of few digits without the detour over text.
pub fn read_word(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<Word, Refusal> {
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

/// What the inside of a comment asks for, if anything. Blanks may stand before its word, and none between the word and its comma.
fn active_comment(inside: &str, offset: usize) -> Result<Option<(CommentKind, String)>, Refusal> {
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
fn refused_python(word: &str, offset: usize) -> Refusal {
    let right = "O-words and expressions compute, user M-codes (M100 to M199) run programs of the machine builder";
    let word = word.to_uppercase();
    let found = format!("a comment of {word}, which runs Python in LinuxCNC");
    Refusal::new(offset, found, right)
}

#[cfg(test)]
mod tests;
