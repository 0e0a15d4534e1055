//! The text of a program: its lines, its files and where its labels are.

use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::Arc;

use machine::Dialect;

use crate::fanuc;
use crate::flow::{Keyword, flow_at};
use crate::refusal::{Refusal, refuse};
use crate::text::{Text, text_of};

/// A line that begins with it begins another file, whose name follows: what [`crate::bundle`] appends to a program that calls
/// subroutines of other files.
pub const FILE_MARK: char = '\u{1c}';

/// The most lines with O-words that others lead to.
pub const LABELS_MAX: usize = 100_000;

/// Where a line begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Spot {
    /// Its number over all files, counted from 0.
    pub line: usize,
    /// Its first byte.
    pub byte: u64,
}

impl Spot {
    /// The line behind it, which begins with this byte.
    fn next(self, byte: u64) -> Self {
        let line = self.line + 1;
        Self { line, byte }
    }
}

/// A line with an O-word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label {
    /// The line.
    pub at: Spot,
    /// The next one.
    pub behind: Spot,
    /// What the O-word does.
    pub keyword: Keyword,
}

/// A program text by lines. Its labels are looked for when the first of them is asked for.
#[derive(Debug, Clone)]
pub struct Source {
    text: Text,
    dialect: Dialect,
    index: Option<Arc<Index>>,
    labels_max: usize,
}

/// Where the labels and the files of a text are, as far as it was looked through.
#[derive(Debug, Clone, Default)]
pub struct Index {
    /// Lines with O-words of each label, in order.
    labels: HashMap<String, Vec<Label>>,
    /// How many lines these are.
    count: usize,
    /// In Fanuc's language, the blocks with N-numbers; in order of their numbers once all of the text is looked through.
    numbers: Vec<(u32, Label)>,
    /// There are more of them than are kept.
    too_many_numbers: bool,
    /// In Fanuc's language, the lines that begin a program or a file.
    sections: Vec<usize>,
    /// Where each file that is appended begins: the line of its mark, and its name.
    files: Vec<(usize, String)>,
    /// What is looked through; none once that is done.
    text: Option<Text>,
    /// The line that is looked at next.
    at: Spot,
}

/// Whether others lead to a line with this word.
fn is_led_to(keyword: Keyword) -> bool {
    !matches!(
        keyword,
        Keyword::Call
            | Keyword::Return
            | Keyword::Break
            | Keyword::Continue
            | Keyword::Do
            | Keyword::Repeat
    )
}

/// Whether a line may hold an O-word, or begin a file.
fn may_lead(line: &[u8]) -> bool {
    let first = line.iter().find(|byte| !matches!(byte, b' ' | b'\t'));
    matches!(first, Some(b'o' | b'O' | b'n' | b'N' | b'/' | 0x1c))
}

/// Whether the block of a line may go on elsewhere: an O-word, M98 and M99, G70 to G72, or a code that is computed.
fn may_jump(line: &[u8]) -> bool {
    if may_lead(line) && line.iter().any(|byte| matches!(byte, b'o' | b'O')) {
        return true;
    }
    let mut code = 0;
    let mut digits = [0; 2];
    for byte in line.iter().filter(|byte| !matches!(byte, b' ' | b'\t')) {
        match (code, byte) {
            (_, b'M' | b'm' | b'G' | b'g') => (code, digits) = (byte.to_ascii_uppercase(), [0; 2]),
            (b'M' | b'G', b'[' | b'#') => return true,
            (b'M' | b'G', b'0') if digits == [0; 2] => {}
            (b'M' | b'G', b'0'..=b'9') if digits[0] == 0 => digits[0] = *byte,
            (b'M', b'8' | b'9') if digits[0] == b'9' => return true,
            (b'G', b'0'..=b'2') if digits[0] == b'7' => return true,
            _ => code = 0,
        }
    }
    false
}

impl Default for Source {
    fn default() -> Self {
        Self::new(Text::of(""), Dialect::LinuxCnc)
    }
}

impl Source {
    pub fn new(text: Text, dialect: Dialect) -> Self {
        Self {
            text,
            dialect,
            index: None,
            labels_max: LABELS_MAX,
        }
    }

