//! The words of program flow: O-words and their labels (LinuxCNC manual, *O Codes*).

use crate::expression::{Cursor, Lookup, comment_end};
use crate::refusal::{Refusal, refuse, shown};

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
    // A loop of Fanuc's language.
    if let Some(number) = label.strip_prefix("DO") {
        return match keyword {
            Keyword::EndWhile => format!("END{number}"),
            _ => label.to_owned(),
        };
    }
    let mut words = KEYWORDS.iter();
    let word = words.find(|(_, of_word)| *of_word == keyword);
    let word = word.map_or("", |(word, _)| word);
    let label = match label.bytes().all(|byte| byte.is_ascii_digit()) {
        true => format!("O{label}"),
        false => format!("O<{label}>"),
    };
    format!("{label} {word}").trim_end().to_owned()
}

/// Reads the O-word at the cursor, up to its last value.
pub fn read_flow_word(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<FlowWord, Refusal> {
    let offset = cursor.offset;
    cursor.offset += 1;
    let label = label(cursor, lookup)?;
    let keyword = keyword(cursor)?;
    let values = match keyword {
        Keyword::Call => arguments(cursor, lookup)?,
        Keyword::While | Keyword::If | Keyword::ElseIf | Keyword::Repeat => {
            if cursor.next_byte() != b'[' {
                let found = shown(cursor.text, cursor.offset);
                let right = format!("{} takes a value in brackets", shown_flow(&label, keyword));
                return refuse(cursor.offset, found, right);
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

fn label(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<String, Refusal> {
    if cursor.next_byte() == b'<' {
        return cursor.name();
    }
    let at = cursor.offset;
    let value = cursor.value(lookup).map_err(|unreadable| Refusal {
        right: "a label is a number or a name, such as O100 or O<pocket>".into(),
        ..unreadable
    })?;
    let right = "a label is a whole number from 0, or a name such as O<pocket>";
    label_of(value).ok_or_else(|| Refusal::new(at, format!("O{value}"), right))
}

/// The text of a label that is a number.
pub fn label_of(value: f64) -> Option<String> {
    if !(value >= 0.0 && value.fract() == 0.0) {
        return None;
    }
    // Every whole number up to here is one of both kinds.
    Some(match value {
        ..=1e15 => (value as u64).to_string(),
        _ => format!("{value:.0}"),
    })
}

fn keyword(cursor: &mut Cursor) -> Result<Keyword, Refusal> {
    cursor.skip_blanks();
    let start = cursor.offset;
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
        None => {
            let right = "one of sub endsub return call do while endwhile if elseif else endif break continue repeat endrepeat";
            refuse(start, shown(cursor.text, start), right)
        }
    }
}

fn arguments(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<Vec<f64>, Refusal> {
    let mut arguments = vec![];
    loop {
        // A comment between them says nothing.
        while cursor.next_byte() == b'(' {
            cursor.offset = comment_end(cursor.text, cursor.offset)?;
        }
        if cursor.next_byte() != b'[' {
            break;
        }
        if arguments.len() == ARGUMENTS_MAX {
            let right = format!("a call has at most {ARGUMENTS_MAX} arguments");
            return refuse(cursor.offset, "one argument more", right);
        }
        arguments.push(cursor.expression(lookup)?);
    }
    Ok(arguments)
}

/// The label and keyword of a line, read without values: for finding where flow leads. None where the line holds none, or a label
/// that is computed.
pub fn flow_at(text: &str) -> Option<(String, Keyword)> {
    let mut cursor = Cursor::new(text, 0);
    cursor.take(b'/');
    if cursor.take(b'n') {
        while matches!(cursor.next_byte(), b'0'..=b'9' | b'.') {
            cursor.offset += 1;
        }
    }
    if !cursor.take(b'o') || !matches!(cursor.next_byte(), b'<' | b'0'..=b'9') {
        return None;
    }
    let label = label(&mut cursor, &NoParameters).ok()?;
    Some((label, keyword(&mut cursor).ok()?))
}

/// The number of the subroutine that `M98 P…` of a line calls, read as [`flow_at`] reads labels.
pub fn called_by_number(line: &str) -> Option<String> {
    if !line.contains(['m', 'M']) {
        return None;
    }
    let lower = line.to_ascii_lowercase();
    let behind = lower.split_once("m98")?.1;
    let at = line.len() - behind.len() + behind.find('p')? + 1;
    label_of(Cursor::new(line, at).value(&NoParameters).ok()?)
}

/// No parameter has a value before anything runs.
struct NoParameters;

impl Lookup for NoParameters {
    fn numbered(&self, number: u32) -> Result<f64, Refusal> {
        refuse(0, format!("#{number}"), "")
    }

    fn named(&self, _: &str) -> Option<f64> {
        None
    }
}
