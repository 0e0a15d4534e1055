//! A capture in a terminal: one small chart per signal, all on one axis of time, as plain text.
//!
//! Curves are drawn in braille dots, two by four to a character, neighbouring scans joined; what was not seen is a gap. The
//! dotted line is the trigger.

use super::Capture;
use super::signal::Signal;

/// Width of the labels left of a chart.
const GUTTER: usize = 10;
/// Narrowest and widest text.
const WIDTHS: (usize, usize) = (40, 200);

/// The capture as text of so many columns.
pub fn text(capture: &Capture, columns: usize) -> String {
    let columns = columns.clamp(WIDTHS.0, WIDTHS.1);
    let width = columns - GUTTER - 2;
    // Two fit on 24 lines, with title and axis; more are made lower, down to what can be read.
    let height = match capture.signals.len() {
        0..=2 => 8,
        3 => 6,
        4 => 4,
        _ => 3,
    };
    let mut text = wrapped(&capture.title(), columns);
    for (index, signal) in capture.signals.iter().enumerate() {
        text += &panel(capture, index, signal, width, height);
    }
    text + &time_axis(capture, width)
}

/// Breaks at spaces.
fn wrapped(line: &str, columns: usize) -> String {
    let mut text = String::new();
    let mut used = 0;
    for word in line.split(' ') {
        let length = word.chars().count();
        if used > 0 && used + 1 + length > columns {
            text.push('\n');
            used = 0;
        } else if used > 0 {
            text.push(' ');
            used += 1;
        }
        text += word;
        used += length;
    }
    text + "\n"
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

/// What a chart of these values reaches from and to.
pub(super) fn limits(low: f64, high: f64) -> (f64, f64) {
    if high > low {
        return (low, high);
    }
    // A value that stands still is drawn in the middle.
    let half = (low.abs() * 1e-3).max(0.5);
    (low - half, high + half)
}

struct Dots {
    cells: Vec<u8>,
    width: usize,
}

impl Dots {
    fn new(width: usize, height: usize) -> Dots {
        Dots {
            cells: vec![0; width * height],
            width,
        }
    }

    /// Sets one dot; x from the left, y from the top.
    fn set(&mut self, x: usize, y: usize) {
        const BITS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];
        let (column, line) = (x / 2, y / 4);
        if column < self.width
            && let Some(cell) = self.cells.get_mut(line * self.width + column)
            && let Some(bit) = BITS.get(y % 4).and_then(|row| row.get(x % 2))
        {
            *cell |= bit;
        }
    }

    /// Joins two dots.
    fn line(&mut self, from: (f64, f64), to: (f64, f64)) {
        let steps = libm::ceil((to.0 - from.0).abs().max((to.1 - from.1).abs())).max(1.0);
        for step in 0..=steps as usize {
            let share = step as f64 / steps;
            let x = libm::round(from.0 + (to.0 - from.0) * share).max(0.0) as usize;
            let y = libm::round(from.1 + (to.1 - from.1) * share).max(0.0) as usize;
            self.set(x, y);
        }
    }

    fn cell(&self, column: usize, line: usize) -> u8 {
        let cell = self.cells.get(line * self.width + column);
        cell.copied().unwrap_or(0)
    }
}

/// Dot columns from the left edge, of `across`, at which a scan stands.
fn across(capture: &Capture, scan: u64, dots: usize) -> f64 {
    let whole = (capture.asked.1 - capture.asked.0).max(1) as f64;
    scan.saturating_sub(capture.asked.0) as f64 / whole * (dots as f64 - 1.0)
}

