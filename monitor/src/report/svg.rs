//! SVG with fine coordinates: plotters draws in whole pixels, so everything is drawn larger and shown smaller.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

/// Drawn units per pixel shown.
pub(crate) const FINE: i32 = 8;

/// Colour of titles and outlines.
pub(crate) const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
/// Colour of words and lines that stand back.
pub(crate) const SOFT: RGBColor = RGBColor(0x6b, 0x72, 0x7b);

/// A drawing area in fine units.
pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Any failure of a drawing, in words.
pub(crate) fn words(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// Draws a picture of so many pixels and writes it.
pub(crate) fn write(
    path: &Path,
    (width, height): (i32, i32),
    draw: impl FnOnce(&Area) -> Result<(), String>,
) -> Result<(), String> {
    let (fine_width, fine_height) = (width * FINE, height * FINE);
    let mut text = String::new();
    {
        let size = (fine_width as u32, fine_height as u32);
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(words)?;
        draw(&root)?;
        root.present().map_err(words)?;
    }
    let fine = format!("width=\"{fine_width}\" height=\"{fine_height}\" viewBox");
    let shown = format!("width=\"{width}\" height=\"{height}\" viewBox");
    std::fs::write(path, text.replacen(&fine, &shown, 1)).map_err(words)
}