    /// The same with as many labels as there are.
    pub fn of_whole(text: Text, dialect: Dialect) -> Self {
        Self {
            labels_max: usize::MAX,
            ..Self::new(text, dialect)
        }
    }

    /// The line that begins at a place, without its end, and where the next begins; none behind the last.
    pub fn line(&mut self, at: Spot) -> Result<Option<(&str, Spot)>, Refusal> {
        let line = self.text.line(at.byte)?;
        Ok(line.map(|(line, byte)| (line, at.next(byte))))
    }

    /// The bytes of the same line, with a carriage return if it ends with one.
    pub fn bytes(&mut self, at: Spot) -> Result<Option<(&[u8], Spot)>, Refusal> {
        let line = self.text.bytes(at.byte)?;
        Ok(line.map(|(line, byte)| (line, at.next(byte))))
    }

    /// Whether a line begins another file.
    pub fn begins_file(line: &str, at: Spot) -> bool {
        at.line > 0 && line.starts_with(FILE_MARK)
    }

    /// Its index, once it is there: all of the text has been looked at, and where its files are.
    pub fn index(&mut self) -> Result<&Index, Refusal> {
        self.look_on(u64::MAX)?;
        let none = || Refusal::new(0, "no index of the labels", "");
        self.index.as_deref().ok_or_else(none)
    }

    /// Whether it is known where all labels are.
    pub fn is_looked_through(&self) -> bool {
        self.index
            .as_ref()
            .is_some_and(|index| index.text.is_none())
    }

    /// Whether some of the text was looked through for labels.
    pub fn is_looked_at(&self) -> bool {
        self.index.is_some()
    }

    /// Looks through about so many bytes more for labels; true once all of the text is.
    pub fn look_on(&mut self, bytes_max: u64) -> Result<bool, Refusal> {
        if self.is_looked_through() {
            return Ok(true);
        }
        let (text, labels_max, dialect) = (&self.text, self.labels_max, self.dialect);
        let index = self
            .index
            .get_or_insert_with(|| Arc::new(Index::new(text.clone())));
        Arc::make_mut(index).look_on(bytes_max, labels_max, dialect)
    }

    /// Whether a line belongs to the program's own file. Others are only reached by labels.
    pub fn is_main(&self, line: usize) -> bool {
        let files = self.index.as_ref().and_then(|index| index.files.first());
        files.is_none_or(|&(first, _)| line < first)
    }

    /// Name of the file and line in it, counted from 1, of a line counted from 1 over all files; no name for the program itself.
    pub fn place(&self, line: u32) -> (Option<&str>, u32) {
        let Some(index) = &self.index else {
            return (None, line);
        };
        let at = (line as usize).saturating_sub(1);
        let next = index.files.partition_point(|&(start, _)| start < at);
        match next.checked_sub(1).and_then(|file| index.files.get(file)) {
            Some((start, name)) => (Some(name), (at - start) as u32),
            None => (None, line),
        }
    }

    /// The next line behind `from`, in the same file, with one of these words and this label.
    pub fn next(
        &mut self,
        label: &str,
        from: usize,
        keywords: &[Keyword],
    ) -> Result<Option<Label>, Refusal> {
        Ok(self.index()?.next(label, from, keywords))
    }

    /// The last line before `from`, in the same file, with one of these words and this label.
    pub fn last_before(
        &mut self,
        label: &str,
        from: usize,
        keywords: &[Keyword],
    ) -> Result<Option<Label>, Refusal> {
        Ok(self.index()?.last_before(label, from, keywords))
    }

    /// In Fanuc's language, the block with an N-number in the program that a line belongs to.
    pub fn numbered(&mut self, number: u32, from: usize) -> Result<Option<Label>, Refusal> {
        self.index()?.numbered(number, from)
    }

    /// What tells whether the block of a line may go on elsewhere.
    pub fn finds_jumps(&self) -> fn(&[u8]) -> bool {
        match self.dialect {
            Dialect::LinuxCnc => may_jump,
            Dialect::Fanuc => fanuc::may_jump,
        }
    }

