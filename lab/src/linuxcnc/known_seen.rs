//! What a difference shows: the program's words up to it, and the two steps.

use std::collections::BTreeSet;

/// A difference in its program.
pub struct Seen {
    /// In capitals, without comments and blanks.
    lines: Vec<String>,
    /// The same with comments.
    text: String,
    pub theirs: Told,
    pub ours: Told,
}

/// One side of a difference.
#[derive(Debug, Default, PartialEq)]
pub struct Told {
    /// 0 where it is no motion.
    pub line: usize,
    pub is_rapid: bool,
    pub is_message: bool,
    /// Letters and values.
    places: Vec<(char, f64)>,
    /// The numbers of a message.
    printed: Vec<f64>,
}

impl Told {
    fn read(text: &str) -> Told {
        let mut told = Told {
            is_message: text.starts_with("message") || text.starts_with("log"),
            printed: text
                .split(' ')
                .filter_map(|word| word.parse().ok())
                .collect(),
            ..Told::default()
        };
        let Some((line, step)) = text
            .strip_prefix("line ")
            .and_then(|rest| rest.split_once(": "))
        else {
            return told;
        };
        told.line = line.parse().unwrap_or(0);
        told.is_rapid = step.starts_with("Rapid");
        for word in step.split(' ').skip(1).take_while(|word| *word != "about") {
            let (letter, value) = word.split_at(1);
            let letter = letter.chars().next().unwrap_or(' ');
            if let (true, Ok(value)) = ("XYZABCUVW".contains(letter), value.parse()) {
                told.places.push((letter, value));
            }
        }
        told
    }

    fn value(&self, letter: char) -> f64 {
        let found = self.places.iter().find(|(found, _)| *found == letter);
        found.map_or(0.0, |(_, value)| *value)
    }
}

/// Codes of a line, ten times their numbers.
fn codes(line: &str, of: char) -> Vec<u32> {
    let parts = line.split(of).skip(1);
    let number = |part: &str| {
        let end = part.find(|c: char| !(c.is_ascii_digit() || c == '.'));
        part[..end.unwrap_or(part.len())].parse::<f64>().ok()
    };
    parts
        .filter_map(number)
        .map(|number| (number * 10.0).round() as u32)
        .collect()
}

fn is_cycle(code: u32) -> bool {
    matches!(code, 730 | 740 | 810..=890)
}

/// Ends a series of cycles.
fn ends_series(code: u32) -> bool {
    matches!(code, 0 | 10 | 20 | 30 | 50..=53 | 330 | 331 | 382..=385 | 760 | 800)
}

impl Seen {
    pub fn new(program: &str, said: &str) -> Seen {
        let bare = |line: &str| {
            let mut text = String::new();
            let mut depth = 0;
            for c in line.to_ascii_uppercase().chars() {
                match c {
                    '(' => depth += 1,
                    ')' => depth -= 1,
                    ';' => break,
                    c if depth == 0 && !c.is_whitespace() => text.push(c),
                    _ => {}
                }
            }
            text
        };
        let sides = said
            .strip_prefix("theirs: ")
            .and_then(|rest| rest.split_once(" | ours: "));
        let (theirs, ours) = sides.unwrap_or_default();
        Seen {
            lines: program.lines().map(bare).collect(),
            text: program.to_ascii_uppercase().replace(' ', ""),
            theirs: Told::read(theirs),
            ours: Told::read(ours),
        }
    }

    /// Whether this stands in a line, not in a comment.
    pub fn has(&self, part: &str) -> bool {
        self.lines.iter().any(|line| line.contains(part))
    }

    /// Whether it is said: both sides print a message, and this stands in the program.
    pub fn prints(&self, part: &str) -> bool {
        self.theirs.is_message && self.ours.is_message && self.text.contains(part)
    }

    pub fn has_code(&self, code: u32) -> bool {
        self.lines
            .iter()
            .any(|line| codes(line, 'G').contains(&code))
    }

    /// The codes of the line where both move.
    pub fn here(&self) -> Vec<u32> {
        self.line_at(self.theirs.line)
            .map_or(vec![], |line| codes(line, 'G'))
    }

    fn line_at(&self, number: usize) -> Option<&String> {
        self.lines.get(number.checked_sub(1)?)
    }

    /// Both move in one line, and are apart in these axes at the most.
    pub fn apart_in(&self, letters: &str) -> bool {
        let all: BTreeSet<char> = [&self.theirs, &self.ours]
            .iter()
            .flat_map(|told| told.places.iter().map(|(letter, _)| *letter))
            .collect();
        let mut apart = all.iter().filter(|letter| {
            (self.theirs.value(**letter) - self.ours.value(**letter)).abs() > 1e-6
        });
        self.one_line() && apart.all(|letter| letters.contains(*letter))
    }

    /// Each coordinate is that of the other side, or is 180 against -180.
    pub fn mirrored(&self) -> bool {
        let of = |told: &Told| -> Vec<f64> {
            let values = told.places.iter();
            values
                .map(|(_, value)| {
                    if matches!(value.abs(), 90.0 | 180.0) {
                        value.abs()
                    } else {
                        *value
                    }
                })
                .collect()
        };
        of(&self.theirs) == of(&self.ours)
    }

    pub fn one_line(&self) -> bool {
        self.theirs.line != 0 && self.theirs.line == self.ours.line
    }

    /// Whether both move, be it in other lines.
    pub fn both_move(&self) -> bool {
        self.theirs.line != 0 && self.ours.line != 0
    }

    /// Whether some line goes to the place of G28 or G30.
    pub fn has_home(&self) -> bool {
        self.has_code(280) || self.has_code(300)
    }

