//! Synthetic tables with known errors: what was put in must be measured.

use std::f64::consts::PI;

use bus::sample::*;
use path::geometry::{AxisVector, Element, Feed, Path};

use super::*;
use crate::test_support::{Deviation, PULSE_LEAD_SCANS, SyntheticRun, machine};

fn at(x: f64, y: f64) -> AxisVector {
    let mut point = AxisVector::zeros();
    (point[0], point[1]) = (x, y);
    point
}

/// An approach along a line and then an arc: centre, radius, start angle and signed sweep in degrees, feed in mm/min.
fn arc_path(centre: [f64; 2], radius: f64, start_deg: f64, sweep_deg: f64, feed: f64) -> Path {
    let on = |deg: f64| {
        let a = deg.to_radians();
        at(
            centre[0] + radius * libm::cos(a),
            centre[1] + radius * libm::sin(a),
        )
    };
    let feed = Feed::PathMmS(feed / 60.0);
    let start = on(start_deg);
    let (from, to) = (start + at(3.0, 1.0), on(start_deg + sweep_deg));
    let centre = at(centre[0], centre[1]);
    Path {
        elements: vec![
            Element::line(4, from, start, Feed::Rapid),
            Element::arc(5, start, to, centre, [0, 1], sweep_deg.to_radians(), feed),
        ],
    }
}

fn measure(path: &Path, deviation: Deviation) -> Measurements {
    let run = SyntheticRun::new(path.clone(), 1, deviation);
    let mut analysis = Analysis::new(machine(&["X", "Y"]), path.clone());
    run.samples().for_each(|sample| analysis.take(sample));
    analysis.finish()
}

const QUIET: Deviation = Deviation {
    centre_mm: [0.0, 0.0],
    radius_mm: 0.0,
    bump_mm: [0.0; 4],
    bump_after_rad: 0.05,
    bump_sigma_rad: 0.017,
    lag_scans: 0.0,
};

#[test]
#[expect(clippy::too_many_lines, reason = "one grid, judged case by case")]
fn centre_radius_and_protrusions_are_measured_apart_within_a_tenth_of_a_micrometre() {
    // Radius in mm, feed in mm/min, bump's centre and width in degrees: inside the window of that speed.
    let grid = [
        (25.0, 3000.0, 3.0, 0.9),
        (100.0, 1000.0, 3.0, 0.9),
        (10.0, 10000.0, 14.0, 3.5),
        (50.0, 10000.0, 4.0, 1.0),
    ];
    let mut case = 0;
    for (radius, feed, after_deg, sigma_deg) in grid {
        for clockwise in [false, true] {
            for start_deg in [30.0, 200.0] {
                case += 1;
                let sweep = if clockwise { -720.0 } else { 720.0 };
                let path = arc_path([12.5, -40.0], radius, start_deg, sweep, feed);
                let deviation = Deviation {
                    centre_mm: [0.0073, -0.0041],
                    radius_mm: 0.0182,
                    bump_mm: [0.0243, 0.0081, 0.0017, 0.0356],
                    bump_after_rad: f64::to_radians(after_deg),
                    bump_sigma_rad: f64::to_radians(sigma_deg),
                    lag_scans: 3.0,
                };
                let measured = measure(&path, deviation);
                let words =
                    format!("case {case}: R{radius} F{feed} cw {clockwise} from {start_deg}°");
                let [arc] = &measured.arcs[..] else {
                    panic!("{words}: {} arcs", measured.arcs.len());
                };
                let fit = arc.table.fit;
                assert!((fit.centre_mm[0] - 0.0073).abs() < 1e-4, "{words}: {fit:?}");
                assert!((fit.centre_mm[1] + 0.0041).abs() < 1e-4, "{words}: {fit:?}");
                assert!(
                    (fit.radius_error_mm - 0.0182).abs() < 1e-4,
                    "{words}: {fit:?}"
                );
                assert!(
                    (arc.table.circular_um - 35.6).abs() < 0.1,
                    "{words}: {:?}",
                    arc.table
                );
                assert!(
                    (arc.table.radial_um.0 - 53.8).abs() < 0.15,
                    "{words}: {:?}",
                    arc.table
                );
                let steady: Vec<_> = measured
                    .reversals
                    .iter()
                    .filter(|reversal| reversal.steady)
                    .collect();
                assert!(steady.len() >= 4, "{words}: {:?}", measured.reversals);
                for reversal in &steady {
                    // Axis X turns at 0° (then goes −) and 180°, Y at 90° and 270°.
                    let quadrant = match (reversal.index, reversal.new_direction) {
                        (0, -1) => 0,
                        (1, -1) => 1,
                        (0, _) => 2,
                        _ => 3,
                    };
                    let expected = deviation.bump_mm[quadrant] * 1e3;
                    let found = reversal.protrusion_um.unwrap();
                    assert!(
                        (found - expected).abs() < 0.1,
                        "{words}: {found} for {expected}"
                    );
                    assert!(reversal.undercut_um.unwrap().abs() < 0.1, "{words}");
                    assert_eq!(reversal.block, Some(5));
                    let width_ms = reversal.width_half_height_ms.unwrap();
                    let angular_speed = feed / 60.0 / radius;
                    let expected_ms = 2.3548 * sigma_deg.to_radians() / angular_speed * 1e3;
                    assert!(
                        (width_ms - expected_ms).abs() < 0.6,
                        "{words}: {width_ms} {expected_ms}"
                    );
                    let lead_ms = reversal.kick_lead_ms.unwrap();
                    assert!(
                        (lead_ms - PULSE_LEAD_SCANS as f64).abs() <= 1.0,
                        "{words}: {lead_ms}"
                    );
                }
                // Motor side: the same plus 2 µm of backlash compensation, which is taken off again.
                let difference = arc.motor.fit.radius_error_mm - fit.radius_error_mm;
                assert!(difference.abs() < 1e-6, "{words}: {difference}");
                let difference = arc.motor.circular_um - arc.table.circular_um;
                assert!(difference.abs() < 0.01, "{words}: {difference}");
            }
        }
    }
}

