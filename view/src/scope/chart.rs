//! A capture in a terminal: one small chart per signal, all on one axis of time, as plain text.
//!
//! Curves are drawn in braille dots, two by four to a character, neighbouring scans joined; what was not seen is a gap. The
//! dotted line is the trigger.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Line};
use report::scope::signal::Signal;
use report::scope::{Capture, Row};

use crate::drawing::text_of;

/// Width of the labels left of a chart.
const GUTTER: u16 = 10;
/// Columns left of a chart: its labels, a space and its edge.
const LEFT: u16 = GUTTER + 2;
/// Narrowest and widest text.
const WIDTHS: (usize, usize) = (40, 200);

/// The capture as text of so many columns.
pub fn text(capture: &Capture, columns: usize) -> String {
    let columns = columns.clamp(WIDTHS.0, WIDTHS.1);
    // Two fit on 24 lines, with title and axis; more are made lower, down to what can be read.
    let height = match capture.signals.len() {
        0..=2 => 8,
        3 => 6,
        4 => 4,
        _ => 3,
    };
    let at_spaces =
        textwrap::Options::new(columns).word_splitter(textwrap::WordSplitter::NoHyphenation);
    let mut text = textwrap::fill(&capture.title(), at_spaces) + "\n";
    for (index, signal) in capture.signals.iter().enumerate() {
        text += &panel(
            capture,
            index,
            signal,
            Rect::new(0, 0, columns as u16, height),
        );
    }
    text + &time_axis(capture, columns as u16)
}

/// Digits behind the point that a range of this size needs.
fn decimals(range: f64) -> usize {
    if range > 0.0 {
        (2.0 - libm::floor(libm::log10(range))).clamp(0.0, 6.0) as usize
    } else {
        3
    }
}

/// A number of a signal, as people want to read it.
fn shown(signal: &Signal, value: f64, decimals: usize) -> String {
    if signal.is_whole() && value.fract() != 0.0 {
        return String::new();
    }
    if let Some(word) = signal.word(value) {
        return word.into();
    }
    let text = format!("{value:.decimals$}");
    // No minus before what is nothing.
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| matches!(c, '0' | '.')) => rest.into(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// Heading and chart of one signal.
fn panel(capture: &Capture, index: usize, signal: &Signal, area: Rect) -> String {
    let heading = signal.heading();
    let (Some((low, high)), Some(limits)) = (capture.range(index), capture.limits(index)) else {
        return format!("{heading}: nothing is known of it in these scans\n");
    };
    let places = if signal.is_whole() {
        0
    } else {
        decimals(high - low)
    };
    let number = |value: f64| shown(signal, value, places);
    let at = capture.at_trigger(index);
    let at = at.map_or("not known".into(), number);
    let (from, to) = (number(low), number(high));
    let heading = format!("{heading}: {from} to {to}, at the trigger {at}\n");
    let mut drawing = Buffer::empty(area);
    frame(&mut drawing, capture, limits, number);
    curve(&mut drawing, capture, index, limits);
    heading + &text_of(&drawing) + "\n"
}

/// Labels and edge, the line of zero and that of the trigger.
fn frame(
    drawing: &mut Buffer,
    capture: &Capture,
    (bottom, top): (f64, f64),
    number: impl Fn(f64) -> String,
) {
    let Rect { width, height, .. } = drawing.area;
    // The lines of dots stand where the canvas puts them.
    let dots_up = f64::from(height) * 4.0 - 1.0;
    let zero =
        (bottom < 0.0 && top > 0.0).then(|| libm::round(top / (top - bottom) * dots_up) as u16 / 4);
    for line in 0..height {
        let label = if line == 0 {
            number(top)
        } else if line + 1 == height {
            number(bottom)
        } else if zero == Some(line) {
            "0".into()
        } else {
            String::new()
        };
        let edge = if label.is_empty() { '│' } else { '┤' };
        let label = format!("{label:>0$} {edge}", usize::from(GUTTER));
        drawing.set_string(0, line, label, Style::new());
    }
    if let Some(zero) = zero {
        let dotted = "·".repeat((width - LEFT).into());
        drawing.set_string(LEFT, zero, dotted, Style::new());
    }
    let dots_across = f64::from(width - LEFT) * 2.0 - 1.0;
    let share = across(capture, capture.trigger_scan) / width_scans(capture);
    let trigger = libm::round(share.min(1.0) * dots_across) as u16 / 2;
    for line in 0..height {
        drawing.set_string(LEFT + trigger, line, "┊", Style::new());
    }
}

/// Scans from the left edge of a chart to its right one.
fn width_scans(capture: &Capture) -> f64 {
    (capture.asked.1 - capture.asked.0).max(1) as f64
}

/// Scans from the left edge of a chart.
fn across(capture: &Capture, scan: u64) -> f64 {
    scan.saturating_sub(capture.asked.0) as f64
}

fn curve(drawing: &mut Buffer, capture: &Capture, index: usize, (bottom, top): (f64, f64)) {
    let point = |row: &Row| {
        let value = row.values.get(index).copied().filter(|v| v.is_finite())?;
        Some((across(capture, row.scan), value))
    };
    let area = drawing.area;
    let canvas = Canvas::default()
        .marker(Marker::Braille)
        .x_bounds([0.0, width_scans(capture)])
        .y_bounds([bottom, top])
        .paint(|canvas| {
            let mut before: Option<(u64, (f64, f64))> = None;
            for row in &capture.rows {
                let Some((x, y)) = point(row) else {
                    before = None;
                    continue;
                };
                let joined = before.filter(|(scan, _)| scan + 1 == row.scan);
                let (x1, y1) = joined.map_or((x, y), |(_, last)| last);
                canvas.draw(&Line::new(x1, y1, x, y, Color::Reset));
                before = Some((row.scan, (x, y)));
            }
        });
    canvas.render(Rect::new(LEFT, 0, area.width - LEFT, area.height), drawing);
}

/// Distance of ticks: 1, 2 or 5 times a power of ten, at most so many in the range.
fn tick_step(range: f64, most: u16) -> f64 {
    let least = range / f64::from(most.max(1));
    let power = libm::pow(10.0, libm::floor(libm::log10(least)));
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power);
    let found = steps.into_iter().find(|step| *step >= least * (1.0 - 1e-9));
    found.unwrap_or(10.0 * power)
}