    /// Whether a tap is done again, in a loop that has another plane behind it.
    pub fn taps_upright_in_a_loop(&self) -> bool {
        let repeats = self.before().len() == self.lines.len();
        let taps = self.has_code(740) || self.has_code(840);
        repeats && taps && (self.has_code(180) || self.has_code(190))
    }

    /// Whether what differs is 0 on one side and whole quarter turns on the other.
    pub fn quarter_turns_apart(&self) -> bool {
        let whole = |value: f64| value != 0.0 && value % 90.0 == 0.0;
        let printed = self.theirs.printed.iter().zip(&self.ours.printed);
        let places = "XYZABCUVW".chars();
        let values = places.map(|of| (self.theirs.value(of), self.ours.value(of)));
        let mut apart = printed
            .map(|(theirs, ours)| (*theirs, *ours))
            .chain(values.filter(|(theirs, ours)| (theirs - ours).abs() > 1e-6))
            .filter(|(theirs, ours)| theirs != ours)
            .peekable();
        apart.peek().is_some() && apart.any(|(theirs, ours)| whole(theirs) || whole(ours))
    }

    /// Whether all numbers that both print, but not alike, are nearer to 0.
    pub fn prints_less_than(&self, limit: f64) -> bool {
        let pairs = self.theirs.printed.iter().zip(&self.ours.printed);
        let mut apart = pairs.filter(|(theirs, ours)| theirs != ours);
        let same_count = self.theirs.printed.len() == self.ours.printed.len();
        same_count && apart.all(|(theirs, ours)| theirs.abs().max(ours.abs()) < limit)
    }

    pub fn both_rapid(&self) -> bool {
        self.one_line() && self.theirs.is_rapid && self.ours.is_rapid
    }

    /// The lines that may have been done before the difference: all of them where lines are repeated or called.
    fn before(&self) -> &[String] {
        let repeats = ["REPEAT", "WHILE", "CALL", "DO", "M98"]
            .iter()
            .any(|word| self.has(word));
        let end = if repeats || self.theirs.line == 0 {
            self.lines.len()
        } else {
            self.theirs.line.min(self.lines.len())
        };
        &self.lines[..end]
    }

    /// Whether cycles follow each other with a line between or in them for which `breaks` holds.
    pub fn series_with(&self, breaks: impl Fn(&str, &[u32]) -> bool) -> bool {
        let (mut in_series, mut broken, mut held) = (false, false, false);
        let mut lines: Vec<&String> = self.before().iter().collect();
        if lines.len() == self.lines.len() {
            // The second time round.
            lines.extend(self.lines.iter());
        }
        for line in lines {
            let found = codes(line, 'G');
            if found.iter().any(|code| ends_series(*code)) {
                (in_series, broken) = (false, false);
            }
            let cycle = found.iter().any(|code| is_cycle(*code));
            if (in_series || cycle) && breaks(line, &found) {
                broken = true;
            }
            in_series |= cycle;
            held |= in_series && broken;
        }
        held
    }

    /// Motion and plane in force at the difference, as the text has them.
    pub fn motion_and_plane(&self) -> (u32, u32) {
        let (mut motion, mut plane) = (0, 170);
        for code in self.before().iter().flat_map(|line| codes(line, 'G')) {
            if is_cycle(code) || ends_series(code) {
                motion = code;
            }
            if matches!(code, 170 | 180 | 190) {
                plane = code;
            }
        }
        (motion, plane)
    }

    /// Whether R is given twice with two values.
    pub fn levels_change(&self) -> bool {
        let levels: BTreeSet<String> = self
            .before()
            .iter()
            .filter(|line| codes(line, 'G').iter().any(|code| is_cycle(*code)))
            .filter_map(|line| number_behind(line, 'R'))
            .map(|value| format!("{value}"))
            .collect();
        levels.len() > 1
    }

    /// Whether a hole is a whole number of pecks deep.
    pub fn whole_pecks(&self) -> bool {
        let whole = |line: &String| {
            let of = |letter| number_behind(line, letter);
            let (Some(r), Some(q)) = (of('R'), of('Q')) else {
                return false;
            };
            let depths = ['X', 'Y', 'Z'].map(of).into_iter().flatten();
            let mut pecks = depths.flat_map(|bottom| [(r - bottom) / q, -bottom / q]);
            pecks.any(|pecks| pecks > 0.5 && (pecks - pecks.round()).abs() < 1e-7)
        };
        self.before().iter().any(whole)
    }

    /// Whether a `do` loop and a `break` are in the program.
    pub fn do_and_break(&self) -> bool {
        let begins = |line: &String| line.starts_with('O') && line.ends_with("DO");
        self.has("BREAK") && self.lines.iter().any(begins)
    }

    /// Whether theirs moves a rotary axis, to another place than 0, in a line of G28, G30 or G53.
    pub fn turns_home(&self) -> bool {
        let at_home = |code: &u32| matches!(code, 280 | 300 | 530);
        let turned = "ABC".chars().any(|letter| self.theirs.value(letter) != 0.0);
        turned && self.here().iter().any(at_home)
    }

    /// Whether a parameter of a work offset is set.
    pub fn sets_offset_parameters(&self) -> bool {
        (0..9).any(|system| self.has(&format!("#{}=", 5221 + 20 * system)))
    }
}

fn number_behind(line: &str, letter: char) -> Option<f64> {
    let (_, rest) = line.split_once(letter)?;
    let end = rest.find(|c: char| !(c.is_ascii_digit() || ".+-".contains(c)));
    rest[..end.unwrap_or(rest.len())].parse().ok()
}
