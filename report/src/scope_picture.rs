//! A capture as a picture: one panel per signal, all on one axis of time, the trigger as a line through all of them.

use std::path::Path;

use plotters::prelude::*;

use crate::plot::{self, Area, CURVES, Drawn, FINE, Frame, INK, PlotError, SOFT, font, words};
use crate::scope::Capture;
use crate::scope::signal::Signal;

const WIDTH: i32 = 1000;
const PANEL: i32 = 170;
const HEAD: i32 = 56;
const FOOT: i32 = 44;

/// Draws it as SVG.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, capture: &Capture) -> Result<(), PlotError> {
    let panels = capture.signals.len().max(1) as i32;
    let size = (WIDTH, HEAD + PANEL * panels + FOOT);
    plot::write(path, size, |root| draw(root, capture))
}

fn draw(root: &Area, capture: &Capture) -> Drawn {
    root.draw_text(&capture.what, &font(20, &INK), (24 * FINE, 10 * FINE))
        .map_err(words)?;
    let title = capture.title();
    let rest = title.strip_prefix(&capture.what).unwrap_or(&title);
    let rest = rest.trim_start_matches([',', ' ']);
    root.draw_text(rest, &font(13, &SOFT), (24 * FINE, 36 * FINE))
        .map_err(words)?;
    let (_, body) = root.split_vertically(HEAD * FINE);
    let count = capture.signals.len();
    let mut rest = body;
    for (index, signal) in capture.signals.iter().enumerate() {
        let last = index + 1 == count;
        let height = PANEL + if last { FOOT } else { 0 };
        let (area, below) = rest.split_vertically(height * FINE);
        panel(&area, capture, index, signal, last)?;
        rest = below;
    }
    Ok(())
}

fn panel(area: &Area, capture: &Capture, index: usize, signal: &Signal, last: bool) -> Drawn {
    let from_ms = capture.time_ms(capture.asked.0);
    let to_ms = capture.time_ms(capture.asked.1).max(from_ms + 1e-3);
    let limits = capture.limits(index);
    let (bottom, top) = limits.unwrap_or((0.0, 1.0));
    let room = (top - bottom) * 0.08;
    let heading = match limits {
        Some(_) => signal.heading(),
        None => format!(
            "{}: nothing is known of it in these scans",
            signal.heading()
        ),
    };
    let frame = Frame {
        caption: None,
        top: 26,
        below: if last { FOOT } else { 0 },
        x: from_ms..to_ms,
        y: bottom - room..top + room,
        titles: ("time from the trigger in ms", ""),
        labels: (Some(11), 5),
        label_pixels: 12,
        x_label: Some(&|value| format!("{}", libm::round(value * 1e3) / 1e3 + 0.0)),
        y_label: &|value| match signal.word(*value) {
            Some(word) if value.fract() == 0.0 => word.into(),
            _ if signal.is_whole() && value.fract() != 0.0 => String::new(),
            _ => format!("{}", libm::round(value * 1e4) / 1e4 + 0.0),
        },
    };
    let mut chart = plot::chart(area, frame)?;
    area.draw_text(&heading, &font(15, &INK), (82 * FINE, 6 * FINE))
        .map_err(words)?;
    let [curve, trigger, ..] = CURVES;
    let line = [(0.0, bottom - room), (0.0, top + room)];
    chart
        .draw_series(LineSeries::new(line, trigger.stroke_width(FINE as u32)))
        .map_err(words)?;
    let known = capture.rows.iter().filter_map(|row| {
        let value = row.values.get(index).copied().filter(|v| v.is_finite())?;
        Some((row.scan, value))
    });
    let known: Vec<(u64, f64)> = known.collect();
    // What was not seen is a gap, not a straight line.
    for piece in known.chunk_by(|one, two| one.0 + 1 == two.0) {
        let points = piece
            .iter()
            .map(|&(scan, value)| (capture.time_ms(scan), value));
        chart
            .draw_series(LineSeries::new(
                points,
                curve.stroke_width(3 * FINE as u32 / 2),
            ))
            .map_err(words)?;
    }
    Ok(())
}
