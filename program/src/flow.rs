//! The words of program flow: O-words and their labels (LinuxCNC manual, *O Codes*).

use crate::expression::{Cursor, Lookup};
use crate::reader::{Unreadable, shown};

/// The most arguments of a call: they become #1 to #30.
pub const ARGUMENTS_MAX: usize = 30;

/// What an O-word does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keyword {
    Sub,
    EndSub,
    Return,
    Call,
    Do,
    While,
    EndWhile,
    If,
    ElseIf,
    Else,
    EndIf,
    Break,
    Continue,
    Repeat,
    EndRepeat,
    /// A number alone: a program's number, or a subroutine for M98.
    Number,
}

/// Longer words before those that they begin with.
const KEYWORDS: [(&str, Keyword); 15] = [
    ("sub", Keyword::Sub),
    ("endsub", Keyword::EndSub),
    ("return", Keyword::Return),
    ("call", Keyword::Call),
    ("do", Keyword::Do),
    ("while", Keyword::While),
    ("endwhile", Keyword::EndWhile),
    ("if", Keyword::If),
    ("elseif", Keyword::ElseIf),
    ("else", Keyword::Else),
    ("endif", Keyword::EndIf),
    ("break", Keyword::Break),
    ("continue", Keyword::Continue),
    ("repeat", Keyword::Repeat),
    ("endrepeat", Keyword::EndRepeat),
];

/// An O-word, its label and its values.
#[derive(Debug, Clone, PartialEq)]
pub struct FlowWord {
    /// What it does.
    pub keyword: Keyword,
    /// Its label: a whole number without leading zeros, or a name in lower case.
    pub label: String,
    /// The condition, the count, what is returned, or the arguments of a call.
    pub values: Vec<f64>,
    /// Byte offset of the O in the line.
    pub offset: usize,
}

impl FlowWord {
    /// As a person writes it.
    pub fn shown(&self) -> String {
        shown_flow(&self.label, self.keyword)
    }
}

/// An O-word as a person writes it.
pub fn shown_flow(label: &str, keyword: Keyword) -> String {
    let word = KEYWORDS
        .iter()
        .find(|&&(_, of_word)| of_word == keyword)
        .map_or("", |(word, _)| word);
    let number = label.bytes().all(|byte| byte.is_ascii_digit());
    let label = if number {
        format!("O{label}")
    } else {
        format!("O<{label}>")
    };
    format!("{label} {word}").trim_end().to_owned()
}

/// Reads the O-word at the cursor, up to its last value.
pub fn read_flow_word(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<FlowWord, Unreadable> {
    let offset = cursor.offset;
    cursor.offset += 1;
    let label = match cursor.next_byte() {
        b'<' => cursor.name()?,
        _ => {
            let at = cursor.offset;
            let value = cursor.value(lookup).map_err(|mut unreadable| {
                unreadable.right =
                    "a label is a number or a name, such as O100 or O<pocket>".into();
                unreadable
            })?;
            label_of(value).ok_or_else(|| Unreadable {
                offset: at,
                found: format!("O{value}"),
                right: "a label is a whole number from 0, or a name such as O<pocket>".into(),
            })?
        }
    };
    let keyword = keyword(cursor)?;
    let values = match keyword {
        Keyword::Call => arguments(cursor, lookup)?,
        Keyword::While | Keyword::If | Keyword::ElseIf | Keyword::Repeat => {
            if cursor.next_byte() != b'[' {
                return Err(Unreadable {
                    offset: cursor.offset,
                    found: shown(cursor.text, cursor.offset),
                    right: format!("{} takes a value in brackets", shown_flow(&label, keyword)),
                });
            }
            vec![cursor.expression(lookup)?]
        }
        Keyword::EndSub | Keyword::Return if cursor.next_byte() == b'[' => {
            vec![cursor.expression(lookup)?]
        }
        _ => vec![],
    };
    Ok(FlowWord {
        keyword,
        label,
        values,
        offset,
    })
}

/// The text of a label that is a number.
pub fn label_of(value: f64) -> Option<String> {
    if !(value >= 0.0 && value.fract() == 0.0) {
        return None;
    }
    // Every whole number up to here is one of both kinds.
    Some(if value <= 1e15 {
        (value as u64).to_string()
    } else {
        format!("{value:.0}")
    })
}

fn keyword(cursor: &mut Cursor) -> Result<Keyword, Unreadable> {
    let start = {
        cursor.skip_blanks();
        cursor.offset
    };
    let mut longest = None;
    for (word, keyword) in KEYWORDS {
        cursor.offset = start;
        if cursor.take_word(word) && longest.is_none_or(|(_, end)| end < cursor.offset) {
            longest = Some((keyword, cursor.offset));
        }
    }
    cursor.offset = start;
    match longest {
        Some((keyword, end)) => {
            cursor.offset = end;
            Ok(keyword)
        }
        None if matches!(cursor.peek(), 0 | b'(' | b';') => Ok(Keyword::Number),
        None => Err(Unreadable {
            offset: start,
            found: shown(cursor.text, start),
            right: "one of sub endsub return call do while endwhile if elseif else endif break continue repeat endrepeat".into(),
        }),
    }
}

fn arguments(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<Vec<f64>, Unreadable> {
    let mut arguments = vec![];
    while cursor.next_byte() == b'[' {
        if arguments.len() == ARGUMENTS_MAX {
            return Err(Unreadable {
                offset: cursor.offset,
                found: "one argument more".into(),
                right: format!("a call has at most {ARGUMENTS_MAX} arguments"),
            });
        }
        arguments.push(cursor.expression(lookup)?);
    }
    Ok(arguments)
}

/// The label and keyword of a line, read without values: for finding where flow leads. None where the line holds none, or a label
/// that is computed.
pub fn flow_at(text: &str) -> Option<(String, Keyword)> {
    let bytes = text.as_bytes();
    let mut at = 0;
    let blank = |at: usize| matches!(bytes.get(at), Some(b' ' | b'\t'));
    let skip = |at: &mut usize| {
        while blank(*at) {
            *at += 1;
        }
    };
    skip(&mut at);
    if bytes.get(at) == Some(&b'/') {
        at += 1;
        skip(&mut at);
    }
    if matches!(bytes.get(at), Some(b'n' | b'N')) {
        at += 1;
        while matches!(bytes.get(at), Some(b' ' | b'\t' | b'0'..=b'9' | b'.')) {
            at += 1;
        }
    }
    if !matches!(bytes.get(at), Some(b'o' | b'O')) {
        return None;
    }
    let mut cursor = Cursor::new(text, at + 1);
    let label = match cursor.next_byte() {
        b'<' => cursor.name().ok()?,
        b'0'..=b'9' => label_of(cursor.value(&NoParameters).ok()?)?,
        _ => return None,
    };
    Some((label, keyword(&mut cursor).ok()?))
}

/// No parameter has a value.
struct NoParameters;

impl Lookup for NoParameters {
    fn numbered(&self, number: u32) -> Result<f64, (String, String)> {
        Err((format!("#{number}"), String::new()))
    }

    fn named(&self, _: &str) -> Option<f64> {
        None
    }
}
