//! Where the contour error was largest: place, line of the program and the text of that line.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::path::Path;

use bus::files::open_to_read;
use serde::Serialize;

use super::evaluation::{Evaluation, program_file};
use super::rounded::r3;

/// Peaks that are named.
const PEAKS_MAX: usize = 5;
/// Bytes of a line of the program that are looked at.
const LINE_MAX: usize = 400;

/// One of the greatest contour errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PeakReport {
    /// How far the table was from the programmed path.
    pub contour_error_um: f64,
    /// Scan.
    pub scan: u64,
    /// Line of the program that the command was in; null where there was none.
    pub block: Option<u32>,
    /// What stands on that line.
    pub text: String,
    /// Where the tool was, by coordinate, of slides in mm.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub position_mm: BTreeMap<String, f64>,
    /// The same of rotary axes, in degrees.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub position_deg: BTreeMap<String, f64>,
}

impl PeakReport {
    /// Where it was, in words.
    pub(super) fn place(&self) -> String {
        let all = self.position_mm.iter().chain(&self.position_deg);
        let all = all.map(|(name, value)| format!("{name}{value:.3}"));
        all.collect::<Vec<_>>().join(" ")
    }
}

/// The greatest contour errors, the largest first.
pub(super) fn contour_peaks(run: &Evaluation) -> Vec<PeakReport> {
    let peaks = run.measurements.travelled.peaks(PEAKS_MAX);
    let lines: BTreeSet<u32> = peaks.iter().map(|peak| peak.error.line).collect();
    let texts = block_texts(run, &lines);
    let position = |tool_mm: &path::geometry::AxisVector, unit: &str| {
        let axes = 0..run.machine.program_axes().len();
        let of_unit = axes.filter(|axis| run.coordinate_unit(*axis) == unit);
        let each = of_unit.map(|axis| {
            let value = tool_mm.get(axis).copied().unwrap_or(0.0);
            (run.coordinate(axis), r3(value))
        });
        each.collect::<BTreeMap<_, _>>()
    };
    let peaks = peaks.iter();
    peaks
        .map(|peak| PeakReport {
            contour_error_um: r3(peak.error.mm * 1e3),
            scan: peak.error.scan,
            block: Some(peak.error.line).filter(|line| *line > 0),
            text: texts.get(&peak.error.line).cloned().unwrap_or_default(),
            position_mm: position(&peak.tool_mm, "mm"),
            position_deg: position(&peak.tool_mm, "deg"),
        })
        .collect()
}

/// Texts of lines of the program in the run directory; nothing where it cannot be read, or is not the one that ran.
fn block_texts(run: &Evaluation, lines: &BTreeSet<u32>) -> BTreeMap<u32, String> {
    if run.program_matches != Some(true) {
        return BTreeMap::new();
    }
    let file = program_file(&run.run_dir, &run.info).ok();
    let texts = file.and_then(|file| texts_in(&file, lines).ok());
    texts.unwrap_or_default()
}

/// Lines are counted from 1.
fn texts_in(file: &Path, lines: &BTreeSet<u32>) -> std::io::Result<BTreeMap<u32, String>> {
    let mut texts = BTreeMap::new();
    let Some(last) = lines.last() else {
        return Ok(texts);
    };
    let mut reader = BufReader::new(open_to_read(file)?);
    let mut bytes = Vec::new();
    for line in 1..=*last {
        bytes.clear();
        if reader.read_until(b'\n', &mut bytes)? == 0 {
            break;
        }
        if lines.contains(&line) {
            let start = bytes.get(..LINE_MAX).unwrap_or(&bytes);
            let text = String::from_utf8_lossy(start);
            let words: Vec<&str> = text.split_whitespace().collect();
            texts.insert(line, words.join(" "));
        }
    }
    Ok(texts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_of_a_line_has_no_more_space_than_words_need_and_a_line_that_is_not_there_has_none()
    {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("part.ngc");
        std::fs::write(&file, "G21\r\n  G1  X10\tY5 (caf\u{e9})\r\nM2").unwrap();
        let texts = texts_in(&file, &BTreeSet::from([2, 3, 9])).unwrap();
        let expected = [(2, "G1 X10 Y5 (caf\u{e9})".to_string()), (3, "M2".into())];
        assert_eq!(texts, BTreeMap::from(expected));
    }
}
