//! The modes that typed-in blocks leave to the next one: each block is a program of its own, and people expect G91, G20, F, S and
//! offsets to stay.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::{fs, io};

/// Which words replace each other. Their order is that of the lines they are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Group {
    Units,
    Plane,
    Distance,
    ArcDistance,
    Diameter,
    FeedMode,
    Path,
    Offset,
    ToolLength,
    Motion,
    Feed,
    Speed,
}

/// Feeds are read in the units of a block before, so there are several lines.
const LINES: [&[Group]; 3] = [
    &[Group::Units, Group::Plane, Group::Diameter],
    &[
        Group::Distance,
        Group::ArcDistance,
        Group::FeedMode,
        Group::Path,
        Group::Offset,
    ],
    &[Group::Feed, Group::Speed, Group::ToolLength, Group::Motion],
];

/// What is kept of the blocks before.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ModalWords(BTreeMap<Group, String>);

/// A word of a block: its letter, and its number where it is written as one.
type Word = (char, Option<String>);

/// The words of a line, without its comments; none of a line with an O-word.
fn words(line: &str) -> Vec<Word> {
    let mut words = Vec::new();
    let mut rest = line.chars().peekable();
    while let Some(letter) = rest.next() {
        match letter {
            ';' => break,
            '(' => while rest.next().is_some_and(|inside| inside != ')') {},
            _ if letter.is_ascii_alphabetic() => {
                let mut number = String::new();
                while let Some(next) = rest.peek().copied() {
                    if next.is_ascii_digit() || ".+-".contains(next) {
                        number.push(next);
                    } else if next != ' ' {
                        break;
                    }
                    rest.next();
                }
                let letter = letter.to_ascii_uppercase();
                if letter == 'O' {
                    return Vec::new();
                }
                words.push((letter, number.parse::<f64>().ok().map(|n| n.to_string())));
            }
            _ => {}
        }
    }
    words
}

/// The group of a G-code, and whether it is written for the next block.
fn group(code: &str) -> Option<(Group, bool)> {
    let number: f64 = code.parse().ok()?;
    let tenths = (number * 10.0).round() as i64;
    Some(match tenths {
        0 | 10 => (Group::Motion, true),
        20 | 30 | 50..=53 | 330 | 331 | 380..=389 | 730 | 760 | 800..=890 => (Group::Motion, false),
        170..=192 => (Group::Plane, true),
        200 | 210 => (Group::Units, true),
        70 | 80 => (Group::Diameter, true),
        900 | 910 => (Group::Distance, true),
        901 | 911 => (Group::ArcDistance, true),
        930 => (Group::FeedMode, false),
        940 | 950 => (Group::FeedMode, true),
        610 | 611 | 640 => (Group::Path, true),
        540..=593 => (Group::Offset, true),
        430 => (Group::ToolLength, true),
        431 | 432 | 490 => (Group::ToolLength, false),
        _ => return None,
    })
}

impl ModalWords {
    /// Those that were kept in this file; none where there is none.
    pub fn read(file: &Path) -> ModalWords {
        let mut kept = ModalWords::default();
        kept.take(&fs::read_to_string(file).unwrap_or_default());
        kept
    }

    /// Keeps them in a file, whole or not at all.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, file: &Path) -> io::Result<()> {
        let new = file.with_extension(std::process::id().to_string());
        fs::write(&new, self.text())?;
        fs::rename(new, file)
    }

    /// Takes what these blocks leave.
    pub fn take(&mut self, blocks: &str) {
        for line in blocks.lines() {
            let words = words(line);
            let beside = |letters: &[char]| {
                let mut text = String::new();
                for (letter, number) in &words {
                    if letters.contains(letter)
                        && let Some(number) = number
                    {
                        let _ = write!(text, " {letter}{number}");
                    }
                }
                text
            };
            for (letter, number) in &words {
                let (group, text) = match (letter, number) {
                    ('F', _) => (Group::Feed, number.as_ref().map(|n| format!("F{n}"))),
                    ('S', _) => (Group::Speed, number.as_ref().map(|n| format!("S{n}"))),
                    ('G', Some(code)) => {
                        let Some((group, stays)) = group(code) else {
                            continue;
                        };
                        let more = match group {
                            Group::Path => beside(&['P', 'Q']),
                            Group::ToolLength => beside(&['H']),
                            _ => String::new(),
                        };
                        (group, stays.then(|| format!("G{code}{more}")))
                    }
                    _ => continue,
                };
                match text {
                    Some(text) => self.0.insert(group, text),
                    None => self.0.remove(&group),
                };
            }
        }
    }

    /// Lines that set them.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for line in LINES {
            let words: Vec<&str> = line
                .iter()
                .filter_map(|group| self.0.get(group).map(String::as_str))
                .collect();
            text += &words.join(" ");
            text.push('\n');
        }
        text
    }

    /// How many lines that are.
    pub fn lines() -> usize {
        LINES.len()
    }
}

#[cfg(test)]
mod tests {
    use super::ModalWords;

    fn after(blocks: &str) -> String {
        let mut words = ModalWords::default();
        words.take(blocks);
        words.text().lines().collect::<Vec<_>>().join("|")
    }

    #[test]
    fn what_a_block_sets_stays_for_the_next() {
        assert_eq!(after(""), "||");
        assert_eq!(after("g91 g20 (G90) ; G21"), "G20|G91|");
        assert_eq!(after("G1 X1 F100 S2000 M3"), "||F100 S2000 G1");
        assert_eq!(after("G55 G64 P0.01 Q0.02 G18"), "G18|G64 P0.01 Q0.02 G55|");
        assert_eq!(after("G43 H2\nG0 Z5"), "||G43 H2 G0");
        assert_eq!(after("G43 H2\nG49"), "||");
    }

    #[test]
    fn an_arc_or_a_cycle_is_not_gone_on_with_and_an_expression_is_not_known() {
        assert_eq!(after("G1 F100\nG2 X1 I1"), "||F100");
        assert_eq!(after("F100\nF[#1*2]"), "||");
        assert_eq!(after("G1 F100\nO100 sub"), "||F100 G1");
    }

    #[test]
    fn what_was_kept_is_read_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("mdi");
        let mut words = ModalWords::read(&file);
        assert_eq!(words, ModalWords::default());
        words.take("G91 G55 F250 G1 G61.1");
        words.write(&file).expect("written");
        assert_eq!(ModalWords::read(&file), words);
    }
}