fn panel(capture: &Capture, index: usize, signal: &Signal, width: usize, height: usize) -> String {
    let unit = match signal.unit.shown {
        "" => String::new(),
        unit => format!(" in {unit}"),
    };
    let Some((low, high)) = capture.range(index) else {
        return format!(
            "{}{unit}: nothing is known of it in these scans\n",
            signal.name
        );
    };
    let places = if signal.is_whole() {
        0
    } else {
        decimals(high - low)
    };
    let number = |value: f64| shown(signal, value, places);
    let at = capture.at_trigger(index);
    let at = at.map_or("not known".into(), number);
    let mut text = format!(
        "{}{unit}: {} to {}, at the trigger {at}\n",
        signal.name,
        number(low),
        number(high)
    );
    let (bottom, top) = limits(low, high);
    let (across_dots, up_dots) = (width * 2, height * 4);
    let up = |value: f64| (top - value) / (top - bottom) * (up_dots as f64 - 1.0);
    let mut dots = Dots::new(width, height);
    let mut before: Option<(u64, (f64, f64))> = None;
    for row in &capture.rows {
        let value = row.values.get(index).copied().filter(|v| v.is_finite());
        let Some(value) = value else {
            before = None;
            continue;
        };
        let at = (across(capture, row.scan, across_dots), up(value));
        match before {
            Some((scan, last)) if scan + 1 == row.scan => dots.line(last, at),
            _ => dots.line(at, at),
        }
        before = Some((row.scan, at));
    }
    let trigger = across(capture, capture.trigger_scan, across_dots) as usize / 2;
    let zero = (bottom < 0.0 && top > 0.0).then(|| up(0.0) as usize / 4);
    for line in 0..height {
        let label = match line {
            0 => number(top),
            line if line + 1 == height => number(bottom),
            line if zero == Some(line) => "0".into(),
            _ => String::new(),
        };
        let edge = if label.is_empty() { '│' } else { '┤' };
        text += &format!("{label:>GUTTER$} {edge}");
        let drawn = (0..width).map(|column| match dots.cell(column, line) {
            0 if column == trigger => '┊',
            0 if zero == Some(line) => '·',
            0 => ' ',
            bits => char::from_u32(0x2800 + u32::from(bits)).unwrap_or(' '),
        });
        text += drawn.collect::<String>().trim_end();
        text.push('\n');
    }
    text
}

/// Distance of ticks: 1, 2 or 5 times a power of ten, at most so many in the range.
pub(super) fn tick_step(range: f64, most: usize) -> f64 {
    let least = range / most.max(1) as f64;
    let power = libm::pow(10.0, libm::floor(libm::log10(least)));
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power);
    let found = steps.into_iter().find(|step| *step >= least * (1.0 - 1e-9));
    found.unwrap_or(10.0 * power)
}

fn time_axis(capture: &Capture, width: usize) -> String {
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
    let step_ms = tick_step(range_ms, (width / 10).max(2));
    let column = |ms: f64| libm::round((ms - from_ms) / range_ms * (width as f64 - 1.0)) as usize;
    let mut line = vec!['─'; width];
    let mut labels = vec![' '; GUTTER + 2 + width];
    let mut free = 0;
    let first = libm::ceil(from_ms / step_ms - 1e-9) as i64;
    let last = libm::floor(to_ms / step_ms + 1e-9) as i64;
    for tick in first..=last {
        let ms = tick as f64 * step_ms;
        let at = column(ms);
        if let Some(place) = line.get_mut(at) {
            *place = if tick == 0 { '┴' } else { '┬' };
        }
        let mut label = format!("{}", libm::round(ms / size * 1e6) / 1e6).replace('-', "−");
        if tick == last {
            label = format!("{label} {unit}");
        }
        let length = label.chars().count();
        let start = (GUTTER + 2 + at).saturating_sub(length / 2);
        let start = start.min(labels.len().saturating_sub(length));
        if start < free {
            continue;
        }
        for (place, letter) in labels.iter_mut().skip(start).zip(label.chars()) {
            *place = letter;
        }
        free = start + length + 1;
    }
    let line: String = line.into_iter().collect();
    let labels: String = labels.into_iter().collect();
    format!("{:>GUTTER$} └{line}\n{}\n", "", labels.trim_end())
}
