//! A log with scans missing: what is there is measured as ever, and nothing is invented for what is not.

use std::ops::Range;

use path::geometry::{AxisVector, Element, Feed, Path};

use super::*;
use crate::test_support::{Deviation, SyntheticRun, machine};
use monitor::log::Sample;

const DEVIATION: Deviation = Deviation {
    centre_mm: [0.0012, -0.0007],
    radius_mm: -0.0031,
    bump_mm: [0.0071, 0.0052, 0.0064, 0.0083],
    bump_after_rad: 0.05,
    bump_sigma_rad: 0.017,
    lag_scans: 3.0,
};

fn at(x: f64, y: f64) -> AxisVector {
    let mut point = AxisVector::zeros();
    (point[0], point[1]) = (x, y);
    point
}

/// Three turns on a circle of 25 mm at 3000 mm/min, then a line and another circle: a turn takes 3142 scans.
fn path() -> Path {
    let feed = Feed::PathMmS(50.0);
    let sweep = 6.0 * std::f64::consts::PI;
    let (start, next) = (at(25.0, 0.0), at(25.0, 30.0));
    Path {
        elements: vec![
            Element::line(1, at(28.0, 1.0), start, Feed::Rapid),
            Element::arc(2, start, start, at(0.0, 0.0), [0, 1], sweep, feed),
            Element::line(3, start, next, feed),
            Element::arc(4, next, next, at(15.0, 30.0), [0, 1], sweep / 3.0, feed),
        ],
    }
}

fn scan_of(sample: &Sample) -> u64 {
    match sample {
        Sample::Feedback(sample) => sample.scan,
        Sample::Instruments(sample) => sample.scan,
        Sample::Command(sample) => sample.scan,
        _ => 0,
    }
}

/// The run without the scans of these gaps, as a recorder that dies and one that comes later leave it: of a gap's last scan
/// there are commands and instruments, which become visible in the next.
fn measure(gaps: &[Range<u64>]) -> Measurements {
    let run = SyntheticRun::new(path(), 1, DEVIATION);
    let mut analysis = Analysis::new(machine(&["X", "Y"]), path());
    for sample in run.samples() {
        let scan = scan_of(&sample);
        let is_feedback = matches!(sample, Sample::Feedback(_));
        let lost = gaps.iter().any(|gap| {
            gap.contains(&scan) && (is_feedback || scan + 1 < gap.end)
                || !is_feedback && scan + 1 == gap.start
        });
        if !lost {
            analysis.take(sample);
        }
    }
    analysis.finish()
}

fn measure_without(gap: Range<u64>) -> Measurements {
    measure(std::slice::from_ref(&gap))
}

#[test]
fn a_gap_is_counted_for_every_channel_and_named() {
    let measured = measure_without(900..930);
    assert_eq!(measured.missing_scans, [(900, 929)]);
    // Instruments and commands of scan 899 become visible in 900; those of 929 are there.
    assert_eq!(measured.samples_lost, 30 + 30 + 2 * 30);
    assert!(measured.is_completed());
    assert_eq!(measure(&[]).samples_lost, 0);
    assert_eq!(measure(&[]).missing_scans, []);
}

#[test]
fn commands_that_were_never_made_are_not_lost_in_a_gap() {
    let run = SyntheticRun::new(path(), 1, DEVIATION);
    let mut analysis = Analysis::new(machine(&["X", "Y"]), path());
    for mut sample in run.samples() {
        let scan = scan_of(&sample);
        // Axis Y: ten scans missed before the gap's end; axis X: its servo is dead from scan 905 on.
        match &mut sample {
            Sample::Feedback(feedback) => {
                feedback.axes[1].missed_scans = scan.saturating_sub(910).min(10) as u32;
                if scan > 905 {
                    feedback.axes[0].command_scan = 904;
                }
            }
            Sample::Command(command) if command.axis == 0 && scan >= 905 => continue,
            _ => {}
        }
        if !(900..930).contains(&scan) {
            analysis.take(sample);
        }
    }
    // Of the servo that is dead five commands, of the other twenty.
    assert_eq!(analysis.finish().samples_lost, 30 + 30 + 5 + 20);
}