    /// Where a subroutine begins: its `sub`, or its number for M98.
    pub fn subroutine(&mut self, label: &str) -> Result<Option<Label>, Refusal> {
        Ok(self.index()?.subroutine(label))
    }
}

impl Index {
    fn new(text: Text) -> Self {
        Self {
            text: Some(text),
            ..Self::default()
        }
    }

    /// Looks through about so many bytes more; true at the end of the text.
    fn look_on(
        &mut self,
        bytes_max: u64,
        labels_max: usize,
        dialect: Dialect,
    ) -> Result<bool, Refusal> {
        let is_fanuc = dialect == Dialect::Fanuc;
        let until = self.at.byte.saturating_add(bytes_max);
        while self.at.byte < until {
            let at = self.at;
            let Some(text) = &mut self.text else {
                return Ok(true);
            };
            let Some((line, byte)) = text.bytes(at.byte)? else {
                self.text = None;
                self.numbers
                    .sort_by_key(|(number, label)| (*number, label.at.line));
                return Ok(true);
            };
            let behind = at.next(byte);
            // What is no text is told when it is read.
            let leads = if is_fanuc { fanuc::may_lead } else { may_lead };
            let line = if leads(line) {
                text_of(line).unwrap_or_default()
            } else {
                ""
            };
            if let Some(name) = line.strip_prefix(FILE_MARK) {
                self.files.push((at.line, name.trim().to_owned()));
                self.sections.push(at.line);
                self.at = behind;
                continue;
            }
            if is_fanuc && let Some(number) = fanuc::number_at(line) {
                self.too_many_numbers |= self.numbers.len() >= labels_max;
                if !self.too_many_numbers {
                    let keyword = Keyword::Number;
                    let label = Label {
                        at,
                        behind,
                        keyword,
                    };
                    self.numbers.push((number, label));
                }
            }
            let found = if is_fanuc {
                fanuc::label_at(line)
            } else {
                flow_at(line)
            };
            if let Some((label, keyword)) = found.filter(|found| is_led_to(found.1)) {
                if self.count >= labels_max {
                    let found =
                        format!("more than {labels_max} lines with O-words that others lead to");
                    let right = "split the program, or put what repeats into subroutines";
                    return refuse(0, found, right);
                }
                let place = Label {
                    at,
                    behind,
                    keyword,
                };
                if is_fanuc && keyword == Keyword::Number {
                    self.sections.push(at.line);
                }
                self.labels.entry(label).or_default().push(place);
                self.count += 1;
            }
            self.at = behind;
        }
        Ok(false)
    }

    /// The lines of the program that a line belongs to: the first, and the first behind it.
    fn section(&self, line: usize) -> (usize, usize) {
        let next = self.sections.partition_point(|begin| *begin <= line);
        let begin = next.checked_sub(1).and_then(|at| self.sections.get(at));
        let end = self.sections.get(next);
        (
            begin.copied().unwrap_or(0),
            end.copied().unwrap_or(usize::MAX),
        )
    }

    fn numbered(&self, number: u32, from: usize) -> Result<Option<Label>, Refusal> {
        if self.too_many_numbers {
            let found = format!("more than {LABELS_MAX} N-numbers in a program that jumps");
            return refuse(0, found, "N-numbers only where something leads to them");
        }
        let (begin, end) = self.section(from);
        let place = |of: u32, line: usize| {
            self.numbers
                .partition_point(|(n, label)| (*n, label.at.line) < (of, line))
        };
        let found = self.numbers.get(place(number, begin)..place(number, end));
        match found.unwrap_or_default() {
            [] => Ok(None),
            [(_, label)] => Ok(Some(*label)),
            [_, (_, again), ..] => {
                let line = again.at.line + 1;
                let found =
                    format!("N{number} is there twice in this program: again in line {line}");
                refuse(0, found, "each number that is led to once in a program")
            }
        }
    }

    /// The line behind the file that a line is in.
    fn end_of_file(&self, line: usize) -> usize {
        let next = self.files.partition_point(|&(index, _)| index <= line);
        self.files.get(next).map_or(usize::MAX, |&(index, _)| index)
    }

