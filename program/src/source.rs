//! The text of a program: its lines, its files and where its labels are.

use std::collections::HashMap;

use crate::flow::{Keyword, flow_at};

/// A line that begins with it begins another file, whose name follows: what [`crate::bundle`] appends to a program that calls
/// subroutines of other files.
pub const FILE_MARK: char = '\u{1c}';

/// A program text by lines, with an index of its labels.
pub struct Source<'a> {
    text: &'a str,
    /// Byte offset of each line.
    lines: Vec<usize>,
    /// Lines with O-words of each label, in order.
    labels: HashMap<String, Vec<(usize, Keyword)>>,
    /// Where each file that is appended begins: the line of its mark, and its name.
    files: Vec<(usize, &'a str)>,
}

impl<'a> Source<'a> {
    pub fn new(text: &'a str) -> Self {
        let mut source = Self {
            text,
            lines: Vec::with_capacity(text.len() / 16),
            labels: HashMap::new(),
            files: vec![],
        };
        let mut offset = 0;
        for line in text.split('\n') {
            let index = source.lines.len();
            source.lines.push(offset);
            offset += line.len() + 1;
            if let Some(name) = line.strip_prefix(FILE_MARK) {
                source.files.push((index, name.trim()));
            } else if let Some((label, keyword)) = flow_at(line) {
                source
                    .labels
                    .entry(label)
                    .or_default()
                    .push((index, keyword));
            }
        }
        source
    }

    /// The text of a line, counted from 0, without its end.
    pub fn line(&self, index: usize) -> Option<&'a str> {
        let start = *self.lines.get(index)?;
        let end = self
            .lines
            .get(index + 1)
            .map_or(self.text.len(), |next| next - 1);
        let line = self.text.get(start..end)?;
        Some(line.strip_suffix('\r').unwrap_or(line))
    }

    /// How many lines the program's own file has.
    pub fn main_end(&self) -> usize {
        self.files
            .first()
            .map_or(self.lines.len(), |&(index, _)| index)
    }

    /// The lines of the file that a line is in: from, to behind the last.
    fn file_of(&self, line: usize) -> (usize, usize) {
        let next = self.files.partition_point(|&(index, _)| index <= line);
        let start = next
            .checked_sub(1)
            .and_then(|file| self.files.get(file))
            .map_or(0, |&(index, _)| index);
        let end = self
            .files
            .get(next)
            .map_or(self.lines.len(), |&(index, _)| index);
        (start, end)
    }

    /// Whether the line is behind the end of the file that `within` is in.
    pub fn is_beyond(&self, line: usize, within: usize) -> bool {
        let (start, end) = self.file_of(within);
        line < start || line >= end
    }

    /// Name of the file and line in it, counted from 1, of a line counted from 1 over all files; no name for the program itself.
    pub fn place(&self, line: u32) -> (Option<&'a str>, u32) {
        let index = (line as usize).saturating_sub(1);
        let next = self.files.partition_point(|&(start, _)| start < index);
        match next.checked_sub(1).and_then(|file| self.files.get(file)) {
            Some(&(start, name)) => (Some(name), (index - start) as u32),
            None => (None, line),
        }
    }

    /// The next line behind `from`, in the same file, with one of these words and this label.
    pub fn next(&self, label: &str, from: usize, keywords: &[Keyword]) -> Option<(usize, Keyword)> {
        let (_, end) = self.file_of(from);
        let lines = self.labels.get(label)?;
        let behind = lines.partition_point(|&(line, _)| line <= from);
        lines
            .get(behind..)?
            .iter()
            .take_while(|&&(line, _)| line < end)
            .find(|(_, keyword)| keywords.contains(keyword))
            .copied()
    }

    /// Where a subroutine begins: its `sub`, or its number for M98.
    pub fn subroutine(&self, label: &str) -> Option<(usize, Keyword)> {
        let lines = self.labels.get(label)?;
        let of = |wanted: Keyword| {
            lines
                .iter()
                .find(|&&(_, keyword)| keyword == wanted)
                .copied()
        };
        of(Keyword::Sub).or_else(|| of(Keyword::Number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_found_whatever_their_writing() {
        let source = Source::new(
            "N10 o0100 SUB\n  / O<My Pocket>  sub (x)\no100 end sub\no100\nG0 o1 sub\n",
        );
        assert_eq!(source.subroutine("100"), Some((0, Keyword::Sub)));
        assert_eq!(source.subroutine("mypocket"), Some((1, Keyword::Sub)));
        assert_eq!(
            source.next("100", 0, &[Keyword::EndSub]),
            Some((2, Keyword::EndSub))
        );
        assert_eq!(source.subroutine("1"), None);
    }

    #[test]
    fn files_that_are_appended_keep_their_own_lines() {
        let source = Source::new(
            "G0 X1\no<a> call\nM2\n\u{1c}a.ngc\no<a> sub\no1 if [1]\no1 endif\no<a> endsub\n\u{1c}b.ngc\no1 endif\n",
        );
        assert_eq!(source.main_end(), 3);
        assert_eq!(source.place(2), (None, 2));
        assert_eq!(source.place(5), (Some("a.ngc"), 1));
        assert_eq!(source.place(10), (Some("b.ngc"), 1));
        assert_eq!(source.next("1", 6, &[Keyword::EndIf]), None);
    }
}
