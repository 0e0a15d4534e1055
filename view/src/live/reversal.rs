//! What an axis left on the table where it reversed, as far as somebody who looks on can tell.
//!
//! On an arc: the largest radial deviation of the table from 6 ms (at least 2°, at most 12°) before the reversal to 50 ms (8° to
//! 40°) after it, less the mean of the stretch before it. That is the window of the report (docs/methods/physics.md §5); the report
//! takes the deviation from a circle that is fitted to the whole run, which is not known while it runs. Elsewhere only the
//! following error around the reversal is known.

use std::collections::VecDeque;

use remote::state::ReversalState;
use report::turns::{WINDOW_S, window_rad};

use super::axis::Turn;
use super::track::{KEPT_SCANS, Track};

/// Reversals that are kept.
const KEPT: usize = 32;
/// Reversals whose window is not over yet, at most.
const OPEN_MAX: usize = 64;
/// Instruments and commands of a scan come after its feedback.
const LATE_SCANS: u64 = 4;

#[derive(Debug, Clone, Copy)]
struct Open {
    axis: usize,
    turn: Turn,
    before: u64,
    after: u64,
    on_arc: bool,
}

/// The reversals of all axes.
#[derive(Debug, Default)]
pub struct Reversals {
    /// The last ones, newest last.
    pub last: VecDeque<ReversalState>,
    /// Seen since this observer came.
    pub count: u64,
    open: VecDeque<Open>,
}

impl Reversals {
    /// An axis has reversed; on an arc that is travelled at `angular_rad_s`.
    pub fn begin(&mut self, axis: usize, turn: Turn, angular_rad_s: Option<f64>, period_s: f64) {
        let (before_s, after_s) = match angular_rad_s.filter(|speed| *speed > 0.0) {
            Some(speed) => {
                let (before_rad, after_rad) = window_rad(speed);
                (before_rad / speed, after_rad / speed)
            }
            None => WINDOW_S,
        };
        let scans = |time_s: f64| (libm::ceil(time_s / period_s) as u64).max(1);
        if self.open.len() == OPEN_MAX {
            self.open.pop_front();
        }
        self.open.push_back(Open {
            axis,
            turn,
            before: scans(before_s),
            after: scans(after_s),
            on_arc: angular_rad_s.is_some(),
        });
    }

    /// Measures those whose window is over in scan `now`.
    pub fn measure(&mut self, now: u64, track: &Track) {
        let over = |open: &Open| now >= open.turn.scan + open.after + LATE_SCANS;
        for open in self.open.iter().filter(|open| over(open)) {
            if self.last.len() == KEPT {
                self.last.pop_front();
            }
            self.last.push_back(measured(open, track));
            self.count += 1;
        }
        self.open.retain(|open| !over(open));
    }
}

fn measured(open: &Open, track: &Track) -> ReversalState {
    let first = open.turn.scan.saturating_sub(open.before);
    let last = open.turn.scan + open.after;
    let error_peak_um = track
        .range(first, last)
        .flatten()
        .filter_map(|note| note.error_um.get(open.axis))
        .filter(|error_um| error_um.is_finite())
        .fold(0.0f64, |peak, error_um| peak.max(error_um.abs()));
    let fits = open.before + 2 * open.after < KEPT_SCANS;
    let heights = (open.on_arc && fits)
        .then(|| heights_um(track, first, last, open.after))
        .flatten();
    ReversalState {
        axis: open.axis as u32,
        direction: open.turn.direction,
        scan: open.turn.scan,
        height_um: heights.map(|(height_um, _)| height_um),
        undercut_um: heights.map(|(_, undercut_um)| undercut_um),
        error_peak_um,
    }
}

/// Highest and lowest in the window over the mean before it; none if a scan of it was not seen.
fn heights_um(track: &Track, first: u64, last: u64, base: u64) -> Option<(f64, f64)> {
    let radial = |note: Option<&super::track::Note>| {
        note.map(|note| note.radial_um).filter(|um| um.is_finite())
    };
    let from = first.checked_sub(base)?;
    let mut sum_um = 0.0;
    for note in track.range(from, first) {
        sum_um += radial(note)?;
    }
    let base_um = sum_um / base as f64;
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for note in track.range(first, last) {
        let um = radial(note)? - base_um;
        (low, high) = (low.min(um), high.max(um));
    }
    Some((high, low))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::sample::PathTag;

    /// Radial deviation 3 µm everywhere, a bump of 5 µm 20 scans after scan 1000.
    fn track(missing: Option<u64>) -> Track {
        let mut track = Track::default();
        for scan in 500..1500u64 {
            track.begin(scan, PathTag::default());
            let note = track.of_mut(scan).expect("just started");
            note.error_um[1] = if scan == 1010 { -7.0 } else { 1.0 };
            if Some(scan) != missing {
                let distance = (scan as f64 - 1020.0) / 8.0;
                note.radial_um = 3.0 + 5.0 * libm::exp(-distance * distance);
            }
        }
        track
    }

    fn measured_with(missing: Option<u64>, angular_rad_s: Option<f64>) -> Option<ReversalState> {
        let mut reversals = Reversals::default();
        let turn = Turn {
            scan: 1000,
            direction: -1,
        };
        reversals.begin(1, turn, angular_rad_s, 1e-3);
        reversals.measure(1400, &track(missing));
        reversals.last.back().copied()
    }

    #[test]
    fn the_height_of_a_reversal_is_over_the_arc_before_it() {
        let reversal = measured_with(None, Some(2.0)).expect("one");
        assert!((reversal.height_um.expect("a height") - 5.0).abs() < 1e-6);
        assert!(reversal.undercut_um.expect("a depth").abs() < 1e-6);
        assert_eq!(reversal.error_peak_um, 7.0);
    }

    #[test]
    fn where_a_scan_was_not_seen_or_no_arc_is_there_is_no_height_but_a_following_error() {
        for (missing, speed) in [
            (Some(1030), Some(2.0)),
            (Some(950), Some(2.0)),
            (None, None),
        ] {
            let reversal = measured_with(missing, speed).expect("one");
            assert_eq!(reversal.height_um, None, "{missing:?}");
            assert_eq!(reversal.error_peak_um, 7.0);
        }
    }

    #[test]
    fn nothing_is_measured_before_its_window_is_over() {
        let mut reversals = Reversals::default();
        let turn = Turn {
            scan: 1000,
            direction: 1,
        };
        reversals.begin(0, turn, Some(2.0), 1e-3);
        reversals.measure(1060, &track(None));
        assert!(reversals.last.is_empty());
        reversals.measure(1080, &track(None));
        assert_eq!(reversals.count, 1);
    }
}
