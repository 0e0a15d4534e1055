//! What is drawn: a model and how, and panels on it.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::Span;
use ratatui::widgets::{Block, Borders};

use crate::live::model::Model;
use crate::live::palette::Palette;
use crate::live::words::Tone;

/// What the bottom line asks or answers.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Prompt {
    /// The keys.
    #[default]
    Keys,
    /// Whether to stop.
    ConfirmStop,
    /// Whether to home.
    ConfirmHome,
    /// Whether to go on out of a trip.
    ConfirmResume,
    /// Axes are jogged by keys: which, and how.
    Jog(String),
    /// A block is typed in.
    Block(String),
    /// What came of an order.
    Answer(Tone, String),
}

/// Everything that is shown.
pub struct Screen<'a> {
    /// The cell.
    pub model: &'a Model,
    /// Colours.
    pub palette: Palette,
    /// The bottom line.
    pub prompt: Prompt,
    /// The readout is shown in place of the panels.
    pub readout: bool,
    /// The page about the keys lies over it.
    pub help: bool,
}

impl<'a> Screen<'a> {
    /// A screen on paper.
    pub fn plain(model: &'a Model) -> Self {
        Screen {
            model,
            palette: Palette::plain(),
            prompt: Prompt::Keys,
            readout: false,
            help: false,
        }
    }
}

/// A panel's area inside a titled rule along its top.
pub fn panel(frame: &mut Frame<'_>, area: Rect, title: &str, palette: Palette) -> Rect {
    let block = Block::new()
        .borders(Borders::TOP)
        .border_style(palette.quiet())
        .title(Span::styled(format!(" {title} "), palette.title()));
    let inside = block.inner(area);
    frame.render_widget(block, area);
    inside
}