#[test]
fn an_undercut_is_not_taken_for_a_protrusion() {
    let deviation = Deviation {
        bump_mm: [-0.0062; 4],
        ..QUIET
    };
    let measured = measure(&arc_path([0.0, 0.0], 25.0, 45.0, 500.0, 3000.0), deviation);
    let on_arc = measured.reversals.iter().filter(|r| r.steady);
    let mut count = 0;
    for reversal in on_arc {
        count += 1;
        assert!((reversal.undercut_um.unwrap() + 6.2).abs() < 0.1);
        assert!(reversal.protrusion_um.unwrap().abs() < 0.1);
        assert_eq!(reversal.width_half_height_ms, None);
    }
    assert!(count >= 4);
}

#[test]
fn a_full_circle_from_a_quadrant_shows_its_other_three_reversals() {
    let deviation = Deviation {
        bump_mm: [0.005, 0.010, 0.015, 0.020],
        ..QUIET
    };
    let measured = measure(&arc_path([0.0, 0.0], 25.0, 0.0, 360.0, 3000.0), deviation);
    let protrusions: Vec<i64> = measured
        .reversals
        .iter()
        .filter(|reversal| reversal.steady)
        .map(|reversal| (reversal.protrusion_um.unwrap() * 10.0).round() as i64)
        .collect();
    assert_eq!(protrusions, [100, 150, 200]);
    // Where the window is not wholly on the arc nothing is published.
    let outside = measured
        .reversals
        .iter()
        .filter(|reversal| !reversal.steady);
    assert!(outside.clone().count() > 0);
    assert!(
        outside
            .clone()
            .all(|reversal| reversal.protrusion_um.is_none())
    );
}