fn time_axis(capture: &Capture, columns: u16) -> String {
    let (from_ms, to_ms) = (
        capture.time_ms(capture.asked.0),
        capture.time_ms(capture.asked.1),
    );
    let range_ms = (to_ms - from_ms).max(f64::from(capture.period_us) * 1e-3);
    let (unit, size) = if range_ms >= 5000.0 {
        ("s", 1e3)
    } else {
        ("ms", 1.0)
    };
    let width = columns - LEFT;
    let step_ms = tick_step(range_ms, (width / 10).max(2));
    let column = |ms: f64| libm::round((ms - from_ms) / range_ms * (f64::from(width) - 1.0)) as u16;
    let mut drawing = Buffer::empty(Rect::new(0, 0, columns, 2));
    let edge = format!("└{}", "─".repeat(width.into()));
    drawing.set_string(LEFT - 1, 0, edge, Style::new());
    let mut free = 0;
    let first = libm::ceil(from_ms / step_ms - 1e-9) as i64;
    let last = libm::floor(to_ms / step_ms + 1e-9) as i64;
    for tick in first..=last {
        let ms = tick as f64 * step_ms;
        let at = LEFT + column(ms).min(width - 1);
        let mark = if tick == 0 { "┴" } else { "┬" };
        drawing.set_string(at, 0, mark, Style::new());
        let mut label = format!("{}", libm::round(ms / size * 1e6) / 1e6).replace('-', "−");
        if tick == last {
            label = format!("{label} {unit}");
        }
        let length = label.chars().count() as u16;
        let start = at.saturating_sub(length / 2);
        let start = start.min(columns.saturating_sub(length));
        if start >= free {
            drawing.set_string(start, 1, label, Style::new());
            free = start + length + 1;
        }
    }
    text_of(&drawing) + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::Machine;

    /// A position that goes up by 1 µm a scan to scan 1000 and down again, and a torque that rises, from 50 scans before the
    /// trigger in scan 1001 on.
    fn capture() -> Capture {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let machine = Machine::load(&root.join("machines/xy")).expect("a machine");
        let signal = |name| Signal::parse(name, &machine).expect("a signal");
        let position_mm = |scan: u64| (1000.0 - (scan as f64 - 1000.0).abs()) * 1e-3;
        let row = |scan: u64| Row {
            scan,
            values: vec![position_mm(scan), scan as f64 * 0.01],
        };
        Capture {
            number: 1,
            trigger_scan: 1001,
            what: "reversal of X to −".into(),
            period_us: 1000,
            signals: vec![signal("X.command"), signal("X.torque")],
            asked: (951, 1200),
            rows: (951..=1200).map(row).collect(),
        }
    }

    #[test]
    fn a_chart_of_two_signals_fits_a_terminal_of_80_by_24_and_marks_the_trigger() {
        let text = text(&capture(), 80);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines.len() <= 23, "{} lines:\n{text}", lines.len());
        for line in &lines {
            assert!(line.chars().count() <= 80, "{line:?}");
        }
        assert!(lines[0].starts_with("reversal of X to −, scan 1001"));
        assert!(
            lines[1].starts_with("X.command in mm: 0.800 to 1.000, at the trigger 0.999"),
            "{text}"
        );
        let marks = lines.iter().filter(|line| line.contains('┊')).count();
        assert!(marks >= 14, "{marks} lines with the trigger:\n{text}");
        assert!(lines[lines.len() - 1].contains("150 ms"), "{text}");
        // The peak of the command is in the column of the trigger, at the top.
        let column = |line: &str, letter: char| line.chars().position(|c| c == letter);
        let at = column(lines[5], '┊').expect("the trigger");
        let top: Vec<char> = lines[2].chars().collect();
        assert!(top[at - 1..=at].iter().any(is_dotted), "{text}");
    }

    fn is_dotted(letter: &char) -> bool {
        ('\u{2801}'..='\u{28ff}').contains(letter)
    }

    #[test]
    fn what_was_not_seen_is_a_gap() {
        let mut capture = capture();
        capture.rows.retain(|row| !(1050..1150).contains(&row.scan));
        let text = text(&capture, 80);
        let lines: Vec<Vec<char>> = text.lines().map(|line| line.chars().collect()).collect();
        // 249 scans on 68 columns: 1055 to 1145 are 29 to 52.
        for column in usize::from(LEFT) + 29..usize::from(LEFT) + 52 {
            let letters = lines[2..10].iter().filter_map(|line| line.get(column));
            assert!(!letters.into_iter().any(is_dotted), "{column}:\n{text}");
        }
    }

    #[test]
    fn a_chart_of_what_is_not_known_says_so() {
        let mut capture = capture();
        for row in &mut capture.rows {
            row.values[1] = f64::NAN;
        }
        let text = text(&capture, 80);
        assert!(
            text.contains("X.torque in N·m: nothing is known of it"),
            "{text}"
        );
    }
}
