//! Lines that others lead to: O-numbers, N-numbers and loops; and the subprograms that a line calls.

use crate::expression::Cursor;
use crate::flow::Keyword;

/// Endings of the files of subprograms, as people name them; one without an ending too.
const ENDINGS: [&str; 8] = ["nc", "ngc", "cnc", "tap", "eia", "prg", "txt", "min"];

/// Whether a line may hold a label, or begin a file.
pub fn may_lead(line: &[u8]) -> bool {
    let first = line.iter().find(|byte| !matches!(byte, b' ' | b'\t'));
    let first = first.map(u8::to_ascii_lowercase);
    matches!(
        first,
        Some(b'o' | b':' | b'n' | b'/' | b'w' | b'd' | b'e' | 0x1c)
    )
}

/// Whether the block of a line may go on elsewhere: a call, a jump or a loop.
pub fn may_jump(line: &[u8]) -> bool {
    let mut last = 0;
    let mut code = 0;
    let mut digits = 0;
    for byte in line.iter().filter(|byte| !matches!(byte, b' ' | b'\t')) {
        let byte = byte.to_ascii_uppercase();
        match (last, byte) {
            // GOTO, DO, END and EN, M97 to M99, G65 and G66, and codes that are computed.
            (b'G' | b'D', b'O') | (b'E', b'N') | (b'G' | b'M', b'#' | b'[') => return true,
            _ => {}
        }
        match byte {
            b'G' | b'M' => (code, digits) = (byte, 0),
            b'0'..=b'9' if code != 0 && digits < 1_000 => {
                digits = digits * 10 + u32::from(byte - b'0');
                if matches!((code, digits), (b'M', 97..=99) | (b'G', 65 | 66)) {
                    return true;
                }
            }
            _ => code = 0,
        }
        last = byte;
    }
    false
}

/// Passes the words before the first that says something: block delete and N.
fn at_first_word(text: &str) -> (Cursor<'_>, Option<u32>) {
    let mut cursor = Cursor::new(text, 0);
    let mut number = None;
    loop {
        if cursor.take(b'/') {
            if matches!(cursor.peek(), b'1'..=b'9') {
                cursor.offset += 1;
            }
        } else if number.is_none() && cursor.take(b'n') {
            number = digits(&mut cursor).parse().ok();
            if number.is_none() {
                return (cursor, None);
            }
        } else {
            return (cursor, number);
        }
    }
}

/// The digits at the cursor, without the zeros before them.
fn digits<'a>(cursor: &mut Cursor<'a>) -> &'a str {
    cursor.skip_blanks();
    let start = cursor.offset;
    while cursor.peek().is_ascii_digit() {
        cursor.offset += 1;
    }
    let all = cursor.text.get(start..cursor.offset).unwrap_or_default();
    let rest = all.trim_start_matches('0');
    match rest {
        "" if !all.is_empty() => "0",
        _ => rest,
    }
}

/// The N-number of a line.
pub fn number_at(text: &str) -> Option<u32> {
    at_first_word(text).1
}

/// The label and keyword of a line: a program's number (`O1000`, `:1000`), the beginning or the end of a loop.
pub fn label_at(text: &str) -> Option<(String, Keyword)> {
    let (mut cursor, _) = at_first_word(text);
    if cursor.take(b'o') || cursor.take(b':') {
        return Some((program_label(&mut cursor)?, Keyword::Number));
    }
    let keyword = match cursor.peek() {
        b'w' => {
            pass_condition(&mut cursor)?;
            Keyword::While
        }
        b'd' => Keyword::While,
        b'e' => Keyword::EndWhile,
        _ => return None,
    };
    let is_there = match keyword {
        Keyword::While => cursor.take_word("do"),
        _ => cursor.take_word("end") || cursor.take_word("en"),
    };
    if !is_there {
        return None;
    }
    Some((loop_label(&mut cursor)?, keyword))
}

/// The number of a program behind its O, or its name in angle brackets.
pub fn program_label(cursor: &mut Cursor<'_>) -> Option<String> {
    if cursor.next_byte() == b'<' {
        return cursor.name().ok();
    }
    Some(digits(cursor).to_owned()).filter(|label| !label.is_empty())
}

/// The number of a loop behind its DO or END.
pub fn loop_label(cursor: &mut Cursor<'_>) -> Option<String> {
    match digits(cursor) {
        number @ ("1" | "2" | "3") => Some(format!("DO{number}")),
        _ => None,
    }
}

/// Passes `WHILE […]` or `WH […]`.
fn pass_condition(cursor: &mut Cursor<'_>) -> Option<()> {
    if !(cursor.take_word("while") || cursor.take_word("wh")) || cursor.next_byte() != b'[' {
        return None;
    }
    let mut depth = 0u32;
    loop {
        match cursor.peek() {
            b'[' => depth += 1,
            b']' => depth -= 1,
            0 => return None,
            _ => {}
        }
        cursor.offset += 1;
        if depth == 0 {
            return Some(());
        }
    }
}