#[test]
fn contour_error_on_an_arc_is_the_radial_deviation_and_lag_is_none() {
    let deviation = Deviation {
        radius_mm: 0.004,
        lag_scans: 20.0,
        ..QUIET
    };
    let measured = measure(&arc_path([0.0, 0.0], 25.0, 45.0, 180.0, 3000.0), deviation);
    assert!((measured.contour_error_mm.peak - 0.004).abs() < 1e-5);
    let following = &measured.axes[0].following_error_mm;
    assert!(following.peak > 0.9, "{following:?}");
}

#[test]
fn consecutive_elements_of_one_circle_are_one_run_and_other_circles_are_not() {
    let feed = Feed::PathMmS(50.0);
    let on = |radius: f64, deg: f64| {
        at(
            radius * libm::cos(deg.to_radians()),
            radius * libm::sin(deg.to_radians()),
        )
    };
    let arc = |line, radius, from, to| {
        Element::arc(
            line,
            on(radius, from),
            on(radius, to),
            at(0.0, 0.0),
            [0, 1],
            (to - from) * PI / 180.0,
            feed,
        )
    };
    let path = Path {
        elements: vec![
            arc(1, 25.0, 0.0, 90.0),
            arc(2, 25.0, 90.0, 270.0),
            Element::line(3, on(25.0, 270.0), on(20.0, 270.0), feed),
            arc(4, 20.0, 270.0, 0.0),
        ],
    };
    let measured = measure(&path, QUIET);
    let runs: Vec<_> = measured
        .arcs
        .iter()
        .map(|arc| (arc.line, arc.elements, arc.circle.clockwise))
        .collect();
    assert_eq!(runs, [(1, (0, 1), false), (4, (3, 3), true)]);
    assert!((measured.arcs[0].turns - 270.0 / 360.0).abs() < 1e-12);
}

#[test]
fn measurements_do_not_depend_on_how_channels_are_interleaved() {
    let deviation = Deviation {
        bump_mm: [0.01; 4],
        ..QUIET
    };
    let path = arc_path([0.0, 0.0], 25.0, 45.0, 360.0, 3000.0);
    let run = SyntheticRun::new(path.clone(), 1, deviation);
    let channel = |sample: &Sample| match sample {
        Sample::Feedback(_) => 0,
        Sample::Instruments(_) => 1,
        Sample::Command(command) => 2 + command.axis,
        _ => 9,
    };
    let samples: Vec<Sample> = run.samples().collect();
    let result = |samples: &[Sample]| {
        let mut analysis = Analysis::new(machine(&["X", "Y"]), path.clone());
        samples
            .iter()
            .for_each(|sample| analysis.take(sample.clone()));
        format!("{:?}", analysis.finish())
    };
    let reference = result(&samples);
    let mut batches = samples.clone();
    batches
        .chunks_mut(400)
        .for_each(|batch| batch.sort_by_key(channel));
    assert_eq!(result(&batches), reference);
    batches = samples.clone();
    batches
        .chunks_mut(360)
        .for_each(|batch| batch.sort_by_key(|s| 9 - channel(s)));
    assert_eq!(result(&batches), reference);
}

#[test]
fn missing_samples_are_counted_and_the_rest_is_measured() {
    let path = arc_path([0.0, 0.0], 25.0, 45.0, 90.0, 3000.0);
    let run = SyntheticRun::new(path.clone(), 1, QUIET);
    let mut analysis = Analysis::new(machine(&["X", "Y"]), path.clone());
    // What belongs to the last scan becomes visible after it: it is no loss.
    let last = run.scans() - 1;
    for sample in run.samples() {
        let lost = match &sample {
            Sample::Feedback(sample) => (200..203).contains(&sample.scan),
            Sample::Instruments(sample) => {
                (200..203).contains(&sample.scan) || [250, last].contains(&sample.scan)
            }
            Sample::Command(sample) if sample.scan == last => true,
            Sample::Command(sample) => (sample.scan, sample.axis) == (300, 1),
            _ => false,
        };
        if !lost {
            analysis.take(sample);
        }
    }
    let measured = analysis.finish();
    // Feedback and instruments of three scans, instruments of one, one command.
    assert_eq!(measured.samples_lost, 3 + 3 + 1 + 1);
    assert_eq!(measured.missing_scans, [(200, 202)]);
    assert!(measured.is_completed());
}

