//! The report of a real run says where its errors come from.

use std::fs;

use serde_json::Value;

use crate::support::{Bench, Run, circle_program, number, quadrant, run};

/// Lost motion of the plant, gap and wind-up 2·F/k, in µm: docs/methods/physics.md §3.
const LOST_MOTION_UM: [(&str, f64); 2] = [("X", 8.3), ("Y", 12.3)];

/// A controller that makes up for nothing.
const NO_COMPENSATION: [(&str, &str); 3] = [
    ("\"contact-force\"", "\"none\""),
    ("\nfriction = true", "\nfriction = false"),
    ("mode = \"on\"", "mode = \"off\""),
];

fn of<'a>(causes: &'a Value, cause: &str, axis: &str) -> Vec<&'a Value> {
    let all = causes.as_array().expect("a list");
    let all = all.iter();
    all.filter(|one| one["cause"] == cause && one["axis"] == axis)
        .collect()
}

/// The lost motion that is built into the machine is the one that the report finds from circles, where nothing makes up for it.
#[test]
fn a_run_without_compensation_shows_the_lost_motion_of_the_plant_and_its_reversal_spikes() {
    let bench = Bench::of("xy", &NO_COMPENSATION);
    let text = circle_program(25.0, 3_000.0, (0.0, 0.0), 45.0);
    let run = run(bench.path(), bench.file("circle.ngc", &text));
    let report = run.good_report();
    let bar = &report["ball_bar"][0];
    for (axis, size_um) in LOST_MOTION_UM {
        let lost = of(&bar["causes"], "lost-motion", axis);
        assert_eq!(lost.len(), 2, "both ends of {axis}: {bar}");
        for one in lost {
            let value_um = number(one, "/value");
            assert!((value_um - size_um).abs() < 1.0, "{axis}: {one}");
        }
        let spikes = of(&bar["causes"], "reversal-spike", axis);
        assert_eq!(spikes.len(), 2, "both ends of {axis}: {bar}");
        assert!(spikes.iter().all(|one| number(one, "/value") > 10.0));
    }
    assert!(number(bar, "/rest_rms_um") < 0.2 * number(bar, "/deviation_rms_um"));
    let both_um = number(bar, "/bidirectional_deviation_um");
    for way in ["counter_clockwise", "clockwise"] {
        let one_um = number(bar, &format!("/{way}/circular_deviation_um"));
        assert!((0.9 * both_um..=both_um + 0.5).contains(&one_um), "{bar}");
    }
    let parts = &report["contour_parts"]["parts"];
    // Lost motion and reversals of both axes come before everything else.
    for index in 0..4 {
        let cause = &parts[index]["cause"];
        assert!(cause == "reversal" || cause == "lost-motion", "{parts}");
    }

    // Made again, it is the same to the byte.
    let file = run.out.join("report.json");
    let before = fs::read(&file).expect("report.json");
    let output = quadrant().arg("report").arg(&run.out).output();
    assert!(output.expect("running quadrant").status.success());
    assert_eq!(fs::read(&file).expect("report.json"), before);
}

/// A shipped machine with one text of one of its files replaced, where it stands first.
fn changed(edits: &[(&str, &str)], file: &str, what: &str, by: &str) -> Bench {
    let bench = Bench::of("xy", edits);
    let path = bench.path().join(file);
    let text = fs::read_to_string(&path).expect("a file of the machine");
    assert!(text.contains(what), "{file} has no {what:?}");
    fs::write(&path, text.replacen(what, by, 1)).expect("writing it");
    bench
}

/// A circle of 25 mm, both ways, at this feed in mm/min.
fn circles(bench: &Bench, feed: f64) -> Run {
    let text = circle_program(25.0, feed, (0.0, 0.0), 45.0);
    run(bench.path(), bench.file("circle.ngc", &text))
}

/// The cause that leads the list of a run's only circle, and its size.
fn first_cause(run: &Run) -> (Value, f64) {
    let report = run.good_report();
    let bar = &report["ball_bar"][0];
    let first = bar["causes"][0].clone();
    let value = number(&first, "/value");
    (first, value)
}

