//! From one line of Fanuc's language to a block.

use super::labels::{loop_label, program_label};
use crate::expression::{Cursor, Lookup};
use crate::flow::{FlowWord, Keyword};
use crate::reader::{Corner, Jump, Line, read_assignment, read_word};
use crate::refusal::{Refusal, refuse, shown};
use crate::words::mask_of;

/// The most words of one block.
const WORDS_MAX: usize = 64;

/// Statements that write to a device, or name variables; the rest of their line is theirs.
const SILENT: [&str; 5] = ["popen", "pclos", "dprnt", "bprnt", "setvn"];

/// Reads one line, without its line end, into `line`. Time is linear in its length.
pub fn read_line(text: &str, lookup: &impl Lookup, line: &mut Line) -> Result<(), Refusal> {
    line.clear();
    if let Some(offset) = text.bytes().position(|byte| byte == b'\r') {
        let right = "end lines with LF or CR LF";
        return refuse(offset, "a carriage return inside a line", right);
    }
    let mut cursor = Cursor::new(text, 0);
    loop {
        let byte = cursor.next_byte();
        let offset = cursor.offset;
        if line.flow.is_some() && !matches!(byte, 0 | b';' | b'(') {
            let found = format!(
                "{} behind a number of a program or a loop",
                shown(text, offset)
            );
            return refuse(offset, found, "it stands alone in its block");
        }
        let is_first = line.words.iter().all(|word| word.letter == 'N');
        match byte {
            0 if offset >= text.len() => break,
            b';' => break,
            b'(' => {
                let end = comment_end(text, offset)?;
                if line.remark.is_empty() {
                    let inside = text.get(offset + 1..end - 1).unwrap_or_default();
                    line.remark = inside.trim().to_owned();
                }
                cursor.offset = end;
            }
            b'/' if is_first && !line.block_delete => {
                line.block_delete = true;
                cursor.offset += 1;
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
            b',' => {
                let mut corner = corner(&mut cursor, lookup)?;
                let written = text.get(offset..cursor.offset).unwrap_or_default();
                corner.is_plain = !written.contains(['.', '#', '[']);
                line.corner = Some(corner);
            }
            b'o' | b':' if is_first => {
                cursor.offset += 1;
                let Some(label) = program_label(&mut cursor) else {
                    let right = "a program has a whole number, such as O1000";
                    return refuse(offset, "O without a number", right);
                };
                line.flow = Some(flow(Keyword::Number, label, vec![], offset));
            }
            letter if letter.is_ascii_alphabetic() => word_or_statement(&mut cursor, lookup, line)?,
            _ => {
                let right = "a block is made of letters with numbers, such as G1 X12.5 F600";
                return refuse(offset, shown(text, offset), right);
            }
        }
    }
    line.blanks_in_number = cursor.blanks_in_number;
    Ok(())
}

fn flow(keyword: Keyword, label: String, values: Vec<f64>, offset: usize) -> FlowWord {
    FlowWord {
        keyword,
        label,
        values,
        offset,
    }
}

/// Reads a statement of a macro, or a word.
fn word_or_statement(
    cursor: &mut Cursor,
    lookup: &impl Lookup,
    line: &mut Line,
) -> Result<(), Refusal> {
    let offset = cursor.offset;
    if statement(cursor, lookup, line)? {
        return Ok(());
    }
    if line.jump.is_some() {
        let found = format!("{} behind GOTO", shown(cursor.text, offset));
        return refuse(offset, found, "GOTO ends its block");
    }
    if line.words.len() >= WORDS_MAX {
        let found = format!("more than {WORDS_MAX} words");
        let right = "one block is one line; break it into several";
        return refuse(offset, found, right);
    }
    word(cursor, lookup, line)
}

/// Reads a word, and keeps whether its number has a decimal point. One whose value is vacant is none.
fn word(cursor: &mut Cursor, lookup: &impl Lookup, line: &mut Line) -> Result<(), Refusal> {
    let word = read_word(cursor, lookup)?;
    if word.value.is_nan() {
        return Ok(());
    }
    let written = cursor.text.get(word.offset + 1..cursor.offset);
    let written = written.unwrap_or_default();
    let letter = mask_of(word.letter.encode_utf8(&mut [0; 4]));
    if written.contains('.') {
        line.pointed |= letter;
    }
    if written.contains(['#', '[']) {
        line.computed |= letter;
    }
    line.words.push(word);
    Ok(())
}

/// Reads a statement of a macro (B-64304EN, 16.6 "Branch and repetition"): a jump, a condition, a loop; false if none is there.
fn statement(cursor: &mut Cursor, lookup: &impl Lookup, line: &mut Line) -> Result<bool, Refusal> {
    let offset = cursor.offset;
    if cursor.take_word("goto") || cursor.take_word("go") {
        line.jump = Some(jump(cursor, lookup, offset)?);
        return Ok(true);
    }
    if cursor.take_word("if") {
        if cursor.next_byte() == b'[' {
            let holds = condition(cursor.expression(lookup)?);
            return then(cursor, lookup, line, holds);
        }
        cursor.offset = offset;
    }
    let mut values = vec![1.0];
    let is_while = cursor.take_word("while") || cursor.take_word("wh");
    if is_while {
        if cursor.next_byte() != b'[' {
            let found = shown(cursor.text, cursor.offset);
            let right = "WHILE takes a condition in brackets: WHILE [#1 LT 5] DO1";
            return refuse(cursor.offset, found, right);
        }
        let holds = condition(cursor.expression(lookup)?);
        values = vec![f64::from(u8::from(holds))];
        cursor.skip_blanks();
    }
    let keyword = if cursor.take_word("do") {
        Keyword::While
    } else if is_while {
        let right = "the number of the loop, DO1 to DO3";
        return refuse(offset, "WHILE without DO", right);
    } else if cursor.take_word("end") || cursor.take_word("en") {
        Keyword::EndWhile
    } else if SILENT.iter().any(|word| cursor.take_word(word)) {
        line.writes = true;
        cursor.offset = cursor.text.len();
        return Ok(true);
    } else {
        return Ok(false);
    };
    let Some(label) = loop_label(cursor) else {
        let right = "a loop has the number 1, 2 or 3: WHILE [#1 LT 5] DO1 … END1";
        return refuse(offset, "a loop without its number", right);
    };
    line.flow = Some(flow(keyword, label, values, offset));
    Ok(true)
}

/// Whether a condition holds.
fn condition(value: f64) -> bool {
    value != 0.0 && !value.is_nan()
}

/// What stands behind a condition; the rest of a line whose condition does not hold is not read.
fn then(
    cursor: &mut Cursor,
    lookup: &impl Lookup,
    line: &mut Line,
    holds: bool,
) -> Result<bool, Refusal> {
    cursor.skip_blanks();
    let offset = cursor.offset;
    let jumps = cursor.take_word("goto") || cursor.take_word("go");
    // Haas' controls go on without THEN: IF [#1 EQ 0] M98 P9004.
    let goes_on = jumps || cursor.take_word("then") || cursor.take_word("th");
    if !goes_on && !cursor.peek().is_ascii_alphabetic() && cursor.peek() != b'#' {
        let right = "IF [#1 EQ 0] GOTO 10, or IF [#1 EQ 0] THEN #1=5";
        return refuse(offset, shown(cursor.text, offset), right);
    }
    if !holds {
        cursor.offset = cursor.text.len();
    } else if jumps {
        line.jump = Some(jump(cursor, lookup, offset)?);
    }
    Ok(true)
}

/// The N-number that a GOTO leads to.
fn jump(cursor: &mut Cursor, lookup: &impl Lookup, offset: usize) -> Result<Jump, Refusal> {
    let value = cursor.value(lookup)?;
    if !((0.0..=99_999_999.0).contains(&value) && value.fract() == 0.0) {
        let right = "the number of a block, such as GOTO 10 for N10";
        return refuse(offset, format!("GOTO {value}"), right);
    }
    Ok(Jump {
        number: value as u32,
        offset,
    })
}

/// `,R` and `,C`: what becomes of the corner behind a straight block.
fn corner(cursor: &mut Cursor, lookup: &impl Lookup) -> Result<Corner, Refusal> {
    let offset = cursor.offset;
    cursor.offset += 1;
    let letter = cursor.next_byte();
    if !matches!(letter, b'r' | b'c') {
        let found = format!(",{}", char::from(letter).to_ascii_uppercase());
        let right =
            ",R rounds a corner and ,C chamfers it; other words behind a comma are not known";
        return refuse(offset, found, right);
    }
    cursor.offset += 1;
    let size = cursor.value(lookup)?;
    if !(0.0..=1e5).contains(&size) {
        let found = format!(",{}{size}", char::from(letter).to_ascii_uppercase());
        return refuse(offset, found, "a radius or a length from 0");
    }
    Ok(Corner {
        rounds: letter == b'r',
        size,
        is_plain: true,
        offset,
    })
}

/// Offset behind the comment that opens at `offset`. Parentheses inside it that are closed belong to it.
fn comment_end(text: &str, offset: usize) -> Result<usize, Refusal> {
    let mut depth = 0;
    for (at, byte) in text.bytes().enumerate().skip(offset) {
        match byte {
            b'(' => depth += 1,
            b')' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return Ok(at + 1);
        }
    }
    let right = "close it with ) on the same line";
    refuse(offset, "a comment that is not closed", right)
}
