//! SVG with fine coordinates: plotters draws in whole pixels, so everything is drawn larger and shown smaller.

use std::ops::Range;
use std::path::{Path, PathBuf};

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Drawn units per pixel shown.
pub const FINE: i32 = 8;

/// Colour of titles and outlines.
pub const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
/// Colour of words and lines that stand back.
pub const SOFT: RGBColor = RGBColor(0x6b, 0x72, 0x7b);
/// Colour of the lines behind curves.
pub const GRID: RGBColor = RGBColor(0xe3, 0xe6, 0xea);
/// Colours of curves, in their order.
pub const CURVES: [RGBColor; 4] = [
    RGBColor(0x0b, 0x5c, 0xad),
    RGBColor(0xc2, 0x4a, 0x14),
    RGBColor(0x2f, 0x7d, 0x32),
    RGBColor(0x7b, 0x3f, 0xa0),
];

/// A drawing area in fine units.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// Whether a piece of a picture could be drawn; if not, why.
pub type Drawn = Result<(), String>;
/// A chart of numbers over numbers.
pub type NumberChart<'a> =
    ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// A plot that cannot be drawn or written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be drawn: {what}")]
pub struct PlotError {
    /// The file.
    pub path: PathBuf,
    /// Why.
    pub what: String,
}

/// Any failure of a drawing, in words.
pub fn words(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// Draws a picture of so many pixels and writes it.
///
/// # Errors
/// It cannot be drawn, or the file cannot be written.
pub fn write(
    path: &Path,
    (width, height): (i32, i32),
    draw: impl FnOnce(&Area) -> Drawn,
) -> Result<(), PlotError> {
    let (fine_width, fine_height) = (width * FINE, height * FINE);
    let drawn = || {
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
    };
    drawn().map_err(|what| PlotError {
        path: path.into(),
        what,
    })
}

/// Pixels in units of the drawing.
pub fn fine(pixels: f64) -> i32 {
    libm::round(pixels * f64::from(FINE)) as i32
}

/// A place in pixels, in units of the drawing.
pub fn at(x: f64, y: f64) -> (i32, i32) {
    (fine(x), fine(y))
}

/// A line of this colour, so many pixels wide.
pub fn stroke(colour: RGBColor, pixels: f64) -> ShapeStyle {
    colour.stroke_width(fine(pixels).max(1) as u32)
}

/// Draws a line through points in units of the drawing.
///
/// # Errors
/// It cannot be drawn.
pub fn line(area: &Area, points: Vec<(i32, i32)>, style: ShapeStyle) -> Drawn {
    area.draw(&PathElement::new(points, style)).map_err(words)
}

/// Letters of so many pixels.
pub fn font(pixels: i32, colour: &RGBColor) -> TextStyle<'static> {
    ("sans-serif", pixels * FINE).into_font().color(colour)
}

/// Writes a line of text that reaches from a place, to it or to both its sides.
///
/// # Errors
/// It cannot be drawn.
pub fn text(
    area: &Area,
    what: &str,
    place: (i32, i32),
    pixels: i32,
    colour: &RGBColor,
    h_pos: HPos,
) -> Drawn {
    let v_pos = VPos::Center;
    let style = font(pixels, colour).pos(Pos { h_pos, v_pos });
    area.draw_text(what, &style, place).map_err(words)
}

/// How a chart looks that curves are drawn on.
pub struct Frame<'a> {
    /// A title inside its area, and its colour.
    pub caption: Option<(&'a str, RGBColor)>,
    /// Pixels left free above.
    pub top: i32,
    /// Pixels for labels below.
    pub below: i32,
    /// What it goes over.
    pub x: Range<f64>,
    /// What it shows.
    pub y: Range<f64>,
    /// Names of both axes.
    pub titles: (&'a str, &'a str),
    /// How many labels of each axis, at most.
    pub labels: (Option<usize>, usize),
    /// Their letters, in pixels.
    pub label_pixels: i32,
    /// The text of a label of x; as it is if none.
    pub x_label: Option<&'a dyn Fn(&f64) -> String>,
    /// The text of a label of y.
    pub y_label: &'a dyn Fn(&f64) -> String,
}

/// Begins a chart: frame, grid and labels.
///
/// # Errors
/// It cannot be drawn.
pub fn chart<'a>(area: &Area<'a>, frame: Frame<'_>) -> Result<NumberChart<'a>, String> {
    let mut builder = ChartBuilder::on(area);
    if let Some((caption, colour)) = frame.caption {
        builder.caption(caption, font(16, &colour));
    }
    let mut chart = builder
        .margin_top(frame.top * FINE)
        .margin_left(16 * FINE)
        .margin_right(30 * FINE)
        .x_label_area_size(frame.below * FINE)
        .y_label_area_size(66 * FINE)
        .build_cartesian_2d(frame.x, frame.y)
        .map_err(words)?;
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(WHITE)
        .bold_line_style(GRID.stroke_width(FINE as u32))
        .axis_style(SOFT.stroke_width(FINE as u32))
        .set_all_tick_mark_size(5 * FINE)
        .label_style(font(frame.label_pixels, &SOFT))
        .x_desc(frame.titles.0)
        .y_labels(frame.labels.1)
        .y_label_formatter(&frame.y_label);
    if !frame.titles.1.is_empty() {
        mesh.y_desc(frame.titles.1);
    }
    if let Some(most) = frame.labels.0 {
        mesh.x_labels(most);
    }
    if let Some(label) = &frame.x_label {
        mesh.x_label_formatter(label);
    }
    mesh.draw().map_err(words)?;
    drop(mesh);
    Ok(chart)
}