#[test]
fn no_limit_is_exceeded_by_rounding_and_every_true_excess_is_counted() {
    let measured = measure(&arc_path([0.0, 0.0], 25.0, 45.0, 90.0, 3000.0), QUIET);
    assert_eq!(measured.limits, LimitCounts::default());
    let machine = machine(&["X", "Y"]);
    let mut audit = LimitsAudit::new(&machine);
    let mut feedback: Feedback = bytemuck::Zeroable::zeroed();
    feedback.mode = Mode::Enabled as u32;
    feedback.axis_count = 2;
    feedback.window.sequence = 1;
    // 500 mm/s is 500 000 increments a scan, 5000 mm/s² a change of 5000; the travel ends at 300 mm.
    for (scan, position) in [0, 5_002, 15_006, 15_006, 299_990_000, 300_000_002]
        .into_iter()
        .enumerate()
    {
        feedback.scan = scan as u64;
        feedback.axes[0].command_position = position;
        audit.take(&feedback);
    }
    let expected = LimitCounts {
        velocity: 1,
        acceleration: 3,
        jerk: 0,
        travel: 1,
    };
    assert_eq!(audit.counts, expected);
}

#[test]
fn jerk_is_judged_where_it_is_limited() {
    let mut machine = machine(&["X"]);
    let judged = |machine: &machine::Machine| {
        let mut audit = LimitsAudit::new(machine);
        let mut feedback: Feedback = bytemuck::Zeroable::zeroed();
        feedback.mode = Mode::Enabled as u32;
        feedback.axis_count = 1;
        feedback.window.sequence = 1;
        // From rest to 1,000 mm/s² in one scan of 1 ms, and back: 1,000,000 mm/s³ twice.
        let ways = [0, 0, 0, 1_000, 2_000, 3_000, 3_000, 3_000, 3_000];
        let mut position = 0;
        for (way, scan) in ways.into_iter().zip(1..) {
            position += way;
            feedback.scan = scan;
            feedback.axes[0].command_position = position;
            audit.take(&feedback);
        }
        audit.counts.jerk
    };
    assert_eq!(judged(&machine), 0);
    machine.axes[0].jerk_mm_s3 = Some(1_000_000.0);
    assert_eq!(judged(&machine), 0);
    machine.axes[0].jerk_mm_s3 = Some(990_000.0);
    assert_eq!(judged(&machine), 2);
}

#[test]
fn setpoints_that_are_split_evenly_are_judged_on_the_means_of_their_periods() {
    let mut machine = machine(&["X", "Y"]);
    let judged = |machine: &machine::Machine, acceleration_mm_s2: f64| {
        let mut audit = LimitsAudit::new(machine);
        let mut feedback: Feedback = bytemuck::Zeroable::zeroed();
        feedback.mode = Mode::Enabled as u32;
        feedback.axis_count = 2;
        feedback.window.sequence = 1;
        for scan in 1..80u64 {
            // Periods of 8 scans end in the command position of their successor's first; straight lines between the ends.
            let end = |period: u64| {
                let t_s = period as f64 * 8e-3;
                0.5 * acceleration_mm_s2 * t_s * t_s * 1e6
            };
            let (period, part) = (scan / 8, (scan % 8) as f64 / 8.0);
            let position = end(period) + part * (end(period + 1) - end(period));
            feedback.scan = scan;
            feedback.axes[0].command_position = libm::round(position) as i64;
            audit.take(&feedback);
        }
        audit.counts.acceleration
    };
    // As rows of their own they step by eight times the limit at every boundary.
    assert_eq!(judged(&machine, 4_990.0), 9);
    machine.interpolation.within_period = machine::WithinPeriod::Linear;
    assert_eq!(judged(&machine, 4_990.0), 0);
    assert_eq!(judged(&machine, 5_010.0), 7);
}

