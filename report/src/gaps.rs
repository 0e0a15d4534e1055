//! What a log does not have of its run: at its beginning, between its parts, inside them, at its end.

use serde::Serialize;

use super::evaluation::Evaluation;

/// Scans in a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct ScanRange {
    /// First of them.
    pub first: u64,
    /// Last of them.
    pub last: u64,
}

/// Samples that are missing, as far as anybody can tell.
pub(super) fn samples_lost(evaluation: &Evaluation) -> u64 {
    // Feedback, instruments and each axis' command.
    let of_a_scan = 2 + evaluation.machine.axes.len() as u64;
    let scans = |range: Option<ScanRange>| range.map_or(0, |r| r.last + 1 - r.first);
    // Of the last scan there is the feedback alone.
    let of_end = scans(end_missing(evaluation))
        .checked_sub(1)
        .map_or(0, |whole| whole * of_a_scan + 1);
    scans(beginning_missing(evaluation)) * of_a_scan
        + of_end
        + evaluation.measurements.samples_lost
        + evaluation.windows_lost
}

/// Of a log whose first recorder left nothing.
fn beginning_missing(evaluation: &Evaluation) -> Option<ScanRange> {
    let first = evaluation.info.begins_at();
    let (first_part, others) = evaluation.parts.split_first()?;
    let of_others = others.iter().find_map(|part| part.first_scan)?;
    let missing = first_part.first_scan.is_none() && of_others > first;
    missing.then(|| ScanRange {
        first,
        last: of_others - 1,
    })
}

/// Of a log whose recorder was killed shortly before the end of the run.
fn end_missing(evaluation: &Evaluation) -> Option<ScanRange> {
    let last = evaluation.ended.as_ref()?.scan;
    let reached = evaluation.parts.iter().filter_map(|part| part.last_scan);
    let first = reached
        .max()
        .map_or(evaluation.info.begins_at(), |scan| scan + 1);
    (first <= last).then_some(ScanRange { first, last })
}

/// Gaps that the measurement saw, and those between parts: over a restart of the master it could not tell that the scans
/// between had been; and what is missing at both ends.
pub(super) fn missing_scans(evaluation: &Evaluation) -> Vec<ScanRange> {
    let seen = evaluation.measurements.missing_scans.iter();
    let mut missing: Vec<ScanRange> = seen
        .map(|&(first, last)| ScanRange { first, last })
        .collect();
    missing.extend(beginning_missing(evaluation));
    missing.extend(end_missing(evaluation));
    let mut reached: Option<u64> = None;
    for part in &evaluation.parts {
        if let (Some(last), Some(first)) = (reached, part.first_scan)
            && first > last + 1
        {
            missing.push(ScanRange {
                first: last + 1,
                last: first - 1,
            });
        }
        reached = reached.max(part.last_scan);
    }
    missing.sort_unstable();
    missing.dedup();
    missing
}
