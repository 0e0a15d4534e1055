use proptest::prelude::*;

use super::*;
use loops::path_correction::{Knot, PathCorrection};

fn vector(x: f64) -> AxisVector {
    let mut vector = AxisVector::zeros();
    vector[0] = x;
    vector
}

/// Scans of 1 ms at 40 mm/s whose axis swings, with this error and correction over time in s.
fn pass(error_mm: impl Fn(f64) -> f64, correction_mm: impl Fn(f64) -> f64) -> Pass {
    let scans = (0..2000).map(|index| {
        let time_s = f64::from(index) * 1e-3;
        PassScan {
            place_mm: 40.0 * time_s,
            feeds: true,
            command_mm: vector(libm::sin(10.0 * time_s)),
            error_mm: vector(error_mm(time_s)),
            behind_mm: 0.08,
            correction_mm: vector(correction_mm(time_s)),
        }
    });
    Pass::new(1e-3, 1, scans.collect())
}

fn correction_of(knots: &[PathKnot]) -> PathCorrection {
    let knot = |of: &PathKnot| Knot {
        place_mm: of.place_mm,
        speed_mm_s: of.speed_mm_s,
        correction_mm: of.correction_mm[0],
    };
    PathCorrection::new(1, vec![(0, 0.0)], knots.iter().map(knot).collect())
}

/// A bump of 4 µm that lasts some hundredths of a second.
fn bump(time_s: f64) -> f64 {
    let off = (time_s - 1.0) / 0.02;
    0.004 * libm::exp(-off * off)
}

#[test]
fn an_error_is_taken_over_by_the_gain_where_the_tool_was_sent_when_it_made_it() {
    // The tool is 2 ms behind its command.
    let learned = pass(|t| bump(t - 0.002), |_| 0.0);
    assert!((learned.lag_s() - 0.002).abs() < 1e-9);
    let knots = learned.learned(GAIN, CORNER_HZ);
    let found = correction_of(&knots);
    for time_s in [0.95, 0.98, 1.0, 1.03] {
        let (is, wanted) = (found.value_mm(40.0 * time_s, 40.0), GAIN * bump(time_s));
        assert!((is - wanted).abs() < 4e-5, "{time_s} s: {is} {wanted}");
    }
    assert!(knots.len() < 300, "{} knots", knots.len());
}

#[test]
fn passes_of_an_axis_that_follows_late_and_weakly_get_better_one_after_the_other() {
    // The error follows the correction 2 ms late, by 0.8 of it.
    let mut correction = PathCorrection::default();
    let mut before = f64::INFINITY;
    for number in 0..8 {
        let now = correction.clone();
        let of = |t: f64| now.value_mm(40.0 * t, 40.0);
        let pass = pass(|t| bump(t - 0.002) - 0.8 * of(t - 0.002), of);
        let rms_um = pass.error().rms_um;
        assert!(
            rms_um < before || rms_um < 0.01,
            "pass {number}: {rms_um} after {before}"
        );
        before = rms_um;
        correction = correction_of(&pass.learned(GAIN, CORNER_HZ));
    }
    assert!(before < 0.02, "{before} µm");
}

#[test]
fn corrections_fade_to_nothing_at_rests_and_rapids_and_are_bounded() {
    let mut at_rest = pass(|_| 1.0, |_| 0.0);
    for scan in &mut at_rest.scans[500..600] {
        scan.feeds = false;
    }
    // From here on the tool stands.
    for scan in &mut at_rest.scans[1500..] {
        scan.place_mm = 60.0;
    }
    let knots = at_rest.learned(GAIN, CORNER_HZ);
    let found = correction_of(&knots);
    for place_mm in [0.0, 20.0, 22.0, 23.9, 60.0] {
        let value_mm = found.value_mm(place_mm, 40.0);
        assert!(value_mm.abs() <= THINNED_MM, "{value_mm} at {place_mm} mm");
    }
    assert!((found.value_mm(10.0, 40.0) - CORRECTION_MAX_MM).abs() < 1e-9);
    assert!(
        knots
            .iter()
            .all(|knot| knot.correction_mm.amax() <= CORRECTION_MAX_MM)
    );
    assert!(knots.is_sorted_by(|a, b| a.place_mm < b.place_mm));
}

#[test]
fn a_pass_is_measured_at_its_reversals_and_by_all_of_it_where_there_are_none() {
    // The axis turns round at 0.157 s and each 0.314 s from there; it is off at the first only.
    let off = |t: f64| if (0.15..0.2).contains(&t) { 0.006 } else { 0.0 };
    let error = pass(off, |_| 0.0).error();
    assert!((error.worst_um - 6.0).abs() < 1e-9, "{error:?}");
    assert!((error.mean_um - 1.0).abs() < 1e-9, "{error:?}");
    let mut straight = pass(|_| 0.002, |_| 0.0);
    for scan in &mut straight.scans {
        scan.command_mm = vector(scan.place_mm);
    }
    let error = straight.error();
    assert!((error.mean_um - error.rms_um).abs() < 1e-12 && (error.worst_um - 2.0).abs() < 1e-9);
}

#[test]
fn errors_that_are_no_numbers_teach_nothing() {
    let knots = pass(|_| f64::NAN, |_| 0.0).learned(GAIN, CORNER_HZ);
    assert!(knots.iter().all(|knot| knot.correction_mm.amax() == 0.0));
}

proptest! {
    #[test]
    fn a_thinned_correction_is_nowhere_off_by_more_than_its_bound(steps in proptest::collection::vec((0.001..0.2f64, -3e-5..3e-5f64), 2..300)) {
        let (mut place_mm, mut correction_mm) = (0.0, 0.0);
        let all: Vec<PathKnot> = steps.iter().map(|(step_mm, change_mm)| {
            place_mm += step_mm;
            correction_mm += change_mm;
            PathKnot { place_mm, speed_mm_s: 40.0, correction_mm: vector(correction_mm) }
        }).collect();
        let of = correction_of(&thinned(all.clone()));
        for knot in &all[..all.len() - 1] {
            let is = of.value_mm(knot.place_mm, 40.0);
            prop_assert!((is - knot.correction_mm[0]).abs() <= THINNED_MM * 1.0001, "{} {is}", knot.correction_mm[0]);
        }
    }
}
