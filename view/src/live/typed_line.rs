//! A line that is typed at the bottom of the screen, with those typed before.

use ratatui::crossterm::event::KeyCode;

/// Lines that are remembered.
const REMEMBERED: usize = 100;

/// What a key came to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Typed {
    /// The line goes on.
    More,
    /// It is to be sent.
    Sent(String),
    /// It was given up.
    Left,
}

/// The line, and those before it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TypedLine {
    text: String,
    before: Vec<String>,
    /// Which of those before is shown; none for the new one.
    shown: Option<usize>,
}

impl TypedLine {
    /// The line so far.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Acts on a key.
    pub fn key(&mut self, code: KeyCode) -> Typed {
        match code {
            KeyCode::Char(letter) => self.text.push(letter),
            KeyCode::Backspace if self.text.is_empty() => return Typed::Left,
            KeyCode::Backspace => {
                self.text.pop();
            }
            KeyCode::Up => self.show(self.shown.unwrap_or(self.before.len()).checked_sub(1)),
            KeyCode::Down => self.show(self.shown.map(|shown| shown + 1)),
            KeyCode::Enter => {
                self.shown = None;
                let line = std::mem::take(&mut self.text).trim().to_owned();
                if line.is_empty() {
                    return Typed::Left;
                }
                if self.before.last() != Some(&line) {
                    self.before.push(line.clone());
                }
                if self.before.len() > REMEMBERED {
                    self.before.remove(0);
                }
                return Typed::Sent(line);
            }
            KeyCode::Esc => {
                self.shown = None;
                self.text.clear();
                return Typed::Left;
            }
            _ => {}
        }
        Typed::More
    }

    fn show(&mut self, index: Option<usize>) {
        let Some(index) = index else { return };
        let line = self.before.get(index);
        self.shown = line.is_some().then_some(index);
        self.text = line.cloned().unwrap_or_default();
    }
}

#[cfg(test)]
mod tests {
    use super::{Typed, TypedLine};
    use ratatui::crossterm::event::KeyCode;

    fn typed(line: &mut TypedLine, text: &str) -> Typed {
        for letter in text.chars() {
            line.key(KeyCode::Char(letter));
        }
        line.key(KeyCode::Enter)
    }

    #[test]
    fn lines_are_sent_and_come_back_by_arrows() {
        let mut line = TypedLine::default();
        assert_eq!(typed(&mut line, "G0 X1"), Typed::Sent("G0 X1".into()));
        assert_eq!(typed(&mut line, "G0 X2"), Typed::Sent("G0 X2".into()));
        for (key, shown) in [
            (KeyCode::Up, "G0 X2"),
            (KeyCode::Up, "G0 X1"),
            (KeyCode::Up, "G0 X1"),
            (KeyCode::Down, "G0 X2"),
            (KeyCode::Down, ""),
            (KeyCode::Up, "G0 X2"),
            (KeyCode::Backspace, "G0 X"),
        ] {
            assert_eq!(line.key(key), Typed::More);
            assert_eq!(line.text(), shown);
        }
        assert_eq!(line.key(KeyCode::Esc), Typed::Left);
        assert_eq!(typed(&mut line, ""), Typed::Left);
    }
}