    fn next(&self, label: &str, from: usize, keywords: &[Keyword]) -> Option<Label> {
        let end = self.end_of_file(from);
        let lines = self.labels.get(label)?;
        let behind = lines.partition_point(|label| label.at.line <= from);
        lines
            .get(behind..)?
            .iter()
            .take_while(|label| label.at.line < end)
            .find(|label| keywords.contains(&label.keyword))
            .copied()
    }

    fn last_before(&self, label: &str, from: usize, keywords: &[Keyword]) -> Option<Label> {
        let file = self.files.partition_point(|&(index, _)| index <= from);
        let begin = file.checked_sub(1).and_then(|file| self.files.get(file));
        let begin = begin.map_or(0, |&(index, _)| index);
        let lines = self.labels.get(label)?;
        let before = lines.partition_point(|label| label.at.line < from);
        let before = lines.get(..before)?.iter().rev();
        before
            .take_while(|label| label.at.line >= begin)
            .find(|label| keywords.contains(&label.keyword))
            .copied()
    }

    fn subroutine(&self, label: &str) -> Option<Label> {
        let lines = self.labels.get(label)?;
        let of = |wanted: Keyword| lines.iter().find(|label| label.keyword == wanted).copied();
        of(Keyword::Sub).or_else(|| of(Keyword::Number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(text: &str) -> Source {
        Source::new(Text::of(text), Dialect::LinuxCnc)
    }

    fn found(label: Result<Option<Label>, Refusal>) -> Option<(usize, Keyword)> {
        label.unwrap().map(|label| (label.at.line, label.keyword))
    }

    #[test]
    fn labels_are_found_whatever_their_writing() {
        let mut source =
            source("N10 o0100 SUB\n  / O<My Pocket>  sub (x)\no100 end sub\no100\nG0 o1 sub\n");
        assert_eq!(found(source.subroutine("100")), Some((0, Keyword::Sub)));
        assert_eq!(
            found(source.subroutine("mypocket")),
            Some((1, Keyword::Sub))
        );
        assert_eq!(
            found(source.next("100", 0, &[Keyword::EndSub])),
            Some((2, Keyword::EndSub))
        );
        assert_eq!(found(source.subroutine("1")), None);
    }

    #[test]
    fn lines_that_may_go_on_elsewhere_are_known_by_their_bytes() {
        for line in [
            "o1 if [1]",
            "N5 O<a> call",
            "/o2 sub",
            "G0 M98 P7",
            "m 0 9 9",
            "G71 Q1",
            "g070Q2",
            "M#1",
            "G[70+1]",
        ] {
            assert!(may_jump(line.as_bytes()), "{line}");
        }
        for line in [
            "G1 X98 Y7",
            "M8",
            "G17 G90",
            "(o1) G0 X1",
            "M9",
            "G7",
            "N10 G1",
            "G73 X1",
        ] {
            assert!(!may_jump(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn a_text_is_looked_through_in_pieces() {
        let text = format!("{}o1 sub\no1 endsub\n", "G1 X1\n".repeat(1_000));
        let mut pieces = source(&text);
        let mut calls = 0;
        while !pieces.look_on(100).unwrap() {
            calls += 1;
        }
        assert!((50..70).contains(&calls), "{calls}");
        assert_eq!(
            found(pieces.subroutine("1")),
            found(source(&text).subroutine("1"))
        );
        assert_eq!(found(pieces.subroutine("1")), Some((1_000, Keyword::Sub)));
    }

    #[test]
    fn files_that_are_appended_keep_their_own_lines() {
        let mut source = source(
            "G0 X1\no<a> call\nM2\n\u{1c}a.ngc\no<a> sub\no1 if [1]\no1 endif\no<a> endsub\n\u{1c}b.ngc\no1 endif\n",
        );
        assert_eq!(found(source.next("1", 6, &[Keyword::EndIf])), None);
        assert!(source.is_main(2) && !source.is_main(3));
        assert_eq!(source.place(2), (None, 2));
        assert_eq!(source.place(5), (Some("a.ngc"), 1));
        assert_eq!(source.place(10), (Some("b.ngc"), 1));
    }
}