/// With the gap of the shipped plant the lost motion of X is 8.3 µm; this one is 20 µm wider.
#[test]
fn a_gap_that_nobody_makes_up_for_leads_the_list_as_the_backlash_of_its_axis() {
    let bench = changed(
        &NO_COMPENSATION,
        "plant.toml",
        "gap_um = 5.0 ",
        "gap_um = 25.0 ",
    );
    let run = circles(&bench, 3_000.0);
    let (first, value_um) = first_cause(&run);
    assert_eq!(first["cause"], "lost-motion");
    assert_eq!(first["axis"], "X");
    let expected_um = LOST_MOTION_UM[0].1 + 20.0;
    assert!(
        (value_um - expected_um).abs() < 0.05 * expected_um,
        "{first}"
    );
    let text = fs::read_to_string(run.out.join("report.txt")).expect("report.txt");
    assert!(text.contains("backlash of X at its"), "{text}");
    let picture = fs::read_to_string(run.out.join("circle-1.svg")).expect("circle-1.svg");
    for words in [
        "What the deviation comes from",
        "1  backlash",
        "hysteresis H",
    ] {
        assert!(picture.contains(words), "no {words:?} in the picture");
    }
}

#[test]
fn axes_that_are_not_square_lead_the_list_with_their_angle() {
    let square = "[[axis.cross_talk]]\nfrom = \"Y\"\nsquareness_um_per_m = 400.0\n\n[axis.screw]";
    let bench = changed(&[], "plant.toml", "[axis.screw]", square);
    let (first, value) = first_cause(&circles(&bench, 3_000.0));
    assert_eq!(first["cause"], "squareness");
    assert_eq!(first["unit"], "µm/m");
    assert!((value - 400.0).abs() < 12.0, "{first}");
}

/// Without feed-forward an axis is late by the inverse of its position gain.
#[test]
fn axes_of_different_gains_lead_the_list_with_the_difference_of_their_lags() {
    let bench = changed(
        &[],
        "machine.toml",
        "gain_per_s = 50.0 ",
        "gain_per_s = 40.0 ",
    );
    let file = bench.path().join("machine.toml");
    let text = fs::read_to_string(&file).expect("machine.toml");
    let forward = "[axis.feed_forward]\nenabled = true";
    assert_eq!(text.matches(forward).count(), 2);
    let text = text.replace(forward, "[axis.feed_forward]\nenabled = false");
    let text = text.replace(
        "following_error_limit_mm = 2.0",
        "following_error_limit_mm = 20.0",
    );
    fs::write(&file, text).expect("writing it");
    let (first, value_ms) = first_cause(&circles(&bench, 3_000.0));
    assert_eq!(first["cause"], "servo-mismatch");
    assert_eq!(first["unit"], "ms");
    let late_ms = 1e3 / 40.0 - 1e3 / 50.0;
    assert!((value_ms - late_ms).abs() < 0.05 * late_ms, "{first}");
}

/// One direction does not tell the angle of the axes from their lags: the report says so and invents neither.
#[test]
fn a_circle_that_is_travelled_one_way_says_what_it_cannot_tell() {
    let square = "[[axis.cross_talk]]\nfrom = \"Y\"\nsquareness_um_per_m = 400.0\n\n[axis.screw]";
    let bench = changed(&[], "plant.toml", "[axis.screw]", square);
    let turn = "G3 X25 Y0 I-25 J0 F3000\n";
    let text = format!("G21 G17 G90 G94\nG0 X25 Y0\nG4 P0.2\n{turn}{turn}G4 P0.2\nM2\n");
    let run = run(bench.path(), bench.file("circle.ngc", &text));
    let report = run.good_report();
    assert!(report.get("ball_bar").is_none(), "{report}");
    let circle = &report["one_way_circles"][0];
    assert!(circle["clockwise"].is_null() && circle["hysteresis_um"].is_null());
    let first = &circle["causes"][0];
    assert_eq!(first["cause"], "squareness-or-servo-mismatch");
    // R·α/2.
    assert!((number(first, "/value") - 5.0).abs() < 0.25, "{circle}");
    for cause in ["squareness", "servo-mismatch"] {
        let all = circle["causes"].as_array().expect("a list");
        assert!(all.iter().all(|one| one["cause"] != cause), "{circle}");
    }
    let text = fs::read_to_string(run.out.join("report.txt")).expect("report.txt");
    assert!(text.contains("Travelled in one direction only"), "{text}");
}
