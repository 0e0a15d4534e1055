//! Colours that everybody can tell apart: blue, orange and the terminal's own; never alone, always beside a sign or a word.

use ratatui::style::{Color, Modifier, Style};

use super::words::Tone;

/// Blue and orange after Okabe and Ito, 2008, as near as 256 colours come.
const BLUE: Color = Color::Indexed(75);
const ORANGE: Color = Color::Indexed(214);

/// How things are shown.
#[derive(Debug, Clone, Copy)]
pub struct Palette {
    coloured: bool,
}

impl Palette {
    /// Without colour where `NO_COLOR` is set (no-color.org).
    pub fn of_environment() -> Self {
        let asked = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        Palette { coloured: !asked }
    }

    /// Without any colour.
    pub fn plain() -> Self {
        Palette { coloured: false }
    }

    fn coloured(self, colour: Color) -> Style {
        if self.coloured {
            Style::new().fg(colour)
        } else {
            Style::new()
        }
    }

    /// What is well.
    pub fn good(self) -> Style {
        self.coloured(BLUE)
    }

    /// What somebody should look at.
    pub fn warn(self) -> Style {
        self.coloured(ORANGE).add_modifier(Modifier::BOLD)
    }

    /// Titles.
    pub fn title(self) -> Style {
        Style::new().add_modifier(Modifier::BOLD)
    }

    /// What is there for those who look for it.
    pub fn quiet(self) -> Style {
        Style::new().add_modifier(Modifier::DIM)
    }

    /// Of a tone.
    pub fn of(self, tone: Tone) -> Style {
        match tone {
            Tone::Good => self.good().add_modifier(Modifier::BOLD),
            Tone::Waits => self.title(),
            Tone::Bad => self.warn(),
        }
    }

    /// Colour of points on a canvas.
    pub fn curve(self) -> Color {
        if self.coloured { ORANGE } else { Color::Reset }
    }

    /// Colour of the nominal circle.
    pub fn nominal(self) -> Color {
        if self.coloured { BLUE } else { Color::Reset }
    }
}