/// The program that a line calls by M98, G65 or G66, if it is written as a number.
pub fn called_by(line: &str) -> Option<String> {
    let mut code = 0;
    let mut number = 0;
    let mut calls = None;
    let mut bytes = line.bytes().enumerate().peekable();
    while let Some((at, byte)) = bytes.next() {
        match byte.to_ascii_uppercase() {
            b' ' | b'\t' => continue,
            b'(' => while bytes.next_if(|(_, byte)| *byte != b')').is_some() {},
            letter @ (b'G' | b'M') => (code, number) = (letter, 0),
            digit @ b'0'..=b'9' if code != 0 && number < 1_000 => {
                number = number * 10 + u32::from(digit - b'0');
            }
            b'P' if calls.is_some() || matches!((code, number), (b'M', 98) | (b'G', 65 | 66)) => {
                return called_number(line, at + 1, code == b'M' || calls == Some(b'M'));
            }
            _ => code = 0,
        }
        if matches!((code, number), (b'M', 98) | (b'G', 65 | 66)) {
            calls = Some(code);
        }
    }
    None
}

/// The number behind P. M98 has at most four digits of the program, and the count before them, where no L stands beside it.
fn called_number(line: &str, at: usize, by_m98: bool) -> Option<String> {
    let mut cursor = Cursor::new(line, at);
    let number: u32 = digits(&mut cursor).parse().ok()?;
    let words = line
        .split('(')
        .enumerate()
        .map(|(index, part)| match index {
            0 => part,
            _ => part.split_once(')').map_or("", |(_, behind)| behind),
        });
    let packed = by_m98 && !words.into_iter().any(|part| part.contains(['L', 'l']));
    Some(if packed { number % 10_000 } else { number }.to_string())
}

/// Whether a file of this name, in lower case, holds the subprogram of a number: `o1000.nc`, `1000.ngc`, `o01000`.
pub fn is_file_of(name: &str, label: &str) -> bool {
    let (stem, ending) = match name.split_once('.') {
        Some((stem, ending)) => (stem, Some(ending)),
        None => (name, None),
    };
    let stem = stem.strip_prefix('o').unwrap_or(stem);
    let number = stem.trim_start_matches('0');
    let is_number = !stem.is_empty() && number == label.trim_start_matches('0');
    is_number && ending.is_none_or(|ending| ENDINGS.contains(&ending))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_found_whatever_their_writing() {
        let label = |text| label_at(text).map(|(label, keyword)| format!("{label} {keyword:?}"));
        assert_eq!(label("O0001 (PART)").as_deref(), Some("1 Number"));
        assert_eq!(label(":0100").as_deref(), Some("100 Number"));
        assert_eq!(label("/2 N10 o 7").as_deref(), Some("7 Number"));
        assert_eq!(label("N5WHILE[[#1]LT[2]]DO2").as_deref(), Some("DO2 While"));
        assert_eq!(
            label("wh [#1 lt 2] do 1 (DO3)").as_deref(),
            Some("DO1 While")
        );
        assert_eq!(label("DO3").as_deref(), Some("DO3 While"));
        assert_eq!(label("END 2").as_deref(), Some("DO2 EndWhile"));
        for text in ["G1 X5", "DO4", "WHILE[#1", "E5", "(O1)", "W5", "O", "N", ""] {
            assert_eq!(label(text), None, "{text}");
        }
        assert_eq!(number_at("N0010 G1"), Some(10));
        assert_eq!(number_at("/ N7"), Some(7));
        assert_eq!(number_at("G1 N7"), None);
    }

    #[test]
    fn calls_are_found_with_their_counts() {
        let called = |text| called_by(text);
        assert_eq!(called("M98 P1000 L3").as_deref(), Some("1000"));
        assert_eq!(called("M98P0031000").as_deref(), Some("1000"));
        assert_eq!(called("N5 G65 P9010 A1. B2.").as_deref(), Some("9010"));
        assert_eq!(called("G66 L2 P12345").as_deref(), Some("12345"));
        assert_eq!(called("IF [#1 EQ 0] M98 P9004").as_deref(), Some("9004"));
        assert_eq!(called("G4 P500"), None);
        assert_eq!(called("(M98 P5) G1 X1"), None);
        for line in [
            "M98 P7",
            "goto 5",
            "END1",
            "G65P5",
            "G#1 X2",
            "M099",
            "WHILE[1]DO1",
        ] {
            assert!(may_jump(line.as_bytes()), "{line}");
        }
        for line in ["G0 X98 D5", "M9", "G1 X1 Y65", "G43 H1", "O0001 (PART)"] {
            assert!(!may_jump(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn files_of_subprograms_are_known_by_their_names() {
        for name in ["1000.ngc", "o1000.nc", "o01000.tap", "o1000"] {
            assert!(is_file_of(name, "1000"), "{name}");
        }
        for name in ["o1000.exe", "o10001.nc", "p1000.nc", "o.nc"] {
            assert!(!is_file_of(name, "1000"), "{name}");
        }
    }
}
