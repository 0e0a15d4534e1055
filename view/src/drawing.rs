//! Drawings of `ratatui` without a terminal.

use ratatui::buffer::{Buffer, Cell};

/// A drawing as text, without what is blank at the ends of lines.
pub(crate) fn text_of(drawing: &Buffer) -> String {
    let width = usize::from(drawing.area.width).max(1);
    let lines = drawing.content.chunks(width).map(|row| {
        let line: String = row.iter().map(Cell::symbol).collect();
        line.trim_end().to_string()
    });
    lines.collect::<Vec<_>>().join("\n")
}