#[test]
fn how_a_run_ended_is_what_its_last_feedback_says_of_it() {
    let mut feedback: Feedback = bytemuck::Zeroable::zeroed();
    let told = |feedback: &Feedback| ended(&machine(&["X", "Y"]), Some(feedback));
    feedback.run = 3;
    assert_eq!(told(&feedback), None, "it goes on");
    feedback.ended = EndedRun {
        scan: 700,
        run: 3,
        outcome: RunOutcome::Stopped as u32,
        mode: Mode::Tripped as u32,
        cause: Cause::FollowingError as u32,
        cause_axis: 1,
        ..EndedRun::default()
    };
    let tripped = told(&feedback).unwrap();
    assert_eq!((tripped.run, tripped.scan), (3, 700));
    assert_eq!(tripped.outcome, RunOutcome::Stopped);
    assert_eq!(tripped.text, "axis Y: following error beyond its limit");
    assert!(tripped.is_whole());
    // Of the run before.
    feedback.run = 4;
    assert_eq!(told(&feedback), None);
    feedback.ended = EndedRun {
        run: 4,
        outcome: RunOutcome::Interrupted as u32,
        order: Order::Reset as u32,
        ..EndedRun::default()
    };
    let given_up = told(&feedback).unwrap();
    assert_eq!(given_up.outcome, RunOutcome::Interrupted);
    assert_eq!(given_up.text, "ended by the order reset");
    // For a process that is lost, of which the launcher knows.
    feedback.ended.outcome = RunOutcome::Stopped as u32;
    assert!(told(&feedback).is_some_and(|of| !of.is_whole()));
    feedback.ended.outcome = 77;
    assert_eq!(told(&feedback), None);
}

#[test]
fn values_out_of_all_reason_do_not_upset_the_measurement() {
    let path = arc_path([0.0, 0.0], 25.0, 45.0, 90.0, 3000.0);
    let run = SyntheticRun::new(path.clone(), 1, QUIET);
    let mut analysis = Analysis::new(machine(&["X", "Y"]), path);
    for mut sample in run.samples() {
        match &mut sample {
            Sample::Feedback(sample) if sample.scan.is_multiple_of(50) => {
                sample.tag.element = u32::MAX;
                sample.axis_count = 99;
                sample.mode = 99;
                sample.axes[0].command_position = i64::MIN;
            }
            Sample::Instruments(sample) if sample.scan.is_multiple_of(70) => {
                sample.axes[0].table_mm[1] = f64::NAN;
                sample.subsamples = 4_000_000_000;
            }
            Sample::Command(sample) if sample.scan.is_multiple_of(90) => {
                sample.position = i64::MAX;
                sample.tag.distance_mm = f64::INFINITY;
                sample.following_error_mm = f64::NAN;
            }
            _ => {}
        }
        analysis.take(sample);
    }
    let measured = analysis.finish();
    assert!(measured.axes[0].following_error_mm.rms().is_finite());
}

/// A program of any length turns any number of times; the memory of its report is bounded.
#[test]
fn reversals_beyond_those_that_are_listed_are_counted() {
    let machine = machine(&["X", "Y"]);
    let mut meter = ReversalMeter::new(machine.axes[0].increment_mm());
    let most = reversal::REVERSALS_MAX as u64;
    for scan in 0..6 * most {
        let (position, pulse) = match scan % 4 {
            0 => (0, -1.0),
            1 => (500_000, 1.0),
            2 => (1_000_000, 1.0),
            _ => (500_000, -1.0),
        };
        meter.take(&AxisCommand {
            scan,
            position,
            friction_pulse_mm_s: pulse,
            ..bytemuck::Zeroable::zeroed()
        });
    }
    // One in two scans, from the fourth on.
    assert_eq!(meter.not_listed(), 2 * most - 1);
    let listed = meter.finish(0, &machine, &Path::default(), &[]);
    assert_eq!(listed.len() as u64, most);
    assert_eq!(listed[0].scan, 3);
    // The last one has its pulse as any other.
    assert_eq!(
        listed[1].kick_lead_ms,
        listed[listed.len() - 1].kick_lead_ms
    );
}