#[test]
fn an_arc_with_gaps_is_measured_on_what_is_there_and_says_so() {
    let whole = measure(&[]);
    assert_eq!(whole.arcs.len(), 2);
    assert!(whole.arcs.iter().all(|arc| arc.missing_scans == 0));
    // Inside a turn, and over more than a whole one.
    for gap in [1000..1030, 1000..1900, 1000..4500] {
        let missing = gap.end - gap.start;
        let measured = measure_without(gap.clone());
        let words = format!("{gap:?}");
        assert_eq!(measured.arcs.len(), 2, "{words}");
        let (arc, reference) = (&measured.arcs[0], &whole.arcs[0]);
        // One scan behind the gap is left out as long as the compensation in force is unknown.
        assert!(
            (missing..=missing + 2).contains(&arc.missing_scans),
            "{words}: {}",
            arc.missing_scans
        );
        let (fit, expected) = (arc.table.fit, reference.table.fit);
        assert!(
            (fit.radius_error_mm - expected.radius_error_mm).abs() < 5e-5,
            "{words}"
        );
        assert!(
            (fit.centre_mm[0] - expected.centre_mm[0]).abs() < 5e-5,
            "{words}"
        );
        assert!(
            arc.table.circular_um <= reference.table.circular_um + 0.05,
            "{words}"
        );
        assert!(
            arc.motor.circular_um <= reference.motor.circular_um + 0.05,
            "{words}"
        );
        // What is missing and what it takes to be steady again.
        let lost_deg = reference.measured_deg - arc.measured_deg;
        let expected_deg = (missing as f64 + 100.0) * 0.05 / 25.0 * 180.0 / std::f64::consts::PI;
        assert!(
            (lost_deg - expected_deg).abs() < 1.0,
            "{words}: {lost_deg} {expected_deg}"
        );
        // The angle goes on where the path did: behind the gap every quadrant is where it was.
        let last = |arc: &ArcResult| {
            arc.quadrants
                .last()
                .map(|q| (q.axis, (q.angle_rad * 1e6) as i64))
        };
        assert_eq!(last(arc), last(reference), "{words}");
        assert_eq!(measured.arcs[1].missing_scans, 0, "{words}");
    }
    assert_eq!(measure(&[]).contour_error_mm, whole.contour_error_mm);
}

#[test]
fn gaps_at_the_ends_of_an_arc_count_for_the_arc_they_are_on() {
    let whole = measure(&[]);
    let (first, second) = (whole.arcs[0].scans, whole.arcs[1].scans);
    let gap = first.1 as u64 - 400..second.0 as u64 + 300;
    let measured = measure_without(gap);
    let [one, two] = &measured.arcs[..] else {
        panic!("{} arcs", measured.arcs.len());
    };
    let near = |found: u64, expected: u64| found.abs_diff(expected) < 40;
    assert!(near(one.missing_scans, 400), "{}", one.missing_scans);
    assert!(near(two.missing_scans, 300), "{}", two.missing_scans);
    // Its first sample is far from its start, and its quadrants are where they are.
    let axes = |arc: &ArcResult| -> Vec<_> {
        arc.quadrants
            .iter()
            .map(|q| (q.axis, (q.angle_rad * 1e6) as i64))
            .collect()
    };
    let all = axes(&whole.arcs[1]);
    assert!(
        all.ends_with(&axes(two)) && !two.quadrants.is_empty(),
        "{:?}",
        axes(two)
    );
}

#[test]
fn no_reversal_is_seen_across_a_gap_and_none_is_measured_with_one_in_its_window() {
    let whole = measure(&[]);
    let on_arc: Vec<&ReversalResult> = whole.reversals.iter().filter(|r| r.steady).collect();
    let turn = on_arc[2].scan;
    // The reversal itself is missing; or only a part of its window, before or behind it.
    for (gap, seen) in [
        (turn - 5..turn + 5, false),
        (turn - 300..turn + 300, false),
        (turn + 10..turn + 14, true),
        (turn - 8..turn - 4, true),
    ] {
        let measured = measure_without(gap.clone());
        let words = format!("turn {turn}, gap {gap:?}");
        let mut left: Vec<&ReversalResult> = measured.reversals.iter().collect();
        for expected in &whole.reversals {
            let found = left
                .iter()
                .position(|r| (r.index, r.scan) == (expected.index, expected.scan));
            if expected.scan == turn && expected.axis == on_arc[2].axis {
                assert_eq!(found.is_some(), seen, "{words}");
            }
            let Some(found) = found.map(|found| left.remove(found)) else {
                continue;
            };
            if expected.scan == turn {
                assert_eq!(found.protrusion_um, None, "{words}");
            } else if let (Some(found), Some(expected)) =
                (found.protrusion_um, expected.protrusion_um)
            {
                assert!(
                    (found - expected).abs() < 0.05,
                    "{words}: {found} {expected}"
                );
            }
        }
        assert!(left.is_empty(), "{words}: invented {left:?}");
    }
}

#[test]
fn a_gap_invents_no_error_and_exceeds_no_limit() {
    let whole = measure(&[]);
    for gap in [700..703, 1000..4500, 9400..9900] {
        let measured = measure_without(gap.clone());
        assert_eq!(measured.limits, LimitCounts::default(), "{gap:?}");
        assert!(measured.contour_error_mm.peak <= whole.contour_error_mm.peak);
        for (found, expected) in measured.axes.iter().zip(&whole.axes) {
            assert!(found.following_error_mm.peak <= expected.following_error_mm.peak);
        }
    }
}

#[test]
fn a_pulse_that_already_runs_behind_a_gap_has_no_known_beginning() {
    let whole = measure(&[]);
    let on_arc: Vec<&ReversalResult> = whole.reversals.iter().filter(|r| r.steady).collect();
    let (axis, turn) = (on_arc[2].index, on_arc[2].scan);
    assert!(on_arc[2].kick_lead_ms.is_some());
    // It began four scans before its reversal.
    let measured = measure_without(turn - 20..turn - 3);
    let found = measured
        .reversals
        .iter()
        .find(|r| (r.index, r.scan) == (axis, turn));
    assert_eq!(found.map(|r| r.kick_lead_ms), Some(None));
}
