//! A capture as a table: one row per scan, units at the end of the names, nothing where nothing is known.

use std::fmt::Write as _;

use super::Capture;
use console::output::joined;

/// The first line.
pub fn header(capture: &Capture) -> String {
    let columns = capture.signals.iter().map(|signal| signal.column());
    format!("capture,scan,time_ms,{}\n", joined(columns, ","))
}

/// One line per scan; time 0 is the trigger. Numbers are written so that reading them gives the same number again.
pub fn rows(capture: &Capture) -> String {
    let mut text = String::new();
    for row in &capture.rows {
        let _ = write!(
            text,
            "{},{},{}",
            capture.number,
            row.scan,
            // The product of a whole number and the period in ms has no digit behind the µs.
            libm::round(capture.time_ms(row.scan) * 1e3) / 1e3
        );
        for value in &row.values {
            text.push(',');
            if value.is_finite() {
                let _ = write!(text, "{value}");
            }
        }
        text.push('\n');
    }
    text
}
